"""Pieces of a recording know what was commanded before them, since a lag or a delay still feels it."""

from dataclasses import replace

import numpy as np
import pytest

from jbridge import load_recording
from jbridge.identification.evaluation.judge import make_judge
from jbridge.identification.residual_force import balance
from jbridge.identification.setting import make_setting
from jbridge.prediction import simulate
from tests.identification.cases import NOISE, cart_model, play, steps
from tests.problems import make_plant

LAG = ("actuator_lag", "cart_drive", {"time_constant": 0.08})
SLOW = ("input_delay", "cart_drive", {"delay": 0.05})
COUNT = 600


@pytest.fixture(scope="module")
def run():
    u = np.stack([steps(COUNT, 3, hold=30), np.zeros(COUNT)], axis=1)
    return play(make_plant(LAG, SLOW), u, start={"x": 0.6}, seed=1)


def test_a_piece_of_a_piece_has_all_that_was_before(run):
    piece = run.rows(slice(100, 500)).rows(slice(50, None))
    assert len(piece.times) == 350 and piece.start == run.times[150]
    assert piece.begun == pytest.approx(run.times[150] - run.times[0])
    np.testing.assert_array_equal(piece.earlier.times, run.times[:150])
    np.testing.assert_array_equal(piece.earlier.u_x, run.u_x[:150])
    np.testing.assert_array_equal(piece.commands.u_x, run.u_x[:500])
    assert run.rows(slice(None, 100)).earlier is None


def test_drives_start_as_they_were(run):
    """The true model meets a piece that begins while the drive answers; without what was before, it is far off."""
    model = cart_model(LAG, SLOW)
    begin = int(np.flatnonzero(np.diff(run.u_x))[5]) + 3  # the drive has not yet heard of the step before
    piece = run.rows(slice(begin, None))
    alone = replace(piece, earlier=None)

    def error(recording):
        setting = make_setting(model, [run], [recording])
        return make_judge(setting, [recording], setting.noise).evaluate(model.plant).errors(np.inf)["x"]

    assert error(piece) < 1.1 * NOISE["x"] and error(alone) > 10 * NOISE["x"]

    def force(recording):
        left = balance(model.plant, recording).force["x"][:20]
        return float(np.sqrt(np.nanmean(left**2)))

    assert force(piece) < 0.5 * force(alone)


def test_simulate_feels_what_was_before():
    """A piece that begins between a command and the drive's answer to it."""
    model = cart_model(LAG, SLOW)
    u = np.stack([np.where(np.arange(100) < 20, 0.0, 1.5), np.zeros(100)], axis=1)
    run = play(model.plant, u, start={"x": 0.6}, noise=0.0)
    whole, piece = (simulate(model, each, "first-row") for each in (run, run.rows(slice(23, None))))
    np.testing.assert_allclose(piece["x"], whole["x"][23:], rtol=0, atol=1e-12)


def test_time_goes_on_in_a_piece():
    """Gains that drift go by the time since the run began, in `simulate` and in the force balance."""
    drift = ("gain_drift", "cart_drive", {"rate": -0.05})
    model = cart_model(drift)
    u = np.stack([steps(COUNT, 4, hold=30), np.zeros(COUNT)], axis=1)
    run = play(model.plant, u, start={"x": 0.6}, noise=0.0)
    late = run.rows(slice(400, None))
    left = balance(model.plant, late).force["x"]
    young = balance(model.plant, replace(late, begun=0.0)).force["x"]
    sizes = [np.sqrt(np.nanmean(force**2)) for force in (left, young)]
    assert sizes[0] < 0.5 * sizes[1], sizes
    aged, new = (simulate(model, each, "first-row")["x"] for each in (late, replace(late, begun=0.0)))
    assert np.ptp(aged - new) > 1e-3


def test_trimmed_rows_still_drive(tmp_path):
    """Back to the last row with no number, or with one that no drive is given."""
    rows = [
        f"{0.01 * i:.2f},{'nan' if i == 3 else 9e37 if i == 4 else 0.1 * i},0.0,{0.0001 * i * i}" for i in range(200)
    ]
    (tmp_path / "run.csv").write_text("t,u_x,u_l,x\n" + "\n".join(rows) + "\n")
    (tmp_path / "run.toml").write_text("[trim]\nstart = 0.095\n[columns]\nu_l = false\n")
    found = load_recording(tmp_path / "run.csv")
    np.testing.assert_allclose(found.earlier.times, 0.01 * np.arange(5, 10))
    np.testing.assert_allclose(found.earlier.u_x, 0.1 * np.arange(5, 10))
    assert found.earlier.u_l is None and found.start == pytest.approx(0.10)
