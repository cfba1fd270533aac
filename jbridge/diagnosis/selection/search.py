"""The search for a structure: proposals are cheap and linear, judgement is by simulation and one criterion.

A model is a set of effects beside what was given. In each round every effect that it lacks is weighed by a linear
screen (the criterion on the quadratic model of every window), the best are refitted together on some windows, the best
of these are fitted to all windows, and the best move is made: an effect is added or replaced by a rival, or a known
number is set free; but first what does with fewer numbers takes the place of the model, without an effect or with a
simpler law. A move to more numbers takes the place of one to fewer only if it gains steadily. Every fit climbs from
short windows, which are nearly linear, to long ones. The search ends when no move lowers the criterion.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from ...compilation.programs import forget_if_large
from ...identification.data.windows import WHOLE
from ...identification.estimation import Problem
from ...identification.setting import Setting
from ...identification.solver import Start
from ...model.plant import Plant
from ..criteria import CRITERIA
from ..structures.candidates import WRONG_VALUE
from ..structures.space import Name, is_apart, largest_shown, looks_like, proposals
from ..structures.structure import (
    Structure,
    accepts,
    from_larger,
    in_equal_steps,
    leaves_nothing,
    preferred,
    serves_as_well,
    weighed,
    with_own_levels,
)
from .additions import added
from .mechanisms import with_mechanisms
from .moves import AT_ONCE, Move, axis_of, refinements, removals, replacements, simplifications, together
from .pairs import paired
from .screening import seen_among_all

_SOME = 3
"""Recordings on which proposals are screened and first refitted."""
_SHORT = 1.0
"""Horizon [s] on which they are, beside whole recordings: long enough to show forces, and nearly linear."""
_FIRST = 6
"""Iterations of the fit to some windows beside which proposals are screened."""
_STAGE, _STAGES = 3, 4
"""Iterations of a trial fit before it is compared with the others, and of how many such stages it has at most."""
_ARRIVED = 0.1
"""What the parameters of a fit that has arrived promise at most [nat]."""


@dataclasses.dataclass(frozen=True)
class Search:
    """What a search held, one model after the other, and what it tried beside each."""

    problem: Problem
    held: tuple[Structure, ...]
    tried: tuple[tuple[Structure, ...], ...]
    """Models fitted to all windows in the round that began at each of `held`."""
    stopped: str
    """`criterion`, `budget` or `interrupted`."""


def select(
    problem: Problem,
    base: Structure,
    given: Plant,
    tell: Callable[[str], None],
    until: Callable[[int], float],
) -> Search:
    """Searches from a base until no move lowers the criterion, or time is over.

    Args:
        problem: recordings and criterion.
        base: the fitted model as given, see `base_structure`.
        given: its plant with the numbers of the model file.
        tell: takes a line on what is being done.
        until: deadline by `time.monotonic` [s], given the number of effects that the validation will leave out.
    """
    largest = largest_shown(proposals(problem.setting, base.plant, base.known))
    prior = dataclasses.replace(problem.likelihood.prior, largest=largest)
    problem = dataclasses.replace(problem, likelihood=dataclasses.replace(problem.likelihood, prior=prior))
    held: list[Structure] = [base]
    tried: list[tuple[Structure, ...]] = []
    seen = {frozenset(base.free)}
    runners_up: dict[Name, Structure] = {}
    stopped = "criterion"
    for number in range(CRITERIA.rounds):
        now = held[-1]
        try:
            problem = problem.judged_by(problem.residuals(now.space.engine, now.point))
            problem = dataclasses.replace(problem, until=until(len(now.names) + 1))
            # What a larger model gains must not be what more iterations gain.
            [point] = problem.solve(now.space.engine, [now.point.start])
            point = problem.solved_anew(now.space.engine, point)
            now = held[-1] = weighed(problem, dataclasses.replace(now, point=point))
            so_far = ", ".join(f"{kind} ({site})" for kind, site in now.names) or "the model as given"
            tell(f"round {number + 1}: looking beyond {so_far}")
            found = _smaller(problem, base, now, runners_up, seen)
            # A law that does with fewer numbers, or a plainer one, is no rival of what may be added to it.
            simpler = [s for s in found if len(s.point.free) < len(now.point.free) and accepts(problem, now, s)]
            simpler += [s for s in found if serves_as_well(problem, now, s)]
            if not simpler:
                found += _larger(problem, base, now, None if number else given, seen)
        except KeyboardInterrupt:
            stopped = "interrupted"
            break
        better = [s for s in found if accepts(problem, now, s) or serves_as_well(problem, now, s)]
        tried.append(tuple(dataclasses.replace(s, left=()) for s in sorted(found, key=_value)))
        if problem.is_late:
            stopped = "budget"
        if better:
            best = preferred(problem, better)
            try:
                itself = from_larger(problem, now, best)
            except KeyboardInterrupt:
                stopped, itself = "interrupted", now
            if itself.value < now.value and not accepts(problem, itself, best):
                best = itself
            runners_up |= _next_to(problem.setting, now, best, better)
            held.append(best)
            seen.add(frozenset(best.free))
        if not better or stopped != "criterion":
            break
        forget_if_large()
    problem = dataclasses.replace(problem, until=math.inf)
    try:
        if stopped != "interrupted":
            [point] = problem.solve(held[-1].space.engine, [held[-1].point.start])
            held[-1] = weighed(problem, with_own_levels(dataclasses.replace(held[-1], point=point)))
    except KeyboardInterrupt:
        stopped = "interrupted"
    return Search(problem, tuple(held), tuple(tried), stopped)


def _next_to(setting: Setting, now: Structure, best: Structure, better: Sequence[Structure]) -> dict[Name, Structure]:
    """The best model that adds another effect on the same axis, by each effect that the best one adds; one that adds a
    plainer effect, which this one looks like, comes before others."""
    if not set(now.names) <= set(best.names):
        return {}
    single = [s for s in better if s.names[:-1] == now.names and s.names[-1][0] != WRONG_VALUE]
    single = [s for s in single if s.names[-1] not in best.names]
    out = {}
    for new in best.names:
        others = [s for s in single if axis_of(setting, s.names[-1]) == axis_of(setting, new)]
        plainer = [s for s in others if looks_like(new, s.names[-1])]
        if others and new not in now.names:
            out[new] = min(plainer or others, key=_value)
    return out


def _smaller(
    problem: Problem,
    base: Structure,
    now: Structure,
    runners_up: Mapping[Name, Structure],
    seen: set[frozenset[str]],
) -> list[Structure]:
    """The model without one of its effects, or with a simpler law or a rival in its place, fitted."""
    moves = [*removals(problem, base, now), *simplifications(problem, base, now)]
    moves += replacements(problem, base, now, runners_up)
    return _all_fitted(problem, [m for m in moves if m.numbers not in seen], now)


def _larger(
    problem: Problem,
    base: Structure,
    now: Structure,
    given: Plant | None,
    seen: set[frozenset[str]],
) -> list[Structure]:
    """All models with one effect or one finer law more that were worth a fit to all windows, fitted; the best of them
    with others' effects beside it."""
    short = min(problem.data.horizons, key=lambda h: abs(math.log(min(h, 1e3) / _SHORT)))
    # Short windows show forces, whole recordings what adds up.
    part = problem.of_some(_SOME, now.point).of_horizons([short, WHOLE])
    begun = Start(now.point.vector, now.point.free, problem.states_of(now.point.states, part))
    # Shapes of effects show beside what is best on the same windows.
    [there] = part.solve(now.space.engine, [begun], _FIRST)
    if problem.is_late:
        return []
    among = seen_among_all(problem, part, dataclasses.replace(now, point=there))
    every = [c for c in proposals(problem.setting, now.plant, now.known) if c.name not in now.names]
    names = {c.name for c in every}
    choice = {
        name: math.log(len(names)) + math.log(sum(c.name == name for c in every if not is_apart(c.kind)) or 1)
        for name in names
    }
    shared = [c for c in every if not is_apart(c.kind)]
    moves, later = added(problem, part, now, among, shared, choice, given)
    moves += refinements(problem, base, now, moves)
    found: list[Structure] = []
    good: list[Structure] = []
    # What promises most may be what imitates best: then it does not gain on blocks that are left out, and what
    # promises less is looked at, too.
    while moves and not good:
        tried = _all_fitted(problem, [m for m in moves if m.numbers not in seen], now)
        # What gains on its own blocks alone may contain a law of fewer numbers that gains on others, too.
        too_many = [s for s in tried if s.value < now.value and not accepts(problem, now, s)]
        simpler = {m.numbers: m for s in too_many for m in simplifications(problem, base, s)}
        known = {*seen, *(frozenset(s.free) for s in tried)}
        tried += _all_fitted(problem, [m for numbers, m in simpler.items() if numbers not in known], now)
        found += tried
        good = sorted((s for s in tried if accepts(problem, now, s)), key=lambda s: s.value)
        moves, later = later[:AT_ONCE], later[AT_ONCE:]
    if problem.is_late:
        return found
    if not good and not leaves_nothing(problem, now):
        moves = paired(problem, part, now, among, shared, choice)
        tried = _all_fitted(problem, [m for m in moves if m.numbers not in seen], now)
        found += tried
        good = sorted((s for s in tried if accepts(problem, now, s)), key=lambda s: s.value)
    best = preferred(problem, good) if good else None
    if best is not None:
        others = [s for s in good if s is not best and _told_apart(problem.setting, now, s, found)]
        joined = _with_other_axes(problem, now, best, others, seen)
        found += [joined] if joined is not best else []
        best = joined
    # Mechanisms take a program each: they are looked at where a search begins, unless what is simpler leaves nothing,
    # and where it would end with names that they may have in truth.
    ends = best is None and bool(now.names)
    if ends or ((best is None or given is not None) and not leaves_nothing(problem, best or now)):
        apart = [c for c in every if is_apart(c.kind)]
        moves = with_mechanisms(problem, part.of_some(1), now, apart, choice, best)
        tried = _all_fitted(problem, [m for m in moves if m.numbers not in seen], now)
        found += in_equal_steps(problem, now, tried)
    return found


def _told_apart(setting: Setting, now: Structure, then: Structure, tried: Sequence[Structure]) -> bool:
    """Whether no other addition on its axis comes near an added effect."""
    near, own = math.log(1.0 / CRITERIA.apart), _new_axes(setting, now, then)
    rivals = [s.value for s in tried if s is not then and _new_axes(setting, now, s) & own]
    return bool(own) and min(rivals, default=math.inf) > then.value + near


def _new_axes(setting: Setting, now: Structure, then: Structure) -> frozenset[str]:
    """The axes on which a model has effects that another lacks."""
    return frozenset(axis_of(setting, name) for name in then.names if name not in now.names)


def _with_other_axes(
    problem: Problem,
    now: Structure,
    best: Structure,
    others: Sequence[Structure],
    seen: set[frozenset[str]],
) -> Structure:
    """The best model with what others add on other axes, one after the other, as long as it gains."""
    taken = set(_new_axes(problem.setting, now, best))
    for other in others if taken else ():
        [new] = set(other.names) - set(now.names)
        axis = axis_of(problem.setting, new)
        if axis in taken:
            continue
        taken.add(axis)
        move = together(problem, now, best, other)
        if move.numbers not in seen:
            joined = _all_fitted(problem, [move], best)
            best = min([best, *(s for s in joined if accepts(problem, best, s))], key=_value)
    return best


def _value(structure: Structure) -> float:
    return structure.value


def _all_fitted(problem: Problem, moves: Sequence[Move], now: Structure) -> list[Structure]:
    """Moves fitted to all windows, some iterations of each at a time, until it is decided which is the best on its
    axes."""

    def begun(move: Move) -> _Fit | None:
        if problem.is_late:
            return None
        engine, start = move.space.engine, move.start
        low = problem.shortest()
        # To the end: what some recordings show of a law may be far from what all of them do.
        [short] = low.solve(engine, [Start(start.vector, start.free, problem.states_of(start.states, low))])
        climbed = Start(short.vector, short.free, problem.states_with(start.states, low, short.states))
        first = min(problem.evaluate(engine, [start, climbed]), key=lambda p: p.value)
        [point] = problem.solve(engine, [first.start], _STAGE)
        restarted = False
        if point.value > now.point.value and move.absent is not None:
            # What fits short windows may run away in long ones: then the effect grows from its absence, where the
            # model is as good as the one that it contains.
            restarted = True
            [other] = problem.solve(engine, [Start(move.absent, start.free, now.point.states)], _STAGE)
            first, point = min((first, point), (now.point, other), key=lambda pair: pair[1].value)
        if problem.is_late:
            # What was cut short says nothing beside what was not.
            return None
        fitted = Structure(
            space=move.space, names=move.names, keys=move.keys, choices=move.choices, point=point, restarted=restarted
        )
        return _Fit(weighed(problem, fitted), first.value - point.value)

    def continued(fit: _Fit) -> _Fit:
        structure, before = fit.structure, fit.structure.point
        [point] = problem.solve(structure.space.engine, [before.start], _STAGE)
        return _Fit(dataclasses.replace(structure, point=point), before.value - point.value)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        fits = [fit for fit in pool.map(begun, moves) if fit is not None]
        longer: set[int] = set()
        for _ in range(1, _STAGES):
            on = _undecided(problem.setting, now, fits)
            if problem.is_late:
                break
            for i, fit in zip(on, pool.map(continued, [fits[i] for i in on]), strict=True):
                fits[i] = fit
            longer.update(on)
        # Its price hardly changes while a fit goes on.
        again = {i: pool.submit(weighed, problem, fits[i].structure) for i in longer}
        return [again[i].result() if i in again else fit.structure for i, fit in enumerate(fits)]


class _Fit(NamedTuple):
    """A move that is being fitted."""

    structure: Structure
    gained: float
    """What its last iterations gained."""


def _undecided(setting: Setting, now: Structure, fits: Sequence[_Fit]) -> list[int]:
    """The fits whose parameters still move, if one more gain like their last could change which is the best on its
    axes, or whether it is better than the model that all are compared with."""
    axes = [_new_axes(setting, now, fit.structure) for fit in fits]
    out = []
    for own in dict.fromkeys(axes):
        group = [i for i, each in enumerate(axes) if each == own]
        best = min(now.value, *(fits[i].structure.value for i in group))
        moving = [
            i
            for i in group
            if fits[i].structure.point.promise > _ARRIVED and fits[i].structure.value - fits[i].gained < best
        ]
        # The best one goes on beside others alone.
        out += [i for i in moving if fits[i].structure.value > best or len(moving) > 1]
    return out
