"""Is the model adequate? Large, significant and learnable: an alarm needs all three.

*Large*: some channel is met worse than 1.5 times its noise. *Significant*: residuals hang together over longer times
than noise does, judged against the same residuals with the signs of short blocks drawn at random. *Learnable*: what
is chosen on some recordings predicts the residual of the others (`screen`), or the force that is missing (`repeats`);
what is large but does not repeat is the rig's own scatter. What is not large raises an alarm only if a name explains
most of it, on recordings that had no part in its fit and on the hold-out.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ..identify.base import channel_errors
from ..identify.evaluate import Run
from ..identify.lanes import Batch
from ..identify.result import Errors
from .result import Channel

LARGE = 1.5
"""Error over noise from which a channel counts as badly met."""
NOTICEABLE = 1.1
"""The same from which names are tried."""
SIGNIFICANT = 0.01
LEARNABLE = 0.3
"""Least share of the excess that must repeat from one recording to another."""
FORESEEN = 0.3
"""Least share of the missing force that other recordings must foresee (`repeats`) for the same, or for the names not
to be the whole truth. Of friction that wanders by 5 % they foresee up to 0.25 (seven concealed cases: 0, 0,
0.03, 0.06, 0.14, 0.14 and 0.25), of laws left out mostly 0.5 and more."""
STILL_LEARNABLE = 0.1
"""Least share of the excess that must repeat for the names not to be the whole truth."""
PROVEN = 0.5
"""Least share of the excess over noise that named effects must remove from the hold-out."""
HELPFUL = 0.1
"""Least share of that excess which names must remove to be told at all. Of twelve concealed cases in which they removed
less, one name was right; of twelve in which they removed more and yet not enough, seven."""
_BLOCK = 0.1
"""Length of the blocks whose signs are drawn [s]."""
_SPAN = 1.0
"""Longest time over which blocks are compared [s]."""
_DRAWS = 199


def channels(batch: Batch, predicted: NDArray[np.float64], noise: Mapping[str, float]) -> dict[str, Channel]:
    """Errors of every channel beside its noise [m, rad, m]."""
    return {axis: Channel(error, noise[axis]) for axis, error in channel_errors(batch, predicted).items()}


def worst_ratio(errors: Mapping[str, float], noise: Mapping[str, float]) -> float:
    """Error over noise of the channel that is met worst; infinite where a simulation ran away."""
    return max((float(np.nan_to_num(e / noise[axis], nan=np.inf)) for axis, e in errors.items()), default=0.0)


def is_large(found: Mapping[str, Channel], limit: float = LARGE) -> bool:
    """Whether some channel is met worse than so many times its noise."""
    # Written so that what is no number counts as large.
    return any(not channel.ratio <= limit for channel in found.values())


def carries_over(before: Errors, after: Errors, noise: Mapping[str, float], *, windows: bool) -> bool:
    """Whether what was named closes the gap on the hold-out, too, or leaves little there and makes little worse.

    Args:
        before: the hold-out's errors without it.
        after: with it.
        noise: standard deviation of each channel [m, rad, m].
        windows: whether windows were compared, since whole recordings drift too far.
    """
    first, last = (worst_ratio(errors.window if windows else errors.free_run, noise) for errors in (before, after))
    return last < np.inf and (last <= min(LARGE, NOTICEABLE * max(first, 1.0)) or _closes(first, last))


def in_vain(before: Errors, after: Errors, noise: Mapping[str, float], *, windows: bool) -> bool:
    """Whether what was named leaves the hold-out as badly met as it was; arguments as those of `carries_over`.

    Of all channels together, since what mends one of them may spoil another.
    """
    first, last = (_together(errors.window if windows else errors.free_run, noise) for errors in (before, after))
    return not last - 1.0 <= (1.0 - HELPFUL) * (first - 1.0)


def _together(errors: Mapping[str, float], noise: Mapping[str, float]) -> float:
    """Root mean square of the channels' errors over noise; infinite where a simulation ran away."""
    power = [np.nan_to_num(e / noise[axis], nan=np.inf) ** 2 for axis, e in errors.items()]
    return float(np.sqrt(np.mean(power))) if power else 0.0


def closes_little(before: Run, after: Run) -> bool:
    """Whether what was named for a small error shows on the hold-out, too, and closes the gap there.

    Of all recordings and channels that are noticeably worse than noise, since one of many may be all that shows it.

    Args:
        before: the hold-out's free runs without it.
        after: with it.
    """
    first, last = (ratios(run.batch, run.predicted) for run in (before, after))
    shown = np.maximum(first, last) > NOTICEABLE
    gap, left = (float(np.sum(np.maximum(found[shown] - 1.0, 0.0))) for found in (first, last))
    return bool((first > NOTICEABLE).any() and np.isfinite(left) and left <= (1.0 - PROVEN) * gap)


def ratios(batch: Batch, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Error over noise, `(recording, channel)`; infinite where a simulation ran away, 0 where nothing was measured.

    Args:
        batch: whole recordings.
        predicted: what a model says of them, `(recording, sample, channel)` [m, rad, m].
    """
    weight = np.asarray(batch.lanes.weight)
    residual = np.where(weight > 0, predicted - np.asarray(batch.lanes.y), 0.0) * weight
    number = np.maximum(np.count_nonzero(weight, axis=1), 1)
    power = np.nan_to_num(np.sum(residual**2, axis=1) / number, nan=np.inf)
    return np.sqrt(power)[np.asarray(batch.recording) >= 0]


def _closes(first: float, last: float) -> bool:
    return last - 1.0 <= (1.0 - PROVEN) * (first - 1.0)


def significance(batch: Batch, predicted: NDArray[np.float64], seed: int = 0, *, draws: bool = True) -> float:
    """Chance of so much structure in the residuals if their signs were free every tenth of a second.

    The recorded input is held, since a controller that may have made it is not known.

    Args:
        batch: whole recordings.
        predicted: what the model says of them [m, rad, m].
        seed: of the draws.
        draws: False takes the distribution for many independent blocks instead (Ljung and Box, Biometrika 65, 1978),
            of the channel that is least likely.
    """
    weight = np.asarray(batch.lanes.weight)
    residual = (predicted - np.asarray(batch.lanes.y)) * weight
    dt = np.asarray(batch.lanes.lane.dt)
    period = float(np.median(dt[dt > 0]))
    block = max(1, round(_BLOCK / period))
    blocks = residual.shape[1] // block
    sums = residual[:, : blocks * block].reshape(len(residual), blocks, block, 3).sum(axis=2)
    span = max(2, round(_SPAN / (block * period)))
    rng = np.random.default_rng(seed)

    if not draws:
        return _ljung_box(sums, span)

    def statistic(values: NDArray[np.float64]) -> float:
        # Squared, so that a swing that falls behind counts as well as a cart that drifts.
        lags = range(1, min(span, blocks - 1) + 1)
        together = sum((values[:, k:] * values[:, :-k]).sum(axis=(0, 1)) ** 2 for k in lags)
        power = (values**2).sum(axis=(0, 1))
        return float(np.max(together / np.where(power > 0, power, 1.0) ** 2))

    own = statistic(sums)
    above = 0
    for _ in range(_DRAWS):
        signs = rng.choice((-1.0, 1.0), size=(*sums.shape[:2], 1))
        above += statistic(sums * signs) >= own
    return (1 + above) / (1 + _DRAWS)


def _ljung_box(sums: NDArray[np.float64], span: int) -> float:
    """The chance for the least likely channel, with Bonferroni's allowance for their number."""
    least, channels_seen = 1.0, 0
    for values in np.moveaxis(sums, 2, 0):
        power = float((values**2).sum())
        if power == 0.0:
            continue
        seen = values != 0.0
        count = int(seen.sum())
        lags = range(1, min(span, values.shape[1] - 1) + 1)
        together = [float((values[:, k:] * values[:, :-k]).sum()) / power for k in lags]
        pairs = [max(int((seen[:, k:] & seen[:, :-k]).sum()), 1) for k in lags]
        q = count * (count + 2) * sum(r**2 / n for n, r in zip(pairs, together, strict=True))
        least, channels_seen = min(least, float(chi2.sf(q, len(lags)))), channels_seen + 1
    return min(1.0, least * max(channels_seen, 1))
