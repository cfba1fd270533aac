"""Finds channels that repeat their value because the sensor is slower than the log.

A 30 Hz camera in a 145 Hz log repeats each value about five times. An encoder repeats values too, at rest and
whenever it moves less than a count per row. What tells them apart is motion that is too fast for that: an
encoder that moves by two counts or more from one row to the next, and does so again in the same direction,
has no reason to stand still in between.
"""

from dataclasses import dataclass

import numpy as np

FAST = 1.5
"""Steps above this many counts are fast: 2 counts in one row mean more than one count per row."""
VERY_FAST = 7.5
"""Steps above this many counts [counts] are beyond any encoder's flicker."""
LONGEST = 0.25
"""A value kept longer than this [s] is taken for standstill; a slower sensor must be declared."""
LEAST = 20
"""Fewer fast runs than this leave the question open."""


@dataclass(frozen=True)
class Hold:
    """Whether a channel repeats values between the samples of a slower sensor."""

    held: bool | None
    """None where the channel never moved fast enough to tell."""
    period: float
    """Time from one sample of the sensor to the next [s]; 0 where unknown."""


def detect_hold(times: np.ndarray, values: np.ndarray, resolution: float) -> Hold:
    """Says whether a channel is held, by the rule below.

    A run is a value and its repeats. Only runs shorter than 0.25 s between two steps in one direction, both
    of 2 counts or more, are looked at. A run is out of place if at the speed of the slower of its two steps
    the channel would have moved by 2 counts or more during the repeats. The channel is held if

    - 6 in 10 of these runs are out of place (noise alone makes it 4 in 10), and they are at least 1 in 50 of
      all runs: a sensor that brings a sample every second row or less often; or
    - between steps of 8 counts or more, 1 in 4 runs is out of place and shorter than 5 rows, there are 50
      such runs or more, and they are at least 1 in 20 of all: a sensor only somewhat slower than the log.

    Fewer than 20 runs to look at leave the question open: a channel at rest is not called held.

    Args:
        times: Times of the rows [s].
        values: Values of the channel.
        resolution: Size of its count, in the unit of the values; 0 if it has no steps.
    """
    changes = np.flatnonzero(np.diff(values)) + 1
    if changes.size < LEAST:
        return Hold(None, 0.0)
    steps = values[changes] - values[changes - 1]
    speeds = np.abs(steps) / (times[changes] - times[changes - 1])
    durations = np.diff(times[changes])
    repeats = times[changes[1:] - 1] - times[changes[:-1]]
    smaller = np.minimum(np.abs(steps[:-1]), np.abs(steps[1:]))
    slower = np.minimum(speeds[:-1], speeds[1:])
    looked_at = (steps[:-1] * steps[1:] > 0) & (durations < LONGEST)
    fast = looked_at & (smaller > FAST * resolution)
    if np.count_nonzero(fast) < LEAST:
        return Hold(None, 0.0)
    out_of_place = (repeats > 0) & (repeats * slower >= 2 * resolution)
    clearly = out_of_place[fast].mean() >= 0.6 and fast.mean() >= 0.02
    very_fast = looked_at & (smaller > VERY_FAST * resolution)
    short = durations < 5 * np.median(np.diff(times))
    partly = (
        np.count_nonzero(very_fast) >= 50
        and very_fast.mean() >= 0.05
        and (out_of_place & short)[very_fast].mean() >= 0.25
    )
    # Rows round each duration to their own spacing, which a mean undoes and a median does not; a run of two
    # equal samples must not enter it.
    typical = durations[fast & (durations < 1.75 * np.median(durations[fast]))]
    return Hold(bool(clearly or partly), float(typical.mean()))


def declared_hold(times: np.ndarray, values: np.ndarray, resolution: float, held: bool) -> Hold:
    """Returns what the rig's owner says, with the sensor's period from the data.

    Where the channel moved too little to show the period, the shortest runs that are not exceptions give it.
    """
    if not held:
        return Hold(False, 0.0)
    period = detect_hold(times, values, resolution).period
    changes = np.flatnonzero(np.diff(values)) + 1
    if period == 0 and changes.size > 2:
        period = float(np.quantile(np.diff(times[changes]), 0.1))
    return Hold(True, period)


def fresh_rows(times: np.ndarray, values: np.ndarray, hold: Hold) -> np.ndarray:
    """Returns True for each row that carries a new sample.

    In a held channel these are the rows where the value changes, and, since a sensor at rest still measures,
    rows about one period apart while it stays the same.
    """
    if not hold.held or hold.period == 0:
        return np.ones(times.size, dtype=bool)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1])
    stops = np.concatenate([starts[1:], [times.size]])
    ends = np.concatenate([times[starts[1:]], [times[-1] + hold.period / 2]])
    fresh = np.zeros(times.size, dtype=bool)
    fresh[starts] = True
    samples = np.round((ends - times[starts]) / hold.period).astype(int)
    for start, stop, end, count in zip(starts, stops, ends, samples, strict=True):
        if count > 1:
            # The number of the last sample before each row: a row where it rises carries a new one.
            spacing = (end - times[start]) / count
            numbers = np.minimum(np.floor((times[start:stop] - times[start] + 1e-9) / spacing), count - 1)
            fresh[start + 1 : stop] |= np.diff(numbers) > 0
    return fresh
