"""A hold-out that goes beyond what was learned: the model explains the recordings, but not it.

What hardly shows in the recordings (a drag where they are slow, friction at a rope length where they never were) may
be all that the hold-out shows. Of a model whose numbers are known as well as they are, errors there have a size.
"""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.base import channel_errors
from ..identify.evaluate import Run, early
from ..identify.finer import LastFit
from ..identify.lanes import Batch
from ..identify.uncertainty import covariance
from .adequacy import LARGE

_SURE = 4.0
"""Times the squared error that uncertain numbers and starts make, from which it is no chance: two standard deviations.

Not those of the intervals: widening each number by itself parts what the recordings hold together, and would allow
errors a hundred times as large."""
_COARSE = 2.0
"""What the limit is multiplied by where the engine's own steps may make such errors."""


class Surprise(NamedTuple):
    """What shows on a hold-out alone."""

    channel: str
    recordings: tuple[int, ...]
    """Those of the hold-out that show it, the worst first."""


def surprise(fitted: LastFit, run: Run, noise: Mapping[str, float], limit: float = LARGE) -> Surprise | None:
    """Whether recordings of a hold-out are met worse than those learned from and all that is uncertain allow.

    Args:
        fitted: the final model.
        run: its free runs over the hold-out.
        noise: standard deviation of each channel [m, rad, m].
        limit: error over noise from which anything is one.

    Returns:
        The channel that is met worst, and where. None also where the recordings themselves are met badly, since then
        that is to be explained first.
    """
    own = channel_errors(fitted.batch, fitted.gram.predicted[0], over_noise=True)
    ratios = {axis: run.errors.free_run[axis] / noise[axis] for axis in run.errors.free_run}
    # What is no number is worse than any.
    worst = max(ratios, key=lambda axis: np.nan_to_num(ratios[axis], nan=np.inf), default=None)
    if worst is None or not max(own.values()) <= LARGE:
        return None
    limit *= 1.0 if fitted.finer else _COARSE
    k = AXES.index(worst)
    weight = np.asarray(run.batch.lanes.weight)[:, :, k]
    residual = np.where(weight > 0, (run.predicted - np.asarray(run.batch.lanes.y))[:, :, k] * weight, 0.0)
    number = np.maximum(np.count_nonzero(weight, axis=1), 1)
    power = np.nan_to_num(np.sum(residual**2, axis=1), nan=np.inf)
    badly = (power > limit**2 * number) & (run.batch.recording >= 0)
    if not badly.any():
        return None
    badly &= power - number > _SURE * _expected(fitted, run.batch)
    order = sorted(np.flatnonzero(badly), key=lambda lane: -power[lane] / number[lane])
    return Surprise(worst, tuple(int(run.batch.recording[lane]) for lane in order)) if order else None


def _expected(fitted: LastFit, batch: Batch) -> NDArray[np.float64]:
    """Of each lane, the weighted squared error that uncertain numbers and an uncertain start make."""
    count, columns = len(fitted.free), fitted.columns
    cov = covariance(fitted.gram.products[0], fitted.gram.predicted[0], count, columns, fitted.initial, fitted.batch)

    def products(batch: Batch) -> NDArray[np.float64]:
        rows = fitted.vector[None], fitted.free[None], batch.initial[None]
        return fitted.engine.gram(*rows, batch, columns=columns).products[0]

    states = slice(columns, columns + batch.initial.shape[1])
    whole = products(batch)
    begun = products(dataclasses.replace(batch, lanes=early(batch)))[:, states, states]
    out = np.einsum("ij,lji->l", cov, whole[:, :count, :count])
    for lane in range(batch.count):
        free = np.isfinite(batch.prior[lane])
        if free.any() and batch.recording[lane] >= 0:
            told = begun[lane][np.ix_(free, free)] + np.diag(batch.prior[lane][free] ** 2)
            out[lane] += np.trace(np.linalg.solve(told, whole[lane, states, states][np.ix_(free, free)]))
    return np.asarray(np.nan_to_num(out, nan=0.0), np.float64)
