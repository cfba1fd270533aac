"""One explanation after the other: which round tries what, which is taken, and when enough is explained."""

import dataclasses
from collections.abc import Sequence
from math import nan

from .._programs import forget
from ..identify.base import BaseFit, measurements
from ..identify.finer import fit_finely
from ..identify.left_out import several
from ..identify.setting import lanes_for
from .adequacy import LARGE, LEARNABLE, channels, is_large
from .ahead import Before, leading
from .aside import stands_out
from .candidates import Candidate, has_hidden_state
from .curve import of_place_alone
from .freeze import last_fit
from .mechanisms import mechanisms
from .revise import SUPERFLUOUS, coarser, completed, finer, prune, simplify
from .screen import Screen
from .search import Search, state_of
from .steps import HOLDS, Step, as_simplified, by_gap_closed, refused_with, renamed
from .swaps import compare_look_alikes
from .ties import look_alikes, ties
from .trials import State, Trial, accepts, as_trial, explained, floor_of, held

MOST_EFFECTS = 6
_KEPT = 2
"""Accepted effects up to which all compiled programs are kept."""
MOST_WITH_MECHANISMS = 2
"""Effects after which those with a hidden state, which take longest to try, are tried no more."""
DRIFTING = 25.0
"""Free-run error over noise above which whole recordings measure luck, and windows are compared instead."""
NEAR = 1.15
"""Error over noise of the whole below which a further effect is not looked for,"""
QUIET = 1.25
"""and of the channel that is met worst, with finer steps: a law that is missing on one axis may be lost in the mean."""
CLOSE = 1.05
"""Error over noise below which even effects with a hidden state have nothing left to explain."""
NONLINEAR = 3.0
"""Error over noise above which a mismatch may be too large for one linear screen of whole recordings."""
MOST = 0.5
"""Least share of the excess that an effect must explain where the model is already adequate."""
NEARLY_ALL = 0.75
"""Least share of a small error that the first effect must explain, recordings that it was fitted to included. One law
that is missing explains it whole; what explains it by half is another one's likeness."""
STRONG = 0.1
"""Cost, relative to the model without it, at which an effect is taken before those with a hidden state are tried: what
it leaves over is explained in the next round, and it is dropped again if that makes it superfluous."""
_MAINLY = 0.9
"""Share of the excess that the first law must explain which is to take a curve's place."""
_AS_A_CURVE = 0.1
"""Rise of the cost up to which a law with a few numbers does as well as a curve with many."""


@dataclasses.dataclass(frozen=True)
class Explained:
    """What a search accepted, and how much of the missing forces other recordings foresee."""

    state: State
    steps: list[Step]
    learnable: float
    """Before anything was accepted; nan where there was nothing to ask."""
    learnable_after: float
    screened: Screen | None
    """Of the last round, in which nothing more was accepted."""
    refused: list[tuple[Trial, str]]
    """The trials of that round, or of one whose choice was withdrawn, and why each did not pass."""
    curve: State | None = None
    """The model with a force that hangs on the place alone, where a map of friction would have played it."""
    unnamed: float = nan
    """`learnable` as a force without a name has it, which does not rest on what was accepted."""
    odd: int | None = None
    """The recording that was met far worse than all others at last, before later acceptances made up for it."""


def nothing_accepted(search: Search, base: BaseFit) -> State:
    """The model as given, on the lanes that are compared."""
    if search.window is None:
        return state_of(base.engine, base.free_run, base.fits, search.known)
    start = base.engine.table.unravel(base.window_vector)
    guess = lanes_for(base.engine.table, start, search.setting, search.setting.recordings, search.window).initial
    return search.polish(start, search.known, guess, ())


def accept_effects(search: Search, base: BaseFit, mismatch: bool, begin: Explained | None = None) -> Explained:
    """Accepts one explanation after the other.

    Args:
        search: what can be tried.
        base: the model as given, refitted.
        mismatch: whether there is anything to explain.
        begin: what was accepted already; then a further explanation is looked for first, if there may be one.
    """
    state = nothing_accepted(search, base)
    first = state, search.window
    steps: list[Step] = []
    if not mismatch:
        return Explained(state, steps, nan, nan, None, [])
    learnable, unnamed, after = 0.0, 0.0, 0.0
    if begin is not None:
        state, steps, learnable, unnamed = begin.state, list(begin.steps), begin.learnable, begin.unnamed
    screened, left = None, []
    before: Before | None = None
    odd = _odd_one(search, state) if begin is None else begin.odd
    for _ in range(len(steps), MOST_EFFECTS):
        if len(steps) >= _KEPT:
            # Programs of structures that were tried are needed no more, and their memory maps are limited.
            forget()
        screened, trials = _weigh(search, state)
        after = screened.learnable
        if not steps:
            learnable = unnamed = screened.learnable
        # What a linear screen could not foresee must prove itself the more by simulation.
        least = HOLDS if after >= LEARNABLE else LEARNABLE
        if state.worst < LARGE:
            # What no longer raises an alarm needs a further effect only if that explains most of it.
            least = MOST
        little = state.worst < LARGE and not steps and search.window is None
        gain = search.least_gain(state)
        reasons, passed = _judged(state, trials, least, gain, little)
        if passed:
            tied = ties(screened.ranked, passed[0].candidate, list(reasons))
            trials = [*trials, *search.refit_all(state, tied)]
            for alike in look_alikes(passed[0].candidate):
                if has_hidden_state(alike[0]) and alike not in {*reasons, *(a.name for a in state.accepted)}:
                    trials += mechanisms(search, state, alike)
            trials.sort(key=lambda t: t.score)
            reasons, passed = _judged(state, trials, least, gain, little)
        floor = floor_of(trials)
        if before is not None:
            passed = [trial for trial in passed if before.holds(trial, least, floor)]
        if passed:
            chosen, start = passed[0], state
            if before is not None:
                start, before = before.state, None
            if not start.accepted and several(state.batch):
                learnable = max(learnable, min(held(start, chosen, floor), 1.0))
        else:
            left = [(t, reasons[t.candidate.name]) for t in trials]
            lead = [] if before is not None or state.worst < LARGE else leading(state, trials, reasons)
            if not lead:
                break
            before = Before(state, tuple(steps), screened, after, left)
            chosen, reasons = lead[0], reasons | {trial.candidate.name: "" for trial in lead}
        said = "found" if before is None else "looking further beside"
        search.progress(
            f"{said} {chosen.candidate.kind.replace('_', ' ')} at {chosen.candidate.site.replace('_', ' ')}"
        )
        state = completed(search, state, chosen)
        number = 1 + max((step.number for step in steps), default=0)
        beside = {candidate.name for candidate in state.accepted}
        if any(step.chosen.candidate.name not in beside for step in steps):  # what it was chosen beside is gone
            steps = [step for step in steps if step.chosen.candidate.name in beside]
            fewer = as_trial(state, chosen.candidate, chosen.z)
            chosen, trials = fewer, [fewer if trial is chosen else trial for trial in trials]
        steps.append(Step(number, chosen, trials, {name: why for name, why in reasons.items() if why}))
        state = simplify(search, state)
        if state.worst > LARGE:
            state = finer(search, state)
        steps[-1] = as_simplified(steps[-1], state)
        after = nan
        if before is not None:
            continue  # on the same lanes, on which both must hold
        if search.window is not None:
            state = _back_to_free_runs(search, state)
        if len(steps) > 1 and chosen.candidate.unscreened:
            state, steps = _alone(search, first, state, steps)
        found = _odd_one(search, state)
        odd = odd if found is None else found
        if state.chi < NEAR and _quiet(search, state):
            break
    else:
        after = learnable
    if before is not None:
        state, steps, screened = before.state, list(before.steps), before.screened
        after, left = before.learnable_after, before.refused
    if len(steps) > 1:
        # Beside the others a law of friction may have become simpler than it was when it was accepted.
        for place, old in enumerate(state.accepted):
            state = simplify(search, state, place)
            steps = [renamed(step, old, state.accepted[place]) for step in steps]
        state = prune(search, state)
        state, steps = compare_look_alikes(search, state, steps)
        steps = by_gap_closed(steps, state)
    for place in range(len(state.accepted)):
        # The error of too coarse a map is seen best when the rest is explained.
        resolved = finer(search, state, place) if state.chi > CLOSE else state
        state = resolved if resolved is not state else coarser(search, state, place)
    if steps and search.window is not None:
        # Parameters are sharpest, and errors are reported, on whole recordings.
        state = _back_to_free_runs(search, state)
    state = search.smooth(state)
    done = Explained(state, steps, learnable, after, screened, left, unnamed=unnamed, odd=odd)
    for candidate in state.accepted:
        alone = of_place_alone(search, state, candidate)
        if alone is not None:
            search.barred |= {candidate.name}
            return _named_after_all(search, base, _without_friction(search, done, candidate, *alone))
    return done


def _named_after_all(search: Search, base: BaseFit, curved: Explained) -> Explained:
    """What has a name, a spring say, if it leaves as little as a force of the place alone that has none; else that."""
    bare = curved.state
    _, trials = _screened(search, bare)  # a hidden state plays no force of the place
    if not any(explained(bare, trial, floor_of(trials)) >= _MAINLY for trial in trials):
        return curved
    named = accept_effects(search, base, True, dataclasses.replace(curved, curve=None))
    as_well = curved.curve is not None and named.state.cost <= curved.curve.cost * (1 + _AS_A_CURVE)
    return named if as_well and named.state.worst <= LARGE else curved


def _without_friction(search: Search, done: Explained, friction: Candidate, bare: State, curved: State) -> Explained:
    """What was accepted less a map of friction, since a force of the place alone does as well and has no name.

    Args:
        search: what can be tried.
        done: with the map.
        friction: the map.
        bare: the model without it,
        curved: and with the force.
    """
    gone = next(step for step in done.steps if step.chosen.candidate.name == friction.name)
    steps = [step for step in done.steps if step is not gone]
    before = {candidate.name for candidate in done.state.accepted}
    for plain in bare.accepted:
        if plain.name not in before:  # the friction that is the same everywhere
            chosen = as_trial(curved, plain, gone.chosen.z)
            steps.append(Step(gone.number, chosen, [chosen], {}))
    screened = search.look(bare)
    share = held(bare, as_trial(curved, friction, gone.chosen.z), floor_of([gone.chosen]))
    after = max(screened.learnable, min(share, 1.0))
    refused = refused_with([gone], "a force of the place alone does as well")
    return dataclasses.replace(
        done, state=bare, steps=steps, learnable_after=after, screened=screened, refused=refused, curve=curved
    )


def _odd_one(search: Search, state: State) -> int | None:
    """The recording that a model meets far worse than all others."""
    if search.window is not None or state.worst <= LARGE:
        return None
    fit = last_fit(state)
    return stands_out(fit.batch, fit.gram.predicted[0])


def _quiet(search: Search, state: State) -> bool:
    """Whether no channel is met badly, apart from what the engine's own steps do to it."""
    if state.worst < QUIET:
        return True
    if state.worst >= LARGE:
        return False
    fine = fit_finely(last_fit(state))
    return not is_large(channels(fine.batch, fine.gram.predicted[0], search.setting.noise), QUIET)


def _judged(
    state: State, trials: Sequence[Trial], least: float, gain: float, little: bool
) -> tuple[dict[tuple[str, str], str], list[Trial]]:
    """Why each trial does not pass, and those that do, the best first."""
    floor = floor_of(trials)
    reasons = {t.candidate.name: accepts(state, t, least, gain, floor) for t in trials}
    if little:
        for t in trials:
            if explained(state, t, floor) < NEARLY_ALL:
                reasons[t.candidate.name] = reasons[t.candidate.name] or "explains a part only"
    return reasons, [t for t in trials if not reasons[t.candidate.name]]


def _alone(
    search: Search, first: tuple[State, float | None], state: State, steps: list[Step]
) -> tuple[State, list[Step]]:
    """An effect with a hidden state in place of all that was accepted before it, if it explains as much.

    What it does may have been explained piecemeal, and from there a fit does not find the way back.
    """
    begin, window = first
    outer, search.window = search.window, window
    trials = mechanisms(search, begin, steps[-1].chosen.candidate.name)
    alone = None
    if trials:
        trial = trials[0]
        alone = search.polish(trial.plant, trial.known, trial.initial, (trial.candidate,))
        if search.window is not None:
            alone = _back_to_free_runs(search, alone)
    same = alone is not None and measurements(alone.batch) == measurements(state.batch)
    if alone is None or not same or not alone.cost <= state.cost * (1 + SUPERFLUOUS):
        search.window = outer
        return state, steps
    others = [trial for trial in steps[0].trials if trial.candidate.name != trials[0].candidate.name]
    ranked = sorted([trials[0], *others], key=lambda t: t.score)
    refused = {name: why for name, why in steps[0].refused.items() if name != trials[0].candidate.name}
    return alone, [Step(1, trials[0], ranked, refused)]


def _screened(search: Search, state: State) -> tuple[Screen, list[Trial]]:
    """Refits what a linear screen finds promising, looking the closer the less that explains."""
    screened = search.look(state)
    trials = search.refit(state, screened)
    if search.window is None and state.chi > NONLINEAR and not _explained(trials, NEAR):
        screened = search.look_closer(state, screened)
        trials += search.refit(state, screened, trials)
    elif not _explained(trials, LARGE):
        trials += search.refit(state, screened, trials)
    return screened, trials


def _weigh(search: Search, state: State) -> tuple[Screen, list[Trial]]:
    """Refits what is promising, with a hidden state or without."""
    screened, trials = _screened(search, state)
    strong = any(t.cost < STRONG * state.cost for t in trials)
    if not strong and len(state.accepted) < MOST_WITH_MECHANISMS and not _explained(trials, CLOSE):
        trials += mechanisms(search, state)
    done = {t.candidate.name for t in trials} | {accepted.name for accepted in state.accepted}
    for name in sorted(search.insist - done):
        # An earlier diagnosis could not rule it out, so it must be compared, not only left out.
        if has_hidden_state(name[0]):
            trials += mechanisms(search, state, name)
    return screened, sorted(trials, key=lambda t: t.score)


def _explained(trials: Sequence[Trial], ratio: float) -> bool:
    """Whether some trial leaves little more than noise."""
    return any(t.cost < ratio**2 * measurements(t.batch) for t in trials)


def _back_to_free_runs(search: Search, state: State) -> State:
    """Whole recordings again, once the model has become good enough for them."""
    windows, search.window = search.window, None
    guess = lanes_for(state.engine.table, state.plant, search.setting, search.setting.recordings).initial
    whole = search.polish(state.plant, state.known, guess, state.accepted)
    if whole.chi < DRIFTING:
        return whole
    search.window = windows
    return state
