"""Fits from many starts end at one optimum."""

import numpy as np
import pytest

from jbridge import fit_from_many
from tests.identification.cases import DRY, cart_model, cart_recordings
from tests.problems import make_plant

TRUTH = make_plant(DRY, cart_damping=50.0, cart_gain=15.0)


@pytest.mark.slow
def test_many_starts_arrive_at_the_truth():
    model = cart_model(DRY, cart_damping=50.0, cart_gain=15.0)
    recordings = cart_recordings(TRUTH, 2, seconds=6.0)
    found = fit_from_many(model, recordings, starts=10, spread=0.4)
    truth = {"cart_damping": 50.0, "cart_gain": 15.0, "coulomb_friction@cart.level": DRY[2]["level"]}
    assert set(found.names) == set(truth) and found.found.shape == (10, 3)
    # The first start is the model's own; the others lie about it.
    np.testing.assert_allclose(found.starts[0], [truth[name] for name in found.names])
    assert np.std(np.log(found.starts[1:]), axis=0).min() > 0.15
    arrived = found.arrived()
    assert arrived.sum() >= 8
    for k, name in enumerate(found.names):
        assert np.abs(found.found[arrived, k] / truth[name] - 1).max() < 0.03, name
    again = fit_from_many(model, recordings, starts=10, spread=0.4)
    np.testing.assert_array_equal(found.found, again.found)
