"""A hold-out that shows what the recordings hardly do: slow runs to learn from, and fast ones to prove it."""

import numpy as np
import pytest

from jbridge import diagnose
from tests.identify.cases import DRY, cart_model, play, scaled, steps
from tests.problems import make_plant

NUMBERS = {"cart_damping": 30.0, "cart_gain": 16.0}
START = {"cart_damping": 0.95, "cart_gain": 1.05, "coulomb_friction@cart.level": 0.95}
DRAG = 1.0
"""Drag [N s^2/m^2] that moves slow runs by less than noise."""


def run(name, seed, volts, *more):
    u = np.stack([steps(800, seed, hold=50, volts=volts), np.zeros(800)], axis=1)
    return play(make_plant(DRY, *more, **NUMBERS), u, name=name, start={"x": 0.6}, seed=seed)


def diagnosed(count, *more):
    """Three slow runs to learn from, and so many fast ones held out."""
    slow = [run(f"slow-{i}.csv", i, 0.6, *more) for i in range(3)]
    fast = [run(f"fast-{i}.csv", 10 + i, 2.0, *more) for i in range(count)]
    return diagnose(scaled(cart_model(DRY, **NUMBERS), START), slow, fast)


DRAGGED = ("quadratic_drag", "cart", {"coefficient": DRAG})


def test_what_only_the_hold_out_shows_is_said():
    found = diagnosed(1, DRAGGED)
    assert found.verdict == "unknown" and not found.effects and not found.adequacy.alarm
    assert "but not the hold-out" in found.statement and "cart position" in found.statement
    assert (found.location.site, found.location.equation) == (None, "cart")
    assert found.holdout == ("fast-0.csv",)


def test_one_that_alone_shows_it_is_not_learned_from():
    """It would be taken away from the proof, and the others prove nothing."""
    slow = [run(f"slow-{i}.csv", i, 0.6, DRAGGED) for i in range(4)]
    found = diagnose(scaled(cart_model(DRY, **NUMBERS), START), slow[:3], [slow[3], run("fast.csv", 10, 2.0, DRAGGED)])
    assert found.verdict == "unknown" and found.holdout == ("slow-3.csv", "fast.csv")
    assert not any("learned from, too" in note for note in found.notes)


def test_of_two_one_is_learned_from_and_the_other_proves_it():
    found = diagnosed(2, DRAGGED)
    assert found.verdict == "missing_physics"
    (effect,) = found.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    assert effect.parameters["coefficient"].value == pytest.approx(DRAG, rel=0.05)
    (note,) = [note for note in found.notes if "learned from, too" in note]
    (left,) = found.holdout
    assert left.startswith("fast-") and left not in note


def test_numbers_that_slow_runs_leave_uncertain_are_no_surprise():
    found = diagnosed(2)
    assert found.verdict == "adequate" and len(found.holdout) == 2
