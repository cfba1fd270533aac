"""Reweighted Gauss-Newton for many starts at once.

Each start has parameters and, for every window, an initial state. The criterion's weights are those of its tangent
(iteratively reweighted least squares); initial states are eliminated window by window (variable projection), so that
the damped and bounded step is one in the parameters alone. After a step each window keeps the initial state that meets
it better, the moved one or the former, so that a window whose initial state lies in another basin holds up no other.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..model.parameters import ParameterTable
from .data.windows import Data
from .likelihood import Index, Likelihood
from .sensitivity.engine import Engine, Job, Sensitivity
from .sensitivity.windowed_rollout import FAR, STATES

_START_DAMPING, _MOST_DAMPING = 1e-3, 1e7
_REACH = 3.0
"""How far an initial value may move from its first guess, in standard deviations of the guess."""
_TIES = 1e-6
"""Strength of ties between neighbouring levels of a map over what the recordings say of the level that they tell most
of: nothing where a place was visited; one that was not takes the level of those beside it (P-splines, Eilers and Marx,
Statistical Science 11, 1996)."""
_SHORTER = 0.25
"""What a window's step is multiplied with after one that it refused."""
_FAINT = 1e-12
"""Guard of divisions."""
_ABREAST = 64
"""Windows whose products are in memory at a time before initial states are eliminated: ten minutes have thousands."""


@dataclasses.dataclass(frozen=True)
class Start:
    """Where a fit begins."""

    vector: NDArray[np.float64]
    free: NDArray[np.int64]
    states: tuple[NDArray[np.float64], ...]
    """By tiling, `(window, 6)`."""


@dataclasses.dataclass(frozen=True)
class Normal:
    """Products of `[free parameters, residual]` by window and channel, initial states eliminated, over the noise."""

    products: NDArray[np.float64]
    """`(window, channel, column, column)`."""
    shift: NDArray[np.float64]
    """Change of the initial states with parameters held, `(window, 6)`,"""
    back: NDArray[np.float64]
    """and with them: `(window, 6, parameter)`."""


@dataclasses.dataclass(frozen=True)
class Point:
    """Parameters and initial states, and what they leave."""

    vector: NDArray[np.float64]
    free: NDArray[np.int64]
    states: tuple[NDArray[np.float64], ...]
    square: NDArray[np.float64]
    """Mean square of each window's errors over the noise's variance, by window and channel."""
    value: float
    """The criterion without a price."""
    iterations: int = 0

    @property
    def start(self) -> Start:
        return Start(self.vector, self.free, self.states)


def solve(
    engine: Engine,
    data: Data,
    windows: Index,
    likelihood: Likelihood,
    starts: Sequence[Start],
    *,
    iterations: int,
    tolerance: float = 0.1,
) -> list[Point]:
    """Minimises the criterion from every start.

    Args:
        engine: of the plant.
        data: recordings and tilings.
        windows: of the tilings.
        likelihood: the criterion.
        starts: where to begin.
        iterations: most steps of each.
        tolerance: a fit is done when a step gains less than this [nat], or a thousandth of that per unit of the
            criterion.
    """
    points = _from_other_states(engine, data, windows, likelihood, evaluate(engine, data, windows, likelihood, starts))
    damping = np.full(len(starts), _START_DAMPING)
    # Share of its Gauss-Newton step that each window's initial state takes.
    pace = np.ones((len(starts), len(windows.tiling)))
    active = np.ones(len(starts), bool)
    for done in range(1, iterations + 1):
        chosen = [int(i) for i in np.flatnonzero(active)]
        if not chosen:
            break
        normals = normal_equations(engine, data, windows, likelihood, [points[i] for i in chosen])
        waiting = dict(zip(chosen, normals, strict=True))
        while waiting:
            trials = []
            for i, normal in waiting.items():
                point = points[i]
                weight = likelihood.weights(point.square)
                step = _parameter_step(engine.table, normal, weight, point, damping[i])
                vector = point.vector.copy()
                vector[point.free] += step
                moved = (normal.shift + normal.back @ step) * pace[i][:, None]
                trials.append(Start(vector, point.free, moved_states(data, windows, point.states, moved)))
            found = evaluate(engine, data, windows, likelihood, trials)
            found, refused = _kept_where_better(engine, data, windows, likelihood, [points[i] for i in waiting], found)
            after = {}
            for (i, normal), new, no in zip(waiting.items(), found, refused, strict=True):
                pace[i] = np.where(no, _SHORTER * pace[i], np.minimum(pace[i] / _SHORTER, 1.0))
                gain = points[i].value - new.value
                if gain > 0:
                    points[i] = dataclasses.replace(new, iterations=done)
                    damping[i] = max(0.1 * damping[i], 1e-9)
                    active[i] = gain > tolerance * max(1.0, 1e-3 * abs(new.value))
                elif damping[i] * 10.0 > _MOST_DAMPING or not len(points[i].free):
                    active[i] = False
                else:
                    damping[i] *= 30.0
                    # What gains nothing after a few shorter steps has arrived.
                    active[i] = damping[i] < 1e2
                    if active[i]:
                        after[i] = normal
            waiting = after
    return points


def evaluate(
    engine: Engine, data: Data, windows: Index, likelihood: Likelihood, starts: Sequence[Start]
) -> list[Point]:
    """Simulates every start once."""
    jobs = [Job(s.vector, t.recording, t.begins, s.states[k]) for s in starts for k, t in enumerate(data.tilings)]
    predicted = engine.predict(jobs)
    out, count = [], len(data.tilings)
    for i, start in enumerate(starts):
        square = np.concatenate(
            [squares(data, k, predicted[i * count + k]) for k in range(count)] or [np.zeros((0, 3))]
        )
        out.append(Point(start.vector, start.free, start.states, square, likelihood.value(square)))
    return out


def residuals(engine: Engine, data: Data, start: Start | Point) -> list[NDArray[np.float64]]:
    """What a simulation leaves over the noise, by tiling `(sample, 3)`; 0 where nothing is measured."""
    jobs = [Job(start.vector, t.recording, t.begins, start.states[k]) for k, t in enumerate(data.tilings)]
    return [residual(data, k, found) for k, found in enumerate(engine.predict(jobs))]


def residual(data: Data, tiling: int, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    r = data.tilings[tiling].recording
    # What is no number counts as one that is far off, like a simulation that runs away.
    predicted = np.where(np.isfinite(predicted), predicted, FAR)
    return np.where(data.measured[r], (predicted - data.y[r]) / data.noise[r], 0.0)


def squares(data: Data, tiling: int, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean square error of each window over the noise's variance, `(window, 3)`."""
    t = data.tilings[tiling]
    measured = data.measured[t.recording]
    square = residual(data, tiling, predicted) ** 2
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(square, axis=0)])
    counts = np.concatenate([np.zeros((1, 3)), np.cumsum(measured, axis=0)])
    number = counts[t.stops] - counts[t.count_from]
    return (sums[t.stops] - sums[t.count_from]) / np.maximum(number, 1.0)


def normal_equations(
    engine: Engine, data: Data, windows: Index, likelihood: Likelihood, points: Sequence[Point]
) -> list[Normal]:
    """Products of tangents and residuals of every point, with the initial states eliminated window by window."""
    count = len(data.tilings)
    jobs = [
        Job(p.vector, t.recording, t.begins, p.states[k], p.free) for p in points for k, t in enumerate(data.tilings)
    ]
    out = [
        Normal(
            np.zeros((len(windows.tiling), 3, len(p.free) + 1, len(p.free) + 1)),
            np.zeros((len(windows.tiling), STATES)),
            np.zeros((len(windows.tiling), STATES, len(p.free))),
        )
        for p in points
    ]
    weights = [likelihood.weights(p.square) for p in points]

    def take(number: int, found: Sensitivity) -> None:
        i, k = divmod(number, count)
        tiling, normal, point = data.tilings[k], out[i], points[i]
        first = int(np.flatnonzero(windows.tiling == k)[0])
        r = tiling.recording
        scale = np.where(data.measured[r], 1.0 / np.where(np.isnan(data.noise[r]), 1.0, data.noise[r]), 0.0).T
        n = len(point.free)
        # Channels first, so that products of windows are products of contiguous matrices.
        table = np.empty((3, n + 1 + STATES, data.samples))
        for row, column in enumerate(found.columns):
            np.multiply(column, scale, out=table[:, row if row < n else row + 1])
        table[:, n] = residual(data, k, found.predicted).T
        away = point.states[k] - tiling.states
        for start in range(0, tiling.windows, _ABREAST):
            some = slice(start, min(start + _ABREAST, tiling.windows))
            own = slice(first + some.start, first + some.stop)
            products = _products(table, tiling.begins[some], tiling.stops[some])
            shift, back = _eliminated(products, weights[i][own], away[some], tiling.precision[some], n)
            normal.shift[own], normal.back[own] = shift, back
            # Parameters and residual, with what the initial states make of either.
            follow = np.zeros((len(shift), n + 1 + STATES, n + 1))
            follow[:, np.arange(n + 1), np.arange(n + 1)] = 1.0
            follow[:, n + 1 :, :n], follow[:, n + 1 :, n] = back, shift
            normal.products[own] = np.swapaxes(follow, 1, 2)[:, None] @ products @ follow[:, None]

    engine.sensitivities(jobs, take)
    return out


def _products(table: NDArray[np.float64], begins: NDArray[np.int64], stops: NDArray[np.int64]) -> NDArray[np.float64]:
    """Inner products of a table's rows over each window: `(channel, row, sample)` to `(window, channel, row, row)`."""
    out = np.zeros((len(begins), table.shape[0], table.shape[1], table.shape[1]))
    for w, (a, b) in enumerate(zip(begins, stops, strict=True)):
        part = table[:, :, a:b]
        out[w] = part @ np.swapaxes(part, 1, 2)
    return out


def _eliminated(
    products: NDArray[np.float64],
    weight: NDArray[np.float64],
    away: NDArray[np.float64],
    precision: NDArray[np.float64],
    n: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Changes of the windows' initial states that minimise their weighted squares.

    Args:
        products: of `[parameters, residual, initial state]`, by window and channel.
        weight: by window and channel.
        away: initial states less their first guesses.
        precision: of the guesses.
        n: number of parameters.

    Returns:
        The changes with parameters held, `(window, 6)`, and with them, `(window, 6, parameter)`.
    """
    relative = weight / np.maximum(weight.max(axis=1, keepdims=True), _FAINT)
    total = np.einsum("wc,wcij->wij", relative, products)
    s = slice(n + 1, n + 1 + STATES)
    finite = np.isfinite(precision)
    prior = np.where(finite, precision, 0.0) ** 2
    diagonal = np.einsum("wii->wi", total)[:, s] + prior
    free = finite & (diagonal > 0.0)
    room = np.where(finite & (precision > 0), _REACH / np.where(finite & (precision > 0), precision, 1.0), 0.0)
    size = np.sqrt(np.maximum(diagonal, _FAINT))
    matrix = (total[:, s, s] + prior[:, :, None] * np.eye(STATES)) / (size[:, :, None] * size[:, None, :])
    right = np.concatenate([total[:, s, :n], total[:, s, n : n + 1] + (prior * away)[:, :, None]], axis=2)
    right = right / size[:, :, None]
    for _ in range(2):
        both = free[:, :, None] & free[:, None, :]
        kept = np.where(both, matrix, 0.0) + (1e-10 + ~free)[:, :, None] * np.eye(STATES)
        change = -np.linalg.solve(kept, np.where(free[:, :, None], right, 0.0)) / size[:, :, None]
        # An initial value at the end of its room that would go on stays there.
        leaving = free & (np.abs(away + change[:, :, n]) > room)
        if not leaving.any():
            break
        free = free & ~leaving
    return change[:, :, n], change[:, :, :n]


def _parameter_step(
    table: ParameterTable, normal: Normal, weight: NDArray[np.float64], point: Point, damping: float
) -> NDArray[np.float64]:
    """Damped Gauss-Newton step of the free parameters within their bounds."""
    free, vector = point.free, point.vector
    low, high = table.bounds()
    total = np.einsum("wc,wcij->ij", weight, normal.products)
    n = len(free)
    tied = ties(table, free, np.diag(total)[:n])
    at = vector[free]
    gradient = total[:n, n] + tied @ at
    return bounded_step(total[:n, :n] + tied, gradient, low[free] - at, high[free] - at, damping)


def ties(
    table: ParameterTable, free: NDArray[np.int64], information: NDArray[np.float64], strength: float = _TIES
) -> NDArray[np.float64]:
    """Precision of the differences between neighbours in each vector of levels."""
    precision = np.zeros((len(free), len(free)))
    for members in table.vectors(free):
        step = np.diff(np.eye(len(members)), axis=0)
        precision[np.ix_(members, members)] = strength * float(information[members].max()) * step.T @ step
    return precision


def bounded_step(
    matrix: NDArray[np.float64],
    gradient: NDArray[np.float64],
    least: NDArray[np.float64],
    most: NDArray[np.float64],
    damping: float,
) -> NDArray[np.float64]:
    """Minimises a damped quadratic within bounds, by Newton steps on what is not held there (Bertsekas 1982).

    Args:
        matrix, gradient: of the quadratic.
        least, most: how far each number may go.
        damping: Levenberg-Marquardt's, over the diagonal.
    """
    n = len(gradient)
    # In units in which every parameter alone weighs the same: a belt's 1e4 N/m beside a gain of 1e-3 N/count would
    # otherwise be below what the solver takes for nothing.
    unit = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    unit = np.maximum(unit, max(1e-18 * unit.max(initial=0.0), 1e-150))
    scaled = matrix / np.outer(unit, unit) + (damping + 1e-13) * np.eye(n)
    slope, low, high = gradient / unit, least * unit, most * unit
    step, value = np.clip(np.zeros(n), low, high), 0.0
    for _ in range(2 * n + 2):
        now = slope + scaled @ step
        moving = np.flatnonzero(~(((step <= low) & (now > 0)) | ((step >= high) & (now < 0))))
        if not len(moving):
            break
        newton = np.zeros(n)
        newton[moving] = np.linalg.lstsq(scaled[np.ix_(moving, moving)], -now[moving], rcond=1e-15)[0]
        share, before = 1.0, value
        while share > 1e-3:
            trial = np.clip(step + share * newton, low, high)
            found = float(slope @ trial + 0.5 * trial @ scaled @ trial)
            if found < value:
                step, value = trial, found
                break
            share *= 0.5
        if not before - value > 1e-10 * abs(value):
            break
    return np.clip(step / unit, least, most)


def moved_states(
    data: Data, windows: Index, states: tuple[NDArray[np.float64], ...], change: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Initial states after a change, within their room, by tiling."""
    out = []
    for k, tiling in enumerate(data.tilings):
        finite = np.isfinite(tiling.precision) & (tiling.precision > 0)
        room = np.where(finite, _REACH / np.where(finite, tiling.precision, 1.0), 0.0)
        new = states[k] + change[windows.tiling == k]
        out.append(np.clip(new, tiling.states - room, tiling.states + room))
    return tuple(out)


def _kept_where_better(
    engine: Engine,
    data: Data,
    windows: Index,
    likelihood: Likelihood,
    before: Sequence[Point],
    after: Sequence[Point],
) -> tuple[list[Point], list[NDArray[np.bool_]]]:
    """The points with, for each window, the initial state that meets it better: the moved one, or the former; and
    which windows kept the former."""
    worse = []
    refused = [np.zeros(len(windows.tiling), bool) for _ in before]
    for i, (old, new) in enumerate(zip(before, after, strict=True)):
        loss = (likelihood.by_window(new.square) - likelihood.by_window(old.square)).sum(axis=1)
        if (loss > 0).any():
            worse.append(i)
    if not worse:
        return list(after), refused
    again = evaluate(
        engine,
        data,
        windows,
        likelihood,
        [Start(after[i].vector, after[i].free, before[i].states) for i in worse],
    )
    out = list(after)
    for i, former in zip(worse, again, strict=True):
        out[i], refused[i] = _better_by_window(windows, likelihood, after[i], former)
    return out, refused


def _from_other_states(
    engine: Engine, data: Data, windows: Index, likelihood: Likelihood, points: Sequence[Point]
) -> list[Point]:
    """The points with, for each window, the initial state in hand or another one, whichever meets it better: that of a
    shorter window that begins with it, whose fit is nearly linear, or else its first guess.

    A model that lacks much pulls initial states into basins that better parameters alone do not lead out of: those of a
    cart that is held a moment longer.
    """
    others = [Start(p.vector, p.free, _states_of_shorter(data, p.states)) for p in points]
    again = evaluate(engine, data, windows, likelihood, others)
    return [_better_by_window(windows, likelihood, p, q)[0] for p, q in zip(points, again, strict=True)]


def _states_of_shorter(data: Data, states: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], ...]:
    """For each window the initial state of the longest shorter one that begins with it, or else its first guess."""
    out = []
    for tiling in data.tilings:
        own = tiling.states.copy()
        shorter = [
            (other.horizon, other.begins, found)
            for other, found in zip(data.tilings, states, strict=True)
            if other.recording == tiling.recording and other.horizon < tiling.horizon
        ]
        for _, begins, found in sorted(shorter, key=lambda entry: entry[0]):
            _, here, there = np.intersect1d(tiling.begins, begins, return_indices=True)
            own[here] = found[there]
        out.append(own)
    return tuple(out)


def _better_by_window(
    windows: Index, likelihood: Likelihood, point: Point, other: Point
) -> tuple[Point, NDArray[np.bool_]]:
    """A point with the initial states of another one, of the same parameters, where these meet a window better, and
    where they do."""
    better = likelihood.by_window(other.square).sum(axis=1) < likelihood.by_window(point.square).sum(axis=1)
    states = tuple(
        np.where(better[windows.tiling == k][:, None], theirs, own)
        for k, (own, theirs) in enumerate(zip(point.states, other.states, strict=True))
    )
    square = np.where(better[:, None], other.square, point.square)
    return dataclasses.replace(point, states=states, square=square, value=likelihood.value(square)), better
