"""Levenberg-Marquardt for many fits at once, with the arrow structure of free runs.

Every row is a fit of its own: shared parameters and, for each lane, an initial state. The normal equations are an
arrow, so initial states are eliminated lane by lane and only the shared parameters are damped and bounded. Written
here rather than taken from a library because the elimination and the batching over rows are what makes a diagnosis
of dozens of candidates affordable; a test holds its optimum against optimistix' `LevenbergMarquardt`.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .lanes import Batch
from .linearise import Engine, Gram
from .neighbours import LOOSE, ties

_START_DAMPING = 1e-3
_MOST_DAMPING = 1e8
_BEFORE_DROP = 4
_REACH = 3.0
"""How far an initial value may move from its first guess, in standard deviations of its prior. A model that is far off
would put its errors there: against hundreds of samples the prior alone counts for nothing."""


@dataclasses.dataclass
class Fits:
    """Rows of fits: parameters, initial states and what they reach."""

    vectors: NDArray[np.float64]
    free: list[NDArray[np.int64]]
    initial: NDArray[np.float64]
    gram: Gram
    iterations: int

    @property
    def cost(self) -> NDArray[np.float64]:
        """Sum of squared weighted residuals of each row."""
        return self.gram.cost.sum(axis=1)


@dataclasses.dataclass(frozen=True)
class Reduced:
    """Normal equations of one row after the initial states are eliminated."""

    matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]
    diagonal: NDArray[np.float64]
    by_lane: NDArray[np.float64]
    """Each lane's share of the matrix."""
    gradient_by_lane: NDArray[np.float64]
    back: NDArray[np.float64]
    """Change of the initial states per change of the parameters: lane, state, parameter."""
    shift: NDArray[np.float64]
    """Change of the initial states with parameters held: lane, state."""


def reduce(
    products: NDArray[np.float64],
    count: int,
    columns: int,
    initial: NDArray[np.float64],
    guess: NDArray[np.float64],
    prior: NDArray[np.float64],
    damping: float = 0.0,
) -> Reduced:
    """Eliminates the initial states of one row.

    Args:
        products: Gram matrices by lane, of `columns` parameters, the states and the residual.
        count: how many of the columns are in use.
        columns: how many there are.
        initial: initial states by lane.
        guess: where their priors are centred.
        prior: one over the priors' standard deviations, infinite where a state is held.
        damping: Levenberg-Marquardt damping of the states.
    """
    lanes, states = initial.shape
    s = slice(columns, columns + states)
    held = ~np.isfinite(prior)
    precision = np.where(held, 0.0, prior) ** 2
    a = products[:, :count, :count]
    b = np.where(held[:, :, None], 0.0, products[:, s, :count])
    c = np.where(held[:, :, None] | held[:, None, :], 0.0, products[:, s, s])
    index = np.arange(states)
    c = c.copy()
    c[:, index, index] += precision + held + 1e-12
    c[:, index, index] *= 1.0 + damping
    ga = products[:, :count, -1]
    gc = np.where(held, 0.0, products[:, s, -1] + precision * (initial - guess))
    # Sensitivities to a start may differ by a hundred orders of magnitude where a simulation nearly runs away; with a
    # diagonal of ones the matrix can be solved all the same.
    size = np.sqrt(np.maximum(c[:, index, index], 1e-300))
    scaled = c / (size[:, :, None] * size[:, None, :])
    scaled[:, index, index] += 1e-12
    right = np.concatenate([b, gc[:, :, None]], axis=2) / size[:, :, None]
    solved = np.linalg.solve(scaled, right) / size[:, :, None]
    by_lane = a - np.einsum("lsi,lsj->lij", b, solved[:, :, :count])
    g_by_lane = ga - np.einsum("lsi,ls->li", b, solved[:, :, count])
    return Reduced(
        by_lane.sum(axis=0),
        g_by_lane.sum(axis=0),
        np.einsum("lii->i", a),
        by_lane,
        g_by_lane,
        -solved[:, :, :count],
        -solved[:, :, count],
    )


def bounded_step(
    reduced: Reduced,
    at: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    damping: float,
) -> NDArray[np.float64]:
    """Damped Gauss-Newton step within bounds, by Newton steps on what is not held there (Bertsekas 1982)."""
    n = len(at)
    # In units in which every parameter alone weighs the same: a belt's 1e4 N/m beside a gain of 1e-3 N/count would
    # otherwise be below what the solver takes for nothing.
    unit = np.sqrt(reduced.diagonal)
    unit = np.maximum(unit, max(1e-18 * unit.max(initial=0.0), 1e-150))
    matrix = reduced.matrix / np.outer(unit, unit) + (damping + 1e-13) * np.eye(n)
    gradient = reduced.gradient / unit
    least, most = (low - at) * unit, (high - at) * unit
    step = np.clip(np.zeros(n), least, most)
    value = 0.0
    for _ in range(2 * n + 2):
        slope = gradient + matrix @ step
        moving = np.flatnonzero(~(((step <= least) & (slope > 0)) | ((step >= most) & (slope < 0))))
        if not len(moving):
            break
        newton = np.zeros(n)
        newton[moving] = np.linalg.lstsq(matrix[np.ix_(moving, moving)], -slope[moving], rcond=1e-15)[0]
        share, before = 1.0, value
        while share > 1e-3:
            trial = np.clip(step + share * newton, least, most)
            found = float(gradient @ trial + 0.5 * trial @ matrix @ trial)
            if found < value:
                step, value = trial, found
                break
            share *= 0.5
        if not before - value > 1e-10 * abs(value):
            break
    return np.clip(step / unit, low - at, high - at)


def solve(
    engine: Engine,
    batch: Batch,
    vectors: NDArray[np.float64],
    free: Sequence[NDArray[np.int64]],
    *,
    initial: NDArray[np.float64] | None = None,
    columns: int,
    iterations: int = 12,
    tolerance: float = 1e-4,
    drop: float | None = None,
    strength: float = LOOSE,
) -> Fits:
    """Fits every row from its own start.

    Args:
        vectors: start of each row, all parameters.
        free: places of the free parameters of each row.
        initial: initial states by row and lane; the batch's first guess where None.
        columns: parameter columns of the compiled program.
        iterations: most steps of a row.
        tolerance: a row is done when a step gains less than this share of its cost.
        drop: after four steps, rows are given up whose cost is this many times the best row's.
        strength: of the ties between neighbouring levels of a map, see `ties`.
    """
    vectors = np.array(vectors, dtype=float)
    rows = len(vectors)
    low_all, high_all = engine.table.bounds()
    if initial is None:
        initial = np.broadcast_to(batch.initial, (rows, *batch.initial.shape))
    initial = np.array(initial, dtype=float)
    width = max(len(f) for f in free)
    places = np.full((rows, width), -1, np.int64)
    for i, f in enumerate(free):
        places[i, : len(f)] = f
    gram = engine.gram(vectors, places, initial, batch, columns=columns)
    products, predicted = gram.products, gram.predicted
    damping = np.full(rows, _START_DAMPING)
    # A start that runs away has no tangents to go by.
    active = np.array([np.isfinite(own).all() for own in products])
    quiet = np.zeros(rows, int)
    least, most = batch.initial - _room(batch), batch.initial + _room(batch)
    tied = [np.zeros((0, 0))] * rows
    done = 0
    for done in range(1, iterations + 1):
        chosen = np.flatnonzero(active)
        if not len(chosen):
            break
        trial_v, trial_i, foreseen = vectors[chosen].copy(), initial[chosen].copy(), np.zeros(len(chosen))
        for j, r in enumerate(chosen):
            f = free[int(r)]
            tied[r] = ties(engine.table, f, products[r], strength)
            prior = batch.prior
            for _ in range(2):
                reduced = reduce(products[r], len(f), columns, initial[r], batch.initial, prior, damping[r])
                reduced = _tied(reduced, tied[r], vectors[r, f])
                step = bounded_step(reduced, vectors[r, f], low_all[f], high_all[f], damping[r])
                moved = reduced.back @ step + reduced.shift
                leaving = ((initial[r] <= least) & (moved < 0)) | ((initial[r] >= most) & (moved > 0))
                if not leaving.any():
                    break
                prior = np.where(leaving, np.inf, prior)
            trial_v[j, f] += step
            trial_i[j] = np.clip(initial[r] + moved, least, most)
            moved = trial_i[j] - initial[r]
            foreseen[j] = _foreseen(products[r], step, moved, columns)
            foreseen[j] += _strain(tied[r], vectors[r, f]) - _strain(tied[r], trial_v[j, f])
        gram = engine.gram(trial_v, places[chosen], trial_i, batch, columns=columns)
        for j, r in enumerate(chosen):
            f = free[int(r)]
            relaxed = _strain(tied[r], vectors[r, f]) - _strain(tied[r], trial_v[j, f])
            old = _objective(products[r], initial[r], batch) + _strain(tied[r], vectors[r, f])
            new = _objective(gram.products[j], trial_i[j], batch) + _strain(tied[r], trial_v[j, f])
            if np.isfinite(gram.products[j]).all() and new < old:
                gain = (old - new) / max(old, 1e-300)
                vectors[r], initial[r] = trial_v[j], trial_i[j]
                fell = products[r, :, -1, -1].sum() - gram.products[j, :, -1, -1].sum() + relaxed
                ratio = fell / foreseen[j] if foreseen[j] > 1e-9 * abs(fell) else np.inf
                products[r], predicted[r] = gram.products[j], gram.predicted[j]
                # The less a step keeps of what the linear model promised, the less the next one may trust it.
                damping[r] = np.clip(damping[r] * (0.1 if ratio > 0.75 else 1.0 if ratio > 0.25 else 3.0), 1e-9, None)
                quiet[r] = quiet[r] + 1 if gain < tolerance else 0
            else:
                damping[r] = damping[r] * 10.0
                quiet[r] += damping[r] > 1e2
            if quiet[r] >= 2 or damping[r] > _MOST_DAMPING:
                active[r] = False
        if drop is not None and done >= _BEFORE_DROP:
            costs = products[:, :, -1, -1].sum(axis=1)
            active &= costs <= drop * np.nanmin(costs)
    return Fits(vectors, list(free), initial, Gram(products, predicted), done)


def _tied(reduced: Reduced, precision: NDArray[np.float64], at: NDArray[np.float64]) -> Reduced:
    """Normal equations with what is known beforehand."""
    return dataclasses.replace(
        reduced,
        matrix=reduced.matrix + precision,
        gradient=reduced.gradient + precision @ at,
        diagonal=reduced.diagonal + np.diag(precision),
    )


def _strain(precision: NDArray[np.float64], at: NDArray[np.float64]) -> float:
    return float(at @ precision @ at)


def _room(batch: Batch) -> NDArray[np.float64]:
    """How far each initial value may move from its first guess, `(lane, state)`."""
    room = np.where(np.isfinite(batch.prior), _REACH / np.where(batch.prior > 0, batch.prior, 1.0), 0.0)
    return np.where(batch.prior == 0, np.inf, room)


def _foreseen(
    products: NDArray[np.float64],
    step: NDArray[np.float64],
    moved: NDArray[np.float64],
    columns: int,
) -> float:
    """Decrease of the sum of squares that the linear model promises for a step of parameters and initial states."""
    change = np.zeros((len(moved), products.shape[1] - 1))
    change[:, : len(step)] = step
    change[:, columns:] = moved
    slope = 2.0 * np.einsum("lc,lc->l", change, products[:, :-1, -1])
    curve = np.einsum("lc,lcd,ld->l", change, products[:, :-1, :-1], change)
    return -float((slope + curve).sum())


def _objective(products: NDArray[np.float64], initial: NDArray[np.float64], batch: Batch) -> float:
    precision = np.where(np.isfinite(batch.prior), batch.prior, 0.0)
    prior = (precision * (initial - batch.initial)) ** 2
    return float(products[:, -1, -1].sum() + prior.sum())
