"""How far the integration steps of a fit are off, and a last fit that makes up for it.

With steps as long as a fit can afford, a simulation is off by about half the noise of a good encoder, where a motor's
input jumps and where friction holds or lets go. That is little, but systematic, and a delay takes it up. How far it is
off hardly depends on the parameters: so one simulation with finer steps tells it, and it is taken off the measurements.
"""

import dataclasses

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from .base import BaseFit, channel_errors, columns_for
from .lanes import Batch
from .linearise import Engine, Gram
from .solve import solve

FINER = 4
"""Steps in place of one. Error goes with the square of the step, so what is left is a sixteenth."""
_ROUNDS = 2
_CLOSE = 1.5
"""Error over noise up to which a model's own error is no small part of it."""
_WORSE = 1.02
"""Growth of the cost up to which a correction is one. Where a little more decides whether a drive breaks away, a
simulation with finer steps is another motion, and its difference no correction."""


@dataclasses.dataclass(frozen=True)
class LastFit:
    """A model fitted to a batch, whose parameters are reported."""

    engine: Engine
    vector: NDArray[np.float64]
    free: NDArray[np.int64]
    initial: NDArray[np.float64]
    gram: Gram
    """At the fit, one row."""
    batch: Batch
    finer: bool = False
    """Whether `batch` is what was measured less the engine's own error."""

    @classmethod
    def of(cls, base: BaseFit) -> "LastFit":
        """The fit of a model as given."""
        return cls(base.engine, base.vector, base.free, base.fits.initial[0], base.fits.gram, base.fitted)

    @property
    def columns(self) -> int:
        """Columns of `gram`'s programs."""
        return columns_for(len(self.free))

    @property
    def cost(self) -> float:
        """Sum of squared weighted residuals."""
        return float(self.gram.cost.sum())


def less_own_error(
    engine: Engine,
    vector: NDArray[np.float64],
    initial: NDArray[np.float64],
    batch: Batch,
    predicted: NDArray[np.float64],
) -> tuple[Batch, NDArray[np.float64]]:
    """The batch with what finer steps would change taken off the measurements.

    Args:
        engine: of the model.
        vector: its parameters, `(parameter,)`.
        initial: initial states, `(lane, state)`.
        batch: the lanes.
        predicted: readings at the usual steps, `(lane, sample, channel)`.

    Returns:
        The corrected batch, and the readings with finer steps, `(lane, sample, channel)`.
    """
    fine = np.asarray(engine.motions(vector, initial, batch, finer=FINER)[1])
    weighed = np.asarray(batch.lanes.weight) > 0
    change = np.where(weighed & np.isfinite(fine) & np.isfinite(predicted), fine - predicted, 0.0)
    y = jax.device_put(np.asarray(batch.lanes.y) - change)
    return dataclasses.replace(batch, lanes=eqx.tree_at(lambda lanes: lanes.y, batch.lanes, y)), fine


def fit_finely(fitted: LastFit, close: float = _CLOSE) -> LastFit:
    """What a fit with finer steps would give.

    `fitted` itself where it leaves much more than noise (`close` times it), or where the difference is no small
    correction.
    """
    if not max(channel_errors(fitted.batch, fitted.gram.predicted[0], over_noise=True).values()) <= close:
        return fitted
    now = fitted
    for _ in range(_ROUNDS):
        batch, _ = less_own_error(now.engine, now.vector, now.initial, fitted.batch, now.gram.predicted[0])
        fits = solve(
            now.engine,
            batch,
            now.vector[None],
            [now.free],
            initial=now.initial[None],
            columns=now.columns,
            iterations=6,
        )
        now = dataclasses.replace(
            now, vector=fits.vectors[0], initial=fits.initial[0], gram=fits.gram, batch=batch, finer=True
        )
        if not now.cost <= _WORSE * fitted.cost:
            return fitted
    return now
