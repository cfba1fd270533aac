"""How a lane begins: a first guess of its state, how far the truth may lie from it, and what tells of it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identification.data.grid import Grid

TOLD = 0.5
"""Time that tells of an initial state [s]."""
_START = 0.15
"""Time [s] over which a parabola through the first samples gives the first guess of the initial state."""

_UNDER_WAY = 0.02
"""Speed [m/s] from which a recording may begin in motion."""
STILL = 4.0
"""Range over noise of a channel's first samples up to which it starts at rest."""
_REST = 0.5
"""Time [s] of rest at a recording's start that leaves no doubt of it; a load hardly swinging may be still for less."""
SPREAD = {"motor": (2e-3, 2e-2), "loaded": (2e-3, 2e-2), "phi": (2e-3, 2e-2), "spring": (0.7,)}
"""Standard deviations of hidden states at a beginning: a deflection from rest [m, rad] and its rate, or what share of
its most a spring is bent."""
_HOOK = 0.5
"""By how much of the load's swing the angle below a hook may differ from the one above it."""


def spread(name: str, g: Grid, a: int, b: int, bounce: tuple[float, float] | None) -> NDArray[np.float64]:
    """Standard deviations of a hidden state where a lane begins at sample `a`."""
    spread = np.array(SPREAD[name])
    if name == "loaded" and bounce is not None:
        return np.maximum(spread, bounce)
    if name != "phi":
        return spread
    near = np.flatnonzero(g.measured[a : b + 1, 1] & (g.times[a : b + 1] <= g.times[a] + TOLD)) + a
    # A load that hangs still has a hook that does.
    return spread * (1.0 + (_HOOK * np.ptp(g.y[near, 1]) / spread[0] if len(near) else 0.0))


def moves(g: Grid, a: int, b: int, axis: str, far: float) -> float:
    """Time from sample `a` at which an axis has gone so far [s]; 0 where it never does before sample `b`."""
    k = AXES.index(axis)
    rows = np.flatnonzero(g.measured[a : b + 1, k]) + a
    gone = rows[np.abs(g.y[rows, k] - g.y[rows[:1], k]) > far]
    return float(g.times[gone[0]] - g.times[a]) if len(gone) else 0.0


def under_way(g: Grid, axis: int, speed: float) -> bool:
    """Whether a recording begins in motion: then what drives it at the first row has done so before.

    An axis that starts from rest has an average speed over its first moments, and none at their beginning.
    """
    rows = np.flatnonzero(g.measured[:, axis] & (g.times <= _START))
    if not g.active[axis] or len(rows) < 2:
        return False
    mean = (g.y[rows[-1], axis] - g.y[rows[0], axis]) / (g.times[rows[-1]] - g.times[rows[0]])
    return bool(abs(speed) > _UNDER_WAY and speed * mean > 0.5 * mean**2)


def first_state(g: Grid, a: int, b: int, sigma: Mapping[str, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A parabola through each channel's first samples, and how far the truth may lie from it."""
    state, tight = np.zeros(6), np.zeros(6)
    state[2] = g.length
    for k, axis in enumerate(AXES):
        if not g.active[k]:
            # What does not move keeps its place exactly.
            tight[[k, k + 3]] = np.inf
            continue
        rows = np.flatnonzero(g.measured[a : b + 1, k]) + a
        if not len(rows):
            tight[[k, k + 3]] = [1 / 0.05, 1 / 0.2]
            continue
        near = rows[g.times[rows] <= g.times[rows[0]] + _START]
        if len(near) < 6:
            near = rows[:6]
        noise = sigma[axis]
        while True:
            since = g.times[near] - g.times[a]
            fit = np.polynomial.polynomial.polyfit(since, g.y[near, k], 2 if len(near) >= 6 else 1)
            left = float(np.std(np.polynomial.polynomial.polyval(since, fit) - g.y[near, k]))
            # What moves too fast for a parabola over this time is looked at for half of it.
            if left <= 2.0 * noise or len(near) < 12:
                break
            near = near[: len(near) // 2]
        state[k], state[k + 3] = fit[0], fit[1]
        off, span = max(noise, left), max(float(since[-1] - since[0]), 1e-6)
        tight[k] = 1.0 / (20.0 * off + 1e-4)
        tight[k + 3] = 1.0 / (200.0 * off / span + 0.05)
        if np.ptp(g.y[near, k]) <= STILL * noise and since[-1] >= 0.5 * _START:
            # Where friction holds a rig at rest, a free initial velocity would be a way around it.
            state[k], state[k + 3] = np.mean(g.y[near, k]), 0.0
            tight[[k, k + 3]] = 2.0 / (STILL * noise), 2.0 * _START / (STILL * noise)
            longer = rows[g.times[rows] <= g.times[rows[0]] + _REST]
            if a == 0 and axis != "psi" and np.ptp(g.y[longer, k]) <= STILL * noise:
                tight[k + 3] = np.inf
    return state, tight
