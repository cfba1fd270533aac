"""From the search's steps to what the report tells: named effects with rivals, the place, and every trial."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..identification.problem import Setting
from ..identify.base import chi, columns_for
from ..identify.evaluate import evaluate
from ..identify.latent import Latent
from ..identify.result import Estimate
from ..identify.uncertainty import covariance, estimates
from ..model.effects.base import AXIS_OF_SITE
from ..model.parameters import ParameterTable
from .candidates import SITE_OF_NUMBER, WRONG_VALUE
from .describe import describe
from .locate import equation_of, intervals, regions, times_of
from .missing import force_along, leading_site, tracks_of
from .result import Location, MissingForce, NamedEffect, Rival
from .screen import Screen
from .steps import Step, weights_of
from .trials import EFFECTIVE, Trial
from .words import effect_sentence

RIVAL = 0.01
"""Least probability, relative to the winner's, of an explanation that counts as not told apart."""
_SAME = 1.01
"""Cost, relative to the winner's, up to which an explanation is as good."""
_MORE = 2
"""Further numbers that such an explanation may have."""


def _as_good(trial: Trial, chosen: Trial) -> bool:
    """Whether a law with a few numbers more explains the same: improbable for its numbers, but not told apart."""
    return trial.weighed <= _SAME * chosen.weighed and trial.extra <= chosen.extra + _MORE


def named_of(steps: list[Step], setting: Setting, values: dict[str, Estimate]) -> tuple[NamedEffect, ...]:
    out = []
    for step in steps:
        kind, site = step.chosen.candidate.name
        weights = weights_of(step)
        own = weights[(kind, site)]
        parameters = {"value": values[site]} if kind == WRONG_VALUE else parameters_of(kind, site, values)
        rivals: list[Rival] = []
        for trial in step.passed:
            name = trial.candidate.name
            if name == (kind, site) or len(rivals) == 3:
                continue
            if weights[name] < RIVAL * own and not _as_good(trial, step.chosen):
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
    values = estimates(table, vector, free, cov, setting.period)
    parameters = {"value": values[site]} if kind == WRONG_VALUE else parameters_of(kind, site, values)
    run = evaluate(trial.plant, setting, setting.holdout, width, (trial.batch, None), windows=False)
    return Rival(kind, site, probability, parameters, run.errors.free_run)


def parameters_of(kind: str, site: str, values: dict[str, Estimate], number: int | None = None) -> dict[str, Estimate]:
    """Estimates of an effect by key.

    Args:
        kind, site: of the effect.
        values: of all parameters.
        number: which of several of its kind and site, from 1; the latest by default.
    """
    owners = {name.rpartition(".")[0] for name in values if "." in name}
    mine = sorted((o for o in owners if o.split("#")[0] == f"{kind}@{site}"), key=lambda o: (len(o), o))
    if not mine:
        return {}
    owner = mine[-1 if number is None else number - 1]
    return {name.removeprefix(f"{owner}."): e for name, e in values.items() if name.startswith(f"{owner}.")}


def location_of(
    alarm: bool,
    effects: tuple[NamedEffect, ...],
    steps: list[Step],
    screened: Screen | None,
    shown: Sequence[Any],
    curve: str | None,
    latent: Latent | None = None,
) -> Location:
    """Where the mismatch is.

    Args:
        alarm: whether there is one.
        effects: what was named.
        steps: how it was found.
        screened: the last screen.
        shown: recordings beside both models.
        curve: site of the force without a name that the final model keeps: what was named beside it explains a part
            only, and the force says where the rest is.
        latent: unknown forces beside the model as given.
    """
    if not alarm:
        return Location(None, "none", {}, (), ())
    sites: dict[str, float] = {}
    if steps:
        for (kind, site), weight in weights_of(steps[0]).items():
            place = SITE_OF_NUMBER.get(site, site)
            sites[place] = sites.get(place, 0.0) + weight
    else:
        ranked = [] if screened is None else screened.ranked
        least = min((r.cost for r in ranked), default=1.0)
        for r in ranked:
            place = SITE_OF_NUMBER.get(r.candidate.site, r.candidate.site)
            odds = math.exp(-0.5 * EFFECTIVE * math.log(max(r.cost, 1e-9) / max(least, 1e-9)))
            sites[place] = max(sites.get(place, 0.0), odds)
        total = sum(sites.values())
        sites = {place: value / total for place, value in sites.items()} if total > 0 else {}
    sites = dict(sorted(sites.items(), key=lambda item: -item[1]))
    sites = {site: value for site, value in sites.items() if value > 1e-4}
    at: str | None = next(iter(sites), None)
    if effects:
        at = SITE_OF_NUMBER.get(effects[0].site, effects[0].site)
    at = curve or at
    train = [trace for trace in shown if trace.role == "train"]
    evidence = {} if latent is None else dict(sorted(latent.evidence.items(), key=lambda item: -item[1]))
    if not effects and curve is None:
        # Nothing that was tried passed, so what was expected of it says less than a force that may be anything.
        at = leading_site(evidence) or at
    axis = AXIS_OF_SITE[at] if at is not None else None
    forces: tuple[MissingForce, ...] = ()
    if latent is not None and axis is not None:
        forces = force_along(latent.forces, train, axis)
    tracks = [] if axis is None else tracks_of(forces, train, axis)
    when = times_of(effects, [(trace.recording, float(trace.times[-1])) for trace in train]) or intervals(tracks)
    if at is not None and at.endswith("_sensor"):
        # Where a sensor is at fault no force is missing, though one would look like it.
        forces = ()
    alone = [track for _, track in tracks]
    where = regions(alone, axis) if forces and axis is not None else ()
    likeness = describe(alone, axis) if forces and axis is not None else None
    return Location(at, equation_of(axis), sites, where, when, evidence, forces, likeness)


def trials_of(steps: list[Step], refused: Sequence[tuple[Trial, str]]) -> tuple[dict[str, object], ...]:
    """Every trial of every round, and why it was not taken; `refused` are those of the last one."""
    rows = []

    def row(number: int, trial: Trial, why: str) -> dict[str, object]:
        return {
            "round": number,
            "kind": trial.candidate.kind,
            "site": trial.candidate.site,
            "ratio": trial.chi,
            "cross_validated": chi(trial.cross_validated, trial.batch),
            "accepted": not why,
            "why": why,
        }

    for step in sorted(steps, key=lambda step: step.number):
        for trial in step.trials:
            why = "" if trial is step.chosen else step.refused.get(trial.candidate.name, "explains less")
            rows.append(row(step.number, trial, why))
    rounds = max((step.number for step in steps), default=0) + 1
    rows += [row(rounds, trial, why) for trial, why in refused]
    return tuple(rows)
