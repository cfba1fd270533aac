"""A force without a name explains what is left, and leaves the numbers that have names alone."""

import numpy as np
import pytest

from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.curve import force_without_a_name, of_place_alone
from jbridge.diagnosis.search import Search, state_of
from jbridge.identify.base import base_fit
from jbridge.identify.linearise import Engine
from jbridge.identify.setting import lanes_for, make_setting
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
MAP = Candidate("position_direction_friction", "cart", {}, ("positive", "negative"), False)


def with_a_map(*effects):
    """A search, and the fit of a map of friction to recordings of a rig that has something else, or such a map."""
    runs = cart_recordings(make_plant(DRY, *effects, cart_damping=30.0), 4, seed=5)
    start = {"knots": list(KNOTS), "positive": [0.5] * 8, "negative": [0.5] * 7 + [0.0]}
    model = cart_model(DRY, ("position_direction_friction", "cart", start), cart_damping=30.0)
    setting = make_setting(model, runs, ())
    search = Search(model.plant, model.known, setting, None)
    guess = lanes_for(Engine(model.plant).table, model.plant, setting, setting.recordings).initial
    return search, search.polish(model.plant, model.known, guess, (MAP,))


@pytest.mark.slow
def test_a_force_of_the_place_is_no_friction():
    hollow = 1.5 * np.sin(2 * np.pi * KNOTS / 0.5)
    curve = {"places": list(KNOTS), "by_place": list(hollow), "speeds": [-1.0, 1.0], "by_speed": [0.0, 0.0]}
    search, state = with_a_map(("residual_force", "cart", curve))
    found = of_place_alone(search, state, MAP)
    assert found is not None and found.accepted == () and len(found.free) <= len(state.free)
    assert found.cost < 1.02 * state.cost
    told = found.plant.effects[-1]
    assert told.kind == "residual_force" and not np.any(told.by_speed)
    inside = (KNOTS > 0.4) & (KNOTS < 1.1)
    np.testing.assert_allclose(np.interp(KNOTS, told.places, told.by_place)[inside], hollow[inside], atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.7])
def test_friction_by_place_and_direction_is_no_force_of_the_place(share):
    """The less its levels in both directions have in common, the more it looks like one."""
    common, apart = np.sin(7 * KNOTS), np.cos(9 * KNOTS)
    levels = {"positive": 1.5 + common + share * apart, "negative": 1.5 + common - share * apart}
    friction = {"knots": list(KNOTS)} | {key: list(level - 0.3) for key, level in levels.items()}
    search, state = with_a_map(("position_direction_friction", "cart", friction))
    assert state.chi < 1.1
    assert of_place_alone(search, state, MAP) is None
