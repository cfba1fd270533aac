"""Estimates the size of a sensor's count from the values it gave."""

import numpy as np

FEW = 40
"""Below this many distinct values chance can look like a grid in the spectrum, so the steps are judged."""
BINS = 2**18
"""Bins over the values' span, of which a count needs at least five: up to 52 000 counts can be seen."""
PADDING = 4
"""Finer steps in frequency, so that a peak between two of them keeps most of its height."""
CONCENTRATION = 0.75
"""How well the values must fall on a grid; 1 is exactly, and numbers rounded in print keep more than 0.9."""


def estimate_resolution(values: np.ndarray) -> float:
    """Returns the spacing of the grid that values lie on, in their unit; 0 where none can be seen.

    Counts of an encoder lie on a grid even where fast motion visits few of them, so that the smallest step
    seen is several counts. The grid of spacing `s` shows as a peak of `abs(mean(exp(2 i pi v / s)))` over the
    distinct values `v`; the largest spacing with a high peak is taken, provided that hardly any two values
    are closer than half of it.

    >>> estimate_resolution(np.round(np.sin(np.arange(500.0)) / 0.01) * 0.01)
    0.01
    """
    largest = float(np.abs(values).max(initial=0.0))
    # A power of two takes the unit out exactly, so that no value is too small or too large for what follows.
    exponent = int(np.frexp(largest)[1])
    values = np.ldexp(values, -exponent)
    distinct = np.unique(values)
    if distinct.size < 2:
        return 0.0
    span = distinct[-1] - distinct[0]
    scale = max(abs(distinct[0]), abs(distinct[-1]))
    # Values that differ by rounding of the arithmetic alone are one value.
    distinct = distinct[np.concatenate([[True], np.diff(distinct) > max(1e-9 * span, 1e-12 * scale)])]
    if distinct.size < 2:
        return 0.0
    if distinct.size < FEW:
        spacing = spacing_of_few(distinct, changes=int(np.count_nonzero(np.diff(values))))
    else:
        spacing = spacing_of_many(distinct)
    return float(f"{np.ldexp(refined(distinct, spacing), exponent):.6g}") if spacing else 0.0


def spacing_of_few(distinct: np.ndarray, changes: int) -> float:
    """Returns the smallest step where the other steps are multiples of it, or where values come back."""
    steps = np.diff(distinct)
    smallest = float(np.mean(steps[steps < 1.5 * steps.min()]))
    multiples = steps[steps < 5.5 * smallest] / smallest
    on_grid = bool(np.all(np.abs(multiples - np.round(multiples)) < 0.2))
    comes_back = changes > 2 * distinct.size
    return smallest if on_grid and (comes_back or multiples.size > 6) else 0.0


def spacing_of_many(distinct: np.ndarray) -> float:
    """Returns the largest spacing at which the spectrum of the distinct values has a high peak, else 0."""
    span = distinct[-1] - distinct[0]
    largest = 2 * float(np.quantile(np.diff(distinct), 0.05))
    first = int(np.ceil(PADDING * span / largest))
    last = PADDING * BINS // 5
    if first >= last:
        return 0.0
    bins = np.minimum((distinct - distinct[0]) * (BINS / span), BINS - 1).astype(np.int64)
    counts = np.bincount(bins, minlength=BINS).astype(np.float64)
    height = np.abs(np.fft.rfft(counts, PADDING * BINS)[: last + 1]) / distinct.size
    high = np.flatnonzero(height[first:] > CONCENTRATION)
    if high.size == 0:
        return 0.0
    peak = first + int(high[0])
    while peak < last and height[peak + 1] > height[peak]:
        peak += 1
    return float(PADDING * span / peak)


def refined(distinct: np.ndarray, spacing: float) -> float:
    """Returns the spacing that fits all values best, once it is known well enough to number the counts."""
    for reach in (20, 400, 8000):
        near = distinct[np.abs(distinct - np.median(distinct)) <= reach * spacing]
        if near.size < 3:
            continue
        numbers = np.round((near - near[0]) / spacing)
        if numbers[-1] > 0:
            slope = np.polyfit(numbers, near, 1)[0]
            spacing = float(slope) if abs(slope / spacing - 1) < 0.2 else spacing
    return spacing
