"""Changes of a model: an effect is added, left out, or replaced by a simpler law."""

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...identification.estimation import Problem
from ...identification.setting import PART_OF
from ...identification.solver import Point, Start
from ...model.bridge import Bridge
from ...model.effects.base import AXIS_OF_SITE, AbstractEffect, parameters_of
from ...model.effects.catalogue import CATALOGUE, make_effect
from ...model.plant import Plant
from ..criteria import CRITERIA
from ..structures.candidates import SITE_OF_NUMBER, WRONG_VALUE, Candidate
from ..structures.space import Name, Space, is_apart, make_space, space_of
from ..structures.structure import Structure
from .screening import AmongAll, linear_optimum, screened

_TRIAL = 2
"""Iterations of a first refit, a linear one included."""
AT_ONCE = 2
"""Programs that are compiled side by side."""


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
    promise: float = 0.0
    """What it should gain beyond its price, by its fit to a part of the windows or by their quadratics."""

    @property
    def numbers(self) -> frozenset[str]:
        """What is estimated, by which models are told apart."""
        return frozenset(self.space.table.entry(int(p)).name for p in self.start.free)


def added(
    problem: Problem,
    part: Problem,
    now: Structure,
    among: AmongAll,
    shared: Sequence[Candidate],
    choice: dict[Name, float],
) -> tuple[list[Move], list[Move]]:
    """The effects that a linear screen puts first, refitted on some windows: those that may be the best, and the others
    that should gain as well.

    A refit begins with short windows alone, which are nearly linear; from there, or from the screen's estimate if that
    is better, it goes on with whole recordings, where small scales and drifts show.
    """
    there, space = among.point, among.space
    best: dict[Name, tuple[float, Candidate, Start]] = {}
    for found in sorted(screened(part, among, shared), key=lambda found: found[0]):
        best.setdefault(found[1].name, found)
    unit = 0.5 * math.log(max(problem.likelihood.total, 2.0))

    def price(candidate: Candidate, free: NDArray[np.int64]) -> float:
        return unit * min(len(free) - len(there.free), 2 * len(candidate.free)) + choice[candidate.name]

    # Of two that meet the recordings as well, the one with fewer numbers comes first.
    chosen = sorted(best.values(), key=lambda found: found[0] + price(found[1], found[2].free))[: CRITERIA.refitted]
    low = problem.shortest().of_some(len({t.recording for t in part.data.tilings}))
    states = low.states_with(problem.states_of(now.point.states, low), part, there.states)
    [short] = low.evaluate(space.engine, [Start(there.vector, there.free, states)])
    absent = [Start(candidate.set(space.table, there.vector), start.free, states) for _, candidate, start in chosen]
    # Tangents where all are absent are the same for all.
    linear = {c.name: s for _, c, s in screened(low, AmongAll(space, short), [c for _, c, _ in chosen])}
    begun = _better(low, space, absent, [linear[candidate.name] for _, candidate, _ in chosen])
    *fitted, without = low.solve(space.engine, [*begun, short.start], _TRIAL - 1)
    after = [Start(p.vector, p.free, part.states_with(there.states, low, p.states)) for p in fitted]
    points = part.solve(space.engine, _better(part, space, [start for _, _, start in chosen], after), _TRIAL)
    order = []
    for (_, candidate, _), point, short_point in zip(chosen, points, fitted, strict=True):
        gains, cost = (there.value - point.value, without.value - short_point.value), price(candidate, point.free)
        order.append(_Tried(candidate, point, (gains[0] - cost, gains[1] - cost)))
    order.sort(key=lambda tried: -tried.promise)
    # The best of each axis, since what acts on one of them is seldom told by another, and the best of all.
    first = {axis_of(tried.candidate.name): k for k, tried in reversed(list(enumerate(order)))}
    others = [k for k, tried in enumerate(order) if _may_win(order, tried)]
    kept = sorted(list(dict.fromkeys([*first.values(), *others]))[: CRITERIA.polished + len(first) - 1])
    later = [k for k, tried in enumerate(order) if k not in kept and tried.promise > 0.0]

    def ready(tried: _Tried) -> Move:
        candidate = tried.candidate
        move = with_effects(problem, part, now, among, [candidate], tried.point, choice)
        return dataclasses.replace(move, promise=tried.promise)

    return [ready(order[k]) for k in kept], [ready(order[k]) for k in later]


class _Tried(NamedTuple):
    """A proposal that was refitted."""

    candidate: Candidate
    point: Point
    gains: tuple[float, float]
    """Beyond its price, in some windows and in short ones alone: where short ones gain, long ones follow when they are
    fitted, too."""

    @property
    def promise(self) -> float:
        return max(self.gains)

    @property
    def axis(self) -> str:
        return axis_of(self.candidate.name)


def _may_win(every: Sequence[_Tried], tried: _Tried) -> bool:
    """Whether a proposal comes near the best one on its axis, in some windows or in short ones."""
    best = [max(t.gains[k] for t in every if t.axis == tried.axis) for k in range(2)]
    return any(gain > 0.0 and gain >= CRITERIA.worth * most for gain, most in zip(tried.gains, best, strict=True))


def _better(problem: Problem, space: Space, one: Sequence[Start], other: Sequence[Start]) -> list[Start]:
    """Of each two places to start the one that meets the recordings better."""
    pairs = zip(problem.evaluate(space.engine, one), problem.evaluate(space.engine, other), strict=True)
    return [min(pair, key=lambda point: point.value).start for pair in pairs]


def axis_of(name: Name) -> str:
    """The axis on which an effect acts."""
    kind, site = name
    return AXIS_OF_SITE[SITE_OF_NUMBER[site] if kind == WRONG_VALUE else site]


def together(problem: Problem, now: Structure, first: Structure, other: Structure) -> Move:
    """A model with what two models add to a third on different axes."""
    new = [name for name in other.names if name not in now.names]
    axis = axis_of(new[0])
    own = {key: getattr(other.plant.bridge, key) for key, place in PART_OF.items() if place == axis}
    effects = [e for e in other.plant.effects if (e.kind, e.site) in new]
    plant = Plant(dataclasses.replace(first.plant.bridge, **own), (*first.plant.effects, *effects))
    space = space_of(problem, plant, first.known & other.known, first.space)
    free = [space.table.positions(name)[0] for name in dict.fromkeys([*first.free, *other.free])]
    return Move(
        space,
        (*first.names, *new),
        {**first.keys, **other.keys},
        {**first.choices, **other.choices},
        Start(space.with_values(plant), np.array(free, np.int64), first.point.states),
    )


def with_effects(
    problem: Problem,
    part: Problem,
    now: Structure,
    among: AmongAll,
    added: Sequence[Candidate],
    point: Point,
    choice: Mapping[Name, float],
) -> Move:
    """A model with effects that were fitted to some windows beside all others."""
    new = [candidate.name for candidate in added]
    names = (*now.names, *new)
    known = now.known - {candidate.site for candidate in added if candidate.kind == WRONG_VALUE}
    # Where they are absent, all else stands as in the model without them.
    absent = among.space.with_values(now.plant)
    for candidate in added:
        absent = candidate.set(among.space.table, absent)
    states = problem.states_with(now.point.states, part, point.states)
    return Move(
        dataclasses.replace(among.space, known=known),
        names,
        {**now.keys, **{candidate.name: candidate.free for candidate in added}},
        {**now.choices, **{name: choice[name] for name in new}},
        Start(point.vector, point.free, states),
        absent,
    )


def removals(problem: Problem, base: Structure, now: Structure) -> list[Move]:
    """The added effect left out that a linear look at the windows misses least, if it may pay."""
    absent = {now.space.table.entry(int(p)).name: now.space.table.entry(int(p)).info.null for p in now.point.free}
    absent |= {site: float(getattr(base.plant.bridge, site)) for kind, site in now.names if kind == WRONG_VALUE}
    # A mechanism has no place from which it is absent, so it is left out by a fit alone.
    linear = [name for name in now.names if not is_apart(name[0])]
    if len(now.names) < 2:
        return []
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
    least = min(losses, key=lambda n: losses[n])
    held = {p: absent[now.space.table.entry(p).name] for p in now.places(least)}
    return [_without(problem, base, now, least)] if _may_pay(problem, now, held) else []


def _may_pay(problem: Problem, now: Structure, at: dict[int, float]) -> bool:
    """Whether a model with some numbers held loses no more in short windows than all its numbers cost."""
    low = problem.shortest()
    states = problem.states_of(now.point.states, low)
    vector = now.point.vector.copy()
    vector[list(at)] = list(at.values())
    free = np.array([p for p in now.point.free if int(p) not in at], np.int64)
    [before] = low.evaluate(now.space.engine, [Start(now.point.vector, now.point.free, states)])
    [after] = low.solve(now.space.engine, [Start(vector, free, states)], _TRIAL)
    return after.value - before.value < now.price


def _without(
    problem: Problem,
    base: Structure,
    now: Structure,
    gone: Name,
    instead: AbstractEffect | None = None,
    free_of: tuple[str, ...] = (),
) -> Move:
    """A model without one of its added effects, or with another one in its place and these keys of it free."""
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
        keys = {**keys, new: free_of}
        left += [f"{instead.kind}@{instead.site}.{key}" for key in free_of]
    plant = Plant(bridge, effects)
    space = space_of(problem, plant, known, now.space)
    free = np.array([place for entry in left for place in space.table.positions(entry)], np.int64)
    return Move(space, names, keys, choices, Start(space.with_values(plant), free, now.point.states))


def _levels(now: Structure, name: Name) -> dict[str, NDArray[np.float64]] | None:
    """Values of a law by place at its knots, by key; None where an effect is none."""
    if "knots" not in parameters_of(CATALOGUE.get(name[0], Bridge)):
        return None
    table = now.space.table
    return {key: now.point.vector[table.positions(f"{name[0]}@{name[1]}.{key}")] for key in now.keys[name]}


def _values(now: Structure, name: Name) -> dict[str, NDArray[np.float64] | float]:
    """All numbers of an added effect, by key."""
    table = now.space.table
    out = {}
    for key, info in parameters_of(CATALOGUE[name[0]]).items():
        values = now.point.vector[table.positions(f"{name[0]}@{name[1]}.{key}")]
        out[key] = values if info.vector else float(values[0])
    return out


def simplifications(problem: Problem, base: Structure, now: Structure) -> list[Move]:
    """Each added effect replaced by a simpler law that it contains, if it may pay."""
    out = []
    present = {(e.kind, e.site) for e in now.plant.effects}
    for name in now.names:
        for part in CATALOGUE[name[0]].contains if name[0] in CATALOGUE else ():
            if (part.kind, name[1]) in present:
                continue
            own = _values(now, name)
            law = part.simpler(own)
            held: dict[int, float] = {}
            for key, value in part.same(law, own).items():
                if key in now.keys[name]:
                    at = now.space.table.positions(f"{name[0]}@{name[1]}.{key}")
                    held |= dict(zip(at, np.broadcast_to(value, len(at)).tolist(), strict=True))
            if _may_pay(problem, now, held):
                out.append(_without(problem, base, now, name, make_effect(part.kind, name[1], law), tuple(law)))
    return out


def replacements(problem: Problem, base: Structure, now: Structure, runners_up: Mapping[Name, Structure]) -> list[Move]:
    """Each added effect but the last one replaced by what came next to it when it was added: beside what was found
    since, that may be the better one.

    Args:
        problem: recordings.
        base, now: the model as given, and the one to change.
        runners_up: the model with the next best effect in its place, by effect.
    """
    out = []
    for name in now.names[:-1]:
        other = runners_up.get(name)
        if other is None:
            continue
        new = other.names[-1]
        left = [e for e in now.plant.effects if (e.kind, e.site) != name]
        [effect] = [e for e in other.plant.effects if (e.kind, e.site) == new]
        if any((e.kind, e.site) == new for e in left):
            continue
        try:
            Plant(now.plant.bridge, (*left, effect)).check()
        except ValueError:
            continue
        out.append(_without(problem, base, now, name, effect, other.keys[new]))
    return out


def refinements(problem: Problem, base: Structure, now: Structure, others: Sequence[Move]) -> list[Move]:
    """Each law by place with one place more between each two, from the same law, if it may compete with others."""
    out = []
    unit = 0.5 * math.log(max(problem.likelihood.total, 2.0))
    for name in now.names:
        levels = _levels(now, name)
        if levels is None:
            continue
        table = now.space.table
        places = now.point.vector[[*table.positions(f"{name[0]}@{name[1]}.knots")]]
        finer = np.sort(np.concatenate([places, 0.5 * (places[1:] + places[:-1])]))
        values = {key: np.interp(finer, places, own).tolist() for key, own in levels.items()}
        refined = make_effect(*name, {"knots": finer.tolist(), **values})
        move = _without(problem, base, now, name, refined, now.keys[name])
        [point] = problem.evaluate(move.space.engine, [move.start])
        [normal] = problem.normal(move.space.engine, [point])
        _, value = linear_optimum(problem, move.space, point, normal, range(len(point.free)))
        promise = now.point.value - value - unit * (len(point.free) - len(now.point.free))
        rivals = [m.promise for m in others if axis_of(m.names[-1]) == axis_of(name)]
        if promise > CRITERIA.worth * max([0.0, *rivals]):
            out.append(dataclasses.replace(move, promise=promise))
    return out


def with_mechanisms(
    problem: Problem,
    part: Problem,
    now: Structure,
    apart: Sequence[Candidate],
    choice: dict[Name, float],
    best: Structure | None,
    deadline: float,
) -> list[Move]:
    """The best effect of each axis with a program of its own, refitted on some windows, if it may compete there.

    It takes the place of added effects that it contains.

    Args:
        problem: recordings.
        part: some of their windows.
        now: the model that an effect is added to.
        apart: effects with programs of their own.
        choice: logarithm of the number of alternatives, by effect.
        best: the best model with one effect more so far, if there is one.
        deadline: of `time.monotonic` [s].
    """
    low = problem.shortest().of_some(len({t.recording for t in part.data.tilings}))
    by_name: dict[Name, list[Candidate]] = {}
    for candidate in apart:
        by_name.setdefault(candidate.name, []).append(candidate)

    def climbed(space: Space, starts: Sequence[Start]) -> tuple[Point, Point]:
        """All starts fitted to short windows, and the best from there to the part's.

        A stiff spring leaves less than a soft one before either is fitted, and moves slowly to where the soft one is
        at once.
        """
        short = [Start(s.vector, s.free, problem.states_of(s.states, low)) for s in starts]
        fitted = low.solve(space.engine, short, _TRIAL + 1)
        which = int(np.argmin([p.value for p in fitted]))
        first = fitted[which]
        begun = Start(starts[which].vector, starts[which].free, problem.states_of(starts[which].states, part))
        after = Start(first.vector, first.free, part.states_with(begun.states, low, first.states))
        [fit] = part.solve(space.engine, _better(part, space, [begun], [after]), _TRIAL)
        return first, fit

    without = climbed(now.space, [now.point.start])
    plant, known = now.space.plant_of(without[1].vector, now.names), now.known

    def gone(name: Name) -> list[Name]:
        """Added effects that this one contains."""
        parts = {part.kind for part in CATALOGUE[name[0]].contains}
        return [each for each in now.names if each[0] in parts and each[1] == name[1]]

    def gains(points: tuple[Point, Point]) -> tuple[float, float]:
        return without[0].value - points[0].value, without[1].value - points[1].value

    def tried(name: Name) -> tuple[float, Plant, Candidate, tuple[Point, Point]] | None:
        seeds, less = by_name[name], gone(name)
        if time.monotonic() > deadline:
            return None
        left = tuple(e for e in plant.effects if (e.kind, e.site) not in less)
        own = Plant(plant.bridge, (*left, _effect(seeds[0])))
        try:
            own.check()
            space = _looked_at(make_space(part, own, known, shared=False))
        except ValueError:
            return None
        lost = {now.space.table.entry(p).name for each in less for p in now.places(each)}
        starts = []
        for candidate in (*seeds, *(_taking_place(now, seed, each) for seed in seeds for each in less)):
            vector = candidate.set(space.table, space.absent)
            kept = [space.table.positions(entry)[0] for entry in now.free if entry not in lost]
            free = np.array([*kept, *map(int, candidate.places(space.table))], np.int64)
            starts.append(Start(vector, free, now.point.states))
        points = climbed(space, starts)
        return max(gains(points)), own, seeds[0], points

    with ThreadPoolExecutor(AT_ONCE) as pool:
        found = [t for t in pool.map(tried, by_name) if t is not None]
    if not found:
        return []
    least = (0.0, 0.0)
    if best is not None:
        one, other = gains(climbed(best.space, [best.point.start]))
        least = (CRITERIA.worth * one, CRITERIA.worth * other)
    moves = []
    for axis in AXES:
        on_axis = [t for t in found if axis_of(t[2].name) == axis]
        if not on_axis:
            continue
        _, own, candidate, points = max(on_axis, key=lambda t: t[0])
        gained = gains(points)
        if best is not None and gained[0] < least[0] and gained[1] < least[1]:
            continue
        space = make_space(problem, own, known, shared=False)
        names = [name for name in now.names if name not in gone(candidate.name)]
        keys = {**{name: now.keys[name] for name in names}, candidate.name: candidate.free}
        choices = {**{name: now.choices[name] for name in names}, candidate.name: choice[candidate.name]}
        # Long windows may have led astray what fits short ones.
        point, windows = (points[1], part) if gained[1] > 0.0 else (points[0], low)
        states = problem.states_with(now.point.states, windows, point.states)
        start = Start(point.vector, point.free, states)
        moves.append(Move(space, (*names, candidate.name), keys, choices, start))
    return moves


def _looked_at(space: Space) -> Space:
    """A space of its own program without one for tangents."""
    return dataclasses.replace(space, engine=space.engine.by_differences())


def _taking_place(now: Structure, seed: Candidate, gone: Name) -> Candidate:
    """A seed of a law that contains an added one, with that one's numbers; what the added one lacks is the seed's."""
    [part] = [part for part in CATALOGUE[seed.kind].contains if part.kind == gone[0]]
    infos = parameters_of(CATALOGUE[seed.kind])
    same = part.same(_values(now, gone), seed.values)
    same = {key: value for key, value in same.items() if np.any(value != infos[key].null)}
    return dataclasses.replace(seed, values={**seed.values, **same})


def _effect(candidate: Candidate) -> AbstractEffect:
    return make_effect(
        candidate.kind, candidate.site, {key: v for key, v in candidate.values.items() if key != "coulomb"}
    )
