"""Effects that show beside the numbers of the model file alone."""

import numpy as np
import pytest

import jbridge
from jbridge.model.files import Model
from tests.identification.cases import play, steps
from tests.problems import NUMBERS, make_plant


def dead_zone(volts):
    return "dead_zone", "hoist_drive", {"positive": volts, "negative": volts}


@pytest.mark.slow
def test_a_friction_is_named_although_a_wider_dead_zone_makes_up_for_it():
    """Fitted without it, the dead zone and the damping grow, and beside these a lag gains more than friction does."""
    true = make_plant(dead_zone(0.42), ("coulomb_friction", "hoist", {"level": 2.7}), hoist_damping=26.0)
    plant = make_plant(dead_zone(0.5), hoist_damping=22.0, hoist_gain=2.8)
    inputs = [np.stack([np.zeros(1200), steps(1200, k, volts=3.5)], axis=1) for k in range(4)]
    runs = [
        play(true, u, name=f"{k}.csv", active=(0.0, 0.0, 1.0), start={"l": 0.7}, seed=k) for k, u in enumerate(inputs)
    ]
    known = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})
    model = Model(plant, known, frozenset(NUMBERS), {}, "m.toml")
    found = jbridge.diagnose(model, runs[:3], runs[3:], budget=1000.0)
    assert [(e.kind, e.site, e.status) for e in found.effects] == [("coulomb_friction", "hoist", "confirmed")]
    assert found.effects[0].parameters["level"].value == pytest.approx(2.7, rel=0.03)
    assert found.explained["l"] > 0.99
