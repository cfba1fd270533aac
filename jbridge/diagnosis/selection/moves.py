"""Changes of a model: effects are added to others, left out, or replaced by a simpler law."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...identification.estimation import Problem
from ...identification.setting import PART_OF, Setting
from ...identification.solver import Point, Start
from ...model.bridge import Bridge
from ...model.effects.base import AbstractEffect, Contained
from ...model.effects.catalogue import CATALOGUE, make_effect
from ...model.fields import parameters_of
from ...model.plant import Plant
from ..criteria import CRITERIA
from ..structures.candidates import SITE_OF_NUMBER, WRONG_VALUE, Candidate
from ..structures.space import Name, Space, is_apart, space_of
from ..structures.structure import Structure
from .screening import AmongAll, linear_optimum

TRIAL = 2
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


def better_of(problem: Problem, space: Space, one: Sequence[Start], other: Sequence[Start]) -> list[Start]:
    """Of each two places to start the one that meets the recordings better."""
    pairs = zip(problem.evaluate(space.engine, one), problem.evaluate(space.engine, other), strict=True)
    return [min(pair, key=lambda point: point.value).start for pair in pairs]


def axis_of(setting: Setting, name: Name) -> str:
    """The axis on which an effect acts."""
    kind, site = name
    return setting.axis_of(SITE_OF_NUMBER[site] if kind == WRONG_VALUE else site)


def together(problem: Problem, now: Structure, first: Structure, other: Structure) -> Move:
    """A model with what two models add to a third on different axes."""
    new = [name for name in other.names if name not in now.names]
    axis = axis_of(problem.setting, new[0])
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
    [after] = low.solve(now.space.engine, [Start(vector, free, states)], TRIAL)
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


def values_of(now: Structure, name: Name) -> dict[str, NDArray[np.float64] | float]:
    """All numbers of an added effect, by key."""
    table = now.space.table
    out = {}
    for key, info in parameters_of(CATALOGUE[name[0]]).items():
        values = now.point.vector[table.positions(f"{name[0]}@{name[1]}.{key}")]
        out[key] = values if info.vector else float(values[0])
    return out


def contained(kind: str) -> Sequence[Contained]:
    """The simpler laws that a kind of effect contains; a wrong value contains none."""
    return CATALOGUE[kind].contains if kind in CATALOGUE else ()


def simplifications(problem: Problem, base: Structure, now: Structure) -> list[Move]:
    """Each added effect replaced by a simpler law that it contains, if it may pay."""
    out = []
    present = {(e.kind, e.site) for e in now.plant.effects}
    for name in now.names:
        for part in contained(name[0]):
            if (part.kind, name[1]) in present:
                continue
            own = values_of(now, name)
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
    """Each added effect replaced by what came next to it when it was added: beside what was found since, and by the
    criterion of a model that leaves less, that may be the better one.

    Args:
        problem: recordings.
        base, now: the model as given, and the one to change.
        runners_up: the model with the next best effect in its place, by effect.
    """
    out = []
    for name in now.names:
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
    unit = problem.likelihood.price
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
        axis = axis_of(problem.setting, name)
        rivals = [m.promise for m in others if axis_of(problem.setting, m.names[-1]) == axis]
        if promise > CRITERIA.worth * max([0.0, *rivals]):
            out.append(dataclasses.replace(move, promise=promise))
    return out
