"""Reweighted Gauss-Newton for many starts at once.

Each start has parameters and, for every window, an initial state. The criterion's weights are those of its tangent
(iteratively reweighted least squares); initial states are eliminated window by window (variable projection), so that
the damped and bounded step is one in the parameters alone. After a step each window keeps the initial state that meets
it better, the moved one or the former, so that a window whose initial state lies in another basin holds up no other.
Tangents cost most of a step, so they serve for the next ones as long as these gain half of what the parameters promise.
"""

import dataclasses
import math
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...model.parameters import ParameterTable
from ..data.windows import Data
from ..likelihood import Index, Likelihood
from ..prior import Prior
from ..sensitivity.engine import Engine
from ..sensitivity.windowed_rollout import STATES
from .bounds import bounded_step
from .prediction_errors import Point, Start, evaluate
from .variable_projection import Held, Normal, moved_states, normal_equations

_START_DAMPING, _MOST_DAMPING = 1e-3, 1e7
_STIFFEST = 1e3
"""How many times stiffer a spring may get in one step."""
_OF_STATES = 10.0
"""How many times the tolerance a step must gain once the parameters have arrived: each window then goes on choosing
among initial states, in one model as in another."""
_SHORTER = 0.25
"""What a window's step is multiplied with after one that it refused."""
_SERVES = 0.5
"""Share of what a step promises that it must gain for the next one to go along the same tangents."""
_ALONG = 0.25
"""What such a step costs, and counts, of one whose tangents are computed."""
_KEPT = 2**25
"""Tangents that are kept for it, in numbers; where there are more, each step computes its own."""


class Limits(NamedTuple):
    """When a fit ends."""

    iterations: int
    """Most steps of each start; those along the tangents of an earlier one count a quarter."""
    tolerance: float = 0.1
    """A fit is done when a step gains less than this [nat], or a thousandth of that per unit of the criterion; once its
    parameters promise less, when a step gains less than ten times as much."""
    until: float = math.inf
    """Time of `time.monotonic` [s] from which on no step is begun."""


def solve(
    engine: Engine,
    data: Data,
    windows: Index,
    likelihood: Likelihood,
    starts: Sequence[Start],
    limits: Limits,
) -> list[Point]:
    """Minimises the criterion from every start.

    Args:
        engine: of the plant.
        data: recordings and tilings.
        windows: of the tilings.
        likelihood: the criterion.
        starts: where to begin.
        limits: when it ends.
    """
    size = sum(len(start.free) + STATES for start in starts) * 3 * data.samples * len(data.tilings)
    keep = size <= _KEPT
    begun = evaluate(engine, data, likelihood, starts, keep=keep)
    points = _from_other_states(engine, data, windows, likelihood, begun)
    damping = np.full(len(starts), _START_DAMPING)
    # Share of its Gauss-Newton step that each window's initial state takes.
    pace = np.ones((len(starts), len(windows.tiling)))
    remaining = np.full(len(starts), float(limits.iterations))
    active = remaining > 0
    held: list[Held] = [{} for _ in starts]
    # All starts go on side by side: one call of the compiled engine serves every start that is still active.
    while active.any() and time.monotonic() < limits.until:
        chosen = [int(i) for i in np.flatnonzero(active)]
        is_old = {i: bool(held[i]) for i in chosen}
        own = [held[i] for i in chosen] if keep else []
        normals = normal_equations(engine, data, windows, likelihood, [points[i] for i in chosen], own)
        waiting = dict(zip(chosen, normals, strict=True))
        for i, normal in waiting.items():
            weight = likelihood.weights(points[i].square)
            promise = _promise(engine.table, normal, weight, likelihood.prior, points[i])
            points[i] = dataclasses.replace(points[i], promise=promise)
            remaining[i] -= _ALONG if is_old[i] else 1.0
        # Where a step gains nothing, shorter ones are tried along the same tangents, which cost several simulations.
        while waiting:
            trials = []
            for i, normal in waiting.items():
                point = points[i]
                weight = likelihood.weights(point.square)
                vector, step = _stepped(engine.table, normal, weight, likelihood.prior, point, damping[i])
                moved = (normal.shift + normal.back @ step) * pace[i][:, None]
                trials.append(Start(vector, point.free, moved_states(data, windows, point.states, moved)))
            found = evaluate(engine, data, likelihood, trials, keep=keep)
            found, refused = _kept_where_better(engine, data, windows, likelihood, [points[i] for i in waiting], found)
            after = {}
            for (i, normal), new, no in zip(waiting.items(), found, refused, strict=True):
                # A refused state was moved too far: the window's next one is shorter, and grows when it is taken.
                pace[i] = np.where(no, _SHORTER * pace[i], np.minimum(pace[i] / _SHORTER, 1.0))
                gain, promise = points[i].value - new.value, points[i].promise
                least = limits.tolerance * max(1.0, 1e-3 * abs(new.value))
                arrived = len(new.free) > 0 and promise < least
                on = gain > (_OF_STATES if arrived else 1.0) * least
                if gain > 0:
                    # The damping of Levenberg and Marquardt: towards Gauss-Newton as long as the quadratic is met.
                    points[i] = dataclasses.replace(new, promise=promise)
                    damping[i] = max(0.1 * damping[i], 1e-9)
                elif not is_old[i]:
                    # Along old tangents a loss says that these are worn out; along new ones that the step is too long.
                    stiff = damping[i] * 10.0 > _MOST_DAMPING or not len(points[i].free)
                    damping[i] *= 30.0
                    # What gains nothing after a few shorter steps has arrived.
                    if not stiff and damping[i] < 1e2:
                        after[i] = normal
                        continue
                # Tangents serve again while the quadratic foretells what is gained.
                if not (on and len(new.free) and gain > _SERVES * promise):
                    held[i].clear()
                # Only new tangents tell whether it has arrived.
                active[i] = remaining[i] > 0 and (on or is_old[i])
            waiting = after
    return [dataclasses.replace(point, left=()) for point in points]


def _stepped(
    table: ParameterTable,
    normal: Normal,
    weight: NDArray[np.float64],
    prior: Prior,
    point: Point,
    damping: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The parameters after a damped Gauss-Newton step of the free ones within their bounds, and that step along the
    tangents, which initial states follow."""
    matrix, right = _quadratic(table, normal, weight, prior, point)
    free, vector, n = point.free, point.vector.copy(), len(point.free)
    low, high = prior.bounds(table)
    at, least, most = vector[free], low[free], high[free]
    # A spring's motions are nearly linear in its compliance: `c = 1 / k`, `dk/dc = -k^2`.
    is_spring = np.array([table.entry(int(p)).info.reciprocal for p in free], bool)
    stiffness, softest = at[is_spring], least[is_spring]
    stiffest = np.minimum(most[is_spring], _STIFFEST * stiffness)
    slope, now = np.ones(n), at.copy()
    slope[is_spring], now[is_spring] = -(stiffness**2), 1.0 / stiffness
    least[is_spring], most[is_spring] = 1.0 / stiffest, 1.0 / softest
    step = bounded_step(matrix * np.outer(slope, slope), right * slope, least - now, most - now, damping)
    after = now + step
    after[is_spring] = 1.0 / after[is_spring]
    vector[free] = after
    return vector, slope * step


def _quadratic(
    table: ParameterTable, normal: Normal, weight: NDArray[np.float64], prior: Prior, point: Point
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matrix and gradient of the free parameters' quadratic."""
    total, n = np.einsum("wc,wcij->ij", weight, normal.products), len(point.free)
    # The last row and column of the products belong to the residual; the prior adds its curvature and its slope.
    precision, gradient = prior.terms(table, point.free, point.vector, np.diag(total)[:n])
    return total[:n, :n] + precision, total[:n, n] + gradient


def _promise(table: ParameterTable, normal: Normal, weight: NDArray[np.float64], prior: Prior, point: Point) -> float:
    """What an undamped step of the free parameters should gain [nat], beyond what initial states gain alone."""
    matrix, right = _quadratic(table, normal, weight, prior, point)
    _, step = _stepped(table, normal, weight, prior, point, 0.0)
    return -float(step @ (right + 0.5 * matrix @ step))


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
        # The former states are simulated again only for starts some window of which lost by its step.
        if (loss > 0).any():
            worse.append(i)
    if not worse:
        return list(after), refused
    again = evaluate(
        engine,
        data,
        likelihood,
        [Start(after[i].vector, after[i].free, before[i].states) for i in worse],
        keep=bool(before[0].left),
    )
    out = list(after)
    for i, former in zip(worse, again, strict=True):
        out[i], refused[i] = _better_by_window(windows, likelihood, after[i], former)
    return out, refused


def _from_other_states(
    engine: Engine, data: Data, windows: Index, likelihood: Likelihood, points: Sequence[Point]
) -> list[Point]:
    """The points with, for each window, the initial state in hand, its first guess, or that of a shorter window that
    begins with it, whose fit is nearly linear: whichever meets it best.

    A model that lacks much pulls initial states into basins that better parameters alone do not lead out of: those of a
    cart that is held a moment longer.
    """
    first = tuple(t.states for t in data.tilings)
    others = [Start(p.vector, p.free, states) for p in points for states in (first, _states_of_shorter(data, p.states))]
    found = evaluate(engine, data, likelihood, others, keep=bool(points[0].left))
    out = []
    for point, *other in zip(points, found[::2], found[1::2], strict=True):
        for each in other:
            point, _ = _better_by_window(windows, likelihood, point, each)
        out.append(point)
    return out


def _states_of_shorter(data: Data, states: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], ...]:
    """For each window the initial state of the longest shorter one that begins with it, or else its own."""
    out = []
    for tiling, mine in zip(data.tilings, states, strict=True):
        own = mine.copy()
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
    left = []
    for k, (own, theirs) in enumerate(zip(point.left, other.left, strict=True)):
        chosen = np.flatnonzero(better & (windows.tiling == k))
        mine = own.copy() if len(chosen) else own
        for w in chosen:
            samples = slice(windows.begin[w], windows.stop[w])
            mine[samples] = theirs[samples]
        left.append(mine)
    value = likelihood.value(square) + point.prior
    return dataclasses.replace(point, states=states, square=square, value=value, left=tuple(left)), better
