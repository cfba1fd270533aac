"""A force without a name explains what is left, and leaves the numbers that have names alone."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.adequacy import LARGE
from jbridge.diagnosis.attempt import Attempt
from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.curve import force_without_a_name, of_place_alone
from jbridge.diagnosis.judge import settle
from jbridge.diagnosis.rounds import Explained, accept_effects
from jbridge.diagnosis.search import Search, state_of
from jbridge.diagnosis.steps import Step
from jbridge.diagnosis.trials import as_trial
from jbridge.identification.problem import make_setting
from jbridge.identify.base import base_fit
from jbridge.identify.linearise import Engine
from jbridge.identify.setting import lanes_for
from tests.identify.cases import DRY, cart_model, cart_recordings
from tests.problems import make_plant


@pytest.mark.slow
def test_a_curve_takes_up_what_is_left_and_nothing_else():
    bump = ("end_stop", "cart", {"position": 0.8, "stiffness": 40.0, "damping": 0.0})
    runs = cart_recordings(make_plant(DRY, bump, cart_damping=50.0, cart_gain=15.0), 3, seconds=6.0)
    model = cart_model(DRY, cart_damping=50.0, cart_gain=15.0)
    setting = make_setting(model, runs, ())
    base = base_fit(model.plant, model.known, setting)
    state = state_of(base.engine, base.free_run, base.fits, model.known)
    found = force_without_a_name(Search(model.plant, model.known, setting, None), state)
    assert found is not None and found.cost < 0.5 * state.cost
    assert found.plant.effects[-1].kind == "residual_force" and found.plant.effects[-1].site == "cart"
    for name in state.engine.table.names():
        ours, theirs = found.engine.table.positions(name), state.engine.table.positions(name)
        np.testing.assert_array_equal(found.vector[ours], state.vector[theirs], err_msg=name)
    names = {found.engine.table.entry(int(place)).group for place in found.free}
    assert names == {"residual_force@cart.by_place", "residual_force@cart.by_speed"}


KNOTS = np.linspace(0.2, 1.3, 8)
WAYS = {"positive": 1.0, "negative": -1.0}
MAP = Candidate("position_direction_friction", "cart", {}, ("positive", "negative"), False)


def with_a_map(*effects, given=(DRY,)):
    """A search, and the fit of a map of friction to recordings of a rig that has something else, or such a map."""
    runs = cart_recordings(make_plant(DRY, *effects, cart_damping=30.0), 4, seed=5)
    start = {"knots": list(KNOTS), "positive": [0.5] * 8, "negative": [0.5] * 7 + [0.0]}
    model = cart_model(*given, ("position_direction_friction", "cart", start), cart_damping=30.0)
    setting = make_setting(model, runs, ())
    search = Search(model.plant, model.known, setting, None)
    guess = lanes_for(Engine(model.plant).table, model.plant, setting, setting.recordings).initial
    return search, search.polish(model.plant, model.known, guess, (MAP,))


HOLLOW = np.array([0.0, 0.0, 1.5, -1.5, 0.7, 0.0, 0.0, 0.0])
CURVE = {"places": list(KNOTS), "by_place": list(HOLLOW), "speeds": [-1.0, 1.0], "by_speed": [0.0, 0.0]}


@pytest.mark.slow
@pytest.mark.parametrize("given", [(DRY,), ()])
def test_a_force_of_the_place_is_no_friction(given):
    search, state = with_a_map(("residual_force", "cart", CURVE), given=given)
    bare, found = of_place_alone(search, state, MAP)
    # Where the model has no friction yet, what is the same everywhere is found, and has a name.
    plain = [] if given else [DRY[:2]]
    assert [a.name for a in bare.accepted] == [a.name for a in found.accepted] == plain
    assert bare.chi > 3.0 and found.chi < 1.1 and len(found.free) <= len(state.free)
    assert float(found.plant.effects[0].level) == pytest.approx(DRY[2]["level"], rel=0.01)
    told = found.plant.effects[-1]
    assert told.kind == "residual_force" and not np.any(told.by_speed)
    inside = (KNOTS > 0.4) & (KNOTS < 1.1)
    np.testing.assert_allclose(np.interp(KNOTS, told.places, told.by_place)[inside], HOLLOW[inside], atol=0.1)
    # A model file that keeps a curve cannot be given another one there.
    assert of_place_alone(search, dataclasses.replace(found, accepted=(MAP,)), MAP) is None
    assert force_without_a_name(search, found) is None


@pytest.mark.slow
@pytest.mark.parametrize(("common", "apart"), [(1.0, 0.0), (1.0, 0.7), (0.5, 1.0)])
def test_friction_by_place_and_direction_is_no_force_of_the_place(common, apart):
    """The less its levels in both directions have in common, the more it looks like one: of the last, a fit decides."""
    levels = {way: 1.5 + common * np.sin(7 * KNOTS) + sign * apart * np.cos(9 * KNOTS) for way, sign in WAYS.items()}
    friction = {"knots": list(KNOTS)} | {way: list(level) for way, level in levels.items()}
    search, state = with_a_map(("position_direction_friction", "cart", friction))
    assert state.chi < 1.1
    assert of_place_alone(search, state, MAP) is None


def gone_on(effect):
    """What a search finds that goes on from a map of friction to recordings of a rig with something else."""
    mapped, state = with_a_map(effect)
    model = cart_model(DRY, cart_damping=30.0)
    base = base_fit(model.plant, model.known, mapped.setting)
    search = Search(model.plant, model.known, mapped.setting, None)
    chosen = as_trial(state, MAP, 9.0)
    begin = Explained(state, [Step(1, chosen, [chosen], {})], 1.0, 1.0, None, [])
    found = accept_effects(search, base, True, begin)
    names = [step.chosen.candidate.name for step in found.steps]
    assert names == [accepted.name for accepted in found.state.accepted]
    return found, names


@pytest.mark.slow
def test_what_has_a_name_is_told_where_a_map_had_played_a_force_of_the_place():
    """A map plays a spring as well as it plays any force of the place, and may be taken before a spring is tried."""
    found, names = gone_on(("spring_force", "cart", {"stiffness": 5.0, "rest": 0.7}))
    assert names == [("spring_force", "cart")] and found.curve is None
    told = found.state.plant.effects[-1]
    assert float(told.stiffness) == pytest.approx(5.0, rel=0.05) and float(told.rest) == pytest.approx(0.7, abs=0.02)


@pytest.mark.slow
def test_what_has_none_is_not_called_something_else_instead():
    found, names = gone_on(("residual_force", "cart", CURVE))
    assert names == [] and found.curve is not None and found.curve.chi < 1.1 < found.state.chi


@pytest.mark.slow
@pytest.mark.parametrize("same", [True, False])
def test_a_curve_is_kept_only_if_the_hold_out_is_met_no_worse_with_it(same):
    """A hollow in the rail that is a hump in the hold-out makes no simulation usable."""
    force = ("residual_force", "cart", CURVE)
    runs = cart_recordings(make_plant(DRY, force, cart_damping=30.0), 4, seed=5)
    there = (*force[:2], CURVE | {"by_place": list(HOLLOW if same else -HOLLOW)})
    others = cart_recordings(make_plant(DRY, there, cart_damping=30.0), 2, seed=20)
    model = cart_model(DRY, cart_damping=30.0)
    setting = make_setting(model, runs, others)
    base = base_fit(model.plant, model.known, setting)
    state = state_of(base.engine, base.free_run, base.fits, model.known)
    search = Search(model.plant, model.known, setting, None)
    curved = search.polish(make_plant(DRY, force, cart_damping=30.0), model.known, state.initial, ())
    assert curved.chi < 1.1 < LARGE < state.worst
    explained = Explained(state, [], 1.0, 1.0, None, [], curve=curved)
    made = Attempt(base, search, explained, {}, 0.0, None, None, None, 1.0, 1.0, True, True)
    found = settle(made, setting, lambda text: None)
    assert found.curved == same
    assert any(effect.kind == "residual_force" for effect in found.last.plant.effects) == same
    before, after = (m.holdout.errors.free_run["x"] / setting.noise["x"] for m in (found.first, found.last))
    assert after < 0.1 * before if same else after == pytest.approx(before)
