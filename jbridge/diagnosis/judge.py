"""The verdict: what the completed model leaves over, and whether recordings that took no part bear it out."""

import dataclasses
from collections.abc import Callable, Sequence
from math import isfinite, nan

from ..identification.problem import Setting
from ..identify.base import WINDOW
from ..identify.finer import LastFit, fit_finely
from ..identify.result import Errors, Estimate
from ..recordings import Recording
from .adequacy import LARGE, carries_over, channels, is_large, worst_ratio
from .attempt import Attempt
from .curve import force_without_a_name
from .freeze import Frozen, freeze, last_fit, numbers
from .holdout import OffMap, by_heart, off_map
from .result import Channel
from .surprise import Surprise, surprise
from .trials import State
from .words import Elsewhere, Proof


@dataclasses.dataclass(frozen=True)
class Settled:
    """Both models that the report compares, with all numbers settled."""

    first: Frozen
    """The model as given, refitted,"""
    last: Frozen
    """and the final one."""
    state: State
    """What the final one was made from."""
    curved: bool
    """Whether it has a force without a name."""
    values: dict[str, Estimate]
    hardly_told: tuple[str, ...]
    unprepared: Surprise | None
    """What shows on the hold-out alone."""


@dataclasses.dataclass(frozen=True)
class Judgement:
    """A verdict, and what it rests on."""

    verdict: str
    left: dict[str, Channel]
    """Errors of the final model."""
    proof: Proof
    unproven: bool
    """Whether what was named does not hold on the hold-out,"""
    abroad: OffMap | None
    """and where a hold-out went that therefore cannot judge it."""
    elsewhere: Elsewhere | None
    odd_one: Elsewhere | None
    """A recording of the hold-out that was learned from, and shows what no other does."""
    still: bool
    """Whether what is left is large and repeats."""


def settle(made: Attempt, setting: Setting, tell: Callable[[str], None]) -> Settled:
    """Settles the numbers of both models, and runs them over the hold-out."""
    state, steps = made.explained.state, made.explained.steps
    curve = None
    if made.alarm and state.worst > LARGE and made.left_repeats:
        curve = made.explained.curve or force_without_a_name(made.search, state)
    if made.given is not None and curve is None:
        first, last = made.given, made.completed or made.given
    else:
        tell("fitting once more, with finer steps, and opening the hold-out")
        plain = LastFit.of(made.base)
        curved = None if curve is None else freeze(last_fit(curve), setting, made.base)
        if made.completed is not None:
            named = made.completed
        elif curved is None:
            named = freeze(fit_finely(last_fit(state) if steps else plain), setting, made.base)
        else:
            named = freeze(last_fit(state) if steps else plain, setting, made.base)
        if curved is not None:
            left = _worst(curved, made, setting)
            if not isfinite(left) or left > _worst(named, made, setting):
                curve = curved = None  # it makes no simulation usable
        last = curved or named
        # Of two, only the completed one leaves so little that finer steps show.
        first = freeze(plain, setting, made.base) if steps or made.completed is not None else named
    values, hardly_told = numbers(last.fit, setting)
    if curve is not None and curve is not made.explained.curve:
        # What has a name keeps the numbers that it had before the curve.
        own, hardly_told = numbers(last_fit(state), setting)
        values |= own
    # Windows say nothing of free runs, and a force without a name explains nothing.
    judged = curve is None and made.search.window is None
    unprepared = surprise(last.fit, last.holdout) if judged else None
    return Settled(first, last, curve or state, curve is not None, values, hardly_told, unprepared)


def _worst(frozen: Frozen, made: Attempt, setting: Setting) -> float:
    """How badly a model meets the hold-out, over the noise."""
    errors = frozen.holdout.errors
    return worst_ratio(errors.free_run if made.search.window is None else errors.window, setting.noise)


def judge(made: Attempt, settled: Settled, setting: Setting, surprised: str | None) -> Judgement:
    """The verdict.

    Args:
        made: the search.
        settled: its models.
        setting: what they were made from.
        surprised: the channel for which the last of the recordings was taken from the hold-out, if one was.
    """
    steps, in_windows = made.explained.steps, made.search.window is not None
    left = channels(settled.last.train.batch, settled.last.train.predicted, setting.noise)
    # A force without a name makes the simulation usable, but it explains nothing.
    still = bool(made.alarm and (settled.curved or (is_large(left) and made.left_repeats)))
    before, after = settled.first.holdout.errors, settled.last.holdout.errors
    # The model is frozen, but whoever reads the verdict must be told if the proof fails.
    names = {step.chosen.candidate.name for step in steps}
    met = [e.window if in_windows else e.free_run for e in (settled.last.train.errors, before, after)]
    trained, _, tested = ({axis: e / setting.noise[axis] for axis, e in errors.items()} for errors in met)
    worst = [worst_ratio(errors, setting.noise) for errors in met[1:]]
    unproven = bool(made.alarm and steps) and (
        not carries_over(before, after, setting.noise, windows=in_windows)
        or by_heart(settled.last.plant, names, trained, tested)
    )
    abroad = None
    if unproven:
        abroad = off_map(settled.last.plant, names, setting.holdout)
    if abroad is not None:
        # Only the other drive's axis knows nothing of where this one is.
        first, last = (_without(errors, (abroad.axis, "psi")) for errors in (before, after))
        if is_large(left) or not carries_over(first, last, setting.noise, windows=in_windows):
            abroad = None
    # A map explains all that was recorded, and the hold-out asks for places where nobody has been.
    unproven = unproven and abroad is None
    elsewhere = odd_one = None
    if settled.unprepared is not None:
        elsewhere = _elsewhere(settled.unprepared, setting.holdout)
    elif not made.alarm and made.large and surprised:
        odd_one = Elsewhere(surprised, setting.recordings[-1].name, nan)
    if made.alarm:
        verdict = "missing_physics" if steps and not still and not unproven else "unknown"
    else:
        verdict = "adequate" if elsewhere is None and odd_one is None else "unknown"
    proof = Proof(worst[0], worst[1], f"windows of {WINDOW:g} s" if in_windows else "free runs")
    return Judgement(verdict, left, proof, unproven, abroad, elsewhere, odd_one, still)


def _elsewhere(found: Surprise, holdout: Sequence[Recording]) -> Elsewhere:
    return Elsewhere(found.channel, holdout[found.recordings[0]].name, found.ratio)


def _without(errors: Errors, axes: Sequence[str]) -> Errors:
    free_run, window = (
        {axis: e for axis, e in part.items() if axis not in axes} for part in (errors.free_run, errors.window)
    )
    return Errors(free_run, window)
