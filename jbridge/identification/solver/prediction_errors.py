"""What simulations leave of the measurements, from given parameters and initial states of windows."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..data.windows import Data
from ..likelihood import Likelihood
from ..sensitivity.engine import Engine, Job
from ..sensitivity.windowed_rollout import FAR


@dataclasses.dataclass(frozen=True)
class Start:
    """Where a fit begins."""

    vector: NDArray[np.float64]
    free: NDArray[np.int64]
    states: tuple[NDArray[np.float64], ...]
    """By tiling, `(window, 6)`."""


@dataclasses.dataclass(frozen=True)
class Point:
    """Parameters and initial states, and what they leave."""

    vector: NDArray[np.float64]
    free: NDArray[np.int64]
    states: tuple[NDArray[np.float64], ...]
    square: NDArray[np.float64]
    """Mean square of each window's errors over the noise's variance, by window and channel."""
    prior: float
    """What the parameters cost beforehand, see `prior`."""
    value: float
    """The criterion without a price."""
    promise: float = math.inf
    """What the step of the parameters that led here should have gained [nat], beyond what initial states gain alone:
    next to nothing where they have arrived."""
    left: tuple[NDArray[np.float64], ...] = ()
    """Residuals over the noise, by tiling `(sample, 3)`, where a fit goes on from here; else none, to spare memory."""

    @property
    def start(self) -> Start:
        return Start(self.vector, self.free, self.states)


def evaluate(
    engine: Engine, data: Data, likelihood: Likelihood, starts: Sequence[Start], *, keep: bool = False
) -> list[Point]:
    """Simulates every start once; with `keep` the points hold what is left."""
    jobs = [Job(s.vector, t.recording, t.begins, s.states[k]) for s in starts for k, t in enumerate(data.tilings)]
    predicted = engine.predict(jobs)
    out, count = [], len(data.tilings)
    for i, start in enumerate(starts):
        left = tuple(residual(data, k, predicted[i * count + k]) for k in range(count))
        square = np.concatenate([mean_squares(data, k, own) for k, own in enumerate(left)] or [np.zeros((0, 3))])
        prior = likelihood.prior.cost(engine.table, start.vector)
        value = likelihood.value(square) + prior
        out.append(Point(start.vector, start.free, start.states, square, prior, value, left=left if keep else ()))
    return out


def residuals(engine: Engine, data: Data, start: Start | Point) -> list[NDArray[np.float64]]:
    """What a simulation leaves over the noise, by tiling `(sample, 3)`; 0 where nothing is measured."""
    jobs = [Job(start.vector, t.recording, t.begins, start.states[k]) for k, t in enumerate(data.tilings)]
    return [residual(data, k, found) for k, found in enumerate(engine.predict(jobs))]


def residual(data: Data, tiling: int, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    r = data.tilings[tiling].recording
    if not np.isfinite(predicted).all():
        # What is no number counts as one that is far off, like a simulation that runs away.
        predicted = np.where(np.isfinite(predicted), predicted, FAR)
    return (predicted - data.y[r]) * data.weight[r]


def squares(data: Data, tiling: int, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean square error of each window over the noise's variance, `(window, 3)`."""
    return mean_squares(data, tiling, residual(data, tiling, predicted))


def mean_squares(data: Data, tiling: int, left: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean square over each window, `(window, 3)`, of what is 0 where nothing is measured, `(sample, 3)`."""
    t = data.tilings[tiling]
    before = data.measured_before[t.recording]
    return t.sums(left * left) / np.maximum(before[t.stops] - before[t.count_from], 1)
