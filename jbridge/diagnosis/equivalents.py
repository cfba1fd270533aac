"""Named effects with their estimates, and the explanations that the recordings cannot tell from them."""

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..identification.estimation import Problem
from ..identification.result import Estimate
from ..identification.uncertainty import covariance, estimates, warnings
from ..model.parameters import ParameterTable
from .criteria import CRITERIA
from .experiment_design.discrimination import Contender
from .result import NamedEffect, Rival
from .selection.moves import axis_of
from .selection.search import Search
from .structures.candidates import WRONG_VALUE
from .structures.space import Name, looks_like
from .structures.structure import Structure, blocks_of
from .validation.confirmation import Checked
from .validation.refits import Fixed, recording_of, replaced
from .words import effect_sentence


def estimated(problem: Problem, final: Fixed) -> tuple[dict[str, Estimate], list[str]]:
    """Every number of the final model with its interval, and what the recordings do not determine."""
    cov = covariance(problem, final.engine, final.point)
    table = ParameterTable(final.plant, problem.setting.units)
    vector, free = problem.setting.since_start(table, final.point.vector), final.point.free
    bounds = problem.likelihood.prior.bounds(table)
    return estimates(table, vector, free, cov, problem.setting.period), warnings(table, vector, free, cov, bounds)


def parameters_of(
    kind: str, site: str, values: Mapping[str, Estimate], number: int | None = None
) -> dict[str, Estimate]:
    """Estimates of an effect by key.

    Args:
        kind, site: of the effect.
        values: of all parameters.
        number: which of several of its kind and site, from 1; the latest by default.
    """
    if kind == WRONG_VALUE:
        return {"value": values[site]}
    owners = {name.rpartition(".")[0] for name in values if "." in name}
    mine = sorted((o for o in owners if o.split("#")[0] == f"{kind}@{site}"), key=lambda o: (len(o), o))
    if not mine:
        return {}
    owner = mine[-1 if number is None else number - 1]
    return {name.removeprefix(f"{owner}."): e for name, e in values.items() if name.startswith(f"{owner}.")}


def round_of(search: Search, name: Name) -> list[tuple[Name, Structure]] | None:
    """All effects that were tried in an effect's place with the models that have them, the effect's own first.

    One that took the place of another was tried where that one was added, and one that was added beside others of its
    axis, beside these. What the final model has as well was not in its place, and what acts on another axis, where the
    final model has other effects, was in theirs, unless the catalogue says that some recordings cannot tell the two
    apart.
    """
    final, setting = set(search.held[-1].names) - {name}, search.problem.setting
    axis = axis_of(setting, name)
    taken = {axis_of(setting, other) for other in final} - {axis}
    for before, tried, after in zip(search.held, search.tried, search.held[1:], strict=False):
        placed = {n for n in after.names if n not in before.names and axis_of(setting, n) == axis}
        members = []
        for structure in tried:
            added = set(structure.names) - set(before.names)
            if not (placed & final <= added and len(added - final) == 1 and len(structure.blocks)):
                continue
            [new] = added - final
            declared = looks_like(name, new) or looks_like(new, name)
            if added - {new} == placed & final and (axis_of(setting, new) not in taken or declared):
                members.append((new, structure))
        own = [member for member in members if member[0] == name]
        if own and placed - final:
            return [own[0], *(member for member in members if member[0] != name)]
    return None


def _chances(blocks: NDArray[np.float64], prices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weight of each model by the criterion, the mean over resamples of the blocks.

    Where one is the best by far in every resample, it is the share of resamples in which it is; two that differ by
    next to nothing have half each.

    Args:
        blocks: the criterion, by model and block.
        prices: by model, with what no resample changes.
    """
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, blocks.shape[1], (CRITERIA.bootstrap, blocks.shape[1]))
    values = blocks[:, drawn].sum(axis=2) + prices[:, None]
    weights = np.exp(values.min(axis=0) - values)
    return (weights / weights.sum(axis=0)).mean(axis=1)


class Naming(NamedTuple):
    """What names of effects are told from."""

    search: Search
    base: Structure
    """The model as given, refitted."""
    values: Mapping[str, Estimate]
    """Estimates of all parameters."""
    holdout_errors: Callable[[Fixed], Mapping[str, float]] | None
    """The rms error of a model on the hold-out, by channel; None where that stays closed."""
    deadline: float = math.inf
    """Time of `time.monotonic` [s] after which nothing is fitted in the place of an effect any more."""


def named_effect(of: Naming, checked: Checked, model: Fixed, *, in_model: bool) -> NamedEffect:
    """An effect with what cannot be told from it: what makes the model nearly as good in its place.

    What comes near in the round in which the effect was found is fitted in its place in the model, since what was added
    later may have parted the two. What has no room there, or for which no time is left, is not listed.

    Args:
        of: where it was found.
        checked: the effect, as the hold-out judges it.
        model: with the effect.
        in_model: whether the model file has it.
    """
    kind, site = checked.name
    parameters = parameters_of(kind, site, of.values)
    own = recording_of(of.search.problem.setting, model, checked.name)
    recording = None if own is None else own.name
    rivals, chance = _rivals(of, checked.name, model)
    statement = effect_sentence(kind, site, parameters, rivals, recording)
    return NamedEffect(
        kind=kind,
        site=site,
        probability=chance,
        parameters=parameters,
        equivalents=tuple(rivals),
        statement=statement,
        status=checked.status,
        explained=checked.explained,
        in_model=in_model,
        recording=recording,
    )


def _rivals(of: Naming, name: Name, model: Fixed) -> tuple[list[Rival], float | None]:
    """What comes near an effect, the nearest first, and the effect's own weight beside it; None where no time is left
    to fit it in the effect's place."""
    members = round_of(of.search, name)
    if members is None:
        return [], 1.0
    if of.holdout_errors is None:
        return [], None
    structures = [structure for _, structure in members]
    prices = np.array([structure.price for structure in structures])
    when_found = _chances(np.stack([s.blocks for s in structures]), prices)
    order = sorted(range(1, len(members)), key=lambda i: -when_found[i])
    near = [i for i in order if when_found[i] >= CRITERIA.apart][: CRITERIA.rivals]
    if not near:
        return [], float(when_found[0])
    if time.monotonic() > of.deadline:
        return [], None
    problem = dataclasses.replace(of.search.problem, until=of.deadline)
    fitted = {i: replaced(problem, model, of.base, name, structures[i], members[i][0]) for i in near}
    models = {0: model} | {i: beside for i, beside in fitted.items() if beside is not None}
    blocks = blocks_of(problem)
    parts = np.array([problem.likelihood.by_window(m.point.square).sum(axis=1) for m in models.values()])
    by_block = np.stack([parts[:, blocks == b].sum(axis=1) for b in range(int(blocks.max()) + 1)], axis=1)
    # Windows across blocks count in every resample.
    rest = np.array([m.point.value for m in models.values()]) - by_block.sum(axis=1)
    chances = dict(zip(models, _chances(by_block, rest + prices[list(models)]).tolist(), strict=True))
    rivals = []
    for i in sorted(models, key=lambda i: -chances[i]):
        if i > 0 and chances[i] >= CRITERIA.apart:
            other = members[i][0]
            values, _ = estimated(problem, models[i])
            rivals.append(
                Rival(
                    *other,
                    chances[i],
                    parameters_of(*other, values),
                    of.holdout_errors(models[i]),
                )
            )
    return rivals, chances[0]


def contenders(search: Search, effects: Sequence[NamedEffect]) -> list[Contender]:
    """The named effect that is least certain, and its rivals; empty where each name stands alone."""
    # No further recording shows what happened in one of these.
    unsure = [e for e in effects if e.equivalents and e.recording is None]
    if not unsure:
        return []
    effect = max(unsure, key=lambda e: sum(r.probability for r in e.equivalents))
    found = round_of(search, (effect.kind, effect.site))
    if found is None:
        return []
    chances = {(effect.kind, effect.site): effect.probability or 0.0}
    chances |= {(r.kind, r.site): r.probability for r in effect.equivalents}
    out = []
    for name, structure in found:
        if name not in chances:
            continue
        problem, point = search.problem, structure.point
        [normal] = problem.normal(structure.space.engine, [point])
        n = len(point.free)
        gram = problem.likelihood.weighted(point.square, normal.products)[:n, :n]
        names = tuple(structure.space.table.entry(int(p)).name for p in point.free)
        out.append(Contender(*name, max(chances[name], 1e-3), structure.plant, names, gram))
    return out
