"""A cheap look at every candidate: what would it gain if the simulation were linear in it?

At its null value an absent effect still has a tangent, and one pass of the superset's program gives the tangents of
all of them. After initial states and base parameters are projected out, a candidate's predicted gain is a small
bounded least-squares problem. Candidates that are singular at their null value are linearised at finite seeds.
The same tangents answer whether anything repeatable is missing at all: what is chosen on all recordings but one must
predict the residual of that one.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..identify.base import columns_for, measurements
from ..identify.lanes import Batch
from ..identify.linearise import Engine
from ..identify.solve import Reduced, bounded_step, reduce
from .candidates import Candidate

_WIDTH = 32
"""Columns of one screening row."""
_GREEDY = 4
"""Most explanations that the flexible model combines."""
_EFFECTIVE = 1000.0
"""Effective number of independent samples: a recording's residuals are far from independent."""


@dataclasses.dataclass(frozen=True)
class Screened:
    """A candidate with what the linear screen expects of it."""

    candidate: Candidate
    cost: float
    """Predicted sum of squares after a refit."""
    vector: NDArray[np.float64]
    """Where a refit should start."""


@dataclasses.dataclass(frozen=True)
class Screen:
    """All candidates, best first, and the share of the residual that can be learned."""

    ranked: list[Screened]
    learnable: float


@dataclasses.dataclass(frozen=True)
class _Normal:
    """Normal equations of base parameters and all null candidates, by lane, initial states eliminated."""

    matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]
    cost: NDArray[np.float64]
    count: NDArray[np.float64]
    """Measured values of each lane."""


def screen(
    engine: Engine,
    batch: Batch,
    vector: NDArray[np.float64],
    free: NDArray[np.int64],
    initial: NDArray[np.float64],
    found: Sequence[Candidate],
) -> Screen:
    """Ranks all candidates without a hidden coordinate.

    Args:
        engine: of the superset.
        batch: lanes.
        vector: the superset's parameters at the base fit.
        free: places of the base's free parameters.
        initial: initial states of the lanes at the base fit.
        found: candidates.
    """
    linear = [c for c in found if not c.finite]
    places = [c.places(engine.table) for c in linear]
    rows = _pack(engine, vector, free, linear, places)
    normal, starts = _normal_equations(engine, batch, rows, initial, len(free), [len(p) for p in places])
    low, high = engine.table.bounds()
    ranked = []
    groups = []
    for candidate, own, start in zip(linear, places, starts, strict=True):
        columns = np.concatenate([np.arange(len(free)), np.arange(start, start + len(own))])
        seeded = candidate.set(engine.table, vector)
        at = np.concatenate([vector[free], seeded[own]])
        edge = np.concatenate([free, own])
        groups.append((columns, at, low[edge], high[edge]))
        step = _step(normal, columns, at, low[edge], high[edge], None)
        gain = -float(2 * normal.gradient.sum(0)[columns] @ step + step @ normal.matrix.sum(0)[np.ix_(columns, columns)] @ step)
        seeded[edge] = at + step
        ranked.append(Screened(candidate, float(normal.cost.sum()) - gain, seeded))
    learnable = _learnable(normal, groups, batch, len(free))
    ranked += _finite(engine, batch, vector, free, initial, [c for c in found if c.finite])
    ranked.sort(key=lambda s: s.cost)
    return Screen(ranked, learnable)


@dataclasses.dataclass(frozen=True)
class _Rows:
    vectors: NDArray[np.float64]
    places: NDArray[np.int64]
    at: list[tuple[int, int]]
    """Row and first column of each candidate."""


def _pack(
    engine: Engine,
    vector: NDArray[np.float64],
    free: NDArray[np.int64],
    linear: Sequence[Candidate],
    places: Sequence[NDArray[np.int64]],
) -> _Rows:
    """Puts candidates side by side into rows: at zero amplitude they do not disturb each other."""
    vectors, columns, names = [vector.copy()], [list(free)], [set[tuple[str, str]]()]
    at = []
    for candidate, own in zip(linear, places, strict=True):
        # Two seeds of one effect need two rows, since they share its shape parameters.
        row = next(
            (
                i
                for i in range(len(vectors))
                if candidate.name not in names[i] and len(columns[i]) + len(own) <= max(_WIDTH, len(free) + len(own))
            ),
            len(vectors),
        )
        if row == len(vectors):
            vectors.append(vector.copy())
            columns.append([])
            names.append(set())
        at.append((row, len(columns[row])))
        vectors[row] = candidate.set(engine.table, vectors[row])
        columns[row] += list(own)
        names[row].add(candidate.name)
    table = np.full((len(vectors), max(len(c) for c in columns)), -1, np.int64)
    for i, c in enumerate(columns):
        table[i, : len(c)] = c
    return _Rows(np.array(vectors), table, at)


def _normal_equations(
    engine: Engine, batch: Batch, rows: _Rows, initial: NDArray[np.float64], base: int, sizes: Sequence[int]
) -> tuple[_Normal, list[int]]:
    width = columns_for(max(rows.places.shape[1], _WIDTH))
    gram = engine.gram(
        rows.vectors, rows.places, np.repeat(initial[None], len(rows.vectors), axis=0), batch, columns=width, keep=True
    )
    tangents = gram.tangents
    assert tangents is not None
    weight = np.asarray(batch.lanes.weight)
    residual = ((gram.predicted[0] - np.asarray(batch.lanes.y)) * weight).reshape(batch.count, -1)
    states = initial.shape[1]
    total = base + sum(sizes)
    matrix = np.empty((batch.count, total, total))
    gradient = np.empty((batch.count, total))
    cost = np.empty(batch.count)
    starts = list(base + np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int)) if sizes else []
    for lane in range(batch.count):
        parts = [tangents[0, lane, :base]]
        parts += [tangents[r, lane, c : c + size] for (r, c), size in zip(rows.at, sizes, strict=True)]
        start = tangents[0, lane, width : width + states]
        table = np.concatenate([*parts, start, residual[lane][None]])
        products = table @ table.T
        full = reduce(
            products[None],
            total,
            total,
            initial[lane][None],
            batch.initial[lane][None],
            batch.prior[lane][None],
        )
        matrix[lane], gradient[lane] = full.by_lane[0], full.gradient_by_lane[0]
        # The initial state may also take up part of the residual; at the base fit it has done so already.
        cost[lane] = products[-1, -1]
    count = (weight > 0).reshape(batch.count, -1).sum(axis=1).astype(float)
    return _Normal(matrix, gradient, cost, count), starts


def _step(
    normal: _Normal,
    columns: NDArray[np.int64],
    at: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    lanes: NDArray[np.bool_] | None,
) -> NDArray[np.float64]:
    chosen = slice(None) if lanes is None else lanes
    matrix = normal.matrix[chosen][:, columns[:, None], columns[None, :]].sum(axis=0)
    gradient = normal.gradient[chosen][:, columns].sum(axis=0)
    empty = np.zeros((0, len(columns), len(columns)))
    reduced = Reduced(matrix, gradient, np.diag(matrix).copy(), empty, empty[:, 0], empty, empty[:, 0])
    return bounded_step(reduced, at, low, high, 1e-9)


def _learnable(normal: _Normal, groups: list[tuple], batch: Batch, base: int) -> float:
    """Share of the excess over noise that explanations chosen on the other recordings predict."""
    names = np.unique(batch.recording)
    if len(names) < 2 or not groups:
        return 0.0
    removed, excess = 0.0, 0.0
    for r in names:
        inside = batch.recording == r
        chosen, best_step = _greedy(normal, groups, ~inside, base)
        own = float(normal.cost[inside].sum())
        excess += max(own - float(normal.count[inside].sum()), 0.0)
        if chosen is not None:
            matrix = normal.matrix[inside][:, chosen[:, None], chosen[None, :]].sum(axis=0)
            gradient = normal.gradient[inside][:, chosen].sum(axis=0)
            removed += -float(2 * gradient @ best_step + best_step @ matrix @ best_step)
    return float(np.clip(removed / excess, 0.0, 1.0)) if excess > 0 else 0.0


def _greedy(
    normal: _Normal, groups: list[tuple], lanes: NDArray[np.bool_], base: int
) -> tuple[NDArray[np.int64] | None, NDArray[np.float64]]:
    """Explanations added one after the other while they pay for their parameters."""
    current: tuple | None = None
    cost = float(normal.cost[lanes].sum())
    left = list(range(len(groups)))
    step = np.zeros(0)
    for _ in range(_GREEDY):
        best = None
        for g in left:
            trial = groups[g] if current is None else _joined(current, groups[g], base)
            s = _step(normal, *trial, lanes)
            columns = trial[0]
            matrix = normal.matrix[lanes][:, columns[:, None], columns[None, :]].sum(axis=0)
            gradient = normal.gradient[lanes][:, columns].sum(axis=0)
            predicted = float(normal.cost[lanes].sum()) + float(2 * gradient @ s + s @ matrix @ s)
            penalty = (len(columns) - base) * np.log(_EFFECTIVE) / _EFFECTIVE
            score = np.log(max(predicted, 1e-12)) + penalty
            if best is None or score < best[0]:
                best = (score, g, trial, s, predicted)
        if best is None or best[4] > cost * (1 - 1e-2):
            break
        current, step, cost = best[2], best[3], best[4]
        left.remove(best[1])
    return (None, step) if current is None else (current[0], step)


def _joined(a: tuple, b: tuple, base: int) -> tuple:
    return tuple(np.concatenate([x, y[base:]]) for x, y in zip(a, b, strict=True))


def _finite(
    engine: Engine,
    batch: Batch,
    vector: NDArray[np.float64],
    free: NDArray[np.int64],
    initial: NDArray[np.float64],
    found: Sequence[Candidate],
) -> list[Screened]:
    """Candidates at finite seeds: cost there, less what one bounded step from there promises."""
    if not found:
        return []
    vectors = np.array([c.set(engine.table, vector) for c in found])
    own = [np.concatenate([free, c.places(engine.table)]) for c in found]
    width = columns_for(max(len(o) for o in own))
    places = np.full((len(found), width), -1, np.int64)
    for i, o in enumerate(own):
        places[i, : len(o)] = o
    gram = engine.gram(vectors, places, np.repeat(initial[None], len(found), axis=0), batch, columns=width)
    low, high = engine.table.bounds()
    out = []
    for i, (candidate, o) in enumerate(zip(found, own, strict=True)):
        reduced = reduce(gram.products[i], len(o), width, initial, batch.initial, batch.prior)
        step = bounded_step(reduced, vectors[i, o], low[o], high[o], 1e-3)
        promised = float(gram.cost[i].sum() + 2 * reduced.gradient @ step + step @ reduced.matrix @ step)
        start = vectors[i].copy()
        start[o] += step
        out.append(Screened(candidate, max(promised, 0.5 * measurements(batch)), start))
    return out
