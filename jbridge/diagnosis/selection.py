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

from ..identification.estimation import Problem
from ..identification.problem import free_places
from ..identification.solver import Normal, Point, Start, bounded_step, ties
from ..model.effects.base import AXIS_OF_SITE
from ..model.effects.catalogue import CATALOGUE
from ..model.effects.friction import CoulombFriction, PositionDependentFriction, PositionDirectionFriction
from ..model.plant import Plant
from .candidates import SITE_OF_NUMBER, WRONG_VALUE, Candidate
from .criteria import CRITERIA
from .space import Name, Space, is_apart, make_space, proposals

_SHORT = 2
"""Horizons on which proposals are screened and first refitted: the shortest ones, on which models are nearly linear."""
_LINEAR = 4
"""Reweightings of a linear screen."""
_TRIAL, _POLISH = 3, 8
"""Iterations of a first refit, and of a fit to all windows."""
_SIMPLER = ("coulomb_friction", "direction_dependent_friction")


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


@dataclasses.dataclass
class Search:
    """What does not change during a search, and what happened in it."""

    problem: Problem
    model: Plant
    known: frozenset[str]
    tell: Callable[[str], None]
    deadline: float
    history: list[dict[str, object]] = dataclasses.field(default_factory=list)
    spaces: dict[tuple[Name, ...], Space] = dataclasses.field(default_factory=dict)


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
        held.append(min(better, key=lambda s: s.value))
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


def _proposed(problem: Problem, now: Structure, deadline: float) -> list[Move]:
    """Moves worth a fit to all windows."""
    part = problem.of_horizons(problem.data.horizons[:_SHORT])
    states = problem.states_of(now.point.states, part.data.horizons)
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
    starts = [Start(m.vector, m.free, states) for m in moves]
    absent = [dataclasses.replace(m, vector=_at_seed(now, c)) for m, (_, c, _) in zip(moves, chosen, strict=True)]
    starts += [Start(m.vector, m.free, states) for m in absent]
    fits = part.solve(now.space.engine, starts, _TRIAL)
    best = []
    for i, move in enumerate(moves):
        point = min(fits[i], fits[i + len(moves)], key=lambda p: p.value)
        best.append((point.value + move.price, dataclasses.replace(move, vector=point.vector)))
    best.sort(key=lambda found: found[0])
    out = [move for _, move in best[: CRITERIA.polished]]
    out += _removals(now) + _simplifications(problem, now)
    return out, (lambda: _apart(problem, part, now, states, every, number, best, deadline))


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
    return Move("add", now.space, (*now.names, candidate.name), keys, vector, free, price)


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
        vector, free = now.point.vector, [*now.point.free]
        for candidate in group:
            vector = candidate.set(table, vector)
            if candidate.harmonic:
                # A small amplitude, so that the phase shows.
                place = table.positions(candidate.group("amplitude"))
                vector[place] = 1e-6
            free += [p for p in _places(now, candidate) if p not in free]
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


def _as_wave(table, candidate: Candidate, at: NDArray[np.float64], vector: NDArray[np.float64]) -> None:
    """Amplitude and phase from steps of a sine and a cosine."""
    a, p = (table.positions(candidate.group(key))[0] for key in ("amplitude", "phase"))
    sine, cosine = vector[a], at[a] * (vector[p] - at[p])
    vector[a], vector[p] = math.hypot(sine, cosine), at[p] + math.atan2(cosine, sine)


def _thinned(problem: Problem, now: Structure, states: tuple, shared: Sequence[Candidate]) -> list[Candidate]:
    """Of effects with many places to start, those few at which a plain regression explains most of what is left."""
    many: dict[Name, list[Candidate]] = {}
    for candidate in shared:
        many.setdefault(candidate.name, []).append(candidate)
    left = None
    out = []
    for own in many.values():
        if len(own) <= _FEW:
            out += own
            continue
        if left is None:
            left = problem.residuals(now.space.engine, Start(now.point.vector, now.point.free, states))
        scores = [_regressed(problem, now, left, candidate) for candidate in own]
        order = np.argsort(scores)[::-1]
        out += [own[int(i)] for i in order[:_BEST]]
    return out


_FEW, _BEST = 12, 3
"""Starts up to which all are screened, and how many are beyond."""


def _regressed(problem: Problem, now: Structure, left: Sequence[NDArray[np.float64]], candidate: Candidate) -> float:
    """Share of the longest screened windows' residual that an effect's shape explains beside a parabola."""
    data = problem.data
    k = ("x", "psi", "l").index(AXIS_OF_SITE[candidate.site])
    horizon = data.horizons[-1]
    total = explained = 0.0
    bridge = now.plant.bridge
    fade = float(bridge.cart_damping / bridge.cart_mass)
    for tiling, residual in zip(data.tilings, left, strict=True):
        if tiling.horizon != horizon:
            continue
        grid = data.grids[tiling.recording]
        for begin, stop in zip(tiling.begins, tiling.stops, strict=True):
            rows = np.flatnonzero(data.measured[tiling.recording, begin:stop, k]) + begin
            if len(rows) < 8:
                continue
            t, y = grid.times[rows], data.y[tiling.recording, rows, k]
            if "time" in candidate.values:
                shapes = [(t >= float(candidate.values["time"])).astype(float)]
            else:
                angle = 2 * np.pi * y / float(candidate.values["period"])
                shapes = [np.sin(angle), np.cos(angle)]
                if not candidate.site.endswith("sensor"):
                    shapes = [_response(t, shape, fade) for shape in shapes]
            basis = np.stack([np.ones_like(t), t - t[0], (t - t[0]) ** 2], axis=1)
            q, _ = np.linalg.qr(basis)
            r = residual[rows, k] - q @ (q.T @ residual[rows, k])
            s = np.stack(shapes, axis=1)
            s = s - q @ (q.T @ s)
            weight = 1.0 / max(float(r @ r), 1e-12)
            norm = np.linalg.norm(s, axis=0)
            if not (norm > 1e-9).any():
                continue
            fit = np.linalg.lstsq(s, r, rcond=1e-8)[0]
            explained += weight * float(r @ r - (r - s @ fit) @ (r - s @ fit))
            total += 1.0
    return explained / max(total, 1.0)


def _response(t: NDArray[np.float64], force: NDArray[np.float64], fade: float) -> NDArray[np.float64]:
    """Way of a mass with viscous damping under a force, from rest, in any unit."""
    dt = np.diff(t, prepend=t[0])
    grow = np.exp(fade * (t - t[0]))
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


def _removals(now: Structure) -> list[Move]:
    """Each added effect left out."""
    out = []
    for name in now.names:
        if is_apart(name[0]):
            continue
        gone = _free_of(now, name)
        vector = now.point.vector.copy()
        table = now.space.table
        for key in now.keys[name]:
            group = name[1] if name[0] == WRONG_VALUE else f"{name[0]}@{name[1]}.{key}"
            places = table.positions(group)
            vector[places] = now.space.absent[places]
        free = np.array([p for p in now.point.free if p not in gone], np.int64)
        names = tuple(n for n in now.names if n != name)
        keys = {n: k for n, k in now.keys.items() if n != name}
        share = len(gone) / max(len(now.point.free) - len(now.space.base), 1)
        out.append(Move("leave out", now.space, names, keys, vector, free, now.price * (1.0 - share)))
    return out


def _free_of(now: Structure, name: Name) -> list[int]:
    table = now.space.table
    groups = [name[1]] if name[0] == WRONG_VALUE else [f"{name[0]}@{name[1]}.{key}" for key in now.keys[name]]
    return [p for group in groups for p in table.positions(group)]


def _simplifications(problem: Problem, now: Structure) -> list[Move]:
    """Each map replaced by a law of one or two levels, in the space without the map."""
    out = []
    for name in now.names:
        cls = CATALOGUE.get(name[0])
        if cls not in (PositionDependentFriction, PositionDirectionFriction):
            continue
        level = float(np.mean(now.point.vector[_free_of(now, name)]))
        for kind in _SIMPLER:
            if (kind, name[1]) in now.names or any((e.kind, e.site) == (kind, name[1]) for e in now.space.own.effects):
                continue
            own = Plant(now.space.own.bridge, tuple(e for e in now.space.own.effects if (e.kind, e.site) != name))
            space = make_space(problem, own, now.space.known)
            if (kind, name[1]) not in {(e.kind, e.site) for e in space.plant.effects}:
                continue
            vector = space.with_values(_without(now, name))
            keys = CATALOGUE[kind].seeds(name[1], _bare_scene(problem, own))[0].free
            for key in keys:
                vector[space.table.positions(f"{kind}@{name[1]}.{key}")] = level
            names = (*(n for n in now.names if n != name), (kind, name[1]))
            kept = {n: k for n, k in now.keys.items() if n != name} | {(kind, name[1]): keys}
            free = _all_free(space, names, kept)
            price = _price(problem, len(free) - len(space.base), 10, 1)
            out.append(Move("simplify", space, names, kept, vector, free, price))
    return out


def _bare_scene(problem: Problem, own: Plant):
    from ..identification.problem import scene_of

    bare = Plant(own.bridge, tuple(e for e in own.effects if not isinstance(e, CoulombFriction)))
    return scene_of(problem.setting, bare)


def _without(now: Structure, name: Name) -> Plant:
    plant = now.plant
    return Plant(plant.bridge, tuple(e for e in plant.effects if (e.kind, e.site) != name))


def _all_free(space: Space, names: Sequence[Name], keys: dict[Name, tuple[str, ...]]) -> NDArray[np.int64]:
    free = [*space.base]
    for name in names:
        groups = [name[1]] if name[0] == WRONG_VALUE else [f"{name[0]}@{name[1]}.{key}" for key in keys[name]]
        free += [p for group in groups for p in space.table.positions(group) if p not in free]
    return np.array(free, np.int64)


def _apart(
    problem: Problem,
    part: Problem,
    now: Structure,
    states: tuple,
    every: Sequence[Candidate],
    number: int,
    best: Sequence[tuple[float, Move]],
    deadline: float,
) -> list[Move]:
    """Effects with a program of their own: refitted beside the model alone, the best fitted on."""
    out = []
    plant = now.plant
    known = now.known
    by_name: dict[Name, list[Candidate]] = {}
    for candidate in every:
        if is_apart(candidate.kind):
            by_name.setdefault(candidate.name, []).append(candidate)
    for name, seeds in by_name.items():
        if time.monotonic() > deadline:
            break
        own = plant.adding(_effect(plant, seeds[0]))
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


def _effect(plant: Plant, candidate: Candidate):
    from ..model.effects.catalogue import make_effect

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
    from ..model.effects.base import parameters_of

    return [key for key, info in parameters_of(CATALOGUE[kind]).items() if info.fitted]


def _all_fitted(problem: Problem, moves: Sequence[Move], now: Structure, deadline: float) -> list[Structure]:
    """Moves fitted to all windows, those of one space side by side."""
    out = []
    for space in {id(m.space): m.space for m in moves}.values():
        if time.monotonic() > deadline:
            break
        own = [m for m in moves if m.space is space]
        starts = [Start(m.vector, m.free, now.point.states) for m in own]
        for move, point in zip(own, problem.solve(space.engine, starts, _POLISH), strict=True):
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


_SITES = SITE_OF_NUMBER
