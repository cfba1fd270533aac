"""A hold-out that goes beyond what was learned: the model explains the recordings, but not it.

What hardly shows in the recordings (a drag where they are slow, friction at a rope length where they never were) may
be all that the hold-out shows. Of a model whose numbers are known as well as they are, errors there have a size.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from .._types import AXES
from ..identify.base import channel_errors
from ..identify.evaluate import Run
from ..identify.finer import LastFit
from ..identify.uncertainty import covariance
from ..recordings import Recording
from .adequacy import LARGE

_SURE = 4.0
"""Times the squared error that uncertain numbers make, from which it is no chance: two standard deviations."""
_COARSE = 2.0
"""What the limit is multiplied by where the engine's own steps may make such errors."""


def surprise(fitted: LastFit, run: Run, noise: Mapping[str, float]) -> str | None:
    """The channel of a hold-out that is met worse than the recordings and their uncertainty allow, if any.

    Args:
        fitted: the final model.
        run: its free runs over the hold-out.
        noise: standard deviation of each channel [m, rad, m].

    Returns:
        None also where the recordings themselves are met badly, since then that is to be explained first.
    """
    own = channel_errors(fitted.batch, fitted.gram.predicted[0], over_noise=True)
    ratios = {axis: error / noise[axis] for axis, error in run.errors.free_run.items()}
    worst = max(ratios, key=lambda axis: ratios[axis], default=None)
    limit = LARGE if fitted.finer else _COARSE * LARGE
    if worst is None or max(own.values()) > LARGE or not limit < ratios[worst] < np.inf:
        return None
    count = len(fitted.free)
    cov = covariance(
        fitted.gram.products[0], fitted.gram.predicted[0], count, fitted.columns, fitted.initial, fitted.batch
    )
    rows = fitted.vector[None], fitted.free[None], run.batch.initial[None]
    products = fitted.engine.gram(*rows, run.batch, columns=fitted.columns).products[0][:, :count, :count]
    expected = float(np.trace(cov @ products.sum(axis=0)))
    number = int(np.count_nonzero(np.asarray(run.batch.lanes.weight)[:, :, AXES.index(worst)]))
    return worst if (ratios[worst] ** 2 - 1.0) * number > _SURE * expected else None


def worst_met(run: Run, recordings: Sequence[Recording]) -> int:
    """Which recording is met worst."""
    weight = np.asarray(run.batch.lanes.weight)
    residual = np.where(weight > 0, (run.predicted - np.asarray(run.batch.lanes.y)) * weight, 0.0)
    power = [
        float(np.sum(residual[run.batch.recording == i] ** 2) / max(np.sum(weight[run.batch.recording == i] > 0), 1))
        for i in range(len(recordings))
    ]
    return int(np.argmax(power))
