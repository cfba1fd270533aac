"""The noise floor of each channel, from the recordings themselves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.special import gammaincinv

from ..._types import AXES
from ...recordings import Recording

_WINDOW = 9
"""Samples of a local polynomial, at most: enough to leave degrees of freedom."""
_SHORT = 0.06
"""Time [s] over which any motion of the bridge is a parabola: half of a cart's mass over its damping."""
_HIGHER = (3, 4, 5, 6)
"""Degrees of the polynomials, each through three samples more than its degree, where samples are too slow for that."""
_GAP = 1.75
"""Of the usual time between samples: a longer one is a gap."""
_FEWEST = 10
"""Windows, for an estimate."""


LEAST = {"x": 2e-5, "psi": 1.5e-4, "l": 2e-5}
"""What no channel is met better than [m, rad, m], however exact it is: so far off are a fit's own steps of time. To the
recordings of a simulation a model would otherwise be wrong by them."""


class _Run(NamedTuple):
    times: NDArray[np.float64]
    values: NDArray[np.float64]
    resolution: float


def noise_floor(recordings: Sequence[Recording]) -> dict[str, float]:
    """Standard deviation of the noise by channel [m, rad, m].

    The larger of two estimates, not their sum: what is left of local polynomials, and the rounding of the encoder,
    `resolution / sqrt(12)`. At rest a coarse encoder shows no scatter at all, and the second is all that can be known.
    """
    floor = {}
    for axis in AXES:
        runs, rounding = [], []
        for recording in recordings:
            values = getattr(recording, axis)
            if values is None:
                continue
            fresh = recording.fresh[axis]
            resolution = recording.resolution.get(axis, 0.0)
            runs.append(_Run(recording.times[fresh], values[fresh], resolution))
            rounding.append(resolution / np.sqrt(12.0))
        if runs:
            floor[axis] = max(_scatter(runs), float(np.median(rounding)), LEAST[axis])
    return floor


def _scatter(runs: Sequence[_Run]) -> float:
    """Standard deviation about local polynomials, over all recordings of a channel; 0 where too little was sampled.

    Where samples come fast, about parabolas, and the median over all windows, so that jerks and stops do not count.
    Where they come slowly a parabola would take motion for noise: then about polynomials of higher degree, at the
    quartile of the quieter windows, since motion only ever adds; of several degrees, since one quartile is uncertain.
    """
    enough = [run for run in runs if len(run.times) >= 4 * _WINDOW]
    fast = [run for run in enough if (_WINDOW - 1) * np.median(np.diff(run.times)) <= _SHORT]
    if fast:  # recordings of both sorts see the same sensor, these better
        return _spread(fast, _WINDOW, 2, 0.5, 0.0)
    # The quieter windows must not be those at rest, where an encoder flickers between two counts or shows one.
    each = [_spread(enough, degree + 3, degree, 0.25, 2.0) for degree in _HIGHER] if enough else [0.0]
    return float(np.median(each))


def _spread(runs: Sequence[_Run], window: int, degree: int, quantile: float, counts: float) -> float:
    """Standard deviation of noise whose variance about polynomials has this quantile among the windows."""
    variances = np.concatenate([_variances(run, window, degree, counts * run.resolution) for run in runs])
    if not len(variances):
        return 0.0
    half = 0.5 * (window - 1 - degree)
    return float(np.sqrt(np.quantile(variances, quantile) * half / gammaincinv(half, quantile)))


def _variances(run: _Run, window: int, degree: int, rest: float) -> NDArray[np.float64]:
    """Variance about a polynomial through each window of samples, at their own times; without windows across gaps.

    Windows whose readings lie within `rest` are left out.
    """
    times, values, _ = run
    usual = float(np.median(np.diff(times)))
    spans, parts = sliding_window_view(times, window), sliding_window_view(values, window)
    # Windows without motion show rounding only, and would drag the quantile to zero where an encoder rests much.
    moving = np.ptp(parts, axis=1) > 1.001 * rest
    whole = np.max(np.diff(spans, axis=1), axis=1) < _GAP * usual
    # Where stamps come in bursts, every window has what looks like a gap.
    chosen = moving & whole if np.count_nonzero(moving & whole) >= _FEWEST * (window // 2) else moving
    spans, parts = spans[chosen][:: window // 2], parts[chosen][:: window // 2]
    if len(parts) < _FEWEST:
        return np.zeros(0)
    middle = 0.5 * (spans[:, :1] + spans[:, -1:])
    scaled = (spans - middle) / (0.5 * (spans[:, -1:] - spans[:, :1]))
    basis, _ = np.linalg.qr(scaled[:, :, None] ** np.arange(degree + 1))
    parts = parts - parts.mean(axis=1, keepdims=True)
    left = parts - np.einsum("wij,wj->wi", basis, np.einsum("wij,wi->wj", basis, parts))
    return (left * left).sum(axis=1) / (window - 1 - degree)
