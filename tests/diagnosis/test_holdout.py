"""What a hold-out can and cannot judge."""

import numpy as np
import pytest

from jbridge.diagnosis.holdout import OffMap, by_heart, off_map
from tests.identify.cases import make_recording
from tests.problems import make_plant

TIMES = np.arange(0.0, 10.0, 0.01)
KNOTS = list(np.linspace(0.4, 0.8, 5))
MAP = ("position_dependent_friction", "hoist", {"knots": KNOTS, "levels": [0.1] * 5})
BOTH = ("position_direction_friction", "hoist", {"knots": KNOTS, "positive": [0.1] * 5, "negative": [0.1] * 5})
DRY = ("coulomb_friction", "hoist", {"level": 1.0})


def going(low: float, high: float, **more):
    """A run whose rope goes evenly from one length to another."""
    return make_recording("run.csv", TIMES, u_l=np.zeros(1000), l=np.linspace(low, high, 1000), **more)


@pytest.mark.parametrize("effect", [MAP, BOTH], ids=lambda effect: effect[0])
def test_a_map_is_not_judged_where_nobody_has_been(effect):
    plant = make_plant(DRY, effect)
    named = {effect[:2]}
    found = off_map(plant, named, [going(0.85, 0.9), going(0.9, 1.1)])
    assert isinstance(found, OffMap) and found.axis == "l"
    np.testing.assert_allclose([*found.learned, *found.asked], [0.4, 0.8, 0.85, 1.1])
    # One of two runs within, the other to five eighths outside of the map and half a knot around it.
    assert off_map(plant, named, [going(0.4, 0.8), going(0.7, 1.1)]) is not None
    # The same with two runs within: 21 % are not enough.
    assert off_map(plant, named, [going(0.4, 0.8), going(0.4, 0.8), going(0.7, 1.1)]) is None
    assert off_map(plant, named, [going(0.35, 0.85)]) is None


@pytest.mark.parametrize(
    ("effects", "named", "runs"),
    [
        ((DRY,), {DRY[:2]}, [going(0.9, 1.1)]),
        ((MAP,), {DRY[:2]}, [going(0.9, 1.1)]),
        ((MAP,), {MAP[:2]}, [make_recording("cart.csv", TIMES, u_x=np.zeros(1000), x=np.linspace(0.9, 1.1, 1000))]),
    ],
    ids=["no map", "the owner's own map", "not measured"],
)
def test_everything_else_is_judged(effects, named, runs):
    assert off_map(make_plant(*effects), named, runs) is None


@pytest.mark.parametrize(
    ("effects", "named", "left", "holdout", "learned"),
    [
        ((DRY, MAP), {MAP[:2]}, 3.5, 17.0, True),
        ((DRY, BOTH), {BOTH[:2]}, 3.5, np.inf, True),
        # Scatter, which both have; what hardly shows in the recordings; no map; a map that was given.
        ((DRY, MAP), {MAP[:2]}, 3.5, 8.0, False),
        ((DRY, MAP), {MAP[:2]}, 1.2, 17.0, False),
        ((DRY,), {DRY[:2]}, 3.5, 17.0, False),
        ((DRY, MAP), {DRY[:2]}, 3.5, 17.0, False),
    ],
)
def test_a_map_that_leaves_much_and_far_more_of_the_hold_out_is_no_law(effects, named, left, holdout, learned):
    # The cart's reading has nothing to do with a map of the hoist's friction.
    assert by_heart(make_plant(*effects), named, {"x": 2.0, "l": left}, {"x": 30.0, "l": holdout}) == learned
