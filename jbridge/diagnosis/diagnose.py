"""`diagnose`: what a model lacks, from recordings, and the proof on recordings that took no part."""

import dataclasses
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._programs import forget
from ..identify.base import WINDOW, BaseFit, base_fit, begun_anew, check_runs, columns_for, measurements
from ..identify.evaluate import Run, evaluate, traces
from ..identify.finer import LastFit, fit_finely
from ..identify.lanes import Batch
from ..identify.linearise import Engine
from ..identify.result import Errors, Estimate
from ..identify.setting import Setting, lanes_for, make_setting, resolve
from ..identify.uncertainty import as_uncertainty, covariance, estimates, warnings
from ..model.files import Model
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..recordings import Recording
from .adequacy import (
    FORESEEN,
    LARGE,
    LEARNABLE,
    NOTICEABLE,
    PROVEN,
    SIGNIFICANT,
    STILL_LEARNABLE,
    carries_over,
    channels,
    closes_little,
    is_large,
    significance,
    worst_ratio,
)
from .contend import contenders, continued, nearest
from .curve import force_without_a_name
from .design import next_experiment
from .holdout import off_map, split_off
from .limits import not_seen
from .locate import equation_of
from .missing import missing_forces
from .repeats import repeating_share
from .result import Adequacy, Channel, Diagnosis, Former, NamedEffect
from .revise import SUPERFLUOUS
from .rounds import DRIFTING, MOST_EFFECTS, Explained, accept_effects
from .search import BOOTSTRAP, PARTS, Search, state_of
from .surprise import surprise
from .tell import location_of, named_of, parameters_of, trials_of
from .trials import EFFECTIVE, State, transfer
from .words import Elsewhere, Proof, verdict_sentence


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    new: Sequence[Recording] = (),
    former: Former | None = None,
    leave_out: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Finds out whether a model lacks physics, where, and which.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs from which everything is chosen.
        holdout: runs from which no number is learned; they say whether names that explain a small error are kept, and
            whether any are looked for where the recordings hardly show one. If several show what the recordings do
            not, the worst is learned from after all, in a second diagnosis. Without any, the last quarter of the
            recordings (of the time, if there is one recording) plays their part. The report says so.
        new: further runs from which everything is chosen, made since an earlier diagnosis; never held out.
        former: that diagnosis. What it named or could not rule out is refitted whatever is expected of it.
        leave_out: of "rescreening", "seeds" and "bootstrap", what is done without, to measure what it is worth:
            screening anew after each acceptance, more than one seed of an effect, and a significance from drawn signs.
        progress: told what goes on, a short text at a time.

    Returns:
        Verdict, place, named effects with intervals, and the errors before and after on the hold-out.

    Raises:
        InputError: model and recordings do not go together.
        ValueError: `leave_out` names something else.
    """
    if unheard := set(leave_out) - set(PARTS):
        raise ValueError(f"a diagnosis can do without {', '.join(PARTS)}, and not without {', '.join(sorted(unheard))}")
    begun = time.perf_counter()
    notes = [f"{r.name}: {note}" for r in (*recordings, *new, *holdout) for note in r.notes]
    given = bool(holdout)
    if not given:
        recordings, holdout, note = split_off(recordings)
        notes.append(note)
    found: Diagnosis | _Plan = _Plan(
        model, (*recordings, *new), tuple(holdout), tuple(new), former, frozenset(leave_out), tuple(notes), given
    )
    while isinstance(found, _Plan):
        found = _diagnose(found, progress)
    return dataclasses.replace(found, seconds=time.perf_counter() - begun)


@dataclasses.dataclass(frozen=True)
class _Plan:
    """What is to be diagnosed."""

    model: Model
    recordings: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    new: tuple[Recording, ...]
    former: Former | None
    leave_out: frozenset[str]
    notes: tuple[str, ...]
    spare: bool
    """Whether a recording of the hold-out may be learned from, if others show the same."""
    surprised: str | None = None
    """The channel for which one was."""

    def taking_in(self, index: int, channel: str) -> "_Plan":
        """The same with a recording of the hold-out to learn from."""
        taken = self.holdout[index]
        note = f"{taken.name} was learned from, too: it shows what the other recordings hardly do."
        return dataclasses.replace(
            self,
            recordings=(*self.recordings, taken),
            holdout=self.holdout[:index] + self.holdout[index + 1 :],
            notes=(*self.notes, note),
            spare=False,
            surprised=channel,
        )


def _diagnose(plan: _Plan, progress: Callable[[str], None] | None) -> "Diagnosis | _Plan":
    """The diagnosis, or a plan for another one that learns from a hold-out which the recordings did not prepare for."""
    tell = progress or (lambda text: None)
    model, recordings, holdout = plan.model, plan.recordings, plan.holdout
    new, former, leave_out, notes = plan.new, plan.former, plan.leave_out, plan.notes
    setting = make_setting(model, recordings, holdout)
    plant = resolve(model.plant, setting.length)
    base = base_fit(plant, model.known, setting, progress=progress)
    check_runs(base, recordings)
    tell("simulating the model as given, refitted")
    insist = former.names if former else frozenset()
    draws = BOOTSTRAP not in leave_out
    for better_start in (False, True):
        window = None if base.chi < DRIFTING else WINDOW
        search = Search(plant, model.known, setting, window, progress, insist, leave_out)
        found, p_value, large = _asked(base, setting, draws)
        given = None if large else _freeze(fit_finely(LastFit.of(base)), setting, base)
        tried = p_value <= SIGNIFICANT if given is None else _worth_a_name(given, setting, p_value)
        explained = accept_effects(search, base, tried)
        better = _as_good(base, explained)
        if better is None or better_start:
            break
        base = better
    state, steps = explained.state, explained.steps
    completed = None
    if given is not None and steps:
        tell("fitting once more, with finer steps")
        completed = _freeze(fit_finely(_last_fit(state)), setting, base)
        if not closes_little(given.holdout, completed.holdout):
            explained, completed = _refuted(explained, search, base), None
            state, steps = explained.state, explained.steps
    learnable, learnable_after = explained.learnable, explained.learnable_after
    if not large and not steps:
        learnable = learnable_after = nan
    badly = [axis for axis, channel in found.items() if not channel.ratio <= LARGE]
    repeating = learnable >= LEARNABLE
    if large and p_value <= SIGNIFICANT and not repeating:
        tell("asking whether the missing force repeats")
        foreseen = _foreseen(base, setting, badly)
        learnable, repeating = max(np.nan_to_num(learnable), foreseen), foreseen >= FORESEEN
    left_repeats = bool(learnable_after >= STILL_LEARNABLE)
    if not steps:
        learnable_after, left_repeats = learnable, repeating
    elif state.worst > LARGE and not left_repeats:
        foreseen = _still_foreseen(state, setting)
        learnable_after, left_repeats = max(np.nan_to_num(learnable_after), foreseen), foreseen >= FORESEEN
    # What is not large is named only if the hold-out proves it, and then that is alarm enough.
    alarm = bool(repeating and p_value <= SIGNIFICANT) if large else bool(steps)
    curved = force_without_a_name(search, state) if alarm and state.worst > LARGE and left_repeats else None
    changed = bool(steps) or curved is not None
    if steps:
        forget()  # what was tried is needed no more
    if given is not None:
        first, last = given, completed or given
    else:
        final = _last_fit(state) if changed else LastFit.of(base)
        if curved is None:
            tell("fitting once more, with finer steps")
            final = fit_finely(final)
        tell("opening the hold-out")
        last = _freeze(final if curved is None else _last_fit(curved), setting, base)
        # Of two, only the completed one leaves so little that finer steps show.
        first = _freeze(LastFit.of(base), setting, base) if changed else last
    values, told_hardly = _numbers(last.fit if curved is None else _last_fit(state), setting)
    if curved is not None:
        values = _numbers(last.fit, setting)[0] | values
        state = curved
    runs = first.train, last.train, first.holdout, last.holdout
    base_plant, final_plant = first.plant, last.plant
    table = ParameterTable(final_plant, setting.units)
    # Windows say nothing of free runs, and a force without a name explains nothing.
    judged = curved is None and search.window is None
    unprepared = surprise(last.fit, last.holdout) if judged else None
    if unprepared is not None and plan.spare and len(unprepared.recordings) > 1:
        tell("learning from a recording of the hold-out, too")
        return plan.taking_in(unprepared.recordings[0], unprepared.channel)
    shown = traces((base_plant, runs[0]), (final_plant, runs[1]), setting.recordings, "train")
    shown += traces((base_plant, runs[2]), (final_plant, runs[3]), setting.holdout, "holdout")
    left = channels(runs[1].batch, runs[1].predicted, setting.noise)
    # A force without a name makes the simulation usable, but it explains nothing.
    still = bool(alarm and (curved is not None or (is_large(left) and left_repeats)))
    # The model is frozen, but whoever reads the verdict must be told if the proof fails.
    in_windows = search.window is not None
    proven = carries_over(runs[2].errors, runs[3].errors, setting.noise, windows=in_windows)
    unproven = bool(alarm and steps) and not proven
    abroad = off_map(final_plant, {step.chosen.candidate.name for step in steps}, setting.holdout) if unproven else None
    if abroad is not None:
        # Only the other drive's axis knows nothing of where this one is.
        others = tuple(_without(run.errors, (abroad.axis, "psi")) for run in runs[2:])
        if is_large(left) or not carries_over(others[0], others[1], setting.noise, windows=in_windows):
            abroad = None
    # A map explains all that was recorded, and the hold-out asks for places where nobody has been.
    unproven = unproven and abroad is None
    before, after = (
        worst_ratio(run.errors.window if in_windows else run.errors.free_run, setting.noise) for run in runs[2:]
    )
    proof = Proof(before, after, f"windows of {WINDOW:g} s" if in_windows else "free runs")
    odd_one = None
    if not alarm and unprepared is None and large and plan.surprised:
        odd_one = Elsewhere(plan.surprised, plan.recordings[-1].name, nan)
    elsewhere = None
    if unprepared is not None:
        elsewhere = Elsewhere(unprepared.channel, holdout[unprepared.recordings[0]].name, unprepared.ratio)
    beyond = odd_one or elsewhere
    if not alarm:
        verdict = "adequate" if beyond is None else "unknown"
    else:
        verdict = "missing_physics" if steps and not still and not unproven else "unknown"
    effects = named_of(steps, state, setting, table, values) if alarm else ()
    rivals = contenders(search, state, steps, effects)
    if verdict == "unknown" and not rivals:
        rivals = nearest(state, explained.refused)
    experiment = next_experiment(rivals, setting, tell) if rivals else None
    at = curved.plant.effects[-1].site if curved is not None else None
    train = [trace for trace in shown if trace.role == "train"]
    # Of small errors a force with no law assumed would be noise.
    latent = missing_forces(base, in_windows, train, tell) if alarm and large else None
    location = location_of(alarm, effects, steps, explained.screened, shown, at, latent)
    if not alarm and beyond is not None:
        location = dataclasses.replace(location, site=None, equation=equation_of(beyond.channel))
    known_in = {(e.kind, e.site) for e in plant.effects}
    own = tuple(
        NamedEffect(e.kind, e.site, None, parameters_of(e.kind, e.site, values), (), "")
        for e in final_plant.effects
        if (e.kind, e.site) in known_in
    )
    shown_before = channels(runs[0].batch, runs[0].predicted, setting.noise) if alarm else found
    statement = verdict_sentence(
        verdict,
        effects,
        location,
        shown_before,
        left,
        proof,
        large=large,
        asked=p_value <= SIGNIFICANT,
        curve=curved is not None,
        unproven=unproven and not still,
        abroad=abroad,
        elsewhere=elsewhere,
        odd_one=odd_one,
    )
    return Diagnosis(
        verdict,
        statement,
        Adequacy(alarm, p_value, learnable, learnable_after, found),
        location,
        effects,
        own,
        {name: e for name, e in values.items() if "@" not in name},
        dataclasses.replace(model, plant=base_plant),
        dataclasses.replace(model, plant=final_plant, known=state.known, uncertainty=as_uncertainty(values)),
        runs[0].errors,
        runs[1].errors,
        runs[2].errors,
        runs[3].errors,
        setting.noise,
        WINDOW,
        tuple(r.name for r in setting.holdout),
        shown,
        trials_of(steps, explained.refused),
        not_seen(search, state, {(rival.kind, rival.site) for effect in effects for rival in effect.equivalents}),
        experiment,
        None if former is None else continued(former, effects, [r.name for r in new]),
        told_hardly,
        tuple(dict.fromkeys(notes)),
        {
            "large": LARGE,
            "noticeable": NOTICEABLE,
            "significant": SIGNIFICANT,
            "learnable": LEARNABLE,
            "foreseen": FORESEEN,
            "still_learnable": STILL_LEARNABLE,
            "proven": PROVEN,
            "compared_on": "free runs" if window is None else f"windows of {window:g} s",
            "most_effects": MOST_EFFECTS,
            "effective_samples": EFFECTIVE,
            "seed": 0,
            "left_out": sorted(leave_out),
        },
        0.0,  # told by whoever asked
    )


class _Frozen(NamedTuple):
    """A model whose numbers are settled, and how it meets what it was and was not learned from."""

    fit: LastFit
    plant: Plant
    train: Run
    holdout: Run


def _freeze(fitted: LastFit, setting: Setting, base: BaseFit) -> _Frozen:
    """The runs of a fitted model; `base` has programs that are compiled anyway."""
    plant = fitted.engine.table.unravel(fitted.vector)
    like = (base.free_run, base.windows)
    with ThreadPoolExecutor(2) as pool:  # the compiler and the programs release the interpreter
        train, holdout = (
            pool.submit(evaluate, plant, setting, which, fitted.columns, like, finer=fitted.finer)
            for which in (setting.recordings, setting.holdout)
        )
    return _Frozen(fitted, plant, train.result(), holdout.result())


def _worth_a_name(given: _Frozen, setting: Setting, p_value: float) -> bool:
    """Whether names are tried for a model that leaves no large errors.

    What all recordings but one can teach is asked of recordings in the plural.
    """
    if len(setting.recordings) < 2:
        return False
    left = channels(given.fit.batch, given.fit.gram.predicted[0], setting.noise)
    noticeable = is_large(left, NOTICEABLE) and p_value <= SIGNIFICANT
    return noticeable or surprise(given.fit, given.holdout, NOTICEABLE) is not None


def _refuted(explained: Explained, search: Search, base: BaseFit) -> Explained:
    """Nothing accepted: what explained a small error does not on the hold-out."""
    state = state_of(base.engine, base.free_run, base.fits, search.known)
    refused = [
        (trial, "does not hold on the hold-out" if trial is step.chosen else step.refused.get(trial.candidate.name, ""))
        for step in explained.steps
        for trial in step.trials
    ]
    refused = [(trial, why or "explains less") for trial, why in refused]
    return Explained(state, [], nan, nan, explained.screened, [*refused, *explained.refused])


def _asked(base: BaseFit, setting: Setting, draws: bool) -> tuple[dict[str, Channel], float, bool]:
    """Errors of every channel, how likely so much structure is, and whether they are large."""
    predicted = base.fits.gram.predicted[0]
    found = channels(base.free_run, predicted, setting.noise)
    return found, significance(base.free_run, predicted, draws=draws), is_large(found)


def _as_good(base: BaseFit, explained: Explained) -> BaseFit | None:
    """The model as given, if from the numbers found beside all effects it fits as well without any of them.

    Then nothing was missing but a better start.
    """
    state = explained.state
    if not explained.steps or measurements(state.batch) != measurements(base.fitted):
        return None
    better = begun_anew(base, transfer(state.engine.table, state.vector, base.engine.table, base.vector))
    most = min((1 + SUPERFLUOUS) * state.cost, (1 - SUPERFLUOUS) * float(base.fits.cost[0]))
    return better if float(better.fits.cost[0]) < most else None


def _without(errors: Errors, axes: Sequence[str]) -> Errors:
    free_run, window = (
        {axis: e for axis, e in part.items() if axis not in axes} for part in (errors.free_run, errors.window)
    )
    return Errors(free_run, window)


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
    return max((shares.get(axis, 0.0) for axis in axes), default=0.0)


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


def _last_fit(state: State) -> LastFit:
    width = columns_for(len(state.free))
    gram = state.engine.gram(state.vector[None], state.free[None], state.initial[None], state.batch, columns=width)
    return LastFit(state.engine, state.vector, state.free, state.initial, gram, state.batch)


def _numbers(fitted: LastFit, setting: Setting) -> tuple[dict[str, Estimate], tuple[str, ...]]:
    """A model's numbers with their intervals, and what the recordings hardly tell."""
    count = len(fitted.free)
    cov = covariance(
        fitted.gram.products[0], fitted.gram.predicted[0], count, fitted.columns, fitted.initial, fitted.batch
    )
    table = ParameterTable(fitted.engine.table.unravel(fitted.vector), setting.units)
    told = estimates(table, fitted.vector, fitted.free, cov, setting.period)
    return told, tuple(warnings(table, fitted.vector, fitted.free, cov))
