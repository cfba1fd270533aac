"""The force that a recording needs beyond a model: of recordings whose missing force is known."""

import dataclasses

import numpy as np
import pytest

from jbridge.identification.data.grid import grid
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import engine_for
from jbridge.identification.residual_force import as_played, balance
from jbridge.identification.sensitivity.engine import Job
from jbridge.identification.setting import Setting
from tests.identification.cases import DRY, NOISE, play, steps
from tests.problems import make_plant

COUNT = 1200
DRIFT = ("friction_drift", "cart", {"level": 1.0, "rate": 0.4})
BASE = make_plant(DRY)


def push(force):
    return make_plant(DRY, ("constant_force", "cart", {"level": force}))


def recorded(plant, noise=1.0):
    u = np.stack([1.6 * steps(COUNT, 3, hold=60), np.zeros(COUNT)], axis=1)
    return play(plant, u, start={"x": 0.6}, noise=noise)


def own_motion(plant, recording):
    """The model's readings under the recording's input."""
    data = make_data([recording], (WHOLE,), NOISE)
    engine = engine_for(Setting((recording,), NOISE, ("x",), {}, 0.7), data, plant)
    vector = np.array(engine.table.ravel(plant), dtype=float)
    [tiling] = data.tilings
    [predicted] = engine.predict([Job(vector, 0, tiling.begins, tiling.states)])
    return as_played(data.grids[0], predicted)


def rms(force):
    return float(np.sqrt(np.nanmean(force**2)))


def test_blur_cancels_and_the_missing_force_stays():
    recording = recorded(push(0.2))
    whole = balance(BASE, recording)
    # The same sticking and sliding, so that only smoothing and the push are left.
    own = balance(BASE, own_motion(push(0.2), recording))
    left = whole.less(own).force["x"]
    truly_own = balance(BASE, own_motion(BASE, recording))
    assert rms(whole.force["x"]) > 0.4  # blur
    assert rms(left) < 0.05
    assert whole.blurred_like(truly_own, "x")
    assert np.nanmedian(whole.less(truly_own).force["x"]) == pytest.approx(0.2, abs=0.02)


def of_rows(recording, rows):
    return dataclasses.replace(
        recording,
        times=recording.times[rows],
        x=recording.x[rows],
        u_x=recording.u_x[rows],
        u_l=None if recording.u_l is None else recording.u_l[rows],
        fresh={"x": recording.fresh["x"][rows]},
    )


def test_no_force_is_told_of_across_a_gap_and_none_arises_at_the_ends():
    recording = recorded(BASE, noise=0.1)
    there = (recording.times < 4.0) | (recording.times > 4.8)
    whole, cut = (balance(BASE, each) for each in (recording, of_rows(recording, there)))
    assert np.isfinite(whole.force["x"][(whole.times > 4.0) & (whole.times < 4.8)]).any()
    assert np.isnan(cut.force["x"][(cut.times > 4.0) & (cut.times < 4.8)]).all()
    ends = (whole.times < 0.35) | (whole.times > whole.times[-1] - 0.35)
    assert rms(whole.force["x"][ends]) < 2.0 * rms(whole.force["x"][~ends])


def test_a_motion_far_off_is_not_blurred_alike():
    recording = recorded(BASE)
    other = dataclasses.replace(recording, x=recording.x + 0.2 * np.sin(5.0 * recording.times))
    assert not balance(BASE, recording).blurred_like(balance(BASE, other), "x")
    nowhere = as_played(grid(recording, 0.015), np.full((COUNT + 1, 3), np.nan))
    assert not balance(BASE, recording).blurred_like(balance(BASE, nowhere), "x")


def test_as_played_takes_the_models_readings():
    recording = recorded(BASE)
    predicted = np.zeros((COUNT + 1, 3))
    predicted[:, 0] = np.linspace(0.2, 0.9, COUNT + 1)
    at = grid(recording, 0.015)
    assert np.allclose(as_played(at, predicted).x, predicted[:, 0], atol=1e-12)
    assert as_played(at, predicted).psi is None and np.array_equal(as_played(at, predicted).u_x, recording.u_x)


def test_time_goes_on_in_the_last_part_of_a_recording():
    """A part that is held out has its own first sample, and the rig's time does not begin there."""
    plant = make_plant(DRIFT)
    recording = recorded(plant, noise=0.0)
    rows = recording.times >= 8.0
    part = of_rows(recording, rows)
    late = balance(plant, dataclasses.replace(part, begun=float(part.times[0]))).force["x"]
    early = balance(plant, dataclasses.replace(part, begun=0.0)).force["x"]
    # Without it, friction is 3.2 N too small, one way or the other.
    assert np.nanmedian(np.abs(late)) < 0.2 and np.nanmedian(np.abs(early)) > 2.5
