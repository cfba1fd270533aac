"""How well a move went: settling, overshoot, residual swing, effort, and how restless the voltage was."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .compensation import LIMITS

NEAR = 0.01
"""Distance within which a position counts as reached [m]."""
DWELL = 0.5
"""Time for which a position must have stayed within that distance, at the end of what was recorded, to count as
settled [s]: a load that swings on crosses its goal again and again."""
IDLE = 0.01
"""Share of a drive's limit within which a voltage has no sign: it moves nothing."""
FULL = 0.999
"""Share of a drive's limit from which a voltage counts as saturated."""
_REST = 1e-7


@dataclasses.dataclass(frozen=True, kw_only=True)
class Move:
    """One leg of a reference, from when it starts until the next one does."""

    start: float
    """[s]"""
    arrival: float
    """When the reference comes to rest [s]."""
    settling_time: dict[str, float | None]
    """Time from the start until the position stays within 1 cm of the goal [s], for `x`, `l` and the `load` (sideways
    and in the rope's length); None if it does not, or not for the last half second."""
    overshoot: dict[str, float]
    """How far beyond the goal, as a share of the way, for `x` and `l`."""
    steady_error: dict[str, float]
    """Mean error over the last quarter of the rest [m], for `x` and `l`."""
    residual_swing: float
    """Largest swing angle over the last quarter of the rest [rad]."""
    itae: dict[str, float]
    """Time-weighted absolute error to the reference [m s^2], for `x` and `l`."""
    effort: dict[str, float]
    """Mean square voltage [V^2]."""
    travel: dict[str, float]
    """Mean travel of the voltage, `mean |du/dt|` [V/s]."""
    sign_changes: dict[str, int]
    """How often the voltage goes from beyond 1 % of the drive's limit to beyond 1 % on the other side."""
    saturation: dict[str, float]
    """Share of the time in which the voltage is at the drive's limit [1]."""


def moves(
    times: NDArray[np.float64],
    reference: NDArray[np.float64],
    position: NDArray[np.float64],
    command: NDArray[np.float64],
    limits: Sequence[float] = LIMITS,
) -> tuple[Move, ...]:
    """Every leg of a reference, measured.

    Args:
        times: of the samples [s], equally spaced.
        reference: wanted cart position and rope length [m], one row a sample.
        position: `x` [m], `psi` [rad], `l` [m], one row a sample.
        command: voltages [V], one row a sample.
        limits: voltages beyond which the drives saturate [V]: cart, hoist.
    """
    return tuple(
        _measure(times[rows], reference[rows], position[rows], command[rows], float(times[stop]), limits)
        for rows, stop in _legs(reference)
    )


def _legs(reference: NDArray[np.float64]) -> Sequence[tuple[slice, int]]:
    """Rows of each leg with the rest that follows, and the row at which the reference has arrived."""
    moving = np.append(np.abs(np.diff(reference, axis=0)).max(axis=1) > _REST, False)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(int), [0]])))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):  # a place to hold
        return [(slice(0, len(reference)), 0)]
    ends = [*starts[1:], len(reference)]
    return [(slice(int(a), int(end)), int(b)) for a, b, end in zip(starts, stops, ends, strict=True)]


def _measure(
    times: NDArray[np.float64],
    reference: NDArray[np.float64],
    position: NDArray[np.float64],
    command: NDArray[np.float64],
    arrival: float,
    limits: Sequence[float],
) -> Move:
    start, goal = reference[0], reference[-1]
    since = times - times[0]
    place = {"x": position[:, 0], "l": position[:, 2]}
    wanted = dict(zip(("x", "l"), goal, strict=True))
    way = dict(zip(("x", "l"), goal - start, strict=True))
    sideways = np.abs(position[:, 0] + position[:, 2] * np.sin(position[:, 1]) - goal[0])
    load = np.maximum(sideways, np.abs(position[:, 2] - goal[1]))
    late = times >= arrival + 0.75 * (times[-1] - arrival)
    beyond = {
        axis: float(np.max(np.sign(way[axis]) * (place[axis] - wanted[axis]), initial=0.0)) / abs(way[axis])
        if way[axis]
        else 0.0
        for axis in place
    }
    return Move(
        start=float(times[0]),
        arrival=arrival,
        settling_time={axis: _settled(since, place[axis] - wanted[axis]) for axis in place}
        | {"load": _settled(since, load)},
        overshoot=beyond,
        steady_error={axis: float(np.mean(place[axis][late] - wanted[axis])) for axis in place},
        residual_swing=float(np.max(np.abs(position[late, 1]))),
        itae={
            axis: float(np.trapezoid(since * np.abs(place[axis] - reference[:, k]), since))
            for k, axis in enumerate(place)
        },
        effort={axis: float(np.mean(command[:, k] ** 2)) for k, axis in enumerate(place)},
        travel={
            axis: float(np.sum(np.abs(np.diff(command[:, k]))) / max(since[-1], since[1]))
            for k, axis in enumerate(place)
        },
        sign_changes={axis: _sign_changes(command[:, k], IDLE * limits[k]) for k, axis in enumerate(place)},
        saturation={axis: float(np.mean(np.abs(command[:, k]) >= FULL * limits[k])) for k, axis in enumerate(place)},
    )


def _sign_changes(command: NDArray[np.float64], idle: float) -> int:
    signs = np.sign(command[np.abs(command) > idle])
    return int(np.sum(signs[1:] != signs[:-1]))


def _settled(since: NDArray[np.float64], error: NDArray[np.float64]) -> float | None:
    # A position that is no number any more is not near.
    outside = np.flatnonzero(~(np.abs(error) <= NEAR))
    if not len(outside):
        return 0.0
    # Compared in the middle between samples, so that rounding of the times does not decide.
    last = since[-1] - DWELL + 0.5 * (since[1] - since[0])
    return float(since[outside[-1] + 1]) if outside[-1] + 1 < len(since) and since[outside[-1] + 1] < last else None
