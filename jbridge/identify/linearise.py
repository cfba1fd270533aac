"""Residuals and their forward-mode tangents, for many parameter vectors and lanes at once.

A fit has few shared parameters and, for each lane, an initial state of its own. Every lane of every row (a row is one
parameter vector with its free parameters) is rolled out, with one tangent for each free parameter and each initial
value (`stages`). Which parameters are free is data, so the programs of a structure serve every choice of them.
"""

import itertools
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._programs import kept
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..rollout import MIDPOINT, Motions, readings, rollout
from . import stages
from .lanes import Batch, Lanes

_ROWS = 4
"""Rows in one call of the compiled program,"""
_LARGE = 12 * 2**20
"""or one alone, where the tangents of one coordinate at all steps of so many would take more [byte];"""
_MOST = 40 * 2**20
"""and some lanes of one where those of all would: a motor of little inertia asks for dozens of steps an interval."""
_THREADS = 2


class Gram(NamedTuple):
    """Inner products of `[free parameters, initial state, residual]` over the samples of each lane."""

    products: NDArray[np.float64]
    """Row, lane, and twice the columns."""
    predicted: NDArray[np.float64]
    """Readings: row, lane, sample, channel."""
    tangents: NDArray[np.float64] | None = None
    """Weighted tangents of `[free parameters, initial state]`: row, lane, column, sample and channel."""

    @property
    def cost(self) -> NDArray[np.float64]:
        """Sum of squared weighted residuals, by row and lane."""
        return self.products[:, :, -1, -1]


class Engine:
    """Compiled rollouts of one plant structure; parameter vectors, data and free sets are arguments."""

    def __init__(self, plant: Plant):
        self.table = ParameterTable(plant)

    def gram(
        self,
        vectors: NDArray[np.float64],
        free: NDArray[np.int64],
        initial: NDArray[np.float64],
        batch: Batch,
        *,
        columns: int,
        keep: bool = False,
    ) -> Gram:
        """Gram matrices of all lanes for every row.

        Args:
            vectors: one parameter vector a row.
            free: places of the free parameters of each row, -1 where a row has fewer.
            initial: initial state by row and lane.
            batch: the lanes.
            columns: number of parameter columns to compile for; at least as many as are free.
            keep: whether to return the tangents, too.
        """
        rows = len(vectors)
        places = np.full((rows, columns), -1, np.int64)
        places[:, : free.shape[1]] = free
        lanes, steps = batch.lanes.lane.dt.shape
        tangents = 8 * lanes * steps * batch.substeps * (columns + initial.shape[2])
        # Few rows run one after the other in the program that a single fit needs anyway.
        width = 1 if rows < _ROWS or _ROWS * tangents > _LARGE else _ROWS
        # Halved until it fits, so that models of nearly one size share their programs.
        halvings = max(0, math.ceil(math.log2(max(tangents, 1) / _MOST)))
        by_lane = _shares(lanes, math.ceil(lanes / 2**halvings))
        some = [batch.lanes] if len(by_lane) == 1 else [_taken(batch.lanes, chosen) for chosen in by_lane]
        jobs = list(itertools.product(_shares(rows, width), zip(by_lane, some, strict=True)))

        def run(job: tuple[NDArray[np.int64], tuple[NDArray[np.int64], Lanes]]) -> tuple[NDArray[np.float64], ...]:
            take, (chosen, own) = job
            asked = vectors[take], places[take], initial[take][:, chosen]
            along, residual, predicted = map(np.asarray, stages.tangents(self.table, *asked, own, batch.substeps))
            table = np.concatenate([along, residual[:, :, None]], axis=2)
            with np.errstate(over="ignore", invalid="ignore"):  # a trial that runs away is judged by its cost
                products = table @ np.swapaxes(table, 2, 3)
            return (products, predicted, along) if keep else (products, predicted)

        if len(jobs) == 1:
            parts = [run(jobs[0])]
        else:
            with ThreadPoolExecutor(_THREADS) as pool:
                parts = list(pool.map(run, jobs))
        whole = [_joined(parts[a : a + len(some)], lanes) for a in range(0, len(parts), len(some))]
        return Gram(*(np.concatenate(part)[:rows] for part in zip(*whole, strict=True)))

    def motions(
        self, vector: NDArray[np.float64], initial: NDArray[np.float64], batch: Batch, *, finer: int = 1
    ) -> tuple:
        """Motions and readings of all lanes at one parameter vector, with `finer` integration steps in place of one."""
        return _motions(self.table, vector, initial, batch.lanes, finer * batch.substeps)


def _shares(count: int, width: int) -> list[NDArray[np.int64]]:
    """What each call takes, so many at a time. A short last one repeats its last: one shape, one program."""
    return [np.minimum(np.arange(a, a + width), count - 1) for a in range(0, count, width)]


def _taken(lanes: Lanes, chosen: NDArray[np.int64]) -> Lanes:
    return jax.tree.map(lambda leaf: np.asarray(leaf)[chosen], lanes)


def _joined(parts: Sequence[tuple[NDArray[np.float64], ...]], lanes: int) -> tuple[NDArray[np.float64], ...]:
    """What calls found for some lanes each, put together."""
    if len(parts) == 1:
        return parts[0]
    return tuple(np.concatenate(part, axis=1)[:, :lanes] for part in zip(*parts, strict=True))


def _predict(
    table: ParameterTable, vector: Array, initial: Array, lanes: Lanes, substeps: int
) -> tuple[Motions, Float[Array, "sample 3"]]:
    plant = table.unravel(lanes.own(vector))
    motions = rollout(plant, initial, lanes.lane, substeps=substeps, method=MIDPOINT)
    return motions, readings(plant, lanes.lane, motions)


@kept(static=(0, 4))
def _motions(table: ParameterTable, vector: Array, initial: Array, lanes: Lanes, substeps: int) -> tuple:
    return jax.vmap(lambda start, lane: _predict(table, vector, start, lane, substeps))(initial, lanes)
