"""A hold-out that goes beyond what was learned: the model explains the recordings, but not it.

What hardly shows in the recordings (a drag where they are slow, friction at a rope length where they never were) may
be all that the hold-out shows. Of a model whose numbers are known as well as they are, errors there have a size.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.base import channel_errors
from ..identify.evaluate import Run, early
from ..identify.finer import LastFit
from ..identify.lanes import Batch, Lanes
from ..identify.uncertainty import covariance
from .adequacy import LARGE, ratios

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
    ratio: float
    """Error over noise of the worst."""


def surprise(fitted: LastFit, run: Run, limit: float = LARGE) -> Surprise | None:
    """Whether recordings of a hold-out are met worse than those learned from and all that is uncertain allow.

    Args:
        fitted: the final model.
        run: its free runs over the hold-out.
        limit: error over noise from which anything is a surprise.

    Returns:
        The channel that is met worst beyond what is allowed, and where. None also where the recordings themselves are
        met badly, since then that is to be explained first.
    """
    own = channel_errors(fitted.batch, fitted.gram.predicted[0], over_noise=True)
    if not max(own.values()) <= LARGE:
        return None
    limit *= 1.0 if fitted.finer else _COARSE
    batch, found = run.batch, ratios(run.batch, run.predicted)
    real = np.flatnonzero(np.asarray(batch.recording) >= 0)
    for k in np.argsort(-found.max(axis=0)):
        badly = found[:, k] > limit
        if not badly.any():
            continue
        number = np.count_nonzero(np.asarray(batch.lanes.weight)[real, :, k], axis=1)
        excess = np.maximum(found[:, k] ** 2 - 1.0, 0.0) * number
        badly &= excess > _SURE * _expected(fitted, batch, int(k))[real]
        if badly.any():
            order = sorted(np.flatnonzero(badly), key=lambda lane: -found[lane, k])
            which = tuple(int(batch.recording[real[lane]]) for lane in order)
            return Surprise(AXES[k], which, float(found[order[0], k]))
    return None


def _expected(fitted: LastFit, batch: Batch, channel: int) -> NDArray[np.float64]:
    """Of each lane, the weighted squared error of a channel that uncertain numbers and an uncertain start make."""
    count, columns = len(fitted.free), fitted.columns
    cov = covariance(fitted.gram.products[0], fitted.gram.predicted[0], count, columns, fitted.initial, fitted.batch)

    def products(lanes: Lanes) -> NDArray[np.float64]:
        rows = fitted.vector[None], fitted.free[None], batch.initial[None]
        return fitted.engine.gram(*rows, dataclasses.replace(batch, lanes=lanes), columns=columns).products[0]

    alone = np.zeros_like(np.asarray(batch.lanes.weight))
    alone[:, :, channel] = np.asarray(batch.lanes.weight)[:, :, channel]
    states = slice(columns, columns + batch.initial.shape[1])
    whole = products(eqx.tree_at(lambda lanes: lanes.weight, batch.lanes, jax.device_put(alone)))
    begun = products(early(batch))[:, states, states]
    out = np.einsum("ij,lji->l", cov, whole[:, :count, :count])
    for lane in range(batch.count):
        free = np.isfinite(batch.prior[lane])
        if free.any() and batch.recording[lane] >= 0:
            told = begun[lane][np.ix_(free, free)] + np.diag(batch.prior[lane][free] ** 2)
            out[lane] += np.trace(np.linalg.solve(told, whole[lane, states, states][np.ix_(free, free)]))
    return np.asarray(np.nan_to_num(out, nan=0.0), np.float64)
