"""One recording alone: its last quarter is the hold-out, and begins while the drive answers to what was before."""

import numpy as np
import pytest

from jbridge import diagnose
from tests.identification.cases import DRY, cart_model, play, scaled, steps
from tests.problems import make_plant

LAG = ("actuator_lag", "cart_drive", {"time_constant": 0.05})
START = {"cart_damping": 0.9, "cart_gain": 1.1}


def diagnosed(*more):
    u = np.stack([steps(2000, 5), np.zeros(2000)], axis=1)
    return diagnose(scaled(cart_model(DRY, LAG), START), [play(make_plant(DRY, LAG, *more), u, start={"x": 0.6})])


@pytest.mark.slow
def test_wrong_numbers_alone_raise_no_alarm():
    found = diagnosed()
    assert found.verdict == "adequate" and not found.effects


@pytest.mark.slow
def test_what_is_missing_is_named():
    """What other recordings foresee cannot be asked, but what other quarters of it do can."""
    found = diagnosed(("quadratic_drag", "cart", {"coefficient": 40.0}))
    assert found.verdict == "missing_physics"
    (effect,) = found.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    assert effect.parameters["coefficient"].value == pytest.approx(40.0, rel=0.05)
