"""The paper's two rule bases, with sets placed by hand where the paper prints pictures only.

Table 2 gives the universes. Figures 5 and 6 show trapezoids at the ends, triangles and Gaussian bells, those of the
errors condensed around zero; their corners are not printed, so the ones here are assumed.
"""

from collections.abc import Sequence

from ..fuzzy.inference import Mamdani
from ..fuzzy.membership import AbstractMembership, Gaussian, Trapezoidal, Triangular, as_number
from ..fuzzy.rules import Variable, rule
from .fuzzy import FuzzyController

RULES = (
    "if error is NB then voltage is NB",
    "if error is PB then voltage is PB",
    "if error is NS then voltage is NS",
    "if error is PS then voltage is PS",
    "if error is NS and velocity is PB then voltage is NS",
    "if error is PS and velocity is NB then voltage is PS",
    "if error is ZE then voltage is ZE",
    "if angle is N then voltage is ZE",
    "if angle is P then voltage is ZE",
)
"""Rules 1 to 9 of the paper; the hoist has the first seven."""

ERROR_RANGE = 3.0
"""Error that counts as 1 [m]: the paper's universe is +-3 m, "normalized to [-1, 1]"."""


def _triangle(*corners: float) -> AbstractMembership:
    return Triangular(*(as_number(corner) for corner in corners))


def _trapezoid(*corners: float) -> AbstractMembership:
    return Trapezoidal(*(as_number(corner) for corner in corners))


def _bell(width: float, centre: float) -> AbstractMembership:
    return Gaussian(as_number(width), as_number(centre))


def _variable(name: str, limit: float, labels: str, sets: Sequence[AbstractMembership]) -> Variable:
    return Variable(name, as_number(-limit), as_number(limit), tuple(labels.split()), tuple(sets))


def error_sets(small: float, big: float) -> Variable:
    """Five sets, condensed around zero: `small` where ZE ends and NS, PS peak, `big` where NB, PB begin to hold."""
    return _variable(
        "error",
        1.0,
        "NB NS ZE PS PB",
        [
            _trapezoid(-1.0, -1.0, -big, -small),
            _triangle(-big, -small, 0.0),
            _triangle(-small, 0.0, small),
            _triangle(0.0, small, big),
            _trapezoid(small, big, 1.0, 1.0),
        ],
    )


def velocity_sets() -> Variable:
    """Three sets over the velocity [m/s]."""
    return _variable(
        "velocity",
        0.7,
        "NB ZE PB",
        [_trapezoid(-0.7, -0.7, -0.4, 0.0), _bell(0.12, 0.0), _trapezoid(0.0, 0.4, 0.7, 0.7)],
    )


def angle_sets(inner: float = 5.0, outer: float = 20.0, width: float = 3.0) -> Variable:
    """Three sets over the swing angle [degrees]: N and P begin to hold at `inner` and hold at `outer`."""
    return _variable(
        "angle",
        45.0,
        "N ZE P",
        [_trapezoid(-45.0, -45.0, -outer, -inner), _bell(width, 0.0), _trapezoid(inner, outer, 45.0, 45.0)],
    )


def voltage_sets(limit: float) -> Variable:
    """Five sets over the voltage, in parts of its limit."""
    full, most, half, third, small = (round(part * limit, 6) for part in (1.0, 0.9, 0.5, 0.3, 0.1))
    sets = [
        _trapezoid(-full, -full, -most, -half),
        _triangle(-2 * third, -third, 0.0),
        _triangle(-small, 0.0, small),
        _triangle(0.0, third, 2 * third),
        _trapezoid(half, most, full, full),
    ]
    return _variable("voltage", limit, "NB NS ZE PS PB", sets)


def cart_system() -> Mamdani:
    """Rules 1 to 9: error, velocity [m/s] and swing angle [degrees] to the cart's voltage [V]."""
    inputs = (error_sets(0.004, 0.08), velocity_sets(), angle_sets())
    output = voltage_sets(3.0)
    return Mamdani(inputs, (output,), tuple(rule(text, inputs, (output,)) for text in RULES))


def hoist_system() -> Mamdani:
    """Rules 1 to 7: error and velocity [m/s] to the hoist's voltage [V]."""
    inputs = (error_sets(0.004, 0.05), velocity_sets())
    output = voltage_sets(10.0)
    return Mamdani(inputs, (output,), tuple(rule(text, inputs, (output,)) for text in RULES[:7]))


def paper_controller() -> FuzzyController:
    """Both rule bases as printed, with the sets assumed here."""
    return FuzzyController(cart_system(), hoist_system(), as_number(ERROR_RANGE), as_number(ERROR_RANGE))
