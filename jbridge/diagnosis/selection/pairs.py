"""Two effects of one axis that gain together what neither gains alone.

Dry friction and air drag share the loss of energy to which one viscous damping was fitted: neither lowers the criterion
before the other is there, and a search that adds one effect at a time finds neither.
"""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from ...identification.estimation import Problem
from ...identification.solver import Start
from ..criteria import CRITERIA
from ..structures.candidates import Candidate
from ..structures.space import Name
from ..structures.structure import Structure
from .moves import Move, axis_of, with_effects
from .screening import AmongAll, linear_optimum, linear_places

_TRIAL = 3
"""Iterations of a first refit."""


def paired(
    problem: Problem,
    part: Problem,
    now: Structure,
    among: AmongAll,
    shared: Sequence[Candidate],
    choice: Mapping[Name, float],
) -> list[Move]:
    """The pairs that a linear screen puts first, refitted on some windows: those that gain more than their price.

    Args:
        problem: recordings and criterion.
        part: some of the windows.
        now: the model to which is added.
        among: that model, fitted to these windows, beside all effects that share a program.
        shared: effects that share it.
        choice: price of having chosen an effect among all.
    """
    there, space = among.point, among.space
    first: dict[Name, Candidate] = {}
    for candidate in shared:
        if not candidate.finite and not candidate.harmonic:
            first.setdefault(candidate.name, candidate)
    if len(first) < 2:
        return []
    places = {name: [int(p) for p in linear_places(space, c)] for name, c in first.items()}
    vector, given = there.vector, [int(p) for p in there.free]
    for candidate in first.values():
        vector = candidate.set(space.table, vector)
    free = list(dict.fromkeys([*given, *itertools.chain.from_iterable(places.values())]))
    [point] = part.evaluate(space.engine, [Start(vector, np.array(free, np.int64), there.states)])
    [normal] = part.normal(space.engine, [point])
    unit = problem.likelihood.price
    times = problem.recordings_for_each_of(part)
    column = {p: k for k, p in enumerate(free)}
    screened = []
    for pair in itertools.combinations(first, 2):
        if axis_of(problem.setting, pair[0]) != axis_of(problem.setting, pair[1]):
            continue
        own = list(dict.fromkeys([*given, *places[pair[0]], *places[pair[1]]]))
        step, value = linear_optimum(part, space, point, normal, [column[p] for p in own])
        price = unit * (len(own) - len(given)) + sum(choice[name] for name in pair)
        screened.append((times * (there.value - value) - price, price, pair, own, step))
    screened.sort(key=lambda found: -found[0])
    tried = [found for found in screened[: CRITERIA.refitted] if found[0] > 0.0]
    starts = []
    for _, _, pair, own, step in tried:
        start = there.vector
        for name in pair:
            start = first[name].set(space.table, start)
        start[own] = point.vector[own] + step
        wanted = dict.fromkeys([*given, *(int(p) for name in pair for p in first[name].places(space.table))])
        starts.append(Start(start, np.array(list(wanted), np.int64), there.states))
    if not starts:
        return []
    points = part.solve(space.engine, starts, _TRIAL)
    gains = [times * (there.value - p.value) - found[1] for p, found in zip(points, tried, strict=True)]
    best = sorted((k for k, gain in enumerate(gains) if gain > 0.0), key=lambda k: -gains[k])[: CRITERIA.polished]
    return [
        with_effects(problem, part, now, among, [first[name] for name in tried[k][2]], points[k], choice) for k in best
    ]
