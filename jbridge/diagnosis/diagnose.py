"""`diagnose`: what a model lacks, from recordings, and the proof on recordings that took no part."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ..errors import InputError
from ..identify.base import WINDOW, BaseFit, base_fit, columns_for, measurements
from ..identify.evaluate import Run, evaluate, traces
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
    PROVEN,
    SIGNIFICANT,
    STILL_LEARNABLE,
    carries_over,
    channels,
    is_large,
    significance,
    worst_ratio,
)
from .repeats import repeating_share
from .result import Adequacy, Diagnosis, NamedEffect
from .screen import Screen
from .search import SUPERFLUOUS, Search, state_of
from .tell import HOLDS, Step, location_of, named_of, parameters_of, trials_of
from .trials import EFFECTIVE, State, Trial, accepts, held
from .words import verdict_sentence

MOST_EFFECTS = 6
MOST_WITH_MECHANISMS = 2
"""Effects after which those with a hidden state, which take longest to try, are tried no more."""
DRIFTING = 25.0
"""Free-run error over noise above which whole recordings measure luck, and windows are compared instead."""
NEAR = 1.15
"""Error over noise below which a further effect is not looked for."""
CLOSE = 1.05
"""Error over noise below which even effects with a hidden state have nothing left to explain."""
NONLINEAR = 3.0
"""Error over noise above which a mismatch may be too large for one linear screen of whole recordings."""
MOST = 0.5
"""Least share of the excess that an effect must explain where the model is already adequate."""
STRONG = 0.1
"""Cost, relative to the model without it, at which an effect is taken before those with a hidden state are tried: what
it leaves over is explained in the next round, and it is dropped again if that makes it superfluous."""


def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Finds out whether a model lacks physics, where, and which.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs from which everything is chosen.
        holdout: runs that are opened once, after the model is frozen. Without any, the last quarter of the recordings
            (of the time, if there is one recording) plays that part, and the report says so.
        progress: told what goes on, a short text at a time.

    Returns:
        Verdict, place, named effects with intervals, and the errors before and after on the hold-out.

    Raises:
        InputError: model and recordings do not go together.
    """
    begun = time.perf_counter()
    tell = progress or (lambda text: None)
    notes = [f"{r.name}: {note}" for r in (*recordings, *holdout) for note in r.notes]
    if not holdout:
        recordings, holdout, note = _split(recordings)
        notes.append(note)
    setting = make_setting(model, recordings, holdout)
    plant = resolve(model.plant, setting.length)
    base = base_fit(plant, model.known, setting, progress=progress)
    if not np.isfinite(base.fits.cost[0]):
        names = ", ".join(r.name for r in recordings)
        raise InputError(
            f"{names}: the model's simulation runs away from these recordings; check the signs and units of the inputs "
            "and the model's numbers"
        )
    base_plant = base.engine.table.unravel(base.vector)
    width = columns_for(len(base.free))
    found = channels(base.free_run, base.fits.gram.predicted[0], setting.noise)
    p_value = significance(base.free_run, base.fits.gram.predicted[0])
    large = is_large(found)
    tell("simulating the model as given, refitted")
    window = None if base.chi < DRIFTING else WINDOW
    search = Search(plant, setting, window, progress)
    state, steps, learnable, learnable_after, last = _search(search, base, plant, model, setting, large, p_value, tell)
    badly = [axis for axis, channel in found.items() if channel.ratio > LARGE]
    repeating = learnable >= LEARNABLE
    if large and p_value <= SIGNIFICANT and not repeating:
        tell("asking whether the missing force repeats")
        foreseen = _foreseen(base, setting, badly)
        learnable, repeating = max(learnable, foreseen), foreseen >= FORESEEN
    if steps and search.window is None and state.worst > LARGE and learnable_after < STILL_LEARNABLE:
        predicted = np.asarray(state.engine.motions(state.vector, state.initial, state.batch)[1])
        shares = repeating_share(state.plant, setting.recordings, state.batch, predicted, setting.noise)
        learnable_after = max([learnable_after, *(shares.get(axis, 0.0) for axis in badly)])
    alarm = bool(large and p_value <= SIGNIFICANT and repeating)
    repeats = alarm and state.worst > LARGE and (not steps or learnable_after >= STILL_LEARNABLE)
    curved = search.curve(state) if repeats else None
    state = curved or state
    changed = bool(steps) or curved is not None
    final_plant = state.plant if changed else base_plant
    final_free, final_vector = (state.free, state.vector) if changed else (base.free, base.vector)
    table = ParameterTable(final_plant, setting.units)
    cov = _covariance(state, base, changed)
    values = estimates(table, final_vector, final_free, cov)
    tell("opening the hold-out")
    runs = _evaluate(base_plant, final_plant, setting, width, columns_for(len(final_free)), base)
    shown = traces((base_plant, runs[0]), (final_plant, runs[1]), setting.recordings, "train")
    shown += traces((base_plant, runs[2]), (final_plant, runs[3]), setting.holdout, "holdout")
    left = channels(runs[1].batch, runs[1].predicted, setting.noise)
    # A force without a name makes the simulation usable, but it explains nothing.
    still = bool(alarm and (curved is not None or (is_large(left) and learnable_after >= STILL_LEARNABLE)))
    # The model is frozen, but whoever reads the verdict must be told if the proof fails.
    in_windows = search.window is not None
    proven = carries_over(runs[2].errors, runs[3].errors, setting.noise, windows=in_windows)
    unproven = bool(alarm and steps) and not proven
    held_out = runs[3].errors.window if in_windows else runs[3].errors.free_run
    verdict = "adequate" if not alarm else ("missing_physics" if steps and not still and not unproven else "unknown")
    effects = named_of(steps, state, setting, table, values) if alarm else ()
    at = curved.plant.effects[-1].site if curved is not None else None
    location = location_of(alarm, effects, steps, last, shown, setting, at)
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
        large,
        curve=curved is not None,
        unproven=worst_ratio(held_out, setting.noise) if unproven and not still else None,
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
        trials_of(steps, last, state),
        None,
        tuple(warnings(table, final_vector, final_free, cov)),
        tuple(dict.fromkeys(notes)),
        {
            "large": LARGE,
            "significant": SIGNIFICANT,
            "learnable": LEARNABLE,
            "foreseen": FORESEEN,
            "still_learnable": STILL_LEARNABLE,
            "proven": PROVEN,
            "compared_on": "free runs" if window is None else f"windows of {window:g} s",
            "most_effects": MOST_EFFECTS,
            "effective_samples": EFFECTIVE,
            "seed": 0,
        },
        time.perf_counter() - begun,
    )


def _foreseen(base: BaseFit, setting: Setting, axes: Sequence[str]) -> float:
    """Largest share of the missing force of some axes that other recordings foresee.

    On windows a missing force has pulled the parameters less far away than on whole recordings.
    """
    plant = base.engine.table.unravel(base.window_vector)
    predicted = np.asarray(base.engine.motions(base.window_vector, base.fits.initial[0], base.free_run)[1])
    shares = repeating_share(plant, setting.recordings, base.free_run, predicted, setting.noise)
    return max(shares.get(axis, 0.0) for axis in axes)


def _split(recordings: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...], str]:
    """The last quarter of the recordings, or of the time of a single one, as hold-out."""
    if len(recordings) > 1:
        count = max(1, len(recordings) // 4)
        names = ", ".join(r.name for r in recordings[-count:])
        return (
            tuple(recordings[:-count]),
            tuple(recordings[-count:]),
            f"No hold-out was given: {names} took no part in the choice and serves as one.",
        )
    only = recordings[0]
    cut = int(0.75 * len(only.times))
    if min(cut, len(only.times) - cut) < 50:
        raise InputError(
            f"{only.name}: {len(only.times)} rows are too few to keep a quarter of them as hold-out; "
            "record longer, or give another recording with --holdout"
        )
    return (
        (_rows(only, slice(None, cut)),),
        (_rows(only, slice(cut, None)),),
        f"There is one recording: its last quarter, from {only.times[cut] - only.times[0]:.3g} s, took no part in the "
        "choice and serves as hold-out.",
    )


def _rows(recording: Recording, rows: slice) -> Recording:
    arrays = {
        name: getattr(recording, name)[rows]
        for name in ("u_x", "u_l", "x", "psi", "l")
        if getattr(recording, name) is not None
    }
    return dataclasses.replace(
        recording,
        times=recording.times[rows],
        fresh={name: flag[rows] for name, flag in recording.fresh.items()},
        extras={name: values[rows] for name, values in recording.extras.items()},
        **arrays,
    )


def _search(
    search: Search,
    base: BaseFit,
    plant: Plant,
    model: Model,
    setting: Setting,
    large: bool,
    p_value: float,
    tell: Callable[[str], None],
) -> tuple[State, list[Step], float, float, tuple[Screen | None, list[Trial]]]:
    """Accepts one explanation after the other; also the learnable share before and after."""
    state = state_of(base.engine, base.free_run, base.fits, model.known)
    if search.window is not None:
        start = base.engine.table.unravel(base.window_vector)
        guess = lanes_for(base.engine.table, plant, setting, setting.recordings, search.window).initial
        state = search.polish(start, model.known, guess, ())
    first = state, search.window
    steps: list[Step] = []
    if not large or p_value > SIGNIFICANT:
        return state, steps, 0.0, 0.0, (None, [])
    learnable, after = 0.0, 0.0
    last: tuple[Screen | None, list[Trial]] = (None, [])
    for _ in range(MOST_EFFECTS):
        screened, trials = _weigh(search, state)
        after = screened.learnable
        if not steps:
            learnable = screened.learnable
        last = (screened, trials)
        # What a linear screen could not foresee must prove itself the more by simulation.
        least = HOLDS if after >= LEARNABLE else LEARNABLE
        if state.worst < LARGE:
            # What no longer raises an alarm needs a further effect only if that explains most of it.
            least = MOST
        reasons = {t.candidate.name: accepts(state, t, least) for t in trials}
        passed = [t for t in trials if not reasons[t.candidate.name]]
        if not passed:
            break
        chosen = passed[0]
        share = min(held(state, chosen), 1.0)
        if not steps:
            learnable = max(learnable, share)
        tell(f"found {chosen.candidate.kind.replace('_', ' ')} at {chosen.candidate.site.replace('_', ' ')}")
        state = search.polish(chosen.plant, chosen.known, chosen.initial, (*state.accepted, chosen.candidate))
        steps.append(Step(len(steps) + 1, chosen, trials, {name: why for name, why in reasons.items() if why}))
        state = search.simplify(state)
        steps[-1] = _as_simplified(steps[-1], state)
        after = 0.0
        if search.window is not None:
            state = _back_to_free_runs(search, state)
        if len(steps) > 1 and chosen.candidate.unscreened:
            state, steps = _alone(search, first, state, steps)
        if state.chi < NEAR and state.worst < LARGE:
            break
    else:
        after = learnable
    if len(steps) > 1:
        state = search.prune(state)
        steps = _by_gap_closed(steps, state)
    if steps and search.window is not None:
        # Parameters are sharpest, and errors are reported, on whole recordings.
        state = _back_to_free_runs(search, state)
    return state, steps, learnable, after, last


def _as_simplified(step: Step, state: State) -> Step:
    """The step with the law that was accepted in the end, with its fit in place of the refit that stopped short."""
    final = state.accepted[-1]
    if final.name == step.chosen.candidate.name:
        return step
    extra = sum(state.engine.table.entry(int(place)).group.startswith(f"{final.kind}@") for place in state.free)
    simple = Trial(**state.shared(), candidate=final, z=step.chosen.z, extra=extra)
    trials = [simple, *(trial for trial in step.trials if trial.candidate.name != final.name)]
    refused = {name: why for name, why in step.refused.items() if name != final.name}
    refused[step.chosen.candidate.name] = "a simpler law explains as much"
    return Step(step.number, simple, trials, refused)


def _by_gap_closed(steps: list[Step], state: State) -> list[Step]:
    """Steps whose effects were kept, first that without which the model would be worst."""
    kept = {candidate.name for candidate in state.accepted}
    left = [step for step in steps if step.chosen.candidate.name in kept]
    return sorted(left, key=lambda step: -state.without.get(step.chosen.candidate.name, 0.0))


def _alone(
    search: Search, first: tuple[State, float | None], state: State, steps: list[Step]
) -> tuple[State, list[Step]]:
    """An effect with a hidden state in place of all that was accepted before it, if it explains as much.

    What it does may have been explained piecemeal, and from there a fit does not find the way back.
    """
    begin, window = first
    outer, search.window = search.window, window
    trials = search.mechanisms(begin, steps[-1].chosen.candidate.name)
    alone = None
    if trials:
        trial = trials[0]
        alone = search.polish(trial.plant, trial.known, trial.initial, (trial.candidate,))
        if search.window is not None:
            alone = _back_to_free_runs(search, alone)
    same = alone is not None and measurements(alone.batch) == measurements(state.batch)
    if alone is None or not same or alone.cost > state.cost * (1 + SUPERFLUOUS):
        search.window = outer
        return state, steps
    others = [trial for trial in steps[0].trials if trial.candidate.name != trials[0].candidate.name]
    ranked = sorted([trials[0], *others], key=lambda t: t.score)
    refused = {name: why for name, why in steps[0].refused.items() if name != trials[0].candidate.name}
    return alone, [Step(1, trials[0], ranked, refused)]


def _weigh(search: Search, state: State) -> tuple[Screen, list[Trial]]:
    """Refits what is promising, looking the closer the less that explains."""
    screened = search.look(state)
    trials = search.refit(state, screened)
    if search.window is None and state.chi > NONLINEAR and not _explained(trials, NEAR):
        screened = search.look_closer(state, screened)
        trials += search.refit(state, screened, trials)
    elif not _explained(trials, LARGE):
        trials += search.refit(state, screened, trials)
    strong = any(t.cost < STRONG * state.cost for t in trials)
    if not strong and len(state.accepted) < MOST_WITH_MECHANISMS and not _explained(trials, CLOSE):
        trials += search.mechanisms(state)
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


def _covariance(state: State, base: BaseFit, accepted: bool) -> Any:
    if accepted:
        width = columns_for(len(state.free))
        gram = state.engine.gram(state.vector[None], state.free[None], state.initial[None], state.batch, columns=width)
        return covariance(gram.products[0], gram.predicted[0], len(state.free), width, state.initial, state.batch)
    return covariance(
        base.fits.gram.products[0],
        base.fits.gram.predicted[0],
        len(base.free),
        columns_for(len(base.free)),
        base.fits.initial[0],
        base.free_run,
    )


def _evaluate(
    before: Plant, after: Plant, setting: Setting, width: int, width_after: int, base: BaseFit
) -> tuple[Run, Run, Run, Run]:
    like = (base.free_run, base.windows)
    with ThreadPoolExecutor(2) as pool:  # the compiler and the programs release the interpreter
        one = pool.submit(evaluate, after, setting, setting.recordings, width_after, like)
        two = pool.submit(evaluate, before, setting, setting.recordings, width, like)
        three = pool.submit(evaluate, after, setting, setting.holdout, width_after, like)
        four = pool.submit(evaluate, before, setting, setting.holdout, width, like)
        return two.result(), one.result(), four.result(), three.result()
