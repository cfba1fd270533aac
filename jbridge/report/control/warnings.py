"""What reports on a controller warn of before anything else: drives that are restless or at their limits, unsettled
loads, carts that leave the rail, extrapolation."""

import re
import textwrap
from collections.abc import Iterable, Mapping

import numpy as np

from ...control.compensation import limits_of
from ...control.move_metrics import FULL, NEAR
from ...simulation.tracking import Tracking
from ...tuning.objectives import DRIVE
from ...tuning.tune import Tuning
from ..text.quantities import digits, percent, plain
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
_NAMES = {"x": "cart position", "l": "rope length"}
_RESTLESS = {
    "chatter_x": 0.03, "chatter_l": 0.03, "sign_changes_x": 1.0, "sign_changes_l": 1.0,
    "saturation_x": 0.01, "saturation_l": 0.01,
}  # fmt: skip
"""What must not grow beyond twice that of the controller as given, and what is too small for that to matter; of the
travel as a share of the drive's limit [1/s]."""
_BEHIND = 0.1
"""Share of its limit by which a drive of `DRIVE` may be behind its command on average: sound loops on noisy encoders
have a third of that at most, those that switch between the limits more than ten times as much."""
_MOSTLY = 0.5
"""Share of the time from which on a drive is at its limit most of the time: it does not follow the law then."""
_SPARE = 0.1
"""What rail and rope may reach beyond the reference where no recordings tell, as a share of the reference's range."""


def tuning_warnings(tuning: Tuning) -> list[str]:
    """Sentences on what became worse on the held-out bridges, loads that do not settle, and extrapolation."""
    before, after = tuning.measures["held_out"]
    found = []
    for key, small in _RESTLESS.items():
        old, new = float(np.mean(before[key])), float(np.mean(after[key]))
        if key.startswith("chatter"):
            small *= dict(zip("xl", limits_of(tuning.given.law).tolist(), strict=True))[key[-1]]
        if not new <= max(2.0 * old, small):
            name, _, factor = SHOWN[key]
            unit = "" if shown_unit(key, tuning.units) == "1" else f" {shown_unit(key, tuning.units)}"
            sizes = f"from {digits(factor * old)} to {digits(factor * new)}{unit}"
            found.append(f"{name} rose {sizes} on average, by more than a factor of two.")
    never = int(np.isnan(after["settling_load"]).sum())
    if never:
        given = int(np.isnan(before["settling_load"]).sum())
        found.append(f"the load does not settle in {never} of {after['settling_load'].size} moves ({given} as given).")
    return found + _beyond_recordings("the moves go", tuning.reached, tuning.recorded)


def tracking_warnings(tracking: Tracking) -> list[str]:
    """Sentences on loads that do not settle, on drives at their limits or behind their commands, and on what leaves the
    range of the recordings, or that of the reference where there are none."""
    never = [str(k) for k, move in enumerate(tracking.moves, start=1) if move.settling_time["load"] is None]
    found = [f"the load does not settle in move{'s' if len(never) > 1 else ''} {', '.join(never)}."] if never else []
    for (name, command), limit in zip(tracking.command.items(), tracking.limits, strict=True):
        unit, seconds = tracking.units.get(name, "V"), float(tracking.times[-1] - tracking.times[0])
        full = float(np.mean(np.abs(command) >= FULL * limit))
        if full > _MOSTLY:
            found.append(f"{name} is at its limit of {digits(limit)} {unit} in {percent(full)} of the time.")
        travel = float(np.sum(np.abs(np.diff(command)))) / seconds
        if DRIVE * travel > _BEHIND * limit:
            changes = sum(move.sign_changes[name[2:]] for move in tracking.moves)
            found.append(
                f"{name} chatters: it travels {plain(travel)} {unit}/s and changes its sign {changes} times in "
                f"{plain(seconds)} s; a drive with a time constant of {1e3 * DRIVE:.0f} ms is behind it by "
                f"{plain(DRIVE * travel)} {unit} on average."
            )
    for axis, values in tracking.reference.items():
        wanted, gone = ((float(np.min(v)), float(np.max(v))) for v in (values, tracking.position[axis]))
        if axis in tracking.recorded:
            given = _beyond_recordings("the reference goes", {axis: wanted}, tracking.recorded)
            found += given or _beyond_recordings("the run goes", {axis: gone}, tracking.recorded)
        elif max(wanted[0] - gone[0], gone[1] - wanted[1]) > max(_SPARE * (wanted[1] - wanted[0]), NEAR):
            found.append(
                f"the run goes from {gone[0]:.3g} to {gone[1]:.3g} m in {_NAMES[axis]}, the reference from "
                f"{wanted[0]:.3g} to {wanted[1]:.3g} m; see that the rig reaches that far."
            )
    return found


def shown_unit(key: str, units: Mapping[str, str]) -> str:
    """Unit of what is told of a controller, where inputs have the units given."""
    return re.sub("V", units.get(f"u_{key[-1]}", "V"), SHOWN[key][1])


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
    for axis, name in _NAMES.items():
        if axis not in recorded or axis not in reached:
            continue
        (low, high), (least, most) = reached[axis], recorded[axis]
        if low < least - NEAR or high > most + NEAR:
            found.append(
                f"{what} from {low:.3g} to {high:.3g} m in {name}, but the recordings behind the model cover "
                f"{least:.3g} to {most:.3g} m; outside of that the model extrapolates."
            )
    return found
