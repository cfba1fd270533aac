"""Maps of friction choose how many places they have, from what recordings left out say."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.revise import coarser, completed, finer, prune
from jbridge.diagnosis.search import Search
from jbridge.diagnosis.trials import as_trial
from jbridge.identification.problem import make_setting
from jbridge.identify.linearise import Engine
from jbridge.identify.setting import lanes_for
from jbridge.model.files import Model
from tests.identify.cases import DRY, cart_recordings
from tests.problems import NUMBERS, make_plant

PLACES = np.linspace(0.2, 1.3, 8)
MAP = Candidate("position_dependent_friction", "cart", {}, ("levels",), False)


def accepted(true_knots, true_levels):
    """A search whose latest acceptance is a map with eight places, and the fit of it."""
    friction = ("position_dependent_friction", "cart")
    rig = make_plant(DRY, (*friction, {"knots": list(true_knots), "levels": list(true_levels)}), cart_damping=30.0)
    runs = cart_recordings(rig, 4, seed=5)
    low, high = min(run.x.min() for run in runs), max(run.x.max() for run in runs)
    start = {"knots": list(np.linspace(low, high, 8)), "levels": [0.5] * 7 + [0.0]}
    plant = make_plant(DRY, (*friction, start), cart_damping=30.0)
    known = frozenset(("cart_mass", "load_mass", "winch_mass", "gravity"))
    setting = make_setting(Model(plant, known, frozenset(NUMBERS), {}, "m.toml"), runs, ())
    search = Search(plant, known, setting, None)
    guess = lanes_for(Engine(plant).table, plant, setting, setting.recordings).initial
    near = search.polish(plant, known, guess, (MAP,))
    return search, search.polish(near.plant, known, near.initial, (MAP,))


def places(state):
    return len(state.plant.effects[-1].knots)


@pytest.mark.slow
def test_a_jagged_friction_gets_more_places():
    knots = np.linspace(0.2, 1.3, 16)
    search, state = accepted(knots, np.where(np.arange(16) % 2, 1.5, 0.0))
    assert state.worst > 2.0
    found = finer(search, state)
    assert places(found) in (15, 29) and found.chi < 0.6 * state.chi


@pytest.mark.slow
def test_a_smooth_friction_gets_fewer():
    search, state = accepted([0.0, 1.5], [0.0, 2.0])
    assert finer(search, state) is state
    found = coarser(search, state)
    assert places(found) == 3 and found.chi < 1.02 * state.chi


@pytest.mark.slow
def test_a_belt_of_which_nothing_is_left_beside_the_delay_it_stood_for_is_dropped_before_its_steps_are_taken():
    late = ("input_delay", "cart_drive", {"delay": 0.015})
    numbers = {"stiffness": 3e4, "damping": 50.0}
    light, sound = (("belt_compliance", "cart", numbers | {"motor_mass": mass}) for mass in (0.01, 1.5))
    runs = cart_recordings(make_plant(DRY, late, cart_damping=30.0), 2, seed=5)
    belt = Candidate("belt_compliance", "cart", {}, ("stiffness", "damping", "motor_mass"), False)
    delay = Candidate("input_delay", "cart_drive", {}, ("delay",), False)
    known = frozenset(("cart_mass", "load_mass", "winch_mass", "gravity"))
    plain, ringing, kept = (make_plant(DRY, *more, late, cart_damping=30.0) for more in ((), (light,), (sound,)))
    setting = make_setting(Model(plain, known, frozenset(NUMBERS), {}, "m.toml"), runs, ())
    search = Search(plain, known, setting, None)
    guess = lanes_for(Engine(plain).table, plain, setting, setting.recordings).initial
    fitted = search.polish(plain, known, guess, (belt, delay))
    chosen = dataclasses.replace(as_trial(fitted, delay, 50.0), plant=ringing)
    polished, polish = [], search.polish
    search.polish = lambda plant, *rest: polished.append(plant) or polish(plant, *rest)
    found = completed(search, dataclasses.replace(fitted, accepted=(belt,)), chosen)
    assert found.accepted == (delay,) and found.chi < 1.1
    assert [effect.kind for effect in polished[0].effects] == ["coulomb_friction", "input_delay"]
    # Where the model cannot do without it, it stays, whatever it costs.
    polished.clear()
    needed = dataclasses.replace(chosen, cost=0.5 * fitted.cost)
    search.polish = lambda plant, *rest: polished.append(plant) or fitted
    assert completed(search, dataclasses.replace(fitted, accepted=(belt,)), needed) is fitted
    assert polished[-1] is ringing and len(polished) == 2
    # And no steps of a usual belt raise the question.
    polished.clear()
    usual = dataclasses.replace(chosen, plant=kept)
    assert completed(search, dataclasses.replace(fitted, accepted=(belt,)), usual) is fitted
    assert polished == [kept]


@pytest.mark.slow
def test_of_two_laws_of_friction_one_of_which_holds_the_other_one_stays():
    """Dry friction was accepted first, and what it lacks beside it: together they are the second law."""
    true = {"level": 1.0, "breakaway": 4.0, "velocity": 0.05}
    drag = ("quadratic_drag", "cart", {"coefficient": 40.0})
    runs = cart_recordings(make_plant(("stribeck_friction", "cart", true), drag, cart_damping=30.0), 3, seed=5)
    plain = Candidate("coulomb_friction", "cart", {}, ("level",), False)
    more = Candidate("stribeck_friction", "cart", {}, ("breakaway", "velocity"), False)
    other = Candidate("quadratic_drag", "cart", {}, ("coefficient",), False)
    beside = ("stribeck_friction", "cart", true | {"level": 0.0, "breakaway": 3.0})
    plant = make_plant(("coulomb_friction", "cart", {"level": 1.0}), beside, drag, cart_damping=30.0)
    known = frozenset(("cart_mass", "load_mass", "winch_mass", "gravity"))
    setting = make_setting(Model(plant, known, frozenset(NUMBERS), {}, "m.toml"), runs, ())
    search = Search(plant, known, setting, None)
    guess = lanes_for(Engine(plant).table, plant, setting, setting.recordings).initial
    found = prune(search, search.polish(plant, known, guess, (plain, more, other)))
    assert [candidate.name for candidate in found.accepted] == [more.name, other.name]
    assert found.chi < 1.2 and set(found.without) == {more.name, other.name}
    # The cost without it is that without any dry friction.
    assert found.without[more.name] > 4 * found.cost
    law = next(effect for effect in found.plant.effects if effect.kind == "stribeck_friction")
    assert float(law.level) == pytest.approx(1.0, abs=0.3) and float(law.breakaway) == pytest.approx(4.0, rel=0.1)
