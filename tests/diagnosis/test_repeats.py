"""Whether a missing force repeats: a force of the place does, one of each run's own does not, and noise is neither."""

import numpy as np
import pytest

from jbridge.diagnosis.adequacy import FORESEEN
from jbridge.diagnosis.repeats import repeating_share
from jbridge.identification.problem import Setting
from jbridge.identify.linearise import Engine
from jbridge.identify.setting import lanes_for
from tests.identify.cases import DRY, NOISE, play, steps
from tests.problems import EVERY_AXIS, make_plant

BASE = make_plant(DRY)
COUNT = 1200


def shares_of(base, recordings, noise, changed=lambda predicted: predicted):
    setting = Setting(tuple(recordings), (), NOISE, ("x",), {}, 0.7)
    engine = Engine(base)
    batch = lanes_for(engine.table, base, setting, recordings)
    predicted = np.array(engine.motions(np.array(engine.table.ravel(base), dtype=float), batch.initial, batch)[1])
    return repeating_share(base, batch, changed(predicted), noise)


def play_cart(seed, extra):
    u = np.stack([1.6 * steps(COUNT, seed, hold=60), np.zeros(COUNT)], axis=1)
    return play(make_plant(DRY, *extra), u, name=f"{seed}.csv", start={"x": 0.6}, seed=seed)


def share_of(*extra_by_run):
    """The shares for one recording a plant, each with an effect that the model does not have."""
    return shares_of(BASE, [play_cart(seed, extra) for seed, extra in enumerate(extra_by_run)], {"x": NOISE["x"]})


def ripple(phase, amplitude=1.5):
    return [("periodic_force", "cart", {"amplitude": amplitude, "period": 0.3, "phase": phase})]


def test_a_force_of_the_place_repeats():
    assert share_of(*[ripple(0.4)] * 4)["x"] > 0.5


def test_a_force_of_each_runs_own_does_not():
    assert share_of(*(ripple(phase) for phase in (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)))["x"] < 0.2


def test_noise_is_not_judged():
    assert "x" not in share_of(*[[]] * 4)
    assert "x" not in share_of([])


def test_one_recording_is_taken_in_quarters_and_counts_less():
    assert FORESEEN < share_of(ripple(0.4))["x"] <= 0.6


def test_a_recording_that_the_simulation_left_has_no_say():
    recordings = [play_cart(seed, ripple(0.4)) for seed in range(4)]

    def astray(predicted):
        predicted[1] = np.nan
        times = np.arange(COUNT + 1) * 0.01
        predicted[2, : COUNT + 1, 0] += 0.2 * np.sin(5.0 * times)
        return predicted

    two = shares_of(BASE, [recordings[0], recordings[3]], {"x": NOISE["x"]})
    assert shares_of(BASE, recordings, {"x": NOISE["x"]}, astray)["x"] == pytest.approx(two["x"], abs=0.02)
    assert shares_of(BASE, recordings, {"x": NOISE["x"]}, lambda predicted: predicted * np.nan) == {}


def test_a_short_wave_along_the_rope_repeats():
    """Of a hoist the length is the place, and is looked at as closely as a cart's."""
    knots = np.linspace(0.3, 1.2, 21)

    def winch(levels):
        return make_plant(("position_dependent_friction", "hoist", {"knots": knots, "levels": levels}))

    recordings = []
    for seed in range(4):
        u = np.stack([np.zeros(COUNT), 2.5 * steps(COUNT, seed, hold=60) - 0.45], axis=1)
        true = winch(np.where(np.arange(21) % 2, 1.6, 2.4))
        recordings.append(play(true, u, name=f"{seed}.csv", start={"l": 0.7}, seed=seed, active=EVERY_AXIS))
    assert shares_of(winch(np.full(21, 2.0)), recordings, NOISE)["l"] > 0.5


def test_a_force_far_below_the_blur_of_reversals_is_seen():
    """The balance smooths friction that jumps by 7 N."""
    assert share_of(*[ripple(0.4, amplitude=0.05)] * 4)["x"] > 0.5


def test_a_force_far_below_the_noise_is_not_judged():
    assert "x" not in share_of(*[ripple(0.4, amplitude=0.001)] * 4)
    assert "x" in share_of(*[ripple(0.4)] * 4)
