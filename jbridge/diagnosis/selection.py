"""The search for a structure: proposals are cheap and linear, judgement is by simulation and one criterion.

A model is a set of effects beside what was given. In each round every effect that it lacks is weighed by a linear
screen (the criterion on the quadratic model of every window), the best are refitted together, the best of these are
fitted to all windows, and the move that lowers the criterion most is made: an effect is added, left out, replaced by a
simpler law, or a known number is set free. It ends when no move lowers the criterion.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identification.estimation import Problem
from ..identification.problem import free_places
from ..identification.solver import Normal, Point, Start, bounded_step, ties
from ..model.effects.base import AXIS_OF_SITE, AbstractEffect, parameters_of
from ..model.effects.catalogue import CATALOGUE, make_effect
from ..model.effects.friction import PositionDependentFriction, PositionDirectionFriction
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from .candidates import WRONG_VALUE, Candidate
from .criteria import CRITERIA
from .space import Name, Space, is_apart, make_space, proposals

_SOME = 3
"""Recordings on which proposals are screened and first refitted."""
_MOST_STARTS = 3
"""Places to start one effect from that are screened by simulation."""
_SHORT = 2
"""Horizons on which proposals are screened and first refitted: the shortest ones, on which models are nearly linear."""
_LINEAR = 4
"""Reweightings of a linear screen."""
_TRIAL, _POLISH = 3, 8
"""Iterations of a first refit, and of a fit to all windows."""
_SIMPLER = {"coulomb_friction": ("level",), "direction_dependent_friction": ("positive", "negative")}
"""Laws that stand in a map's place, and what is free of them."""


@dataclasses.dataclass(frozen=True)
class Structure:
    """One fitted model of a search."""

    space: Space
    names: tuple[Name, ...]
    """What was added, in the order in which it was."""
    keys: dict[Name, tuple[str, ...]]
    """Keys that are free of each."""
    point: Point
    price: float
    blocks: NDArray[np.float64]
    """The criterion by block, each left out in turn."""

    @property
    def value(self) -> float:
        """The criterion with its price."""
        return self.point.value + self.price

    @property
    def plant(self) -> Plant:
        return self.space.plant_of(self.point.vector, self.names)

    @property
    def known(self) -> frozenset[str]:
        return self.space.known - {site for kind, site in self.names if kind == WRONG_VALUE}


@dataclasses.dataclass(frozen=True)
class Move:
    """A change of a structure, ready to be refitted."""

    label: str
    space: Space
    names: tuple[Name, ...]
    keys: dict[Name, tuple[str, ...]]
    vector: NDArray[np.float64]
    free: NDArray[np.int64]
    price: float
    absent: NDArray[np.float64] | None = None
    """The parameters at which what is added is absent."""


def select(
    problem: Problem, base: Structure, tell: Callable[[str], None], deadline: float
) -> tuple[Problem, list[Structure], list[dict[str, object]], str]:
    """Searches from a base until no move lowers the criterion, or time is over.

    Returns:
        The problem with the last effective numbers of samples, the structures that were held one after the other, what
        was tried in each round, and why the search stopped (`criterion` or `budget`).
    """
    held, history = [base], []
    for number in range(CRITERIA.rounds):
        now = held[-1]
        problem = problem.judged_by(problem.residuals(now.space.engine, now.point))
        now = revalued(problem, now)
        held[-1] = now
        tell(f"round {number + 1}: looking beyond {', '.join(kind for kind, _ in now.names) or 'the model as given'}")
        moves, apart = _proposed(problem, now, deadline)
        found = _all_fitted(problem, moves, now, deadline)
        better = [s for s in found if _accepts(now, s)]
        if not better:
            found += _all_fitted(problem, apart(), now, deadline)
            better = [s for s in found if _accepts(now, s)]
        history.append(_row(now, found))
        if not better:
            return problem, held, history, "criterion" if time.monotonic() < deadline else "budget"
        held.append(_among_all(problem, min(better, key=lambda s: s.value)))
        if time.monotonic() > deadline:
            return problem, held, history, "budget"
    return problem, held, history, "criterion"


def _row(now: Structure, found: Sequence[Structure]) -> dict[str, object]:
    return {
        "from": now.names,
        "value": now.value,
        "tried": [
            (
                sorted(set(s.names) ^ set(now.names)),
                round(now.value - s.value, 2),
                round(float((now.blocks - s.blocks).sum()), 2),
            )
            for s in sorted(found, key=lambda s: s.value)
        ],
    }


def _accepts(now: Structure, then: Structure) -> bool:
    gain = now.blocks - then.blocks
    error = float(np.std(gain, ddof=1) * math.sqrt(len(gain))) if len(gain) > 1 else 0.0
    fewer = len(then.point.free) < len(now.point.free)
    if fewer:
        # Within one standard error the structure with fewer numbers wins.
        return then.value < now.value + min(error, 0.0) or then.value <= now.value
    return then.value < now.value and float(gain.sum()) > -CRITERIA.veto * error


def base_structure(problem: Problem, space: Space, point: Point) -> Structure:
    """A structure with nothing added, from its fitted point."""
    return Structure(space, (), {}, point, 0.0, left_out(problem, space, point))


def revalued(problem: Problem, structure: Structure) -> Structure:
    """A structure by another criterion."""
    point = problem.revalued(structure.point)
    return dataclasses.replace(structure, point=point, blocks=left_out(problem, structure.space, point))


# ------------------------------------------------------------------ proposals


def _proposed(problem: Problem, now: Structure, deadline: float) -> tuple[list[Move], Callable[[], list[Move]]]:
    """Moves worth a fit to all windows, and a call for those with a program of their own."""
    part = problem.of_horizons(problem.data.horizons[:_SHORT]).of_some(_SOME)
    states = problem.states_of(now.point.states, part)
    every = [c for c in proposals(problem.setting, now.plant, now.known) if c.name not in now.names]
    shared = [c for c in every if not is_apart(c.kind)]
    scored = sorted(_screened(part, now, states, shared), key=lambda found: found[0])
    names: dict[Name, tuple[float, Candidate, NDArray[np.float64]]] = {}
    for score, candidate, vector in scored:
        names.setdefault(candidate.name, (score, candidate, vector))
    number = len({c.name for c in every})
    ranked = list(names.values())
    chosen = ranked[: CRITERIA.refitted]
    for site in dict.fromkeys(c.site for _, c, _ in ranked):
        best = next(found for found in ranked if found[1].site == site)
        if all(best[1].name != c.name for _, c, _ in chosen):
            chosen.append(best)
    moves = [_adding(problem, now, c, vector, number, _grid(every, c)) for _, c, vector in chosen]
    # Each refitted on the shorter windows, from the screen's estimate and from the effect's absence.
    fits = part.solve(now.space.engine, [Start(m.vector, m.free, states) for m in moves], _TRIAL)
    parent = part.likelihood.value(problem.square_of(now.point.square, part))
    # Where the screen's estimate leads astray, the effect starts from its absence.
    astray = [i for i, point in enumerate(fits) if not point.value < parent]
    begun = [Start(_at_seed(now, chosen[i][1]), moves[i].free, states) for i in astray]
    for i, point in zip(astray, part.solve(now.space.engine, begun, _TRIAL), strict=True):
        fits[i] = min(fits[i], point, key=lambda p: p.value)
    refitted = [
        (point.value + move.price, dataclasses.replace(move, vector=point.vector))
        for move, point in zip(moves, fits, strict=True)
    ]
    refitted.sort(key=lambda found: found[0])
    out = [move for _, move in refitted[: CRITERIA.polished]]
    out += _removals(problem, now) + _simplifications(problem, now)
    return out, (lambda: _apart(problem, part, now, states, every, number, deadline))


def _grid(every: Sequence[Candidate], candidate: Candidate) -> int:
    """Number of places that were tried to start a candidate from."""
    return max(1, sum(c.name == candidate.name for c in every))


def _at_seed(now: Structure, candidate: Candidate) -> NDArray[np.float64]:
    return candidate.set(now.space.table, now.point.vector)


def _places(now: Structure, candidate: Candidate) -> NDArray[np.int64]:
    return candidate.places(now.space.table)


def _adding(
    problem: Problem, now: Structure, candidate: Candidate, vector: NDArray[np.float64], number: int, grid: int
) -> Move:
    free = np.array(list(dict.fromkeys([*now.point.free, *_places(now, candidate)])), np.int64)
    price = now.price + _price(problem, len(free) - len(now.point.free), number, grid)
    keys = {**now.keys, candidate.name: candidate.free}
    names = (*now.names, candidate.name)
    return Move("add", now.space, names, keys, vector, free, price, _at_seed(now, candidate))


def _price(problem: Problem, numbers: float, candidates: int, grid: int) -> float:
    """What further numbers, and the choice among so many, must gain."""
    return 0.5 * numbers * math.log(max(problem.likelihood.total, 2.0)) + math.log(candidates) + math.log(grid)


def _screened(
    problem: Problem, now: Structure, states: tuple, shared: Sequence[Candidate]
) -> list[tuple[float, Candidate, NDArray[np.float64]]]:
    """The criterion that each candidate would reach if windows were quadratic, and the parameters there.

    Candidates that are absent where they start share a simulation: those that are each an effect's first seed, then
    the second ones, and so on. The others have one of their own.
    """
    groups: list[list[Candidate]] = []
    seen: dict[Name, int] = {}
    for candidate in _thinned(problem, now, states, shared):
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
    table = now.space.table
    starts = []
    for group in groups:
        vector, free = now.point.vector, [int(p) for p in now.point.free]
        for candidate in group:
            vector = candidate.set(table, vector)
            if candidate.harmonic:
                # A small amplitude, so that the phase shows.
                vector[table.positions(candidate.group("amplitude"))] = 1e-6
            free += [int(p) for p in _places(now, candidate) if p not in free]
        starts.append(Start(vector, np.array(free, np.int64), states))
    points = problem.evaluate(now.space.engine, starts)
    normals = problem.normal(now.space.engine, points)
    out = []
    for group, point, normal in zip(groups, points, normals, strict=True):
        for candidate in group:
            wanted = np.array(list(dict.fromkeys([*now.point.free, *_places(now, candidate)])), np.int64)
            columns = [int(np.flatnonzero(point.free == p)[0]) for p in wanted]
            step, value = linear_optimum(problem, now.space, point, normal, columns)
            vector = candidate.set(table, now.point.vector)
            vector[wanted] = point.vector[wanted] + step
            if candidate.harmonic:
                _as_wave(table, candidate, point.vector, vector)
            out.append((value, candidate, vector))
    return out


def _as_wave(table: ParameterTable, candidate: Candidate, at: NDArray[np.float64], vector: NDArray[np.float64]) -> None:
    """Amplitude and phase from steps of a sine and a cosine."""
    a, p = (table.positions(candidate.group(key))[0] for key in ("amplitude", "phase"))
    sine, cosine = vector[a], at[a] * (vector[p] - at[p])
    vector[a], vector[p] = math.hypot(sine, cosine), at[p] + math.atan2(cosine, sine)


def _thinned(problem: Problem, now: Structure, states: tuple, shared: Sequence[Candidate]) -> list[Candidate]:
    """Of effects with many places to start, those few at which a plain regression explains most of what is left."""
    many: dict[Name, list[Candidate]] = {}
    for candidate in shared:
        many.setdefault(candidate.name, []).append(candidate)
    out = [c for own in many.values() if len(own) <= _MOST_STARTS for c in own]
    crowded = [own for own in many.values() if len(own) > _MOST_STARTS]
    if crowded:
        left = problem.residuals(now.space.engine, Start(now.point.vector, now.point.free, states))
        bridge = now.space.own.bridge
        fade = float(bridge.cart_damping / bridge.cart_mass)
        for own in crowded:
            order = np.argsort(-_regressed(problem, left, own, fade), kind="stable")
            out += [own[int(i)] for i in order[:_MOST_STARTS]]
    return out


def _regressed(
    problem: Problem, left: Sequence[NDArray[np.float64]], own: Sequence[Candidate], fade: float
) -> NDArray[np.float64]:
    """Share of the longest screened windows' residuals that one effect's shapes explain beside a parabola, by start.

    Args:
        problem: recordings.
        left: what the model leaves, by tiling.
        own: places to start one effect from.
        fade: the cart's damping over its mass [1/s].
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
            t, y = grid.times[rows], data.y[tiling.recording, rows, k]
            s = np.stack([_shapes(c, t, y, fade) for c in own])
            q, _ = np.linalg.qr((t - t[0])[:, None] ** np.arange(3))
            r = residual[rows, k] - q @ (q.T @ residual[rows, k])
            s = s - np.swapaxes(q @ (q.T @ np.swapaxes(s, 1, 2)), 1, 2)
            s = s / np.maximum(np.linalg.norm(s, axis=2, keepdims=True), 1e-9)
            gram = s @ np.swapaxes(s, 1, 2) + 1e-6 * np.eye(s.shape[1])
            right = s @ r
            found = np.einsum("ki,ki->k", right, np.linalg.solve(gram, right[:, :, None])[:, :, 0])
            explained += found / max(float(r @ r), 1e-12)
    return explained


def _shapes(candidate: Candidate, t: NDArray[np.float64], y: NDArray[np.float64], fade: float) -> NDArray[np.float64]:
    """What an effect adds to a reading, in any unit, `(shape, sample)`."""
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
    return shapes if candidate.site.endswith("sensor") else np.stack([_response(t, s, fade) for s in shapes])


def _response(t: NDArray[np.float64], force: NDArray[np.float64], fade: float) -> NDArray[np.float64]:
    """Way of a mass with viscous damping under a force, from rest, in any unit."""
    dt = np.diff(t, prepend=t[0])
    grow = np.exp(np.minimum(fade * (t - t[0]), 300.0))
    return np.cumsum(np.cumsum(force * grow * dt) / grow * dt)


def linear_optimum(
    problem: Problem, space: Space, point: Point, normal: Normal, columns: Sequence[int]
) -> tuple[NDArray[np.float64], float]:
    """Step of some free parameters that minimises the criterion on the windows' quadratics, and the criterion there."""
    n = len(point.free)
    take = [*columns, n]
    products = normal.products[:, :, take][:, :, :, take]
    places = point.free[list(columns)]
    low, high = space.table.bounds()
    least, most = low[places] - point.vector[places], high[places] - point.vector[places]
    m = len(columns)
    step = np.zeros(m)
    square, best = _square(problem, products, step), (step, math.inf)
    for _ in range(_LINEAR):
        weight = problem.likelihood.weights(square)
        total = np.einsum("wc,wcij->ij", weight, products)
        tied = ties(space.table, places, np.diag(total)[:m])
        gradient = total[:m, m] + tied @ point.vector[places]
        step = bounded_step(total[:m, :m] + tied, gradient, least, most, 1e-6)
        square = _square(problem, products, step)
        value = problem.likelihood.value(square)
        if value < best[1]:
            best = step, value
    return best


def _square(problem: Problem, products: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    along = np.append(step, 1.0)
    total = np.einsum("wcij,i,j->wc", products, along, along)
    return np.maximum(total, 0.0) / np.maximum(problem.likelihood.count, 1.0)


# ------------------------------------------------------------------ other moves


def _among_all(problem: Problem, structure: Structure) -> Structure:
    """A structure in a space that has every effect of a shared program beside what it consists of."""
    space = structure.space
    if space.shared:
        return structure
    added = [n for n in structure.names if n[0] != WRONG_VALUE and not is_apart(n[0])]
    return _rebuilt(problem, structure, [e for e in structure.plant.effects if (e.kind, e.site) not in added])


def _rebuilt(problem: Problem, structure: Structure, own: Sequence[AbstractEffect]) -> Structure:
    """A structure in the space of other effects that every model has."""
    plant = structure.plant
    space = make_space(problem, Plant(plant.bridge, tuple(own)), structure.space.known)
    free = [structure.space.table.entry(int(p)).name for p in structure.point.free]
    places = np.array([space.table.positions(name)[0] for name in free], np.int64)
    start = Start(space.with_values(plant), places, structure.point.states)
    [point] = problem.evaluate(space.engine, [start])
    return dataclasses.replace(structure, space=space, point=point)


def _removals(problem: Problem, now: Structure) -> list[Move]:
    """Each added effect left out."""
    out = []
    extra = max(sum(len(_free_of(now, name)) for name in now.names), 1)
    for name in now.names:
        gone = _free_of(now, name)
        price = now.price * (1.0 - len(gone) / extra)
        keys = {n: k for n, k in now.keys.items() if n != name}
        names = tuple(n for n in now.names if n != name)
        if is_apart(name[0]):
            out.append(_without_apart(problem, now, name, names, keys, price))
            continue
        vector = now.point.vector.copy()
        vector[gone] = now.space.absent[gone]
        free = np.array([p for p in now.point.free if p not in gone], np.int64)
        out.append(Move("leave out", now.space, names, keys, vector, free, price))
    return out


def _without_apart(
    problem: Problem,
    now: Structure,
    name: Name,
    names: tuple[Name, ...],
    keys: dict[Name, tuple[str, ...]],
    price: float,
) -> Move:
    """A model without an effect that has a program of its own, which changes what all models share."""
    own = Plant(now.plant.bridge, tuple(e for e in now.space.own.effects if (e.kind, e.site) != name))
    space = make_space(problem, own, now.space.known)
    gone = _free_of(now, name)
    left = [now.space.table.entry(int(p)).name for p in now.point.free if p not in gone]
    free = np.array([space.table.positions(entry)[0] for entry in left], np.int64)
    return Move("leave out", space, names, keys, space.with_values(_without(now, name)), free, price)


def _free_of(now: Structure, name: Name) -> list[int]:
    table = now.space.table
    groups = [name[1]] if name[0] == WRONG_VALUE else [f"{name[0]}@{name[1]}.{key}" for key in now.keys[name]]
    return [p for group in groups for p in table.positions(group)]


def _simplifications(problem: Problem, now: Structure) -> list[Move]:
    """Each map of friction replaced by a law of one or two levels."""
    out = []
    for name in now.names:
        if CATALOGUE.get(name[0]) not in (PositionDependentFriction, PositionDirectionFriction):
            continue
        level = float(np.mean(now.point.vector[_free_of(now, name)]))
        left = tuple(n for n in now.names if n != name)
        rest = {n: k for n, k in now.keys.items() if n != name}
        bare = _without_apart(problem, now, name, left, rest, 0.0)
        present = {(e.kind, e.site) for e in bare.space.own.effects} | set(left)
        for kind, keys in _SIMPLER.items():
            if (kind, name[1]) in present:
                continue
            vector, places = bare.vector.copy(), []
            for key in keys:
                places += bare.space.table.positions(f"{kind}@{name[1]}.{key}")
            vector[places] = level
            free = np.array([*bare.free, *places], np.int64)
            price = _price(problem, len(free) - len(bare.space.base), len(_SIMPLER), 1)
            names, freed = (*left, (kind, name[1])), rest | {(kind, name[1]): keys}
            out.append(Move("simplify", bare.space, names, freed, vector, free, price))
    return out


def _without(now: Structure, name: Name) -> Plant:
    plant = now.plant
    return Plant(plant.bridge, tuple(e for e in plant.effects if (e.kind, e.site) != name))


def _apart(
    problem: Problem,
    part: Problem,
    now: Structure,
    states: tuple,
    every: Sequence[Candidate],
    number: int,
    deadline: float,
) -> list[Move]:
    """Effects with a program of their own: refitted beside the model alone, the best fitted on."""
    out: list[tuple[float, Move]] = []
    plant, known = now.plant, now.known
    by_name: dict[Name, list[Candidate]] = {}
    for candidate in every:
        if is_apart(candidate.kind):
            by_name.setdefault(candidate.name, []).append(candidate)
    for name, seeds in by_name.items():
        if time.monotonic() > deadline:
            break
        own = plant.adding(_effect(seeds[0]))
        try:
            space = make_space(part, own, known, shared=False)
        except ValueError:
            continue
        starts = []
        for candidate in seeds:
            vector = candidate.set(space.table, space.absent)
            starts.append(Start(vector, _freed(space, own, known, part, candidate), states))
        fits = part.solve(space.engine, starts, _TRIAL)
        which = int(np.argmin([p.value for p in fits]))
        point, candidate = fits[which], seeds[which]
        extra = len(point.free) - len(now.point.free)
        price = now.price + _price(problem, extra, number, len(seeds))
        if out and point.value + price >= min(v for v, _ in out):
            continue
        full = make_space(problem, own, known, shared=False)
        keys = {**now.keys, name: candidate.free}
        out = [(point.value + price, Move("add", full, (*now.names, name), keys, point.vector, point.free, price))]
    return [move for _, move in out]


def _effect(candidate: Candidate) -> AbstractEffect:
    return make_effect(
        candidate.kind, candidate.site, {key: v for key, v in candidate.values.items() if key != "coulomb"}
    )


def _freed(
    space: Space, own: Plant, known: frozenset[str], problem: Problem, candidate: Candidate
) -> NDArray[np.int64]:
    free = [int(p) for p in free_places(space.table, known, problem.setting)]
    mine = {
        p for key in _keys_of(candidate.kind) for p in space.table.positions(f"{candidate.kind}@{candidate.site}.{key}")
    }
    wanted = set(map(int, candidate.places(space.table)))
    return np.array([p for p in free if p not in mine or p in wanted], np.int64)


def _keys_of(kind: str) -> list[str]:
    return [key for key, info in parameters_of(CATALOGUE[kind]).items() if info.fitted]


def _all_fitted(problem: Problem, moves: Sequence[Move], now: Structure, deadline: float) -> list[Structure]:
    """Moves fitted to all windows, those of one space side by side."""
    out = []
    for space in {id(m.space): m.space for m in moves}.values():
        if time.monotonic() > deadline:
            break
        own = [m for m in moves if m.space is space]
        starts = [Start(m.vector, m.free, now.point.states) for m in own]
        points = problem.solve(space.engine, starts, _POLISH)
        # What fits short windows may run away in long ones: then the effect grows from its absence, where the model
        # is as good as the one that it contains.
        again = [(i, m.absent) for i, m in enumerate(own) if points[i].value > now.point.value]
        begun = [(i, Start(v, own[i].free, now.point.states)) for i, v in again if v is not None]
        for (i, _), point in zip(begun, problem.solve(space.engine, [s for _, s in begun], _POLISH), strict=True):
            points[i] = min(points[i], point, key=lambda p: p.value)
        for move, point in zip(own, points, strict=True):
            out.append(Structure(space, move.names, move.keys, point, move.price, left_out(problem, space, point)))
    return out


# ------------------------------------------------------------------ blocks


def blocks_of(problem: Problem) -> NDArray[np.int64]:
    """The block of each window: its recording where there are six, else a stretch of it; -1 where it spans several."""
    windows, data = problem.windows, problem.data
    if len(data.grids) >= 6:
        return windows.recording.copy()
    length = max(CRITERIA.block, 2.0 * _swing_period(problem))
    out = np.full(len(windows.recording), -1)
    first = 0
    for r, grid in enumerate(data.grids):
        count = max(1, int(grid.times[-1] / length))
        own = windows.recording == r
        time = grid.times[np.minimum(windows.begin[own], grid.intervals)]
        whole = np.isinf(windows.horizon[own])
        out[own] = np.where(whole, -1, first + np.minimum((time / grid.times[-1] * count).astype(int), count - 1))
        first += count
    return out


def _swing_period(problem: Problem) -> float:
    if "psi" not in problem.setting.axes:
        return 0.0
    return 2.0 * math.pi * math.sqrt(problem.setting.length / 9.81)


def left_out(problem: Problem, space: Space, point: Point) -> NDArray[np.float64]:
    """The criterion of each block at the parameters that the others ask for: one Gauss-Newton step, no refit."""
    [normal] = problem.normal(space.engine, [point])
    blocks = blocks_of(problem)
    weight = problem.likelihood.weights(point.square)
    n = len(point.free)
    each = np.einsum("wc,wcij->wij", weight, normal.products)
    total = each.sum(axis=0)
    tied = ties(space.table, point.free, np.diag(total)[:n])
    low, high = space.table.bounds()
    at = point.vector[point.free]
    out = []
    for block in range(int(blocks.max()) + 1):
        own = blocks == block
        rest = total - each[own].sum(axis=0)
        gradient = rest[:n, n] + tied @ at
        step = bounded_step(rest[:n, :n] + tied, gradient, low[point.free] - at, high[point.free] - at, 1e-6)
        square = _square(problem, normal.products, step)
        out.append(float(problem.likelihood.by_window(square)[own].sum()))
    return np.array(out)
