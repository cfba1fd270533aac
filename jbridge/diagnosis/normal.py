"""Normal equations of a base model's numbers and of what effects that it lacks would do, initial states eliminated."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..identify.base import columns_for
from ..identify.lanes import Batch, refined
from ..identify.linearise import Engine, Gram
from ..identify.respond import linearise
from ..identify.solve import Reduced, bounded_step, reduce
from .candidates import Candidate
from .columns import candidate_columns


@dataclasses.dataclass(frozen=True)
class Normal:
    """Normal equations of base parameters and all null candidates, by lane, initial states eliminated."""

    matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]
    cost: NDArray[np.float64]
    count: NDArray[np.float64]
    """Measured values of each lane."""

    def over(self, lanes: NDArray[np.bool_]) -> "Sum":
        return Sum(self.matrix[lanes].sum(axis=0), self.gradient[lanes].sum(axis=0), float(self.cost[lanes].sum()))


@dataclasses.dataclass(frozen=True)
class Sum:
    """Normal equations summed over some lanes."""

    matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]
    cost: float

    def step(
        self,
        columns: NDArray[np.int64],
        at: NDArray[np.float64],
        low: NDArray[np.float64],
        high: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Bounded Gauss-Newton step in some columns."""
        matrix = self.matrix[np.ix_(columns, columns)]
        none = np.zeros((0, len(columns), len(columns)))
        reduced = Reduced(matrix, self.gradient[columns], np.diag(matrix).copy(), none, none[:, 0], none, none[:, 0])
        return bounded_step(reduced, at, low, high, 1e-9)

    def after(self, columns: NDArray[np.int64], step: NDArray[np.float64]) -> float:
        """Predicted cost after a step."""
        matrix = self.matrix[np.ix_(columns, columns)]
        return self.cost + float(2 * self.gradient[columns] @ step + step @ matrix @ step)


class Tangents:
    """What a model's own numbers, and what effects that it lacks, do to the readings along its trajectories."""

    def __init__(
        self,
        engine: Engine,
        batch: Batch,
        vector: NDArray[np.float64],
        free: NDArray[np.int64],
        extra: NDArray[np.int64],
        initial: NDArray[np.float64],
    ):
        """Args:
        engine: of the base model.
        batch: lanes.
        vector: the base model's parameters.
        free: places of its free parameters.
        extra: places of known numbers that may be wrong.
        initial: initial states of the lanes at the base fit.
        """
        self.engine = engine
        self.batch = batch
        self.vector = vector
        self.initial = initial
        self.free = free
        self.extra = len(extra)
        self.width = columns_for(len(free) + self.extra)
        places = np.concatenate([free, extra])[None]
        self.gram = engine.gram(vector[None], places, initial[None], batch, columns=self.width, keep=True)
        self.along = linearise(engine.table, vector, initial, refined(batch.lanes, batch.substeps))

    @property
    def own(self) -> NDArray[np.float64]:
        """Of the model's numbers and starts: lane, column, sample and channel (flat)."""
        assert self.gram.tangents is not None
        return self.gram.tangents[0]

    def effects(self, found: Sequence[Candidate]) -> list[NDArray[np.float64]]:
        """Of effects without a hidden coordinate, wrong values left out; shaped alike."""
        columns = candidate_columns(self.engine.table, self.vector, self.batch, self.initial, found, self.along)
        correct_locked(found, columns, self.own[:, self.width + 2], self.batch, self.initial)
        return columns

    def numbers(self) -> list[NDArray[np.float64]]:
        """Of each known number that may be wrong."""
        return [self.own[:, [len(self.free) + i]] for i in range(self.extra)]

    def normal(self, columns: Sequence[NDArray[np.float64]], free_starts: bool = False) -> Normal:
        """Normal equations of the model's numbers and these columns.

        Args:
            columns: of effects and known numbers.
            free_starts: whether a start is what the recording says, and no guess holds it back.
        """
        batch = self.batch
        if free_starts:
            batch = dataclasses.replace(batch, prior=np.where(np.isfinite(batch.prior), 0.0, np.inf))
        return normal_equations(self.gram, batch, self.initial, len(self.free), self.width, columns)


def correct_locked(
    everything: Sequence[Candidate],
    columns: list[NDArray[np.float64]],
    by_length: NDArray[np.float64],
    batch: Batch,
    initial: NDArray[np.float64],
) -> None:
    """Where the rope is locked, a wrong length sensor means another length, not another reading."""
    locked = np.asarray(batch.lanes.lane.active.l) == 0
    if not locked.any():
        return
    for i, candidate in enumerate(everything):
        if candidate.site != "l_sensor":
            continue
        factor = {"sensor_offset": -np.ones(len(initial)), "sensor_scale": -initial[:, 2]}.get(candidate.kind)
        for lane in np.flatnonzero(locked):
            columns[i][lane] = 0.0 if factor is None else factor[lane] * by_length[lane]


def normal_equations(
    gram: Gram,
    batch: Batch,
    initial: NDArray[np.float64],
    base: int,
    width: int,
    columns: Sequence[NDArray[np.float64]],
) -> Normal:
    assert gram.tangents is not None
    weight = np.asarray(batch.lanes.weight)
    residual = ((gram.predicted[0] - np.asarray(batch.lanes.y)) * weight).reshape(batch.count, -1)
    states = initial.shape[1]
    total = base + sum(c.shape[1] for c in columns)
    matrix = np.empty((batch.count, total, total))
    gradient = np.empty((batch.count, total))
    cost = np.empty(batch.count)
    for lane in range(batch.count):
        start = gram.tangents[0, lane, width : width + states]
        table = np.concatenate(
            [gram.tangents[0, lane, :base], *(c[lane] for c in columns), start, residual[lane][None]]
        )
        products = table @ table.T
        full = reduce(
            products[None], total, total, initial[lane][None], batch.initial[lane][None], batch.prior[lane][None]
        )
        matrix[lane], gradient[lane] = full.by_lane[0], full.gradient_by_lane[0]
        cost[lane] = products[-1, -1]
    count = (weight > 0).reshape(batch.count, -1).sum(axis=1).astype(float)
    return Normal(matrix, gradient, cost, count)
