"""A fit begun anew from elsewhere is taken if it ends better, and only then."""

import dataclasses
import functools

import numpy as np
import pytest

from jbridge.identification.problem import make_setting
from jbridge.identify import base
from jbridge.identify.base import base_fit, begun_anew, columns_for
from jbridge.identify.solve import solve
from tests.identify.cases import DRY, cart_model, cart_recordings, scaled
from tests.problems import make_plant

FAR = {"cart_damping": 0.7, "cart_gain": 1.4, "coulomb_friction@cart.level": 1.5}


def test_a_fit_that_stopped_short_goes_on_from_better_numbers():
    model = scaled(cart_model(DRY, cart_damping=50.0, cart_gain=15.0), FAR)
    runs = cart_recordings(make_plant(DRY, cart_damping=50.0, cart_gain=15.0), 2, seconds=6.0)
    good = base_fit(model.plant, model.known, make_setting(model, runs, ()))
    assert 0.6 < good.chi < 1.2
    start = np.array(good.engine.table.ravel(model.plant))
    width = columns_for(len(good.free))
    short = solve(good.engine, good.fitted, start[None], [good.free], columns=width, iterations=1)
    stopped = dataclasses.replace(good, vector=short.vectors[0], fits=short)
    assert stopped.chi > 3.0
    near = good.vector.copy()
    near[good.free] *= 1.02
    found = begun_anew(stopped, near)
    assert found.chi < 1.001 * good.chi
    np.testing.assert_allclose(found.vector[good.free], good.vector[good.free], rtol=1e-3)
    # From far away it ends where it was, and what is no better is not taken.
    assert begun_anew(good, start).chi == pytest.approx(good.chi, rel=1e-6)
    held = np.setdiff1d(np.arange(len(start)), good.free)
    np.testing.assert_array_equal(found.vector[held], stopped.vector[held])


@pytest.mark.parametrize("times", [1, 2])
def test_where_numbers_from_windows_go_astray_in_whole_recordings_others_are_tried(monkeypatch, times):
    """As a winch may that winds in all of its rope, although no window is long enough for that: first the numbers that
    were given, then those of longer windows."""
    model = cart_model(DRY, cart_damping=45.0, cart_gain=15.0)
    runs = cart_recordings(make_plant(DRY, cart_damping=50.0, cart_gain=15.0), 2, seconds=6.0)
    astray = []

    @functools.wraps(solve)
    def led_astray(engine, batch, *args, **options):
        fits = solve(engine, batch, *args, **options)
        if batch.count > len(runs) or len(astray) == times:
            return fits
        astray.append(fits)
        return dataclasses.replace(fits, gram=fits.gram._replace(products=np.full_like(fits.gram.products, np.nan)))

    monkeypatch.setattr(base, "solve", led_astray)
    found = base_fit(model.plant, model.known, make_setting(model, runs, ()))
    assert len(astray) == times and 0.6 < found.chi < 1.2
