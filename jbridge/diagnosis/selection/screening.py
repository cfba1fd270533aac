"""A linear look at every effect that a model lacks: what the criterion would gain on the quadratics of all windows."""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...identification.estimation import Problem
from ...identification.setting import axis_of_number
from ...identification.solver import Normal, Point, Start, bounded_step, moved_states
from ...model.effects.base import AXIS_OF_SITE, MAP_KNOTS
from ...model.parameters import ParameterTable
from ...model.plant import Plant
from ..structures.candidates import WRONG_VALUE, Candidate
from ..structures.space import Name, Space, is_apart, make_space
from ..structures.structure import Structure, squares

_MOST_STARTS = 3
"""Places to start one effect from that are screened by simulation, beside one that bisection finds."""
_HALVINGS = 12
"""Times that the distance between places to start is halved, about the best of them."""
_COLUMNS = 12
"""Parameter columns of a call that most models need no more than, always the same, so that few programs serve a whole
search."""
_LINEAR = 4
"""Reweightings of a linear screen."""


@dataclasses.dataclass(frozen=True)
class AmongAll:
    """A fitted model beside all effects that share a program, absent."""

    space: Space
    point: Point


def seen_among_all(problem: Problem, part: Problem, now: Structure) -> AmongAll:
    """A model, fitted to a part of the windows, in the program that has all other effects beside it."""
    # A map that was refined is not the one that stands in the program for all.
    finer = {(e.kind, e.site) for e in now.plant.effects if np.size(getattr(e, "knots", ())) > MAP_KNOTS}
    added = {n for n in now.names if n[0] != WRONG_VALUE and not is_apart(n[0])} - finer
    given = len(now.plant.effects) - len([n for n in now.names if n[0] != WRONG_VALUE])
    own = tuple(e for k, e in enumerate(now.plant.effects) if k < given or (e.kind, e.site) not in added)
    space = make_space(problem, Plant(now.plant.bridge, own), now.known, width=_COLUMNS)
    places = np.array([space.table.positions(name)[0] for name in now.free], np.int64)
    [point] = part.evaluate(space.engine, [Start(space.with_values(now.plant), places, now.point.states)])
    return AmongAll(space, point)


def screened(problem: Problem, among: AmongAll, shared: Sequence[Candidate]) -> list[tuple[float, Candidate, Start]]:
    """The criterion that each candidate would reach if windows were quadratic, and parameters and states there.

    Candidates that are absent where they start share a simulation: those that are each an effect's first seed, then
    the second ones, and so on. The others have one of their own.
    """
    there = among.point
    groups: list[list[Candidate]] = []
    seen: dict[Name, int] = {}
    for candidate in _thinned(problem, among, shared):
        if candidate.finite:
            groups.append([candidate])
            continue
        place = seen.get(candidate.name, 0)
        seen[candidate.name] = place + 1
        while len(groups) <= place or groups[place][0].finite or any(c.name == candidate.name for c in groups[place]):
            if len(groups) <= place:
                groups.append([])
                break
            place += 1
        groups[place].append(candidate)
    table = among.space.table
    starts = []
    for group in groups:
        vector, free = there.vector, [int(p) for p in there.free]
        for candidate in group:
            vector = candidate.set(table, vector)
            if candidate.harmonic:
                # A small amplitude, so that the phase shows.
                vector[table.positions(candidate.group("amplitude"))] = 1e-6
            if candidate.finite:
                # It has a simulation of its own, so it is weighed by the numbers of its axis alone.
                axis = AXIS_OF_SITE[candidate.site]
                free = [p for p in free if axis_of_number(table.entry(p)) == axis]
            free += [int(p) for p in linear_places(among.space, candidate) if p not in free]
        starts.append(Start(vector, np.array(free, np.int64), there.states))
    points = problem.evaluate(among.space.engine, starts)
    normals = problem.normal(among.space.engine, points)
    out = []
    for group, point, normal in zip(groups, points, normals, strict=True):
        for candidate in group:
            given = [p for p in there.free if p in point.free]
            wanted = np.array(list(dict.fromkeys([*given, *linear_places(among.space, candidate)])), np.int64)
            columns = [int(np.flatnonzero(point.free == p)[0]) for p in wanted]
            step, value = linear_optimum(problem, among.space, point, normal, columns)
            vector = candidate.set(table, there.vector)
            vector[wanted] = point.vector[wanted] + step
            if candidate.harmonic:
                _as_wave(table, candidate, point.vector, vector)
            change = normal.shift + normal.back[:, :, columns] @ step
            states = moved_states(problem.data, problem.windows, there.states, change)
            own = list(dict.fromkeys([*there.free, *candidate.places(table)]))
            out.append((value, candidate, Start(vector, np.array(own, np.int64), states)))
    return out


def linear_places(space: Space, candidate: Candidate) -> NDArray[np.int64]:
    """Parameters that do something where a candidate starts."""
    return candidate.places(space.table, None if candidate.finite else candidate.linear)


def _as_wave(table: ParameterTable, candidate: Candidate, at: NDArray[np.float64], vector: NDArray[np.float64]) -> None:
    """Amplitude and phase from steps of a sine and a cosine."""
    a, p = (table.positions(candidate.group(key))[0] for key in ("amplitude", "phase"))
    sine, cosine = vector[a], at[a] * (vector[p] - at[p])
    vector[a], vector[p] = math.hypot(sine, cosine), at[p] + math.atan2(cosine, sine)


def _thinned(problem: Problem, among: AmongAll, shared: Sequence[Candidate]) -> list[Candidate]:
    """Of effects with many places to start, those few at which a plain regression explains most of what is left, and
    the one near the best of them at which it explains most: the time of a step has a gradient only within one sample of
    the true one.
    """
    many: dict[Name, list[Candidate]] = {}
    for candidate in shared:
        many.setdefault(candidate.name, []).append(candidate)
    out = [c for own in many.values() if len(own) <= _MOST_STARTS for c in own]
    crowded = [own for own in many.values() if len(own) > _MOST_STARTS]
    if crowded:
        left = problem.residuals(among.space.engine, among.point)
        b = among.space.table.unravel(among.point.vector).bridge
        fades = {
            "x": float(b.cart_damping / b.cart_mass),
            "psi": 0.0,
            "l": float(b.hoist_damping / (b.winch_mass + b.load_mass)),
        }
        for own in crowded:
            fade = fades[AXIS_OF_SITE[own[0].site]]
            explained = functools.partial(_regressed, problem, left, fade=fade)
            order = [int(i) for i in np.argsort(-explained(own), kind="stable")]
            first, *others = (own[i] for i in order[:_MOST_STARTS])
            beside = [own[i] for i in (order[0] - 1, order[0] + 1) if 0 <= i < len(own)]
            beside = [other for other in beside if _midway(other, first) == _midway(first, other)]
            out += [first, *others, _between(first, beside, explained)]
    return out


def _between(
    best: Candidate, beside: Sequence[Candidate], explained: Callable[[Sequence[Candidate]], NDArray[np.float64]]
) -> Candidate:
    """The place to start between the best one and those beside it that explains most, by bisection."""
    for _ in range(_HALVINGS):
        tried = [best, *(_midway(best, other) for other in beside)]
        first = int(np.argmax(explained(tried)))
        beside = tried[1:] if first == 0 else [best, beside[first - 1]]
        best = tried[first]
    return best


def _midway(one: Candidate, other: Candidate) -> Candidate:
    """A place to start halfway between two, in all numbers."""
    values = {
        key: 0.5 * (value + other.values[key]) if isinstance(value, float) else value
        for key, value in one.values.items()
    }
    return dataclasses.replace(one, values=values)


def _regressed(
    problem: Problem, left: Sequence[NDArray[np.float64]], own: Sequence[Candidate], fade: float
) -> NDArray[np.float64]:
    """Share of the longest screened windows' residuals that one effect's shapes explain beside a parabola, by start.

    Args:
        problem: recordings.
        left: what the model leaves, by tiling.
        own: places to start one effect from.
        fade: the axis' damping over its mass [1/s].
    """
    data = problem.data
    k = AXES.index(AXIS_OF_SITE[own[0].site])
    explained = np.zeros(len(own))
    for tiling, residual in zip(data.tilings, left, strict=True):
        if tiling.horizon != data.horizons[-1]:
            continue
        grid = data.grids[tiling.recording]
        for begin, stop in zip(tiling.begins, tiling.stops, strict=True):
            rows = np.flatnonzero(data.measured[tiling.recording, begin:stop, k]) + begin
            if len(rows) < 8:
                continue
            t, y = grid.recording.begun + grid.times[rows], data.y[tiling.recording, rows, k]
            u = np.zeros(len(rows))
            if own[0].site.endswith("_drive"):
                u = grid.u[np.minimum(rows, grid.intervals - 1), 0 if AXES[k] == "x" else 1]
            s = np.stack([_shapes(c, t, y, u, fade) for c in own])
            q, _ = np.linalg.qr((t - t[0])[:, None] ** np.arange(3))
            r = residual[rows, k] - q @ (q.T @ residual[rows, k])
            s = s - np.swapaxes(q @ (q.T @ np.swapaxes(s, 1, 2)), 1, 2)
            s = s / np.maximum(np.linalg.norm(s, axis=2, keepdims=True), 1e-9)
            gram = s @ np.swapaxes(s, 1, 2) + 1e-6 * np.eye(s.shape[1])
            right = s @ r
            found = np.einsum("ki,ki->k", right, np.linalg.solve(gram, right[:, :, None])[:, :, 0])
            explained += found / max(float(r @ r), 1e-12)
    return explained


def _shapes(
    candidate: Candidate, t: NDArray[np.float64], y: NDArray[np.float64], u: NDArray[np.float64], fade: float
) -> NDArray[np.float64]:
    """What an effect adds to a reading, in any unit, `(shape, sample)`; `u` is the input of its drive."""
    values = candidate.values
    if "time" in values:
        return (t >= float(values["time"])).astype(float)[None]
    if "start" in values:
        push = ((t >= float(values["start"])) & (t < float(values["stop"]))).astype(float)
        return _response(t, push, 0.0)[None]
    if "end" in values:
        beyond = y - float(values["position"])
        return _response(t, np.maximum(beyond if values["end"] == "high" else -beyond, 0.0), fade)[None]
    angle = 2 * np.pi * y / float(values["period"])
    shapes = np.stack([np.sin(angle), np.cos(angle)])
    if candidate.site.endswith("_drive"):
        shapes = shapes * u
    return shapes if candidate.site.endswith("sensor") else np.stack([_response(t, s, fade) for s in shapes])


def _response(t: NDArray[np.float64], force: NDArray[np.float64], fade: float) -> NDArray[np.float64]:
    """Way of a mass with viscous damping under a force, from rest, in any unit."""
    dt = np.diff(t, prepend=t[0])
    grow = np.exp(np.minimum(fade * (t - t[0]), 300.0))
    return np.cumsum(np.cumsum(force * grow * dt) / grow * dt)


def linear_optimum(
    problem: Problem,
    space: Space,
    point: Point,
    normal: Normal,
    columns: Sequence[int],
    away: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], float]:
    """Step of some free parameters that minimises the criterion on the windows' quadratics, and the criterion there.

    Args:
        problem: recordings and criterion.
        space: of the model.
        point: where the windows were linearised.
        normal: there.
        columns: those of the free parameters that may move.
        away: a step that is made before, of all free parameters.
    """
    n = len(point.free)
    turned = np.eye(n + 1)
    turned[:n, n] = 0.0 if away is None else away
    turned = turned[:, [*columns, n]]
    products = np.einsum("ia,wcij,jb->wcab", turned, normal.products, turned, optimize=True)
    places = point.free[list(columns)]
    low, high = space.table.bounds()
    prior, vector = problem.likelihood.prior, point.vector.copy()
    if away is not None:
        vector[point.free] += away
    least, most = low[places] - vector[places], high[places] - vector[places]
    m = len(columns)
    step = np.zeros(m)
    square, best = squares(problem, products, step), (step, math.inf)
    for _ in range(_LINEAR):
        weight = problem.likelihood.weights(square)
        total = np.einsum("wc,wcij->ij", weight, products)
        precision, gradient = prior.terms(space.table, places, vector, np.diag(total)[:m])
        step = bounded_step(total[:m, :m] + precision, total[:m, m] + gradient, least, most, 1e-6)
        square = squares(problem, products, step)
        there = vector.copy()
        there[places] += step
        value = problem.likelihood.value(square) + prior.cost(space.table, there)
        if value < best[1]:
            best = step, value
    return best
