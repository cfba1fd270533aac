"""The criterion that fits minimise and searches compare: the logarithm of errors in windows.

The variance of channel `c` in a window is

    s2 = (m mse + nu) / (m + nu),

in units of the noise's variance, with `m` the effective number of samples of a window and `nu = 2`: no window can be
met better than its noise. The windows of one horizon of a recording are Student's t with one scale `S`, the typical
variance, which is estimated with all else. The criterion is

    J = sum over recordings and channels of n * weighted mean over horizons of mean over windows of a j,
    j = ln(S) / 2 + ln((1 + s2 / S) / 2).

It goes by the logarithm of the typical error: between 200 and 100 times the noise as much is gained as between 2 times
and once. Windows near the typical error count by their squares, as in least squares. One that the model cannot meet yet
costs the logarithm of its error, so it does not bend everything else; and one that happens to be met far better than
most has no say of its own: a sum of logarithms would have a minimum at each such window. `n`, the effective number of
samples of a recording (the geometric mean over horizons), follows from the autocorrelation of what the best model so
far leaves, over the root of `(S + s2) / 2`, so that one window that it does not meet does not say how the errors of all
others hang together: it is the number of independent samples whose mean square would be as uncertain (Bayley and
Hammersley, Supplement to the Journal of the Royal Statistical Society 8, 1946). A whole recording of a model that
drifts has a few, short windows have hundreds: horizons weigh as their own numbers do, so that no law is found in a
single drift, but none by more than the mean, so that short windows, in which slow laws hardly show, do not outvote long
ones. `a` discounts windows in which the rig rests and the best model so far is right, which tell next to nothing of
laws of motion; where the rig rests and the model does not, it lacks what holds the rig.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .data.windows import Data
from .prior import Prior

NU = 2.0
"""Weight of the noise that is known beforehand, in samples."""
_FEW = 1e-9
"""Samples of a window of which the logarithm of its error is as good as linear in the squares."""
_NEWTON, _ARRIVED = 12, 1e-12
"""Steps to the logarithm of a scale, and how short the last one is, unless these are too few."""
_MOTION = 5.0
"""Standard deviation of a reading over its noise at which a window tells half of what one in motion does."""


@dataclasses.dataclass(frozen=True)
class Index:
    """All windows of all tilings in one row."""

    recording: NDArray[np.int64]
    horizon: NDArray[np.float64]
    tiling: NDArray[np.int64]
    begin: NDArray[np.int64]
    stop: NDArray[np.int64]
    count: NDArray[np.float64]
    """Measured samples by window and channel."""
    signal: NDArray[np.float64]
    """Variance of the readings over the noise's, by window and channel; 0 where nothing is measured."""

    @property
    def motion(self) -> NDArray[np.float64]:
        """How much each window is one in motion, from 0 to 1, by window and channel."""
        return _told(self.signal)


def _told(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    return signal / (signal + _MOTION**2)


def index(data: Data) -> Index:
    """Lists the windows of all tilings, and how much moves in each."""
    parts, counts, signals = [], [], []
    for own, tiling in enumerate(data.tilings):
        r = tiling.recording
        for a, b in zip(tiling.count_from, tiling.stops, strict=True):
            seen = data.measured[r, a:b]
            count = seen.sum(axis=0)
            mean = (data.y[r, a:b] * seen).sum(axis=0) / np.maximum(count, 1)
            var = ((data.y[r, a:b] - mean) ** 2 * seen).sum(axis=0) / np.maximum(count, 1)
            signal = var / np.where(np.isnan(data.noise[r]), 1.0, data.noise[r]) ** 2
            counts.append(count)
            signals.append(signal)
        for a, b in zip(tiling.begins, tiling.stops, strict=True):
            parts.append((r, tiling.horizon, own, a, b))
    recording, horizon, number, begin, stop = (np.array(column) for column in zip(*parts, strict=True))
    return Index(recording, horizon, number, begin, stop, np.array(counts, float), np.array(signals, float))


@dataclasses.dataclass(frozen=True)
class Likelihood:
    """The criterion for one set of windows, with the effective numbers of samples that it goes by."""

    share: NDArray[np.float64]
    """What the logarithm of each window's variance counts, by window and channel."""
    within: NDArray[np.float64]
    """Effective number of samples within a window, by window and channel: `m`."""
    count: NDArray[np.float64]
    group: NDArray[np.int64]
    """Number of each window's recording and horizon, which have a scale together."""
    total: float
    """Effective number of samples of all recordings and channels, `N` of the price."""
    prior: Prior
    """What is known of the parameters beforehand, which counts beside the windows."""

    def variance(self, square: NDArray[np.float64]) -> NDArray[np.float64]:
        """`s2` from the mean square of each window's errors, both over the noise's variance."""
        return (self.within * square + NU) / (self.within + NU)

    def scale(self, square: NDArray[np.float64]) -> NDArray[np.float64]:
        """`S` of each window and channel: logistic M-estimate of where the logarithms of the variances lie."""
        level = np.log(self.variance(square)).ravel()
        # Each channel of a group has a scale of its own.
        channels = square.shape[1]
        own = (self.group[:, None] * channels + np.arange(channels)).ravel()
        groups, weight = int(own.max(initial=-1)) + 1, self.share.ravel()
        total = np.bincount(own, weight, groups)
        share = weight / np.maximum(total, 1e-300)[own]
        at = np.asarray(np.bincount(own, share * level, groups), float)
        for _ in range(_NEWTON):
            above = 1.0 / (1.0 + np.exp(np.clip(at[own] - level, -300.0, 300.0)))
            slope = np.bincount(own, share * above * (1.0 - above), groups)
            step = (np.bincount(own, share * above, groups) - 0.5) / np.maximum(slope, 0.05)
            step = np.clip(np.where(total > 0.0, step, 0.0), -2.0, 2.0)
            at = at + step
            if np.abs(step).max(initial=0.0) < _ARRIVED:
                break
        return np.exp(at[own]).reshape(square.shape)

    def by_window(self, square: NDArray[np.float64], scale: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Each window's part of the criterion, by window and channel, with the scales of these squares or others."""
        own = self.scale(square) if scale is None else scale
        return self.share * (0.5 * np.log(own) + np.log(0.5 * (1.0 + self.variance(square) / own)))

    def value(self, square: NDArray[np.float64]) -> float:
        """`J` of the windows, without what the parameters cost beforehand and without a price."""
        return float(self.by_window(square).sum())

    def of_squares(self) -> "Likelihood":
        """Least squares on the same windows: half the sum of squares over the noise's variance, less a constant."""
        share, within = self.count * NU / _FEW, np.full(self.count.shape, _FEW)
        return Likelihood(share, within, self.count, self.group, self.total, self.prior)

    def expected(self, square: NDArray[np.float64], apart: NDArray[np.float64]) -> NDArray[np.float64]:
        """What each window's part of the criterion is expected to rise by, by window and channel, if a model is
        replaced by another one although it is true.

        Args:
            square: mean square errors of the model, over the noise's variance.
            apart: those of the two models' predictions from each other.
        """
        scale = self.scale(square)
        return self.by_window(square + apart, scale) - self.by_window(square, scale)

    @property
    def price(self) -> float:
        """What one number more must gain [nat]: half the logarithm of how much there is to tell it from."""
        return 0.5 * math.log(max(self.total, 2.0))

    def weighted(self, square: NDArray[np.float64], products: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum over windows and channels of products of slopes and residuals, each with its weight.

        Args:
            square: by window and channel, which the weights are for.
            products: `(window, channel, n, n)`.
        """
        return np.einsum("wc,wcij->ij", self.weights(square), products)

    def weights(self, square: NDArray[np.float64]) -> NDArray[np.float64]:
        """Weight of each sample's squared error over the noise's variance, by window and channel.

        With these the sum of squares has the criterion's gradient, and bounds it from above (the logarithm is concave),
        so that what lowers the one lowers the other.
        """
        slope = 2.0 * self.share * self.within / (self.within + NU)
        return slope / (self.scale(square) + self.variance(square)) / np.maximum(self.count, 1.0)


def likelihood(
    data: Data,
    windows: Index,
    residuals: Sequence[NDArray[np.float64]] | None = None,
    prior: Prior = Prior(),
) -> Likelihood:
    """The criterion with effective numbers of samples from what a model leaves.

    Args:
        data: recordings.
        windows: of its tilings.
        residuals: what the best model so far leaves, by tiling, `(sample, 3)`, over the noise; 0 where nothing is
            measured. Without a model each recording counts as one smooth error.
        prior: of the parameters.
    """
    shape = windows.count.shape
    within, share = np.ones(shape), np.zeros(shape)
    number: dict[tuple[int, int], dict[int, float]] = {}
    for t, tiling in enumerate(data.tilings):
        own = windows.tiling == t
        for k in range(3):
            counted = windows.count[own, k]
            if not counted.any():
                continue
            measured, signal = data.measured[tiling.recording, :, k], windows.signal[own, k]
            left, energy = data.y[tiling.recording, :, k], measured.astype(float)
            if residuals is not None:
                square = tiling.sums(residuals[t][:, k] ** 2) / np.maximum(counted, 1.0)
                signal = np.maximum(signal, square)
                size, told = (counted * square + NU) / (counted + NU), _told(signal)
                # As the criterion weighs them: those near the typical error alike.
                typical = np.exp(np.sum(told * np.log(size)) / max(float(told.sum()), 1e-300))
                energy, factor = np.zeros(len(energy)), np.zeros(len(energy))
                for a, b, own_told, over in zip(tiling.count_from, tiling.stops, told, size + typical, strict=True):
                    energy[a:b], factor[a:b] = own_told, np.sqrt(2.0 * own_told / over)
                left, energy = residuals[t][:, k] * factor, np.where(measured, energy, 0.0)
            effective = _effective(left, energy)
            within[own, k] = np.maximum(counted * effective, 1.0)
            number.setdefault((tiling.recording, k), {})[t] = max(float((counted * effective).sum()), 1.0)
            share[own, k] = _told(signal) / tiling.windows
    total = 0.0
    for (_, k), values in number.items():
        n = float(np.exp(np.mean(np.log(list(values.values())))))
        weight = {t: min(own_number, n) for t, own_number in values.items()}
        for t, own_weight in weight.items():
            share[windows.tiling == t, k] *= n * own_weight / sum(weight.values())
        total += n
    _, group = np.unique(np.stack([windows.recording, windows.horizon]), axis=1, return_inverse=True)
    return Likelihood(share, within, windows.count, group, total, prior)


def _effective(residual: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Effective number of samples over their number, from the autocorrelation over a recording.

    It is that of the recording, not of its windows: an error that comes back with every repetition of a motion tells
    no more than one repetition does.

    Args:
        residual: of each sample.
        weight: its mean square in proportion to that of the others, if the errors of all windows were alike; 0 where
            nothing is measured.
    """
    size = 2 ** int(np.ceil(np.log2(2 * len(residual))))
    lags = np.arange(1, max(len(residual) // 2, 2))
    total = _autocorrelation(np.where(weight > 0.0, residual, 0.0), size)
    pairs = _autocorrelation(weight, size)
    if total[0] <= 0.0:
        return 1.0
    # The square of a correlation that is none is 1/pairs on average, where all weigh the same. What is correlated adds
    # more than that at far lags, which is not told from an error that comes back: the number is rather too small than
    # too large.
    squares = (total[lags] / total[0]) ** 2 - pairs[lags] / max(float(weight.sum()), 1e-300) ** 2
    return float(1.0 / (1.0 + 2.0 * max(float(squares.sum()), 0.0)))


def _autocorrelation(values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    return np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)
