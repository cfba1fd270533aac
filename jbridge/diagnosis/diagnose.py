"""`diagnose`: what a model lacks, from recordings, and the proof on recordings that took no part."""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..identify.base import WINDOW, BaseFit, base_fit, chi, columns_for, measurements
from ..identify.evaluate import Run, evaluate, traces
from ..identify.result import Estimate
from ..identify.setting import Setting, lanes_for, make_setting, resolve
from ..identify.uncertainty import as_uncertainty, covariance, estimates, warnings
from ..model.effects.base import AXIS_OF_SITE, SITES
from ..model.files import Model
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..recordings import Recording
from .adequacy import LARGE, LEARNABLE, SIGNIFICANT, channels, is_large, significance
from .candidates import WRONG_VALUE
from .locate import equation_of, intervals, region
from .result import Adequacy, Diagnosis, Location, NamedEffect, Rival
from .screen import Screen
from .search import EFFECTIVE, Search, State, Trial, accepts, first_state, held
from .words import effect_sentence, verdict_sentence

MOST_EFFECTS = 6
DRIFTING = 25.0
"""Free-run error over noise above which whole recordings measure luck, and windows are compared instead."""
NEAR = 1.15
"""Error over noise below which a further effect is not looked for."""
HOLDS = 0.1
"""Least share of the excess over noise that an effect must remove from recordings left out."""
RIVAL = 0.01
"""Least probability, relative to the winner's, of an explanation that counts as not told apart."""


@dataclasses.dataclass
class Step:
    """One acceptance: what was chosen, and from which trials."""

    chosen: Trial
    trials: list[Trial]
    before: float


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
    base_plant = base.engine.table.unravel(base.vector)
    width = columns_for(len(base.free))
    found = channels(base.free_run, base.fits.gram.predicted[0], setting.noise)
    p_value = significance(base.free_run, base.fits.gram.predicted[0])
    large = is_large(found)
    tell("simulating the model as given, refitted")
    window = None if base.chi < DRIFTING else WINDOW
    search = Search(setting, window, progress)
    state, steps, learnable, learnable_after, last = _search(search, base, plant, model, setting, large, p_value, tell)
    alarm = large and p_value <= SIGNIFICANT and learnable >= LEARNABLE
    final_plant = state.plant if steps else base_plant
    final_free, final_vector = (state.free, state.vector) if steps else (base.free, base.vector)
    table = ParameterTable(final_plant, setting.units)
    cov = _covariance(state, base, bool(steps))
    values = estimates(table, final_vector, final_free, cov)
    tell("opening the hold-out")
    runs = _evaluate(base_plant, final_plant, setting, width, columns_for(len(final_free)), base)
    shown = traces((base_plant, runs[0]), (final_plant, runs[1]), setting.recordings, "train")
    shown += traces((base_plant, runs[2]), (final_plant, runs[3]), setting.holdout, "holdout")
    left = channels(runs[1].batch, runs[1].predicted, setting.noise)
    if steps and not is_large(left):
        learnable_after = min(learnable_after, LEARNABLE)
    still = alarm and is_large(left) and learnable_after >= LEARNABLE
    verdict = "adequate" if not alarm else ("missing_physics" if steps and not still else "unknown")
    effects = _named(steps, state, setting, table, values) if alarm else ()
    location = _location(alarm, effects, steps, last, shown, setting)
    known_in = {(e.kind, e.site) for e in plant.effects}
    own = tuple(
        NamedEffect(e.kind, e.site, None, _parameters(e.kind, e.site, values), (), "")
        for e in final_plant.effects
        if (e.kind, e.site) in known_in
    )
    statement = verdict_sentence(verdict, effects, location, found, left, learnable, large, steps_held=bool(steps))
    return Diagnosis(
        verdict,
        statement,
        Adequacy(alarm, p_value, learnable, learnable_after, found),
        location,
        effects,
        own,
        {name: e for name, e in values.items() if "@" not in name},
        dataclasses.replace(model, plant=base_plant),
        dataclasses.replace(model, plant=final_plant, uncertainty=as_uncertainty(values)),
        runs[0].errors,
        runs[1].errors,
        runs[2].errors,
        runs[3].errors,
        setting.noise,
        WINDOW,
        tuple(r.name for r in setting.holdout),
        shown,
        _trials(steps, last, state),
        None,
        tuple(warnings(table, final_vector, final_free, cov)),
        tuple(dict.fromkeys(notes)),
        {
            "large": LARGE,
            "significant": SIGNIFICANT,
            "learnable": LEARNABLE,
            "compared_on": "free runs" if window is None else f"windows of {window:g} s",
            "most_effects": MOST_EFFECTS,
            "effective_samples": EFFECTIVE,
            "seed": 0,
        },
        time.perf_counter() - begun,
    )


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
    state = first_state(plant, model.known, setting, base.free_run, base.engine, base.fits)
    if search.window is not None:
        start = base.engine.table.unravel(base.window_vector)
        guess = lanes_for(base.engine.table, plant, setting, setting.recordings, search.window).initial
        state = search.polish(start, model.known, guess, ())
    steps: list[Step] = []
    if not large or p_value > SIGNIFICANT:
        return state, steps, 0.0, 0.0, (None, [])
    learnable, after = 0.0, 0.0
    last: tuple[Screen | None, list[Trial]] = (None, [])
    for _ in range(MOST_EFFECTS):
        screened = search.look(state)
        after = screened.learnable
        if not steps:
            learnable = screened.learnable
        trials = search.refit(state, screened)
        if not _explained(trials):
            trials = sorted(trials + search.refit(state, screened, trials), key=lambda t: t.score)
        if not _explained(trials):
            trials = sorted(trials + search.mechanisms(state), key=lambda t: t.score)
        last = (screened, trials)
        # What a linear screen could not foresee must prove itself the more by simulation.
        least = HOLDS if after >= LEARNABLE else LEARNABLE
        passed = [t for t in trials if not accepts(state, t, least)]
        if not passed:
            break
        chosen = passed[0]
        share = min(held(state, chosen), 1.0)
        if not steps:
            learnable = max(learnable, share)
        before = state.chi
        tell(f"found {chosen.candidate.kind.replace('_', ' ')} at {chosen.candidate.site.replace('_', ' ')}")
        state = search.polish(chosen.plant, chosen.known, chosen.initial, (*state.accepted, chosen.candidate))
        steps.append(Step(chosen, trials, before))
        after = 0.0
        if state.chi < NEAR:
            break
        if search.window is not None:
            state = _back_to_free_runs(search, state)
    if steps and search.window is not None:
        # Parameters are sharpest, and errors are reported, on whole recordings.
        state = _back_to_free_runs(search, state)
    return state, steps, learnable, after, last


def _explained(trials: Sequence[Trial]) -> bool:
    """Whether some trial leaves little more than noise."""
    return any(t.cost < LARGE**2 * measurements(t.batch) for t in trials)


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
    return (
        evaluate(before, setting, setting.recordings, width, like),
        evaluate(after, setting, setting.recordings, width_after, like),
        evaluate(before, setting, setting.holdout, width, like),
        evaluate(after, setting, setting.holdout, width_after, like),
    )


def _weights(step: Step) -> dict[tuple[str, str], float]:
    """Probability of every explanation of a step."""
    scores = np.array([t.score for t in step.trials])
    odds = np.exp(-0.5 * (scores - scores.min()))
    return {t.candidate.name: float(o / odds.sum()) for t, o in zip(step.trials, odds, strict=True)}


def _named(
    steps: list[Step], state: State, setting: Setting, table: ParameterTable, values: dict[str, Estimate]
) -> tuple[NamedEffect, ...]:
    out = []
    for step in steps:
        kind, site = step.chosen.candidate.name
        weights = _weights(step)
        own = weights[(kind, site)]
        parameters = {"value": values[site]} if kind == WRONG_VALUE else _parameters(kind, site, values)
        rivals: list[Rival] = []
        for trial in step.trials:
            name = trial.candidate.name
            if name == (kind, site) or weights[name] < RIVAL * own or len(rivals) == 3:
                continue
            rivals.append(_rival(trial, weights[name], setting))
        out.append(
            NamedEffect(kind, site, own, parameters, tuple(rivals), effect_sentence(kind, site, parameters, rivals))
        )
    return tuple(out)


def _rival(trial: Trial, probability: float, setting: Setting) -> Rival:
    kind, site = trial.candidate.name
    table = ParameterTable(trial.plant, setting.units)
    vector = np.array(table.ravel(trial.plant))
    width = columns_for(len(trial.free))
    gram = trial.engine.gram(trial.vector[None], trial.free[None], trial.initial[None], trial.batch, columns=width)
    cov = covariance(gram.products[0], gram.predicted[0], len(trial.free), width, trial.initial, trial.batch)
    names = [trial.engine.table.entry(int(p)).name for p in trial.free]
    free = np.array([table.positions(name)[0] for name in names])
    values = estimates(table, vector, free, cov)
    parameters = {"value": values[site]} if kind == WRONG_VALUE else _parameters(kind, site, values)
    run = evaluate(trial.plant, setting, setting.holdout, width, (trial.batch, None))
    return Rival(kind, site, probability, parameters, run.errors.free_run)


def _parameters(kind: str, site: str, values: dict[str, Estimate]) -> dict[str, Estimate]:
    prefix = f"{kind}@{site}."
    return {name.removeprefix(prefix): e for name, e in values.items() if name.startswith(prefix)}


def _location(
    alarm: bool,
    effects: tuple[NamedEffect, ...],
    steps: list[Step],
    last: tuple[Screen | None, list[Trial]],
    shown: Sequence[Any],
    setting: Setting,
) -> Location:
    if not alarm:
        return Location(None, "none", {}, (), ())
    sites: dict[str, float] = {}
    if steps:
        for (kind, site), weight in _weights(steps[0]).items():
            place = site if kind != WRONG_VALUE else _site_of_number(site)
            sites[place] = sites.get(place, 0.0) + weight
    else:
        screened = last[0]
        ranked = [] if screened is None else screened.ranked
        least = min((r.cost for r in ranked), default=1.0)
        for r in ranked:
            place = r.candidate.site if r.candidate.kind != WRONG_VALUE else _site_of_number(r.candidate.site)
            odds = math.exp(-0.5 * EFFECTIVE * math.log(max(r.cost, 1e-9) / max(least, 1e-9)))
            sites[place] = max(sites.get(place, 0.0), odds)
        total = sum(sites.values())
        sites = {place: value / total for place, value in sites.items()} if total > 0 else {}
    sites = dict(sorted(sites.items(), key=lambda item: -item[1]))
    sites = {site: value for site, value in sites.items() if value > 1e-4}
    at: str | None = next(iter(sites), None)
    if effects:
        at = effects[0].site if effects[0].site in SITES else _site_of_number(effects[0].site)
    axis = AXIS_OF_SITE[at] if at is not None else None
    train = [trace for trace in shown if trace.role == "train"]
    where = region(train, axis) if axis is not None else ()
    when = intervals(train, axis, setting.noise) if axis is not None and axis in setting.noise else ()
    return Location(at, equation_of(axis), sites, where, when)


def _site_of_number(name: str) -> str:
    """The site that a wrong number of the bridge belongs to."""
    return {"cart_mass": "cart", "load_mass": "swing", "winch_mass": "hoist"}.get(name, "cart")


def _trials(steps: list[Step], last: tuple[Screen | None, list[Trial]], state: State) -> tuple[dict[str, object], ...]:
    rows = []
    for number, step in enumerate(steps, start=1):
        for trial in step.trials:
            rows.append(
                {
                    "round": number,
                    "kind": trial.candidate.kind,
                    "site": trial.candidate.site,
                    "ratio": chi(trial.cost, trial.batch),
                    "cross_validated": chi(trial.cross_validated, trial.batch),
                    "accepted": trial is step.chosen,
                    "why": "" if trial is step.chosen else "explains less",
                }
            )
    shown = {id(t) for step in steps for t in step.trials}
    for trial in last[1]:
        if id(trial) not in shown:
            rows.append(
                {
                    "round": len(steps) + 1,
                    "kind": trial.candidate.kind,
                    "site": trial.candidate.site,
                    "ratio": chi(trial.cost, trial.batch),
                    "cross_validated": chi(trial.cross_validated, trial.batch),
                    "accepted": False,
                    "why": accepts(state, trial, HOLDS) or "explains less",
                }
            )
    return tuple(rows)
