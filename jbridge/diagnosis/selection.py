"""The search for a structure: proposals are cheap and linear, judgement is by simulation and one criterion.

A model is a set of effects beside what was given. In each round every effect that it lacks is weighed by a linear
screen (the criterion on the quadratic model of every window), the best are refitted together on short windows, the
best of these are fitted to all windows, and the move that lowers the criterion most is made: an effect is added, left
out, replaced by a simpler law, or a known number is set free. It ends when no move lowers the criterion, or when less
is left of every channel than one number costs.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identification.data.windows import WHOLE
from ..identification.estimation import Problem
from ..identification.solver import Normal, Point, Start, bounded_step, moved_states, ties
from ..model.effects.base import AXIS_OF_SITE, AbstractEffect
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
_SHORT = 1.0
"""Horizon [s] on which proposals are screened and first refitted: long enough to show forces, and nearly linear."""
_LINEAR = 4
"""Reweightings of a linear screen."""
_TRIAL, _POLISH, _LAST = 2, 3, 12
"""Iterations of a first refit, of a fit to all windows, and of the chosen one's."""
_SIMPLER = {"coulomb_friction": ("level",), "direction_dependent_friction": ("positive", "negative")}
"""Laws that stand in a map's place, and what is free of them."""
_AT_ONCE = 2
"""Programs that are compiled side by side."""


@dataclasses.dataclass(frozen=True, eq=False)
class Structure:
    """One fitted model of a search."""

    space: Space
    """With a program of its own."""
    names: tuple[Name, ...]
    """What was added, in the order in which it was."""
    keys: dict[Name, tuple[str, ...]]
    """Keys that are free of each."""
    choices: dict[Name, float]
    """Logarithm of the number of alternatives among which each was chosen."""
    point: Point
    blocks: NDArray[np.float64]
    """The criterion by block, each left out in turn."""
    price: float
    """What its numbers and the choices behind it must gain."""

    @property
    def value(self) -> float:
        """The criterion with its price."""
        return self.point.value + self.price

    @property
    def plant(self) -> Plant:
        return self.space.table.unravel(self.point.vector)

    @property
    def known(self) -> frozenset[str]:
        return self.space.known

    @property
    def free(self) -> list[str]:
        """Names of the estimated numbers, entries of lists one by one."""
        return [self.space.table.entry(int(p)).name for p in self.point.free]

    def places(self, name: Name) -> list[int]:
        """Where the free parameters of an added effect stand."""
        groups = [name[1]] if name[0] == WRONG_VALUE else [f"{name[0]}@{name[1]}.{key}" for key in self.keys[name]]
        return [p for group in groups for p in self.space.table.positions(group)]


@dataclasses.dataclass(frozen=True)
class Move:
    """A change of a structure, ready to be refitted."""

    space: Space
    names: tuple[Name, ...]
    keys: dict[Name, tuple[str, ...]]
    choices: dict[Name, float]
    start: Start
    absent: NDArray[np.float64] | None = None
    """The parameters at which what is added is absent."""


@dataclasses.dataclass(frozen=True)
class AmongAll:
    """A fitted model beside all effects that share a program, absent."""

    space: Space
    point: Point


@dataclasses.dataclass(frozen=True)
class Search:
    """What a search held, one model after the other, and what it tried beside each."""

    problem: Problem
    held: tuple[Structure, ...]
    tried: tuple[tuple[Structure, ...], ...]
    """Models fitted to all windows in the round that began at each of `held`."""
    stopped: str
    """`criterion`, `budget` or `interrupted`."""


def select(problem: Problem, base: Structure, tell: Callable[[str], None], deadline: float) -> Search:
    """Searches from a base until no move lowers the criterion, or time is over.

    Args:
        problem: recordings and criterion.
        base: the fitted model as given, see `base_structure`.
        tell: takes a line on what is being done.
        deadline: of `time.monotonic` [s].
    """
    held: list[Structure] = [base]
    tried: list[tuple[Structure, ...]] = []
    seen = {frozenset(base.names)}
    stopped = "criterion"
    for number in range(CRITERIA.rounds):
        now = held[-1]
        problem = problem.judged_by(problem.residuals(now.space.engine, now.point))
        # What a larger model gains must not be what more iterations gain.
        [point] = problem.solve(now.space.engine, [now.point.start], _LAST)
        now = held[-1] = weighed(problem, dataclasses.replace(now, point=point))
        added = ", ".join(f"{kind} ({site})" for kind, site in now.names) or "the model as given"
        tell(f"round {number + 1}: looking beyond {added}")
        if _leaves_nothing(problem, now):
            break
        try:
            found = _round(problem, base, now, not number, seen, deadline)
        except KeyboardInterrupt:
            stopped = "interrupted"
            break
        better = [s for s in found if _accepts(now, s)]
        tried.append(tuple(sorted(found, key=lambda s: s.value)))
        if time.monotonic() > deadline:
            stopped = "budget"
        if better:
            best = min(better, key=lambda s: s.value)
            held.append(best)
            seen.add(frozenset(best.names))
        if not better or stopped == "budget":
            break
    if stopped != "interrupted":
        [point] = problem.solve(held[-1].space.engine, [held[-1].point.start], _LAST)
        held[-1] = weighed(problem, dataclasses.replace(held[-1], point=point))
    return Search(problem, tuple(held), tuple(tried), stopped)


def base_structure(problem: Problem, space: Space, point: Point) -> Structure:
    """A structure with nothing added, from its fitted point."""
    return weighed(problem, Structure(space, (), {}, {}, point, np.zeros(0), 0.0))


def weighed(problem: Problem, structure: Structure) -> Structure:
    """A structure with its price, and its criterion by block."""
    space, point = structure.space, structure.point
    [normal] = problem.normal(space.engine, [point])
    numbers = _numbers(problem, structure, normal)
    price = 0.5 * numbers * math.log(max(problem.likelihood.total, 2.0)) + sum(structure.choices.values())
    return dataclasses.replace(structure, price=price, blocks=left_out(problem, space, point, normal))


def _numbers(problem: Problem, structure: Structure, normal: Normal) -> float:
    """Added numbers; those of a map by its effective degrees of freedom: no place counts that is not visited."""
    free, n = structure.point.free, len(structure.point.free)
    added = [int(np.flatnonzero(free == p)[0]) for name in structure.names for p in structure.places(name)]
    total = np.einsum("wc,wcij->ij", problem.likelihood.weights(structure.point.square), normal.products)[:n, :n]
    tied = ties(structure.space.table, free, np.diag(total))
    levels = {int(i) for members in structure.space.table.vectors(free) for i in members}
    unit = np.sqrt(np.maximum(np.diag(total + tied), 1e-150))
    scaled = (total + tied) / np.outer(unit, unit) + 1e-12 * np.eye(n)
    share = np.diag(np.linalg.solve(scaled, total / np.outer(unit, unit)))
    return float(sum(np.clip(share[i], 0.0, 1.0) if i in levels else 1.0 for i in added))


def _accepts(now: Structure, then: Structure) -> bool:
    if not then.value < now.value:
        return False
    gain = now.blocks - then.blocks
    error = float(np.std(gain, ddof=1) * math.sqrt(len(gain))) if len(gain) > 1 else 0.0
    steady = len(then.names) < len(now.names) or float(gain.sum()) > -CRITERIA.veto * error
    return steady


# ------------------------------------------------------------------ a round


def _round(
    problem: Problem, base: Structure, now: Structure, first: bool, seen: set[frozenset[Name]], deadline: float
) -> list[Structure]:
    """All moves that were worth a fit to all windows, fitted."""
    short = min(problem.data.horizons, key=lambda h: abs(math.log(min(h, 1e3) / _SHORT)))
    # Short windows show forces, whole recordings what adds up.
    part = problem.of_horizons([short, WHOLE]).of_some(_SOME)
    begun = Start(now.point.vector, now.point.free, problem.states_of(now.point.states, part))
    # Shapes of effects show beside what is best on the same windows.
    [there] = part.solve(now.space.engine, [begun], _POLISH)
    among = seen_among_all(problem, part, dataclasses.replace(now, point=there))
    every = [c for c in proposals(problem.setting, now.plant, now.known) if c.name not in now.names]
    names = {c.name for c in every}
    choice = {
        name: math.log(len(names)) + math.log(sum(c.name == name for c in every if not is_apart(c.kind)) or 1)
        for name in names
    }
    moves = _added(problem, part, now, among, [c for c in every if not is_apart(c.kind)], choice)
    moves += [*_removals(problem, base, now, among), *_simplifications(problem, base, now)]
    found = _all_fitted(problem, [m for m in moves if frozenset(m.names) not in seen], now, deadline)
    good = sorted((s for s in found if _accepts(now, s)), key=lambda s: s.value)
    if good:
        [point] = problem.solve(good[0].space.engine, [good[0].point.start], _LAST)
        found[found.index(good[0])] = good[0] = dataclasses.replace(good[0], point=point)
    # Mechanisms take a program each: they are looked at where a search begins and where it would end, unless what is
    # simpler leaves nothing.
    if not good or (first and not _leaves_nothing(problem, good[0])):
        apart = [c for c in every if is_apart(c.kind)]
        moves = _apart(problem, part.of_some(1), now, apart, choice, deadline)
        found += _all_fitted(problem, [m for m in moves if frozenset(m.names) not in seen], now, deadline)
    return found


def _leaves_nothing(problem: Problem, structure: Structure) -> bool:
    """Whether less is left of every channel than one number costs."""
    engine = structure.space.engine
    problem = problem.judged_by(problem.residuals(engine, structure.point))
    [point] = problem.solve(engine, [structure.point.start], _POLISH)
    left = problem.likelihood.by_window(point.square).sum(axis=0)
    return bool(left.max() < 0.5 * math.log(max(problem.likelihood.total, 2.0)))


def _all_fitted(problem: Problem, moves: Sequence[Move], now: Structure, deadline: float) -> list[Structure]:
    """Moves fitted to all windows."""

    def fitted(move: Move) -> Structure | None:
        if time.monotonic() > deadline:
            return None
        [point] = problem.solve(move.space.engine, [move.start], _POLISH)
        if point.value > now.point.value and move.absent is not None:
            # What fits short windows may run away in long ones: then the effect grows from its absence, where the
            # model is as good as the one that it contains.
            begun = Start(move.absent, move.start.free, now.point.states)
            point = min(point, *problem.solve(move.space.engine, [begun], _POLISH), key=lambda p: p.value)
        structure = Structure(move.space, move.names, move.keys, move.choices, point, np.zeros(0), math.inf)
        # One that gains nothing needs no price.
        return weighed(problem, structure) if point.value < now.value else structure

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return [structure for structure in pool.map(fitted, moves) if structure is not None]


# ------------------------------------------------------------------ proposals


def _added(
    problem: Problem,
    part: Problem,
    now: Structure,
    among: AmongAll,
    shared: Sequence[Candidate],
    choice: dict[Name, float],
) -> list[Move]:
    """The effects that a linear screen puts first, refitted on the shorter windows; the best of them."""
    there, space = among.point, among.space
    best: dict[Name, tuple[float, Candidate, Start]] = {}
    for found in sorted(_screened(part, among, shared), key=lambda found: found[0]):
        best.setdefault(found[1].name, found)
    ranked = list(best.values())
    chosen = ranked[: CRITERIA.refitted]
    fits = part.solve(space.engine, [start for _, _, start in chosen], _TRIAL)
    # Where the screen's estimate leads astray, the effect starts from its absence.
    astray = [i for i, point in enumerate(fits) if not point.value < there.value]
    begun = [Start(chosen[i][1].set(space.table, there.vector), chosen[i][2].free, there.states) for i in astray]
    for i, point in zip(astray, part.solve(space.engine, begun, _TRIAL), strict=True):
        fits[i] = min(fits[i], point, key=lambda p: p.value)
    unit = 0.5 * math.log(max(problem.likelihood.total, 2.0))
    order = []
    for (_, candidate, _), point in zip(chosen, fits, strict=True):
        numbers = min(len(point.free) - len(there.free), 2 * len(candidate.free))
        order.append((point.value + unit * numbers + choice[candidate.name], candidate, point))
    order.sort(key=lambda found: found[0])
    return [_with(problem, part, now, among, c, p, choice[c.name]) for _, c, p in order[: CRITERIA.polished]]


def _with(
    problem: Problem, part: Problem, now: Structure, among: AmongAll, added: Candidate, point: Point, choice: float
) -> Move:
    """A model with an effect that was fitted to some windows beside all others."""
    names = (*now.names, added.name)
    plant = among.space.plant_of(point.vector, names)
    known = now.known - ({added.site} if added.kind == WRONG_VALUE else set())
    space = make_space(problem, plant, known, shared=False)
    # Where it is absent, all else stands as in the model without it.
    before = among.space.with_values(now.plant)
    absent = among.space.plant_of(added.set(among.space.table, before), names)
    free = [among.space.table.entry(int(p)).name for p in point.free]
    places = np.array([space.table.positions(name)[0] for name in free], np.int64)
    states = problem.states_with(now.point.states, part, point.states)
    return Move(
        space,
        names,
        {**now.keys, added.name: added.free},
        {**now.choices, added.name: choice},
        Start(space.with_values(plant), places, states),
        space.with_values(absent),
    )


def _screened(problem: Problem, among: AmongAll, shared: Sequence[Candidate]) -> list[tuple[float, Candidate, Start]]:
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
            free += [int(p) for p in _linear_places(among.space, candidate) if p not in free]
        starts.append(Start(vector, np.array(free, np.int64), there.states))
    points = problem.evaluate(among.space.engine, starts)
    normals = problem.normal(among.space.engine, points)
    out = []
    for group, point, normal in zip(groups, points, normals, strict=True):
        for candidate in group:
            wanted = np.array(list(dict.fromkeys([*there.free, *_linear_places(among.space, candidate)])), np.int64)
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


def _linear_places(space: Space, candidate: Candidate) -> NDArray[np.int64]:
    """Parameters that do something where a candidate starts."""
    return candidate.places(space.table, None if candidate.finite else candidate.linear)


def _as_wave(table: ParameterTable, candidate: Candidate, at: NDArray[np.float64], vector: NDArray[np.float64]) -> None:
    """Amplitude and phase from steps of a sine and a cosine."""
    a, p = (table.positions(candidate.group(key))[0] for key in ("amplitude", "phase"))
    sine, cosine = vector[a], at[a] * (vector[p] - at[p])
    vector[a], vector[p] = math.hypot(sine, cosine), at[p] + math.atan2(cosine, sine)


def _thinned(problem: Problem, among: AmongAll, shared: Sequence[Candidate]) -> list[Candidate]:
    """Of effects with many places to start, those few at which a plain regression explains most of what is left."""
    many: dict[Name, list[Candidate]] = {}
    for candidate in shared:
        many.setdefault(candidate.name, []).append(candidate)
    out = [c for own in many.values() if len(own) <= _MOST_STARTS for c in own]
    crowded = [own for own in many.values() if len(own) > _MOST_STARTS]
    if crowded:
        left = problem.residuals(among.space.engine, among.point)
        bridge = among.space.own.bridge
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


def _removals(problem: Problem, base: Structure, now: Structure, among: AmongAll) -> list[Move]:
    """The added effect left out that a linear look at the windows misses least, if it may pay."""
    beside = among.space.table
    absent = {name: among.space.absent[beside.positions(name)[0]] for name in beside.names()}
    absent |= {site: float(getattr(base.plant.bridge, site)) for kind, site in now.names if kind == WRONG_VALUE}
    # A mechanism has no place from which it is absent, so it is left out by a fit alone.
    linear = [name for name in now.names if not is_apart(name[0])]
    if len(linear) < 2:
        return [_without(problem, base, now, name) for name in now.names]
    [normal] = problem.normal(now.space.engine, [now.point])
    losses = {}
    for name in linear:
        gone = [i for i, p in enumerate(now.point.free) if int(p) in now.places(name)]
        columns = [i for i in range(len(now.point.free)) if i not in gone]
        away = np.zeros(len(now.point.free))
        away[gone] = [absent[now.free[i]] - now.point.vector[now.point.free[i]] for i in gone]
        _, losses[name] = linear_optimum(problem, now.space, now.point, normal, columns, away)
    return [_without(problem, base, now, min(losses, key=lambda n: losses[n]))]


def _without(
    problem: Problem, base: Structure, now: Structure, gone: Name, instead: AbstractEffect | None = None
) -> Move:
    """A model without one of its added effects, or with another one in its place."""
    names = tuple(n for n in now.names if n != gone)
    keys = {n: k for n, k in now.keys.items() if n != gone}
    choices = {n: c for n, c in now.choices.items() if n != gone}
    bridge, known = now.plant.bridge, now.known
    if gone[0] == WRONG_VALUE:
        bridge, known = dataclasses.replace(bridge, **{gone[1]: getattr(base.plant.bridge, gone[1])}), known | {gone[1]}
    given = len(base.plant.effects)
    effects = tuple(e for k, e in enumerate(now.plant.effects) if k < given or (e.kind, e.site) != gone)
    left = [now.space.table.entry(int(p)).name for p in now.point.free if int(p) not in now.places(gone)]
    if instead is not None:
        new = instead.kind, instead.site
        effects, names, choices = (*effects, instead), (*names, new), {**choices, new: now.choices[gone]}
        keys = {**keys, new: _SIMPLER[instead.kind]}
        left += [f"{instead.kind}@{instead.site}.{key}" for key in _SIMPLER[instead.kind]]
    plant = Plant(bridge, effects)
    space = make_space(problem, plant, known, shared=False)
    free = np.array([space.table.positions(entry)[0] for entry in left], np.int64)
    return Move(space, names, keys, choices, Start(space.with_values(plant), free, now.point.states))


def _simplifications(problem: Problem, base: Structure, now: Structure) -> list[Move]:
    """Each map of friction replaced by a law of one or two levels."""
    out = []
    present = {(e.kind, e.site) for e in now.plant.effects}
    for name in now.names:
        if CATALOGUE.get(name[0]) not in (PositionDependentFriction, PositionDirectionFriction):
            continue
        level = float(np.mean(now.point.vector[now.places(name)]))
        for kind, keys in _SIMPLER.items():
            if (kind, name[1]) not in present:
                simple = make_effect(kind, name[1], dict.fromkeys(keys, level))
                out.append(_without(problem, base, now, name, simple))
    return out


def _apart(
    problem: Problem,
    part: Problem,
    now: Structure,
    apart: Sequence[Candidate],
    choice: dict[Name, float],
    deadline: float,
) -> list[Move]:
    """The best effect with a program of its own, refitted on some of the shorter windows beside the model alone."""
    begun = Start(now.point.vector, now.point.free, problem.states_of(now.point.states, part))
    [there] = part.solve(now.space.engine, [begun], _TRIAL)
    by_name: dict[Name, list[Candidate]] = {}
    for candidate in apart:
        by_name.setdefault(candidate.name, []).append(candidate)
    plant, known = now.space.table.unravel(there.vector), now.known

    def tried(name: Name) -> tuple[float, Plant, Candidate, Point] | None:
        seeds = by_name[name]
        if time.monotonic() > deadline:
            return None
        own = plant.adding(_effect(seeds[0]))
        try:
            space = make_space(part, own, known, shared=False)
        except ValueError:
            return None
        starts = []
        for candidate in seeds:
            vector = candidate.set(space.table, space.absent)
            kept = [space.table.positions(name)[0] for name in now.free]
            free = np.array([*kept, *map(int, candidate.places(space.table))], np.int64)
            starts.append(Start(vector, free, there.states))
        which = int(np.argmin([p.value for p in part.evaluate(space.engine, starts)]))
        [fit] = part.solve(space.engine, [starts[which]], _TRIAL)
        return fit.value, own, seeds[which], fit

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        found = [t for t in pool.map(tried, by_name) if t is not None]
    if not found:
        return []
    _, own, candidate, point = min(found, key=lambda t: t[0])
    space = make_space(problem, own, known, shared=False)
    keys, choices = (
        {**now.keys, candidate.name: candidate.free},
        {**now.choices, candidate.name: choice[candidate.name]},
    )
    states = problem.states_with(now.point.states, part, point.states)
    return [Move(space, (*now.names, candidate.name), keys, choices, Start(point.vector, point.free, states))]


def _effect(candidate: Candidate) -> AbstractEffect:
    return make_effect(
        candidate.kind, candidate.site, {key: v for key, v in candidate.values.items() if key != "coulomb"}
    )


def seen_among_all(problem: Problem, part: Problem, now: Structure) -> AmongAll:
    """A model, fitted to a part of the windows, in the program that has all other effects beside it."""
    added = {n for n in now.names if n[0] != WRONG_VALUE and not is_apart(n[0])}
    given = len(now.plant.effects) - len([n for n in now.names if n[0] != WRONG_VALUE])
    own = tuple(e for k, e in enumerate(now.plant.effects) if k < given or (e.kind, e.site) not in added)
    space = make_space(problem, Plant(now.plant.bridge, own), now.known)
    places = np.array([space.table.positions(name)[0] for name in now.free], np.int64)
    [point] = part.evaluate(space.engine, [Start(space.with_values(now.plant), places, now.point.states)])
    return AmongAll(space, point)


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


def left_out(problem: Problem, space: Space, point: Point, normal: Normal) -> NDArray[np.float64]:
    """The criterion of each block at the parameters that the others ask for: one Gauss-Newton step, no refit."""
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
