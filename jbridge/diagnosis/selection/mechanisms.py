"""Mechanisms and hidden springs, each with a program of its own."""

import dataclasses
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..._types import AXES
from ...identification.estimation import Problem
from ...identification.solver import Point, Start
from ...model.effects.base import AbstractEffect
from ...model.effects.catalogue import CATALOGUE, make_effect
from ...model.fields import parameters_of
from ...model.plant import Plant
from ..criteria import CRITERIA
from ..structures.candidates import Candidate
from ..structures.space import Name, Space, make_space
from ..structures.structure import Structure
from .moves import AT_ONCE, TRIAL, Move, axis_of, better_of, values_of


def with_mechanisms(
    problem: Problem,
    part: Problem,
    now: Structure,
    apart: Sequence[Candidate],
    choice: dict[Name, float],
    best: Structure | None,
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
    """
    low = problem.shortest().of_recordings(part.recordings)
    by_name: dict[Name, list[Candidate]] = {}
    for candidate in apart:
        by_name.setdefault(candidate.name, []).append(candidate)

    def climbed(space: Space, starts: Sequence[Start]) -> tuple[Point, Point]:
        """All starts fitted to short windows for some iterations, the most promising one to its end, and from there to
        the part's.

        A stiff spring leaves less than a soft one before either is fitted, and moves slowly to where the soft one is
        at once.
        """
        short = [Start(s.vector, s.free, problem.states_of(s.states, low)) for s in starts]
        fitted = low.solve(space.engine, short, TRIAL + 1)
        which = int(np.argmin([p.value - p.promise for p in fitted]))
        [first] = low.solve(space.engine, [fitted[which].start])
        begun = Start(starts[which].vector, starts[which].free, problem.states_of(starts[which].states, part))
        after = Start(first.vector, first.free, part.states_with(begun.states, low, first.states))
        [fit] = part.solve(space.engine, better_of(part, space, [begun], [after]), TRIAL)
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
        if problem.is_late:
            return None
        left = tuple(e for e in plant.effects if (e.kind, e.site) not in less)
        own = Plant(plant.bridge, (*left, _effect(seeds[0])))
        try:
            own.check()
            space = _by_differences(make_space(part, own, known, shared=False))
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
    least = (-math.inf, -math.inf)
    if best is not None:
        one, other = gains(climbed(best.space, [best.point.start]))
        least = (CRITERIA.worth * one, CRITERIA.worth * other)
    times = problem.recordings_for_each_of(part)
    unit = problem.likelihood.price
    moves = []
    for axis in AXES:
        on_axis = [t for t in found if axis_of(problem.setting, t[2].name) == axis]
        if not on_axis:
            continue
        _, own, candidate, points = max(on_axis, key=lambda t: t[0])
        gained = gains(points)
        cost = unit * (len(points[0].free) - len(now.point.free))
        if (gained[0] < least[0] and gained[1] < least[1]) or times * max(gained) < cost:
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


def _by_differences(space: Space) -> Space:
    """The same space with differences of predictions in the place of tangents, which would take a program more."""
    return dataclasses.replace(space, engine=space.engine.by_differences())


def _taking_place(now: Structure, seed: Candidate, gone: Name) -> Candidate:
    """A seed of a law that contains an added one, with that one's numbers; what the added one lacks is the seed's."""
    [part] = [part for part in CATALOGUE[seed.kind].contains if part.kind == gone[0]]
    infos = parameters_of(CATALOGUE[seed.kind])
    same = part.same(values_of(now, gone), seed.values)
    same = {key: value for key, value in same.items() if np.any(value != infos[key].null)}
    return dataclasses.replace(seed, values={**seed.values, **same})


def _effect(candidate: Candidate) -> AbstractEffect:
    return make_effect(
        candidate.kind, candidate.site, {key: v for key, v in candidate.values.items() if key != "coulomb"}
    )
