"""Whether a missing force repeats: a force of the place does, one of each run's own does not, and noise is neither."""

import numpy as np

from jbridge.diagnosis.repeats import _edges, repeating_share
from jbridge.identify.force_balance import Balance
from jbridge.identify.linearise import Engine
from jbridge.identify.setting import Setting, lanes_for
from tests.identify.cases import DRY, NOISE, play, steps
from tests.problems import make_plant

BASE = make_plant(DRY)
COUNT = 1200


def share_of(*extra_by_run):
    """The share for one recording a plant, each with an effect that the model does not have."""
    recordings = []
    for seed, extra in enumerate(extra_by_run):
        u = np.stack([1.6 * steps(COUNT, seed, hold=60), np.zeros(COUNT)], axis=1)
        recordings.append(play(make_plant(DRY, *extra), u, name=f"{seed}.csv", start={"x": 0.6}, seed=seed))
    setting = Setting(tuple(recordings), (), NOISE, ("x",), {}, 0.7)
    engine = Engine(BASE)
    batch = lanes_for(engine.table, BASE, setting, recordings)
    vector = np.array(engine.table.ravel(BASE), dtype=float)
    predicted = np.asarray(engine.motions(vector, batch.initial, batch)[1])
    return repeating_share(BASE, recordings, batch, predicted, {"x": NOISE["x"]})


def ripple(phase, amplitude=1.5):
    return [("periodic_force", "cart", {"amplitude": amplitude, "period": 0.3, "phase": phase})]


def test_a_force_of_the_place_repeats():
    assert share_of(*[ripple(0.4)] * 4)["x"] > 0.5


def test_a_force_of_each_runs_own_does_not():
    assert share_of(*(ripple(phase) for phase in (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)))["x"] < 0.2


def test_noise_does_not():
    assert share_of(*[[]] * 4).get("x", 0.0) < 0.2


def test_one_recording_is_taken_in_quarters():
    assert share_of(ripple(0.4))["x"] > 0.1
    assert share_of([]).get("x", 0.0) < 0.05


def test_a_channel_that_flickers_once_is_no_place():
    """Its range is not nothing, but nearly all of its values are one."""
    steady = np.full(2000, 0.7)
    flicker = steady.copy()
    flicker[5:7] += 1e-4
    force = np.random.default_rng(0).normal(size=2000)
    motion = np.sin(np.arange(2000) * 0.01)
    runs = [
        Balance(np.arange(2000) * 0.005, {"x": motion, "l": flicker}, {"x": motion}, {"x": force}, {"u_x": motion})
        for _ in range(3)
    ]
    edges = _edges(runs, "x")
    assert "l" not in edges and {"x", "v_x", "u_x"} <= set(edges)


def test_a_force_far_below_the_blur_is_not_judged():
    assert "x" not in share_of(*[ripple(0.4, amplitude=0.03)] * 4)
    assert "x" in share_of(*[ripple(0.4)] * 4)
