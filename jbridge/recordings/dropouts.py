"""Finds rows that a log lost and filled with a neighbour's value, or with one value that stands for none.

A log that stalls, a packet that is lost, or a resampling over a gap leaves rows that repeat the value before or after
them. Such a row is no measurement: a cart does not stand still for three rows and make up for it in the fourth.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

FAST = 1.5
"""Counts above which a step tells a speed."""
GROWS = 2.0
"""Second step of a motion over its first one: 3 from rest at one acceleration, 2.1 where the drive lags by a row."""
LEAST = 4.0
"""Travel that repeats missed, over the usual change from one step to the next, from which on it is no flicker."""

FAR = 10.0
"""Multiple of what a channel's own bends from row to row stay below (99 % of them) that is no motion."""
AGAIN = 3
"""Rows of one value from which on it is no chance that they are alike."""


def filled_rows(values: NDArray[np.float64], least: float) -> NDArray[np.bool_]:
    """Says which rows hold the one value that a sensor or a log gives where it has none, mostly 0.

    They are single rows, far from the row before and from the row after to the same side, and all exactly alike.

    Args:
        values: of the channel, shape (n,).
        least: distance that is far, in their unit.

    Returns:
        True for such rows, shape (n,).
    """
    filled = np.zeros(values.size, bool)
    before, after = np.diff(values)[:-1], -np.diff(values)[1:]
    away = np.where(before * after > 0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    alike, rows = np.unique(values[1:-1][away > least], return_counts=True)
    if not rows.size or rows.max() < AGAIN:
        return filled
    suspect = np.concatenate([[False], (away > least) & (values[1:-1] == alike[rows.argmax()]), [False]])
    bends = np.abs(np.diff(values[~suspect], 2))
    usual = float(np.quantile(bends, 0.99)) if bends.size else 0.0
    filled[1:-1] = suspect[1:-1] & (away > FAR * usual)
    return filled if np.count_nonzero(filled) >= AGAIN else np.zeros(values.size, bool)


def lost_rows(times: NDArray[np.float64], values: NDArray[np.float64], resolution: float) -> NDArray[np.bool_]:
    """Says which rows of a channel hold another row's value.

    Rows are lost if the value stands still between two steps in one direction, of more than a count, although at the
    speed of the slower step it would have moved by far more than steps usually differ from one to the next, and if the
    faster step, the jump, makes up for that travel, by half of it at least and twice of it at most, and does not come
    back. It is one step: where a motion begins after a rest, or ends before one, steps grow away from the rest. Where
    the jump comes first, the rows were filled with the value after them and the last of them is a measurement; where it
    comes last, the first of them is.

    Args:
        times: of the rows [s], shape (n,).
        values: of the channel, shape (n,).
        resolution: size of its count, in the unit of the values; 0 if it has no steps.

    Returns:
        True for rows that are no measurements, shape (n,).
    """
    lost = np.zeros(times.size, bool)
    starts = np.flatnonzero(np.diff(values)) + 1
    if starts.size < 2:
        return lost
    sizes, took = np.abs(values[starts] - values[starts - 1]), times[starts] - times[starts - 1]
    speeds = sizes / took
    before, after = np.arange(starts.size - 1), np.arange(1, starts.size)
    first, last = starts[before], starts[after] - 1
    comes_first = speeds[before] > speeds[after]
    jump, other = np.where(comes_first, (before, after), (after, before))
    beyond = np.clip(np.where(comes_first, before - 1, after + 1), 0, starts.size - 1)  # at an end, the jump itself
    missed = speeds[other] * (times[last] - times[first])
    extra = sizes[jump] - speeds[other] * took[jump]
    usual = max(resolution, float(np.median(np.abs(np.diff(values, 2)))))
    # Values may be finer than the count that is declared. A step of one count is no measure of a speed.
    count = min(resolution, float(np.quantile(sizes, 0.05)))
    way = np.sign(values[starts] - values[starts - 1])
    found = (way[before] == way[after]) & (last > first) & (sizes[other] > FAST * count)
    found &= (missed >= LEAST * usual) & (extra <= 2.0 * missed)
    returns = way[beyond] != way[jump]
    found &= extra - np.where(returns, sizes[beyond], 0.0) >= 0.5 * missed
    found &= returns | (speeds[beyond] < GROWS * speeds[jump])
    for begin, end, jump_first in zip(first[found], last[found], comes_first[found], strict=True):
        lost[begin:end] |= jump_first
        lost[begin + 1 : end + 1] |= not jump_first
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
