"""Finds rows that a log lost and filled with a neighbour's value.

A log that stalls, a packet that is lost, or a resampling over a gap leaves rows that repeat the value before or after
them. Such a row is no measurement: a cart does not stand still for three rows and make up for it in the fourth.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

LEAST = 4.0
"""Travel that repeats missed, over the usual change from one step to the next, from which on it is no flicker."""


def lost_rows(times: NDArray[np.float64], values: NDArray[np.float64], resolution: float) -> NDArray[np.bool_]:
    """Says which rows of a channel hold another row's value.

    Rows are lost if the value stands still between two steps in one direction, although at the speed of the slower
    step it would have moved by far more than steps usually differ from one to the next, and if the faster step makes
    up for that travel, by half of it at least and twice of it at most. Where the faster step comes first, the rows were
    filled with the value after them and the last of them is a measurement; where it comes last, the first of them is.

    Args:
        times: of the rows [s], shape (n,).
        values: of the channel, shape (n,).
        resolution: size of its count, in the unit of the values; 0 if it has no steps.

    Returns:
        True for rows that are no measurements, shape (n,).
    """
    lost = np.zeros(times.size, bool)
    starts = np.flatnonzero(np.diff(values)) + 1
    first, last = starts[:-1], starts[1:] - 1
    before, after = values[first] - values[first - 1], values[last + 1] - values[last]
    rows_before, rows_after = times[first] - times[first - 1], times[last + 1] - times[last]
    speed_before, speed_after = np.abs(before) / rows_before, np.abs(after) / rows_after
    slower = np.minimum(speed_before, speed_after)
    missed = slower * (times[last] - times[first])
    comes_first = speed_before > speed_after
    extra = np.where(comes_first, np.abs(before) - slower * rows_before, np.abs(after) - slower * rows_after)
    usual = max(resolution, float(np.median(np.abs(np.diff(values, 2)))) if values.size > 2 else 0.0)
    found = (before * after > 0) & (last > first) & (missed >= LEAST * usual)
    found &= (extra >= 0.5 * missed) & (extra <= 2.0 * missed)
    for begin, end, first_step_is_faster in zip(first[found], last[found], comes_first[found], strict=True):
        rows = slice(begin, end) if first_step_is_faster else slice(begin + 1, end + 1)
        lost[rows] = True
    return lost


def lost_together(
    times: NDArray[np.float64], values: Mapping[str, NDArray[np.float64]], resolution: Mapping[str, float]
) -> dict[str, NDArray[np.bool_]]:
    """Rows that are lost, by channel: those that its own motion shows, and those that another's shows and at which it
    repeats its value, too, since a log mostly loses whole rows."""
    own = {name: lost_rows(times, channel, resolution[name]) for name, channel in values.items()}
    anywhere = np.logical_or.reduce(list(own.values())) if own else np.zeros(times.size, bool)
    out = {}
    for name, channel in values.items():
        same = np.diff(channel) == 0
        repeats = np.concatenate([same, [False]]) | np.concatenate([[False], same])
        out[name] = own[name] | (anywhere & repeats)
    return out
