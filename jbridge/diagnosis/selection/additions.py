"""Effects that a model lacks, added by what a linear screen promises and a fit to some windows keeps."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...identification.estimation import Problem
from ...identification.solver import Point, Start
from ...model.plant import Plant
from ..criteria import CRITERIA
from ..structures.candidates import Candidate
from ..structures.space import Name
from ..structures.structure import Structure, leaves_nothing
from .moves import TRIAL, Move, axis_of, better_of, contained, with_effects
from .screening import AmongAll, screened


def added(
    problem: Problem,
    part: Problem,
    now: Structure,
    among: AmongAll,
    shared: Sequence[Candidate],
    choice: dict[Name, float],
    given: Plant | None,
) -> tuple[list[Move], list[Move]]:
    """The effects that a linear screen puts first, refitted on some windows: those that may be the best, and the others
    that should gain as well.

    A refit begins with short windows alone, which are nearly linear; from there, or from the screen's estimate if that
    is better, it goes on with whole recordings, where small scales and drifts show.

    Args:
        problem: recordings and criterion.
        part: some of the windows.
        now: the model to which is added.
        among: that model, fitted to these windows, beside all effects that share a program.
        shared: effects that share it.
        choice: price of having chosen an effect among all.
        given: the plant with the numbers of the model file, from which effects are screened as well: fitted numbers
            make up for what is missing, as a larger dead zone does for a friction. None in later rounds.
    """
    if problem.is_late:
        return [], []
    there, space = among.point, among.space
    best: dict[Name, tuple[float, Candidate, Start]] = {}
    for found in sorted(screened(part, among, shared), key=lambda found: found[0]):
        best.setdefault(found[1].name, found)
    if problem.is_late:
        return [], []
    unit = problem.likelihood.price
    times = problem.recordings_for_each_of(part)

    def of_numbers(candidate: Candidate, free: NDArray[np.int64]) -> float:
        return unit * min(len(free) - len(there.free), 2 * len(candidate.free))

    def price(candidate: Candidate, free: NDArray[np.int64]) -> float:
        return of_numbers(candidate, free) + choice[candidate.name]

    # Of two that meet the recordings as well, the one with fewer numbers comes first.
    chosen = sorted(best.values(), key=lambda found: times * found[0] + price(found[1], found[2].free))
    chosen = chosen[: CRITERIA.refitted]
    if leaves_nothing(problem, now):
        # Beside noise alone windows are quadratic as the screen takes them, and what does not pay for its numbers there
        # needs no fit.
        given = None
        chosen = [(v, c, start) for v, c, start in chosen if times * (there.value - v) > of_numbers(c, start.free)]
        if not chosen:
            return [], []
    low = problem.shortest().of_recordings(part.recordings)
    states = low.states_with(problem.states_of(now.point.states, low), part, there.states)
    [short] = low.evaluate(space.engine, [Start(there.vector, there.free, states)])
    elsewhere: dict[Name, Start] = {}
    if given is not None:
        [owner] = low.evaluate(space.engine, [Start(space.with_values(given), there.free, low.guesses)])
        shown: dict[Name, tuple[float, Start]] = {}
        for value, candidate, start in sorted(
            screened(low, AmongAll(space, owner), shared), key=lambda found: found[0]
        ):
            # The same numbers are estimated from either place.
            if candidate.free == best[candidate.name][1].free:
                shown.setdefault(candidate.name, (times * value + price(candidate, start.free), start))
        ahead = sorted(shown, key=lambda name: shown[name][0])[: CRITERIA.refitted]
        chosen += [best[name] for name in ahead if all(candidate.name != name for _, candidate, _ in chosen)]
        elsewhere = {name: shown[name][1] for name in ahead}
        short = min(low.solve(space.engine, [short.start, owner.start], 2 * TRIAL), key=lambda point: point.value)
    absent = [Start(candidate.set(space.table, there.vector), start.free, states) for _, candidate, start in chosen]
    # Tangents where all are absent are the same for all.
    linear = {c.name: s for _, c, s in screened(low, AmongAll(space, short), [c for _, c, _ in chosen])}
    begun = better_of(low, space, absent, [linear[candidate.name] for _, candidate, _ in chosen])
    if elsewhere:
        solved = low.solve(space.engine, list(elsewhere.values()), 2 * TRIAL)
        far = {name: point.start for name, point in zip(elsewhere, solved, strict=True)}
        from_far = [far.get(c.name, start) for (_, c, _), start in zip(chosen, begun, strict=True)]
        begun = better_of(low, space, begun, from_far)
    *fitted, without = low.solve(space.engine, [*begun, short.start], TRIAL - 1)
    after = [Start(p.vector, p.free, part.states_with(there.states, low, p.states)) for p in fitted]
    points = part.solve(space.engine, better_of(part, space, [start for _, _, start in chosen], after), TRIAL)
    order = []
    for (_, candidate, _), point, short_point in zip(chosen, points, fitted, strict=True):
        gained, cost = (there.value - point.value, without.value - short_point.value), price(candidate, point.free)
        gains = times * gained[0] - cost, times * gained[1] - cost
        order.append(_Tried(candidate, axis_of(problem.setting, candidate.name), point, gains))
    order.sort(key=lambda tried: -tried.promise)
    # The best of each axis, since what acts on one of them is seldom told by another, and the best of all.
    first = {tried.axis: k for k, tried in reversed(list(enumerate(order)))}
    others = [k for k, tried in enumerate(order) if _may_win(order, tried)]
    kept = sorted(list(dict.fromkeys([*first.values(), *others]))[: CRITERIA.polished + len(first) - 1])
    # What a map costs is known once it is fitted: the simpler laws that it contains are fitted with it.
    parts = {(part.kind, site) for kind, site in (order[k].candidate.name for k in kept) for part in contained(kind)}
    kept += [k for k, tried in enumerate(order) if k not in kept and tried.candidate.name in parts]
    later = [k for k, tried in enumerate(order) if k not in kept and tried.promise > 0.0]

    def ready(tried: _Tried) -> Move:
        candidate = tried.candidate
        move = with_effects(problem, part, now, among, [candidate], tried.point, choice)
        return dataclasses.replace(move, promise=tried.promise)

    return [ready(order[k]) for k in kept], [ready(order[k]) for k in later]


class _Tried(NamedTuple):
    """A proposal that was refitted."""

    candidate: Candidate
    axis: str
    """The axis on which it acts."""
    point: Point
    gains: tuple[float, float]
    """Beyond its price, in some windows and in short ones alone: where short ones gain, long ones follow when they are
    fitted, too."""

    @property
    def promise(self) -> float:
        return max(self.gains)


def _may_win(every: Sequence[_Tried], tried: _Tried) -> bool:
    """Whether a proposal comes near the best one on its axis, in some windows or in short ones: promises a good part of
    what it does, or so nearly as much that the two may not be told apart."""
    best = [max(t.gains[k] for t in every if t.axis == tried.axis) for k in range(2)]
    near = math.log(1.0 / CRITERIA.apart)
    return max(best) > 0.0 and any(
        gain >= min(CRITERIA.worth * most, most - near) for gain, most in zip(tried.gains, best, strict=True)
    )
