"""A hold-out that shows what the recordings hardly do: slow runs to learn from, and fast ones to prove it."""

import numpy as np
import pytest

from jbridge import diagnose
from jbridge.diagnosis.adequacy import LARGE, NOTICEABLE
from tests.identify.cases import DRY, cart_model, play, scaled, steps
from tests.problems import make_plant

NUMBERS = {"cart_damping": 30.0, "cart_gain": 16.0}
START = {"cart_damping": 0.95, "cart_gain": 1.05, "coulomb_friction@cart.level": 0.95}
DRAG = 1.0
"""Drag [N s^2/m^2] that moves slow runs by less than noise."""


def run(name, seed, volts, *more, gain=NUMBERS["cart_gain"]):
    u = np.stack([steps(800, seed, hold=50, volts=volts), np.zeros(800)], axis=1)
    plant = make_plant(DRY, *more, **(NUMBERS | {"cart_gain": gain}))
    return play(plant, u, name=name, start={"x": 0.6}, seed=seed)


def diagnosed(slow, held_out):
    return diagnose(scaled(cart_model(DRY, **NUMBERS), START), slow, held_out)


def slow(count, *more, volts=0.6):
    return [run(f"slow-{i}.csv", i, volts, *more) for i in range(count)]


def fast(count, *more, **other):
    return [run(f"fast-{i}.csv", 10 + i, 2.0, *more, **other) for i in range(count)]


DRAGGED = ("quadratic_drag", "cart", {"coefficient": DRAG})
WEAK = {"gain": 0.9 * NUMBERS["cart_gain"]}
"""A drive that is weaker in the hold-out than in any recording: no law learned from these foresees it."""


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_what_hardly_shows_is_named_if_the_hold_out_proves_it(count):
    """Nothing is noticeable in the recordings, and nothing but the hold-out says that there is something to find."""
    found = diagnosed(slow(3, DRAGGED, volts=0.56), fast(count, DRAGGED))
    assert all(channel.ratio < NOTICEABLE for channel in found.adequacy.channels.values())
    assert found.verdict == "missing_physics" and found.adequacy.alarm
    (effect,) = found.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    assert effect.parameters["coefficient"].value == pytest.approx(DRAG, rel=0.2)
    assert len(found.holdout) == count
    assert found.holdout_after.free_run["x"] < 0.1 * found.holdout_before.free_run["x"]


@pytest.mark.slow
def test_the_search_goes_on_where_the_hold_out_shows_more():
    """A lag leaves large errors, and once it has a name the drag leaves nothing that shows in slow runs."""
    lag = ("actuator_lag", "cart_drive", {"time_constant": 0.03})
    found = diagnosed(slow(3, DRAGGED, lag), fast(1, DRAGGED, lag))
    assert found.verdict == "missing_physics"
    assert {(e.kind, e.site) for e in found.effects} == {("actuator_lag", "cart_drive"), ("quadratic_drag", "cart")}
    assert found.holdout_after.free_run["x"] < 0.02 * found.holdout_before.free_run["x"]


@pytest.mark.slow
def test_what_no_name_foresees_is_said():
    found = diagnosed(slow(3), fast(1, **WEAK))
    assert found.verdict == "unknown" and not found.effects and not found.adequacy.alarm
    assert "but not the hold-out" in found.statement and "cart position" in found.statement
    assert (found.location.site, found.location.equation) == (None, "cart")
    assert found.holdout == ("fast-0.csv",)


@pytest.mark.slow
def test_a_name_for_a_small_error_falls_with_the_hold_out():
    """Drag in all recordings, none in the hold-out: a name that explains the recordings whole proves nothing there."""
    found = diagnosed([run(f"slow-{i}.csv", i, 0.8, DRAGGED) for i in range(3)], fast(1))
    assert all(channel.ratio < LARGE for channel in found.adequacy.channels.values())
    assert found.verdict != "missing_physics" and not found.effects
    (row,) = [t for t in found.trials if t["why"] == "does not hold on the hold-out"]
    assert (row["kind"], row["site"], row["accepted"]) == ("quadratic_drag", "cart", False)


@pytest.mark.slow
def test_one_that_alone_shows_it_is_not_learned_from():
    """It would be taken away from the proof, and the others prove nothing."""
    four = slow(4)
    found = diagnosed(four[:3], [four[3], *fast(1, **WEAK)])
    assert found.verdict == "unknown" and found.holdout == ("slow-3.csv", "fast-0.csv")
    assert not any("learned from, too" in note for note in found.notes)


@pytest.mark.slow
def test_of_two_one_is_learned_from_and_the_other_proves_it():
    """So slow that no name can be learned."""
    found = diagnosed(slow(3, DRAGGED, volts=0.4), fast(2, DRAGGED))
    assert found.verdict == "missing_physics"
    (effect,) = found.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    assert effect.parameters["coefficient"].value == pytest.approx(DRAG, rel=0.05)
    (note,) = [note for note in found.notes if "learned from, too" in note]
    (left,) = found.holdout
    assert left.startswith("fast-") and left not in note


@pytest.mark.slow
def test_numbers_that_slow_runs_leave_uncertain_are_no_surprise():
    found = diagnosed(slow(3), fast(2))
    assert found.verdict == "adequate" and len(found.holdout) == 2
