"""What reports on a controller warn of before anything else: restless drives, unsettled loads, extrapolation."""

import textwrap
from collections.abc import Iterable, Mapping

import numpy as np

from ...control.measures import NEAR
from ...simulation.tracking import Tracking
from ...tuning.tune import Tuning
from ..text.quantities import digits
from ..text.tables import WIDTH

SHOWN: Mapping[str, tuple[str, str, float]] = {
    "settling_load": ("load settled", "s", 1.0),
    "residual_swing": ("swing left", "°", 180.0 / np.pi),
    "overshoot_x": ("overshoot of x", "mm", 1e3),
    "overshoot_l": ("overshoot of l", "mm", 1e3),
    "itae_x": ("ITAE of x", "m s²", 1.0),
    "itae_l": ("ITAE of l", "m s²", 1.0),
    "effort_x": ("effort of the cart", "V²", 1.0),
    "chatter_x": ("travel of u_x", "V/s", 1.0),
    "chatter_l": ("travel of u_l", "V/s", 1.0),
    "sign_changes_x": ("sign changes of u_x", "1", 1.0),
    "sign_changes_l": ("sign changes of u_l", "1", 1.0),
    "saturation_x": ("time of u_x at the limit", "%", 100.0),
    "saturation_l": ("time of u_l at the limit", "%", 100.0),
}
"""What is told of a controller: name, unit, factor from the summaries' unit."""
_RESTLESS = {
    "chatter_x": 0.1, "chatter_l": 0.1, "sign_changes_x": 1.0, "sign_changes_l": 1.0,
    "saturation_x": 0.01, "saturation_l": 0.01,
}  # fmt: skip
"""What must not grow beyond twice that of the controller as given, and what is too small for that to matter."""


def tuning_warnings(tuning: Tuning) -> list[str]:
    """Sentences on what became worse on the held-out bridges, loads that do not settle, and extrapolation."""
    before, after = tuning.measures["held_out"]
    found = []
    for key, small in _RESTLESS.items():
        old, new = float(np.mean(before[key])), float(np.mean(after[key]))
        if not new <= max(2.0 * old, small):
            name, unit, factor = SHOWN[key]
            unit = "" if unit == "1" else f" {unit}"
            sizes = f"from {digits(factor * old)} to {digits(factor * new)}{unit}"
            found.append(f"{name} went {sizes} on average, more than twice.")
    never = int(np.isnan(after["settling_load"]).sum())
    if never:
        given = int(np.isnan(before["settling_load"]).sum())
        found.append(f"the load does not settle in {never} of {after['settling_load'].size} moves ({given} as given).")
    return found + _beyond_recordings("the moves go", tuning.reached, tuning.recorded)


def tracking_warnings(tracking: Tracking) -> list[str]:
    """Sentences on loads that do not settle, and on a reference that leaves the range of the recordings."""
    never = [str(k) for k, move in enumerate(tracking.moves, start=1) if move.settling_time["load"] is None]
    found = [f"the load does not settle in move{'s' if len(never) > 1 else ''} {', '.join(never)}."] if never else []
    reached = {axis: (float(np.min(v)), float(np.max(v))) for axis, v in tracking.reference.items()}
    return found + _beyond_recordings("the reference goes", reached, tracking.recorded)


def warning_lines(warnings: Iterable[str]) -> list[str]:
    """Warnings on a terminal."""
    return [line for sentence in warnings for line in textwrap.wrap(f"Warning: {sentence}", WIDTH)]


def _beyond_recordings(
    what: str, reached: Mapping[str, tuple[float, float]], recorded: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Sentences on positions and rope lengths outside of the recordings; none where the model does not say.

    Args:
        what: subject and verb of the sentence.
        reached: least and largest `x` and `l` [m].
        recorded: the same in the recordings.
    """
    found = []
    for axis, name in (("x", "cart position"), ("l", "rope length")):
        if axis not in recorded or axis not in reached:
            continue
        (low, high), (least, most) = reached[axis], recorded[axis]
        if low < least - NEAR or high > most + NEAR:
            found.append(
                f"{what} from {low:.3g} to {high:.3g} m in {name}, but the recordings behind the model cover "
                f"{least:.3g} to {most:.3g} m; outside of that the model extrapolates."
            )
    return found
