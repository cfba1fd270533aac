"""Where a window begins: a first guess of its readings and their rates, and how far the truth may lie from it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from .grid import Grid

_SPAN = 0.15
"""Time [s] over which a parabola through the samples around a beginning gives the guess."""
_LEAST = 7
"""Samples that it takes at least."""
STILL = 4.0
"""Range over noise of a channel up to which it rests."""
_OFF, _RATE_OFF = 20.0, 100.0
"""Standard deviations of the guess: of the reading over what the parabola leaves, and of its rate over that per span.
A beginning may differ from its guess by what noise allows, not by what a wrong model asks for."""
_SLACK, _RATE_SLACK = 1e-4, 0.02
"""What is added to them [m, rad] and [m/s, rad/s]."""


def initial_states(
    grid: Grid, begins: NDArray[np.int64], noise: Mapping[str, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Guesses of `x, psi, l` and their rates where windows begin, and one over the guesses' standard deviations.

    What does not move is held exactly (infinite precision); what is not measured is held at 0 and loosely.

    Args:
        grid: the recording.
        begins: samples at which windows begin.
        noise: standard deviation of each channel [m, rad, m].
    """
    states, precision = np.zeros((len(begins), 6)), np.zeros((len(begins), 6))
    states[:, 2] = grid.length
    for k, axis in enumerate(AXES):
        if not grid.active[k]:
            precision[:, [k, k + 3]] = np.inf
            continue
        rows = np.flatnonzero(grid.measured[:, k])
        if len(rows) < _LEAST:
            precision[:, [k, k + 3]] = 1 / 0.05, 1 / 0.2
            continue
        times, values, sigma = grid.times[rows], grid.y[rows, k], noise[axis]
        usual = float(np.median(np.diff(times)))
        half = max(_LEAST // 2, round(0.5 * _SPAN / usual))
        for w, begin in enumerate(begins):
            at = grid.times[begin]
            near = int(np.searchsorted(times, at))
            a, b = max(near - half, 0), min(near + half + 1, len(rows))
            size = half
            while True:
                since = times[a:b] - at
                degree = 2 if b - a >= _LEAST else 1
                basis = since[:, None] ** np.arange(degree + 1)
                fit = np.linalg.lstsq(basis, values[a:b], rcond=None)[0]
                left = float(np.std(basis @ fit - values[a:b]))
                # What moves too fast for a parabola over this time is looked at for half of it.
                if left <= 2.0 * sigma or size <= _LEAST:
                    break
                size //= 2
                a, b = max(near - size, 0), min(near + size + 1, len(rows))
            span = max(float(since[-1] - since[0]), 1e-6)
            off = max(sigma, left)
            states[w, k], states[w, k + 3] = fit[0], fit[1]
            precision[w, k] = 1.0 / (_OFF * off + _SLACK)
            precision[w, k + 3] = 1.0 / (_RATE_OFF * off / span + _RATE_SLACK)
            still = np.ptp(values[a:b]) <= STILL * sigma
            if still:
                # Where friction holds a rig at rest, a free velocity would be a way around it.
                states[w, k], states[w, k + 3] = np.mean(values[a:b]), 0.0
                precision[w, k], precision[w, k + 3] = 2.0 / (STILL * sigma), 2.0 * span / (STILL * sigma)
    return states, precision
