"""How long trial fits go on: until it is decided which of them is the best; and which that is."""

from types import SimpleNamespace

import pytest

from jbridge.diagnosis.selection.search import _Fit, _next_to, _undecided
from jbridge.diagnosis.structures import structure as structures
from jbridge.diagnosis.structures.structure import Structure, preferred
from jbridge.identification.estimation import Problem
from jbridge.identification.setting import Setting

GIVEN = ("coulomb_friction", "hoist")
CART, DRIVE, SWING = ("quadratic_drag", "cart"), ("input_delay", "cart_drive"), ("coulomb_friction", "swing")


def structure(value: float, names: tuple[tuple[str, str], ...], promise: float) -> Structure:
    """A model as far as its rank goes, without simulations."""
    made = object.__new__(Structure)
    made.__dict__.update(names=names, price=0.0, point=SimpleNamespace(value=value, promise=promise))
    return made


def fit(value: float, gained: float, *names: tuple[str, str], promise: float = 5.0) -> _Fit:
    return _Fit(structure(value, (GIVEN, *names), promise), gained)


SETTING = object.__new__(Setting)
object.__setattr__(SETTING, "axes", ("x", "psi", "l"))
NOW = structure(100.0, (GIVEN,), 0.0)


@pytest.mark.parametrize(
    ("fits", "go_on"),
    [
        ([], []),
        # It is better, and nothing else on its axis is near.
        ([fit(60.0, 30.0, CART)], []),
        # It may become better than the model that it is compared with, or it may not.
        ([fit(110.0, 30.0, CART)], [0]),
        ([fit(110.0, 5.0, CART)], []),
        ([fit(110.0, 30.0, CART, promise=0.01)], []),
        # The second may overtake the first, which then goes on, too; the third may not, or has arrived.
        ([fit(60.0, 9.0, CART), fit(65.0, 9.0, DRIVE), fit(75.0, 9.0, CART)], [0, 1]),
        ([fit(60.0, 9.0, CART), fit(65.0, 9.0, DRIVE, promise=0.01)], []),
        # Other axes are decided for themselves: effects on them are added together.
        ([fit(60.0, 9.0, CART), fit(65.0, 9.0, SWING)], []),
        # Models with an effect less are one group.
        ([fit(98.0, 3.0), fit(99.0, 3.0), fit(120.0, 3.0)], [0, 1]),
    ],
)
def test_a_fit_goes_on_while_it_may_still_be_the_best_on_its_axis(fits, go_on):
    assert sorted(_undecided(SETTING, NOW, fits)) == go_on


@pytest.mark.parametrize(
    ("steady", "chosen"),
    [
        # The map has the lowest value: it is taken if it gains steadily on what has fewer numbers, else the next one.
        ({("lag", "map"), ("drag", "map"), ("lag", "drag")}, "map"),
        ({("lag", "drag")}, "drag"),
        ({("drag", "map")}, "lag"),
        (set(), "lag"),
    ],
)
def test_more_numbers_are_taken_only_for_a_steady_gain(monkeypatch, steady, chosen):
    models = {}
    for name, value, numbers in (("map", 60.0, 8), ("drag", 70.0, 2), ("lag", 75.0, 1)):
        models[name] = structure(value, (GIVEN, (name, "cart")), 0.0)
        models[name].point.free = list(range(numbers))
    monkeypatch.setattr(structures, "accepts", lambda _, one, other: (one.names[-1][0], other.names[-1][0]) in steady)
    assert preferred(object.__new__(Problem), list(models.values())) is models[chosen]


@pytest.mark.parametrize(("steady", "chosen"), [(False, "plain"), (True, "clock")])
def test_what_looks_like_a_plainer_effect_is_taken_only_for_a_steady_gain(monkeypatch, steady, chosen):
    """At one rope length a wrong clock, scale and offset of the length leave the same, but for the last digits."""
    models = {
        "clock": structure(60.0, (GIVEN, ("clock_scale", "clock")), 0.0),
        "scale": structure(60.1, (GIVEN, ("sensor_scale", "l_sensor")), 0.0),
        "plain": structure(60.2, (GIVEN, ("sensor_offset", "l_sensor")), 0.0),
        "drag": structure(60.3, (GIVEN, ("load_drag", "swing")), 0.0),
    }
    for model in models.values():
        model.point.free = [0]
    monkeypatch.setattr(structures, "accepts", lambda _, one, other: steady and other.value < one.value)
    assert preferred(object.__new__(Problem), list(models.values())) is models[chosen]


def test_what_looks_like_a_plainer_effect_yields_to_that_alone(monkeypatch):
    models = [
        structure(60.0, (GIVEN, ("clock_scale", "clock")), 0.0),
        structure(75.0, (GIVEN, ("load_drag", "swing")), 0.0),
        structure(99.0, (GIVEN, ("sensor_offset", "l_sensor")), 0.0),
    ]
    for model in models:
        model.point.free = [0]
    monkeypatch.setattr(structures, "accepts", lambda _, one, other: one.value - other.value > 30.0)
    assert preferred(object.__new__(Problem), models) is models[0]


def test_each_of_two_effects_that_are_added_together_has_its_own_runner_up():
    """On the same axis alone; one that looks alike and is plainer comes first, and what it has by now is none."""
    clock, offset, lag = ("clock_scale", "clock"), ("sensor_offset", "l_sensor"), ("actuator_lag", "cart_drive")
    single = [structure(70.0, (GIVEN, clock), 0.0), structure(72.0, (GIVEN, SWING), 0.0)]
    single += [structure(75.0, (GIVEN, offset), 0.0), structure(80.0, (GIVEN, DRIVE), 0.0)]
    single += [structure(85.0, (GIVEN, lag), 0.0), structure(90.0, (GIVEN, CART), 0.0)]
    best = structure(60.0, (GIVEN, clock, DRIVE), 0.0)
    setting = object.__new__(Setting)
    object.__setattr__(setting, "axes", ("x", "psi"))
    found = _next_to(setting, NOW, best, [best, *single])
    assert {new: other.names[-1] for new, other in found.items()} == {clock: offset, DRIVE: lag}
    # What replaces an effect is no addition.
    assert _next_to(setting, best, single[0], single) == {}
