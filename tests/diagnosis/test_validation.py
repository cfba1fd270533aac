"""What a hold-out must say of an effect for it to be confirmed."""

import numpy as np
import pytest

from jbridge.diagnosis.validation.validate import _checked
from jbridge.identification.evaluation import Evaluation

DRAG = ("quadratic_drag", "cart")


class Run(Evaluation):
    """Errors at one horizon, in units of each channel's noise; the cart's is a thousandth of the swing's."""

    def __init__(self, x, psi=0.0):
        object.__setattr__(self, "total", {"x": x, "psi": psi})

    @property
    def horizons(self):
        return (1.0,)

    def ratios(self, horizon):
        return {axis: np.sqrt(1.0 + total) for axis, total in self.total.items()}

    def excess(self, horizon):
        return {"x": 1e-6 * self.total["x"], "psi": self.total["psi"]}


@pytest.mark.parametrize(
    ("back", "left", "losses", "status"),
    [
        (90.0, 10.0, [40.0, 60.0, 50.0], "confirmed"),
        (12.0, 10.0, [40.0, 60.0, 50.0], "confirmed"),
        (8.0, 10.0, [40.0, 60.0, 50.0], "suggested"),  # what is left could be what it imitates
        (0.5, 0.1, [4.0, 6.0, 5.0], "confirmed"),  # little, and nothing is left
        (90.0, 10.0, [40.0, -60.0, 1.0], "suggested"),  # in one block better, in another one worse
    ],
)
def test_an_effect_is_confirmed_by_steady_gains_above_what_has_no_name(back, left, losses, status):
    found = _checked(DRAG, np.array(losses), Run(100.0), Run(left), Run(left + back))
    assert found.status == status
    assert found.explained == pytest.approx(back / max(100.0, left + back))


@pytest.mark.parametrize(("back", "status"), [(80.0, "confirmed"), (10.0, "suggested")])
def test_what_has_no_name_in_one_channel_speaks_against_nothing_in_another(back, status):
    """The cart's error is 100 times larger in units of its noise, and hardly changes."""
    before, after, without = Run(1e6, 100.0), Run(9e5, 20.0), Run(9e5, 20.0 + back)
    found = _checked(DRAG, np.array([40.0, 60.0, 50.0]), before, after, without)
    assert found.status == status
    assert found.explained == pytest.approx(0.5 * back / 100.0)


def test_where_nothing_exceeds_the_noise_steadiness_alone_decides():
    found = _checked(DRAG, np.array([40.0, 60.0, 50.0]), Run(0.5), Run(0.1), Run(0.4))
    assert found.status == "confirmed" and found.explained is None


def test_what_happened_once_is_an_event():
    found = _checked(("missed_counts", "x_sensor"), np.array([-1.0, 0.0, 0.0]), Run(100.0), Run(1.0), Run(1.0))
    assert found.status == "event"
