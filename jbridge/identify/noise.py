"""The noise floor of each channel, from the recordings themselves."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from .._types import AXES
from ..recordings import Recording

_WINDOW = 9
"""Samples of one local parabola: short against any motion of the bridge, long enough to leave degrees of freedom."""


def noise_floor(recordings: Sequence[Recording]) -> dict[str, float]:
    """Standard deviation of the noise by channel [m, rad, m].

    The larger of two estimates, not their sum: what is left of local parabolas (the median over all windows, so that
    jerks and stops do not count), and the rounding of the encoder, `resolution / sqrt(12)`. At rest a coarse encoder
    shows no scatter at all, and the second is all that can be known.
    """
    floor = {}
    for axis in AXES:
        scatter, rounding = [], []
        for recording in recordings:
            values = getattr(recording, axis)
            if values is None:
                continue
            fresh = recording.fresh[axis]
            scatter.append(_local_scatter(recording.times[fresh], values[fresh]))
            rounding.append(recording.resolution.get(axis, 0.0) / np.sqrt(12.0))
        if scatter:
            # A channel that is exact, as a simulation's, still needs a scale: a thousandth of a millimetre or a
            # thousandth of a degree.
            least = 1e-6 if axis != "psi" else 1.7e-5
            spread = np.concatenate(scatter)
            found = float(np.sqrt(np.median(spread) / _MEDIAN_OF_CHI2)) if len(spread) else 0.0
            floor[axis] = max(found, float(np.median(rounding)), least)
    return floor


_DEGREES = _WINDOW - 3
_MEDIAN_OF_CHI2 = 1.0 - 2.0 / (9.0 * _DEGREES)
_MEDIAN_OF_CHI2 = _MEDIAN_OF_CHI2**3
"""Median over mean of a chi-square variable with the parabola's degrees of freedom (Wilson and Hilferty 1931)."""


def _local_scatter(times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variance about a parabola through each window of samples; windows with a gap are left out."""
    if len(values) < 4 * _WINDOW:
        return np.zeros(0)
    # Windows without motion show rounding only, and would drag the median to zero where an encoder rests much.
    parts = sliding_window_view(values, _WINDOW)
    spans = sliding_window_view(times, _WINDOW)
    even = np.ptp(np.diff(spans, axis=1), axis=1) < 0.5 * np.median(np.diff(times))
    moving = np.ptp(parts, axis=1) > 0
    s = np.linspace(-1, 1, _WINDOW)
    basis, _ = np.linalg.qr(np.stack([np.ones(_WINDOW), s, s * s], axis=1))
    chosen = parts[even & moving][:: max(1, _WINDOW // 2)]
    if len(chosen) < 10:
        return np.zeros(0)
    chosen = chosen - chosen.mean(axis=1, keepdims=True)
    left = chosen - (chosen @ basis) @ basis.T
    return (left * left).sum(axis=1) / _DEGREES
