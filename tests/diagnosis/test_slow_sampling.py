"""Recordings of a slow logger, 20 and 50 rows a second: motion between two rows is not taken for noise."""

import numpy as np
import pytest

from jbridge import diagnose
from tests.identification.cases import DRY, NOISE, cart_model, play, scaled, steps
from tests.problems import make_plant

NUMBERS = {"cart_damping": 0.9, "cart_gain": 1.1}
DRAG = ("quadratic_drag", "cart", {"coefficient": 15.0})


def diagnosed(rate, *more):
    def run(number):
        u = np.stack(
            [steps(round(15.0 * rate), 20 + number, hold=round(0.8 * rate)), np.zeros(round(15.0 * rate))], axis=1
        )
        return play(make_plant(DRY, *more), u, name=f"run-{number}.csv", period=1 / rate, start={"x": 0.6}, seed=number)

    return diagnose(scaled(cart_model(DRY), NUMBERS), [run(i) for i in range(3)], [run(3)])


@pytest.mark.slow
@pytest.mark.parametrize("rate", [50.0, 20.0])
def test_wrong_numbers_alone_raise_no_alarm(rate):
    found = diagnosed(rate)
    assert found.verdict == "adequate" and not found.effects


@pytest.mark.slow
@pytest.mark.parametrize("rate", [50.0, 20.0])
def test_what_is_missing_is_named(rate):
    """A drag that leaves a millimetre: with motion taken for noise (22 times it at 20 Hz) it would not show."""
    found = diagnosed(rate, DRAG)
    assert found.noise["x"] < 3 * NOISE["x"]
    assert found.verdict == "missing_physics", found.statement
    (effect,) = found.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    assert effect.parameters["coefficient"].value == pytest.approx(15.0, rel=0.15)
