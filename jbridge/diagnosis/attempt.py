"""The search from beginning to end: whether there is something to explain, what explains it, and whether it repeats."""

import dataclasses
from collections.abc import Callable, Sequence
from math import nan

import numpy as np
from numpy.typing import NDArray

from .._programs import forget
from ..identification.problem import Setting, resolve
from ..identify.base import WINDOW, BaseFit, base_fit, begun_anew, check_runs, measurements
from ..identify.finer import LastFit, fit_finely
from ..identify.lanes import Batch
from ..identify.linearise import Engine
from ..identify.setting import lanes_for
from ..model.files import Model
from .adequacy import (
    FORESEEN,
    LARGE,
    LEARNABLE,
    NOTICEABLE,
    SIGNIFICANT,
    STILL_LEARNABLE,
    carries_over,
    channels,
    closes_little,
    in_vain,
    is_large,
    significance,
    worst_ratio,
)
from .freeze import Frozen, freeze, last_fit
from .holdout import off_map
from .repeats import repeating_share
from .result import Channel
from .revise import SUPERFLUOUS, fitted_without
from .rounds import DRIFTING, QUIET, Explained, accept_effects, nothing_accepted
from .search import BOOTSTRAP, Search
from .steps import refused_with
from .surprise import surprise
from .trials import FAR_FROM_NULL, State, significance_of, transfer

_LOOSELY = 2.5
"""Error over noise up to which finer steps are tried for a model without what may have made up for their error."""
_NOT_PROVEN = "does not hold on the hold-out"


@dataclasses.dataclass(frozen=True)
class Attempt:
    """What a search came to."""

    base: BaseFit
    """The model as given, refitted."""
    search: Search
    explained: Explained
    channels: dict[str, Channel]
    """Errors of the model as given,"""
    p_value: float
    """how likely so much structure is in noise,"""
    given: Frozen | None
    """The model as given, fitted finely, where none of its errors is large."""
    completed: Frozen | None
    """The model that was completed, where it leaves little."""
    window: float | None
    """Length of the windows on which models were compared at first [s]; None for whole recordings."""
    learnable: float
    """How much of the missing forces other recordings foresee,"""
    learnable_after: float
    """and how much of what the names leave over."""
    left_repeats: bool
    """Whether that is enough to be a law."""
    alarm: bool
    """Whether physics is missing."""

    @property
    def large(self) -> bool:
        """Whether an error of the model as given is large."""
        return self.given is None


def attempt(
    model: Model,
    setting: Setting,
    *,
    insist: frozenset[tuple[str, str]],
    leave_out: frozenset[str],
    progress: Callable[[str], None] | None,
) -> Attempt:
    """Fits the model as given and explains what it leaves over.

    The hold-out is opened where small errors, or none, are left: it says whether names are looked for, and kept.

    Args:
        model: see `diagnose`.
        setting: made of the recordings.
        insist: what an earlier diagnosis could not rule out.
        leave_out, progress: see `diagnose`.

    Raises:
        InputError: model and recordings do not go together.
    """
    tell = progress or (lambda text: None)
    plant = resolve(model.plant, setting.length)
    base = base_fit(plant, model.known, setting, progress=progress)
    check_runs(base, setting.recordings)
    tell("simulating the model as given, refitted")
    draws = BOOTSTRAP not in leave_out
    for better_start in (False, True):
        window = None if base.chi < DRIFTING else WINDOW
        search = Search(plant, model.known, setting, window, progress, insist, leave_out)
        found, p_value, large = _asked(base, setting, draws)
        given = None if large else freeze(fit_finely(LastFit.of(base)), setting, base)
        tried = p_value <= SIGNIFICANT if given is None else _worth_a_name(given, setting, p_value)
        explained = accept_effects(search, base, tried)
        better = None if better_start else as_good(base, explained)
        if better is None:
            break
        base = better
    completed = None
    if explained.steps and large:
        forget()  # what was tried is needed no more
    if explained.steps and (given is not None or (search.window is None and explained.state.worst <= LARGE)):
        tell("fitting once more, with finer steps")
        completed = freeze(fit_finely(last_fit(explained.state)), setting, base)
        explained, completed = _less_what_vanished(search, base, explained, completed)
        if given is not None and not _closes(given, completed, setting, base):
            explained, completed = _refuted(explained, search, base), None
        elif surprise(completed.fit, completed.holdout) is not None:
            explained, completed = _gone_on(search, base, explained, completed, setting)
            explained, completed = _less_what_vanished(search, base, explained, completed)
    state, steps = explained.state, explained.steps
    learnable, learnable_after = explained.learnable, explained.learnable_after
    if not large and not steps:
        learnable = learnable_after = nan
    badly = [axis for axis, channel in found.items() if not channel.ratio <= LARGE]
    repeating = bool(learnable >= LEARNABLE)
    if large and p_value <= SIGNIFICANT and not repeating:
        tell("asking whether the missing force repeats")
        foreseen = _foreseen(base, setting, badly)
        learnable, repeating = max(np.nan_to_num(learnable), foreseen), bool(foreseen >= FORESEEN)
        if not repeating and steps and len(setting.recordings) == 1:
            # Of one recording a gust or missed counts repeat in no other part: only the hold-out can say so.
            repeating = _borne_out(base, state, completed, setting, search.window is not None)
    left_repeats = bool(learnable_after >= STILL_LEARNABLE)
    if not steps:
        learnable_after, left_repeats = learnable, repeating
    elif state.worst > LARGE and not left_repeats:
        foreseen = _still_foreseen(state, setting)
        learnable_after, left_repeats = max(np.nan_to_num(learnable_after), foreseen), bool(foreseen >= FORESEEN)
    # What is not large is named only if the hold-out proves it, and then that is alarm enough.
    alarm = bool(repeating and p_value <= SIGNIFICANT) if large else bool(steps)
    if steps and not alarm:  # names for scatter are none, and do not belong into the model
        explained, completed = _refuted(explained, search, base, "what it explains does not repeat"), None
        learnable_after, left_repeats = learnable, repeating
    elif steps and large and _helps_nowhere(base, explained, completed, setting, search.window is not None):
        # That it held on recordings left out is no proof any more that something repeats.
        foreseen, unnamed = _foreseen(base, setting, badly), explained.unnamed
        learnable, alarm = max(np.nan_to_num(unnamed), foreseen), bool(unnamed >= LEARNABLE or foreseen >= FORESEEN)
        explained, completed = _refuted(explained, search, base), None
        learnable_after, left_repeats = learnable, alarm
    return Attempt(
        base,
        search,
        explained,
        found,
        p_value,
        given,
        completed,
        window,
        learnable,
        learnable_after,
        left_repeats,
        alarm,
    )


def _worth_a_name(given: Frozen, setting: Setting, p_value: float) -> bool:
    """Whether names are tried for a model that leaves no large errors.

    What all recordings but one can teach is asked of recordings in the plural.
    """
    if len(setting.recordings) < 2:
        return False
    left = channels(given.fit.batch, given.fit.gram.predicted[0], setting.noise)
    # Where finer steps are another motion, the engine's own error is among what is left.
    limit = NOTICEABLE if given.fit.finer else QUIET
    noticeable = is_large(left, limit) and p_value <= SIGNIFICANT
    return noticeable or surprise(given.fit, given.holdout, NOTICEABLE) is not None


def _borne_out(base: BaseFit, state: State, completed: Frozen | None, setting: Setting, windows: bool) -> bool:
    """Whether what was named closes the gap on a hold-out that shows one."""
    before = freeze(LastFit.of(base), setting, base).holdout.errors
    after = (completed or freeze(last_fit(state), setting, base)).holdout.errors
    gap = worst_ratio(before.window if windows else before.free_run, setting.noise)
    return gap > LARGE and carries_over(before, after, setting.noise, windows=windows)


def _helps_nowhere(
    base: BaseFit, explained: Explained, completed: Frozen | None, setting: Setting, windows: bool
) -> bool:
    """Whether the hold-out, where it may judge what was named, is met as badly with it as without."""
    named = completed or freeze(last_fit(explained.state), setting, base)
    after = named.holdout.errors
    if worst_ratio(after.window if windows else after.free_run, setting.noise) <= LARGE:
        return False
    before = freeze(LastFit.of(base), setting, base).holdout.errors
    if not in_vain(before, after, setting.noise, windows=windows):
        return False
    return off_map(named.plant, {step.chosen.candidate.name for step in explained.steps}, setting.holdout) is None


def _gone_on(
    search: Search, base: BaseFit, explained: Explained, completed: Frozen, setting: Setting
) -> tuple[Explained, Frozen]:
    """What is found beside all that was accepted, if the hold-out that asks for more bears it out."""
    search.progress("the hold-out shows more: going on")
    search.urged = True
    more = accept_effects(search, base, True, explained)
    if {step.chosen.candidate.name for step in more.steps} == {step.chosen.candidate.name for step in explained.steps}:
        refused = more.refused or explained.refused
        return dataclasses.replace(explained, screened=more.screened, refused=refused), completed
    whole = freeze(fit_finely(last_fit(more.state)), setting, base)
    if _closes(completed, whole, setting, base):
        return more, whole
    before = {step.number for step in explained.steps}
    new = [step for step in more.steps if step.number not in before]
    return dataclasses.replace(
        explained, screened=more.screened, refused=[*refused_with(new, _NOT_PROVEN), *more.refused]
    ), completed


def _less_what_vanished(
    search: Search, base: BaseFit, explained: Explained, completed: Frozen
) -> tuple[Explained, Frozen]:
    """Without those of several names that took up the engine's own error alone: finer steps leave nothing of them."""
    for step in explained.steps[::-1]:
        fit, named = completed.fit, {candidate.name: candidate for candidate in explained.state.accepted}
        vain = named.get(step.chosen.candidate.name)
        if len(named) < 2 or not fit.finer or vain is None:
            continue
        mine = np.flatnonzero(np.isin(fit.free, vain.places(fit.engine.table, vain.sizes))).tolist()
        given = transfer(base.engine.table, base.vector, fit.engine.table, fit.vector)
        weighed = (fit.gram.products[0], fit.free, fit.columns, fit.initial, fit.batch, fit.vector, mine, fit.cost)
        if significance_of(*weighed, fit.engine.table, given) >= FAR_FROM_NULL:
            continue
        state = fitted_without(search, explained.state, vain)
        fewer = fit_finely(last_fit(state), _LOOSELY)
        if fewer.finer and fewer.cost <= fit.cost * (1 + SUPERFLUOUS):
            refused = [*refused_with([step], "is gone with finer steps"), *explained.refused]
            steps = [other for other in explained.steps if other is not step]
            explained = dataclasses.replace(explained, state=state, steps=steps, refused=refused)
            completed = freeze(fewer, search.setting, base)
    return explained, completed


def _closes(before: Frozen, after: Frozen, setting: Setting, base: BaseFit) -> bool:
    """Whether what distinguishes two models, which leave little, closes the gap on the hold-out."""
    if before.fit.finer != after.fit.finer:  # with equal steps, lest these be what makes the difference
        before, after = (freeze(dataclasses.replace(m.fit, finer=False), setting, base) for m in (before, after))
    return closes_little(before.holdout, after.holdout)


def _refuted(explained: Explained, search: Search, base: BaseFit, why: str = _NOT_PROVEN) -> Explained:
    """Nothing accepted, for a reason that came to light afterwards."""
    state = nothing_accepted(search, base)
    refused = [*refused_with(explained.steps, why), *explained.refused]
    return Explained(state, [], nan, nan, explained.screened, refused, odd=explained.odd)


def _asked(base: BaseFit, setting: Setting, draws: bool) -> tuple[dict[str, Channel], float, bool]:
    """Errors of every channel, how likely so much structure is, and whether they are large."""
    predicted = base.fits.gram.predicted[0]
    found = channels(base.free_run, predicted, setting.noise)
    return found, significance(base.free_run, predicted, draws=draws), is_large(found)


def as_good(base: BaseFit, explained: Explained) -> BaseFit | None:
    """The model as given, if from the numbers found beside all effects it fits as well without any of them.

    Then nothing was missing but a better start.
    """
    state = explained.state
    if not (explained.steps or explained.curve) or measurements(state.batch) != measurements(base.fitted):
        return None
    better = begun_anew(base, transfer(state.engine.table, state.vector, base.engine.table, base.vector))
    most = min((1 + SUPERFLUOUS) * state.cost, (1 - SUPERFLUOUS) * float(base.fits.cost[0]))
    return better if float(better.fits.cost[0]) < most else None


def _foreseen(base: BaseFit, setting: Setting, axes: Sequence[str]) -> float:
    """Largest share of the missing force of some axes that other recordings foresee, for the model as given.

    On windows a missing force has pulled the parameters less far away than on whole recordings.
    """
    shares: dict[str, float] = {}
    for vector in (base.window_vector, base.vector):
        told = _repeating(base.engine, vector, base.fits.initial[0], base.free_run, setting)
        shares = told | shares
        if all(axis in shares for axis in axes):
            break
    return float(max((shares.get(axis, 0.0) for axis in axes), default=0.0))


def _still_foreseen(state: State, setting: Setting) -> float:
    """The same with what was named in the model, of what that leaves badly met."""
    whole = lanes_for(state.engine.table, state.plant, setting, setting.recordings)
    same = whole.count == state.batch.count and np.array_equal(whole.recording, state.batch.recording)
    initial = state.initial if same else whole.initial
    shares = _repeating(state.engine, state.vector, initial, whole, setting)
    return max((shares.get(axis, 0.0) for axis, ratio in state.ratios.items() if not ratio <= LARGE), default=0.0)


def _repeating(
    engine: Engine, vector: NDArray[np.float64], initial: NDArray[np.float64], batch: Batch, setting: Setting
) -> dict[str, float]:
    predicted = np.asarray(engine.motions(vector, initial, batch)[1])
    return repeating_share(engine.table.unravel(vector), batch, predicted, setting.noise)
