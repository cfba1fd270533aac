"""Named effects with their estimates, and the explanations that the recordings cannot tell from them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..identification.estimation import Problem
from ..identification.result import Estimate
from ..identification.uncertainty import covariance, estimates, warnings
from ..model.effects.catalogue import CATALOGUE
from ..model.parameters import ParameterTable
from .criteria import CRITERIA
from .experiment_design.discrimination import Contender
from .result import NamedEffect, Rival
from .selection.moves import axis_of
from .selection.search import Search
from .structures.candidates import WRONG_VALUE
from .structures.space import Name
from .structures.structure import Structure
from .validation.refits import Fixed, of_its_own
from .validation.validate import Checked
from .words import effect_sentence


def estimated(problem: Problem, final: Fixed) -> tuple[dict[str, Estimate], list[str]]:
    """Every number of the final model with its interval, and what the recordings do not determine."""
    cov = covariance(problem, final.engine, final.point)
    table = ParameterTable(final.plant, problem.setting.units)
    vector, free = final.point.vector, final.point.free
    return estimates(table, vector, free, cov, problem.setting.period), warnings(table, vector, free, cov)


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
    final = set(search.held[-1].names) - {name}
    taken = {axis_of(other) for other in final} - {axis_of(name)}
    for before, tried, after in zip(search.held, search.tried, search.held[1:], strict=False):
        placed = {n for n in after.names if n not in before.names and axis_of(n) == axis_of(name)}
        members = []
        for structure in tried:
            added = set(structure.names) - set(before.names)
            if not (placed & final <= added and len(added - final) == 1 and len(structure.blocks)):
                continue
            [new] = added - final
            if added - {new} == placed & final and (axis_of(new) not in taken or _declared(name, new)):
                members.append((new, structure))
        own = [member for member in members if member[0] == name]
        if own and placed - final:
            return [own[0], *(member for member in members if member[0] != name)]
    return None


def _declared(one: Name, other: Name) -> bool:
    """Whether the catalogue says of two effects that some recordings cannot tell them apart."""
    pairs = ((one, other), (other, one))
    return any(
        (each.own_site, each.kind, each.site) == (a[1], *b)
        for a, b in pairs
        if a[0] in CATALOGUE
        for each in CATALOGUE[a[0]].alike
    )


def _chances(members: Sequence[Structure]) -> np.ndarray:
    """Weight of each by the criterion, the mean over resamples of the blocks.

    Where one is the best by far in every resample, it is the share of resamples in which it is; two that differ by
    next to nothing have half each.
    """
    blocks = np.stack([s.blocks for s in members])
    prices = np.array([s.price for s in members])
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, blocks.shape[1], (CRITERIA.bootstrap, blocks.shape[1]))
    values = blocks[:, drawn].sum(axis=2) + prices[:, None]
    weights = np.exp(values.min(axis=0) - values)
    return (weights / weights.sum(axis=0)).mean(axis=1)


def named_effect(
    search: Search,
    checked: Checked,
    values: Mapping[str, Estimate],
    in_model: bool,
    holdout_errors: Callable[[Fixed], Mapping[str, float]],
) -> NamedEffect:
    """An effect with what cannot be told from it.

    Args:
        search: that found it.
        checked: the effect, as the hold-out judges it.
        values: estimates of all parameters.
        in_model: whether the final model has it.
        holdout_errors: the rms error of a model on the hold-out, by channel.
    """
    kind, site = checked.name
    parameters = parameters_of(kind, site, values)
    members = round_of(search, checked.name)
    rivals: list[Rival] = []
    own = 1.0
    if members is not None:
        chances = _chances([structure for _, structure in members])
        own = float(chances[0])
        order = sorted(range(1, len(members)), key=lambda i: -chances[i])
        near = [i for i in order if chances[i] >= CRITERIA.apart][: CRITERIA.rivals]
        rivals = [_rival(search, *members[i], float(chances[i]), holdout_errors) for i in near]
    statement = effect_sentence(kind, site, parameters, rivals)
    return NamedEffect(
        kind=kind,
        site=site,
        probability=own,
        parameters=parameters,
        equivalents=tuple(rivals),
        statement=statement,
        status=checked.status,
        explained=checked.explained,
        in_model=in_model,
    )


def _rival(
    search: Search,
    name: Name,
    own: Structure,
    probability: float,
    holdout_errors: Callable[[Fixed], Mapping[str, float]],
) -> Rival:
    model = of_its_own(search.problem, own)
    values, _ = estimated(search.problem, model)
    return Rival(*name, probability, parameters_of(*name, values), holdout_errors(model))


def contenders(search: Search, effects: Sequence[NamedEffect]) -> list[Contender]:
    """The named effect that is least certain, and its rivals; empty where each name stands alone."""
    unsure = [e for e in effects if e.equivalents]
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
        gram = np.einsum("wc,wcij->ij", problem.likelihood.weights(point.square), normal.products)[:n, :n]
        names = tuple(structure.space.table.entry(int(p)).name for p in point.free)
        out.append(Contender(*name, max(chances[name], 1e-3), structure.plant, names, gram))
    return out
