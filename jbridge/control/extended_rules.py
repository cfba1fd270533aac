"""A rule base in which velocity and swing angle really act, beside the paper's, where they cannot.

In the paper's rule base the rules that name the velocity ask for more than rules that conclude the same, and those that
name the angle only ever speak for zero voltage. Here the velocity brakes what the error drives, and the angle moves the
cart after the load: a cart whose drive turns voltage into speed then takes energy out of the swing. The velocity is
that beyond the reference's, which is not to be braked.
"""

from ..fuzzy.inference import Mamdani
from ..fuzzy.membership import as_number
from ..fuzzy.norms import Product, Sum
from ..fuzzy.rules import Variable, rule
from .compensation import LIMITS, Compensation
from .fuzzy import FuzzyController
from .paper_rules import angle_sets, error_sets, velocity_sets, voltage_sets

_TABLE = {
    # error: voltage where the velocity is NB, ZE, PB
    "NB": ("NS", "NB", "NB"),
    "NS": ("PS", "NS", "NB"),
    "ZE": ("PS", "ZE", "NS"),
    "PS": ("PB", "PS", "NS"),
    "PB": ("PB", "PB", "PS"),
}
TRACKING = tuple(
    f"if error is {error} and velocity is {velocity} then voltage is {voltage}"
    for error, row in _TABLE.items()
    for velocity, voltage in zip(("NB", "ZE", "PB"), row, strict=True)
)
"""A proportional law with damping, as a table of error and velocity."""
SWING = (
    "if angle is N then voltage is NS",
    "if angle is ZE then voltage is ZE",
    "if angle is P then voltage is PS",
)
"""The cart follows the load."""
SCALE = 0.4
"""Error that counts as 1 [m]."""


def extended_controller(compensation: Compensation | None = None) -> FuzzyController:
    """The paper's variables with rules for error, velocity and angle, each of which counts by its degree.

    Degrees are multiplied and conclusions added, so that rules which contradict each other are weighed.

    Args:
        compensation: of what friction and dead zones take; `tuning.compensation_for` has a model's.
    """
    limits = LIMITS if compensation is None else compensation.limits.tolist()
    cart = _system(
        (error_sets(0.03, 0.15), velocity_sets(), angle_sets(0.0, 8.0, 2.0)), voltage_sets(limits[0]), TRACKING + SWING
    )
    hoist = _system((error_sets(0.03, 0.1), velocity_sets()), voltage_sets(limits[1]), TRACKING)
    scale = as_number(SCALE)
    return FuzzyController(cart, hoist, scale, scale, compensation=compensation, relative_speed=True)


def _system(inputs: tuple[Variable, ...], output: Variable, rules: tuple[str, ...]) -> Mamdani:
    return Mamdani(
        inputs,
        (output,),
        tuple(rule(text, inputs, (output,)) for text in rules),
        conjunction=Product(),
        implication=Product(),
        aggregation=Sum(),
    )
