"""A linear look at every effect that a model lacks: what the criterion would gain on the quadratics of all windows."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...identification.estimation import Problem
from ...identification.setting import axis_of_number
from ...identification.solver import Normal, Point, Start, bounded_step, moved_states
from ...model.effects.base import MAP_KNOTS
from ...model.parameters import ParameterTable
from ...model.plant import Plant
from ..structures.candidates import WRONG_VALUE, Candidate
from ..structures.space import Name, Space, is_apart, make_space
from ..structures.structure import Structure, squares
from .starting_points import promising

_COLUMNS, _MORE = 12, 16
"""Parameter columns of a call, and for models that are given with many: most models need no more. Always the same, so
that one program serves a whole search, and those of a rig many searches."""
_ROOM = 3
"""Columns that are left beyond the model as given."""
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
    columns = len(now.free) - sum(len(now.places(name)) for name in now.names)
    width = _COLUMNS if columns + _ROOM <= _COLUMNS else _MORE
    space = make_space(problem, Plant(now.plant.bridge, own), now.known, width=width)
    places = np.array([space.table.positions(name)[0] for name in now.free], np.int64)
    [point] = part.evaluate(space.engine, [Start(space.with_values(now.plant), places, now.point.states)])
    return AmongAll(space, point)


def screened(problem: Problem, among: AmongAll, shared: Sequence[Candidate]) -> list[tuple[float, Candidate, Start]]:
    """The criterion that each candidate would reach if windows were quadratic, and parameters and states there.

    Candidates that are absent where they start share a simulation: those that are each an effect's first seed, then
    the second ones, and so on. The others have one of their own.
    """
    there = among.point
    bridge = among.space.table.unravel(there.vector).bridge
    groups: list[list[Candidate]] = []
    seen: dict[Name, int] = {}
    for candidate in promising(problem, problem.residuals(among.space.engine, there), bridge, shared):
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
                axis = problem.setting.axis_of(candidate.site)
                free = [p for p in free if axis_of_number(table.entry(p), problem.setting.axes) == axis]
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
    products = normal.products
    if away is not None:
        turned = np.eye(n + 1)
        turned[:n, n] = away
        products = np.swapaxes(turned, 0, 1) @ products @ turned
    chosen = np.array([*columns, n])
    products = products[:, :, chosen[:, None], chosen]
    places = point.free[list(columns)]
    prior, vector = problem.likelihood.prior, point.vector.copy()
    low, high = prior.bounds(space.table)
    if away is not None:
        vector[point.free] += away
    least, most = low[places] - vector[places], high[places] - vector[places]
    m = len(columns)
    step = np.zeros(m)
    square, best = squares(problem, products, step), (step, math.inf)
    for _ in range(_LINEAR):
        weight = problem.likelihood.weights(square)
        total = np.tensordot(weight, products, axes=2)
        precision, gradient = prior.terms(space.table, places, vector, np.diag(total)[:m])
        step = bounded_step(total[:m, :m] + precision, total[:m, m] + gradient, least, most, 1e-6)
        square = squares(problem, products, step)
        there = vector.copy()
        there[places] += step
        value = problem.likelihood.value(square) + prior.cost(space.table, there)
        if value < best[1]:
            best = step, value
    return best
