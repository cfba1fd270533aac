"""A force without a name explains what is left, and leaves the numbers that have names alone."""

import numpy as np
import pytest

from jbridge.diagnosis.curve import force_without_a_name
from jbridge.diagnosis.search import Search, state_of
from jbridge.identify.base import base_fit
from jbridge.identify.setting import make_setting
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
