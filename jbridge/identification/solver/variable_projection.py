"""Normal equations of the parameters, with the initial states of windows eliminated (variable projection)."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..data.windows import Data
from ..likelihood import Index, Likelihood
from ..sensitivity.engine import Engine, Job, Sensitivity
from ..sensitivity.windowed_rollout import STATES
from .prediction_errors import Point, residual

_REACH = 3.0
"""How far an initial value may move from its first guess, in standard deviations of the guess."""
_FAINT = 1e-12
"""Guard of divisions."""
_ABREAST = 64
"""Windows whose products are in memory at a time before initial states are eliminated: ten minutes have thousands."""


Held = dict[int, NDArray[np.float32]]
"""Tangents of a point, by number of the tiling: `(column, 3, sample)`."""


@dataclasses.dataclass(frozen=True)
class Normal:
    """Products of `[free parameters, residual]` by window and channel, initial states eliminated, over the noise."""

    products: NDArray[np.float64]
    """`(window, channel, column, column)`."""
    shift: NDArray[np.float64]
    """Change of the initial states with parameters held, `(window, 6)`,"""
    back: NDArray[np.float64]
    """and with them: `(window, 6, parameter)`."""


def normal_equations(
    engine: Engine,
    data: Data,
    windows: Index,
    likelihood: Likelihood,
    points: Sequence[Point],
    held: Sequence[Held] = (),
) -> list[Normal]:
    """Products of tangents and residuals of every point, with the initial states eliminated window by window.

    Args:
        engine: of the plant.
        data: recordings and tilings.
        windows: of the tilings.
        likelihood: the criterion.
        points: where.
        held: tangents of each point by tiling, which may be those of a place nearby; what it lacks is computed, and put
            there.
    """
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

    known = {i: p.left for i, p in enumerate(points) if p.left}
    unknown = [n for n in range(len(jobs)) if n // count not in known]
    predicted = dict(zip(unknown, engine.predict([jobs[n] for n in unknown]), strict=True))

    def take(number: int, found: Sensitivity) -> None:
        i, k = divmod(number, count)
        tiling, normal, point = data.tilings[k], out[i], points[i]
        first = int(np.flatnonzero(windows.tiling == k)[0])
        r = tiling.recording
        scale = data.weight[r].T
        n = len(point.free)
        # Channels first, so that products of windows are products of contiguous matrices.
        table = np.empty((3, n + 1 + STATES, data.samples))
        for row, column in enumerate(found.columns):
            np.multiply(column, scale, out=table[:, row if row < n else row + 1])
        if held and k not in held[i]:
            held[i][k] = np.stack(found.columns).astype(np.float32)
        left = known[i][k] if i in known else residual(data, k, predicted[number])
        table[:, n] = left.T
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

    new = []
    for number in range(len(jobs)):
        i, k = divmod(number, count)
        if held and k in held[i]:
            take(number, Sensitivity(tuple(held[i][k])))
        else:
            new.append(number)
    engine.sensitivities([jobs[number] for number in new], lambda place, found: take(new[place], found))
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
