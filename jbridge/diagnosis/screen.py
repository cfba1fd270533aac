"""A cheap look at every candidate: what would it gain if the simulation were linear in it?

At its null value an absent effect still has a tangent, and `columns` gives the tangents of all of them along the base
trajectory. After initial states and base parameters are projected out, a candidate's predicted gain is a small bounded
least-squares problem.
The same tangents answer whether anything repeatable is missing at all: what is chosen on all recordings but one must
predict the residual of that one.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..identify.lanes import Batch
from ..identify.linearise import Engine
from ..model.effects.base import parameters_of
from ..model.effects.catalogue import KINDS
from ..model.effects.forces import Wind
from ..model.parameters import ParameterTable
from .candidates import WRONG_VALUE, Candidate
from .gusts import gusts
from .normal import Normal, Sum, Tangents
from .trials import EFFECTIVE

_GREEDY = 4
"""Most explanations that the flexible model combines."""
_MANY = 16
"""Seeds of one effect above which only the best few are weighed beside the other effects."""
_SEEDS = 4
"""How many."""
_MOMENT = "time"
"""The key of a number that says when something happens once."""
_COARSE = 8
"""Of an effect that has many seeds, one in so many takes part in the question what could be learned."""
_KEPT = 30
"""Explanations that stay in play after the first has been chosen."""
_TRUSTED = 0.7
"""Share of the predicted step that a refit starts with."""
_EXCESS = 1.2
"""Least mean square over the noise's at which it is asked what of the excess could be learned."""


@dataclasses.dataclass(frozen=True)
class Screened:
    """A candidate with what the linear screen expects of it."""

    candidate: Candidate
    cost: float
    """Predicted sum of squares after a refit."""
    gain: float
    """The share of the sum of squares that this removes."""
    base_names: tuple[str, ...]
    """The base's free parameters."""
    base_step: NDArray[np.float64]
    """Their expected change."""
    own_step: NDArray[np.float64]
    """Expected change of the candidate's; for a finite seed, how much of it."""

    def start(self, table: ParameterTable, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where a refit should start, in the table of the model with the candidate."""
        vector = self.candidate.set(table, vector)
        if not self.candidate.finite:
            low, high = table.bounds()
            base = np.array([table.positions(name)[0] for name in self.base_names], np.int64)
            places = np.concatenate([base, self.candidate.places(table, self.candidate.linear)])
            own = self.own_step
            if self.candidate.harmonic:
                own = np.array([np.hypot(*own), np.arctan2(own[1], own[0]) / _TRUSTED])
            # Less than a linear model promises, which overstates what is strongly nonlinear.
            step = _TRUSTED * np.concatenate([self.base_step, own])
            vector[places] = np.clip(vector[places] + step, low[places], high[places])
        return vector


@dataclasses.dataclass(frozen=True)
class Screen:
    """All candidates, best first, and the share of the residual that can be learned."""

    ranked: list[Screened]
    learnable: float


def screen(told: Tangents, found: Sequence[Candidate], unnamed: Sequence[Candidate]) -> Screen:
    """Ranks all candidates without a hidden coordinate.

    Args:
        told: the base model along its trajectories, with a column for each `wrong_value` candidate, in order.
        found: candidates.
        unnamed: forces without a name, for the question what could be learned.
    """
    engine, batch, free = told.engine, told.batch, told.free
    base = len(free)
    plain, picked, coarse = _promising(told, [c for c in found if c.kind != WRONG_VALUE])
    numbers = [c for c in found if c.kind == WRONG_VALUE]
    effects = [*picked, *plain, *coarse, *unnamed]
    columns = [*told.effects(effects), *told.numbers()]
    everything = [*effects, *numbers]
    normal = told.normal(columns)
    whole = normal.over(np.ones(batch.count, bool))
    names = tuple(engine.table.entry(int(place)).name for place in free)
    ranked: list[Screened] = []
    groups = _groups(told, everything, columns)
    for i, (candidate, group) in enumerate(zip(everything, groups, strict=True)):
        if i < len(picked) + len(plain) or i >= len(effects):
            step = whole.step(*group)
            cost = whole.after(group[0], step)
            gain = 1.0 - cost / max(whole.cost, 1e-300)
            ranked.append(Screened(candidate, cost, gain, names, step[:base], step[base:]))
    # What was picked from all recordings would foresee the one that is left out.
    learnable = _learnable(normal, groups[len(picked) :], batch, base)
    ranked.sort(key=lambda s: s.cost)
    return Screen(ranked, learnable)


def _promising(told: Tangents, found: Sequence[Candidate]) -> tuple[list[Candidate], list[Candidate], list[Candidate]]:
    """Seeds of effects that have few; of those that have many the few that gain most; and some of these regardless.

    A wave of another length or a push at another time must be looked for closely, for between two seeds it hides. To
    weigh all seeds of all effects together would take the square of their number.
    """
    families: dict[tuple[str, str], list[Candidate]] = {}
    for candidate in found:
        families.setdefault(candidate.name, []).append(candidate)
    plain: list[Candidate] = []
    kept: list[Candidate] = []
    coarse: list[Candidate] = []
    for seeds in families.values():
        if seeds[0].kind == Wind.kind:
            kept += gusts(told, seeds[0], _SEEDS)
            plain += seeds
            continue
        if len(seeds) <= _MANY:
            plain += seeds
            continue
        coarse += seeds[_COARSE // 2 :: _COARSE]
        best = [seeds[i] for i in np.argsort(_costs(told, seeds), kind="stable")[:_SEEDS]]
        if _MOMENT in seeds[0].free:
            best[0] = _sharpened(told, best[0], sorted(seed.values[_MOMENT] for seed in seeds))
        kept += best
    return plain, kept, coarse


def _costs(told: Tangents, seeds: Sequence[Candidate]) -> list[float]:
    """What the linear model expects to be left beside each seed alone."""
    columns = told.effects(seeds)
    costs: list[float] = []
    for a in range(0, len(seeds), _MANY):
        some = slice(a, a + _MANY)
        whole = told.normal(columns[some]).over(np.ones(told.batch.count, bool))
        groups = _groups(told, seeds[some], columns[some])
        costs += [whole.after(group[0], whole.step(*group)) for group in groups]
    return costs


def _sharpened(told: Tangents, seed: Candidate, moments: Sequence[float]) -> Candidate:
    """The seed at the moment that gains most, to a fraction of a sample.

    Of when a step happens a fit learns from the samples beside it alone, so it hardly moves it.
    """
    apart = moments[1] - moments[0]
    for _ in range(2):
        # As many as there were: the program is there already.
        around = seed.values[_MOMENT] + np.linspace(-apart, apart, len(moments))
        tries = [dataclasses.replace(seed, values={**seed.values, _MOMENT: float(time)}) for time in around]
        seed = tries[int(np.argmin(_costs(told, tries)))]
        apart = 2 * apart / (len(moments) - 1)
    return seed


def _groups(told: Tangents, found: Sequence[Candidate], columns: Sequence[NDArray[np.float64]]) -> list[tuple]:
    """Of each candidate: places of the model's free numbers and its own in the normal equations, values and bounds."""
    low_all, high_all = told.engine.table.bounds()
    free, base = told.free, len(told.free)
    groups = []
    start = base
    for candidate, own in zip(found, columns, strict=True):
        count = own.shape[1]
        at, low, high = _edges(candidate, told.engine, told.vector, count)
        groups.append(
            (
                np.concatenate([np.arange(base), np.arange(start, start + count)]),
                np.concatenate([told.vector[free], at]),
                np.concatenate([low_all[free], low]),
                np.concatenate([high_all[free], high]),
            )
        )
        start += count
    return groups


def _edges(
    candidate: Candidate, engine: Engine, vector: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Value, lower and upper bound of a candidate's columns."""
    if candidate.kind == WRONG_VALUE:
        place = engine.table.positions(candidate.site)
        least, most = engine.table.bounds()
        return vector[place], least[place], most[place]
    if candidate.finite:
        # The amplitude of what the seed would do; some more than the seed is as possible as some less.
        return np.zeros(1), np.zeros(1), np.full(1, 3.0)
    if candidate.harmonic:
        return np.zeros(2), np.full(2, -np.inf), np.full(2, np.inf)
    infos = parameters_of(KINDS[candidate.kind])
    at: list[float] = []
    low: list[float] = []
    high: list[float] = []
    for key in candidate.linear:
        value = np.atleast_1d(np.asarray(candidate.values.get(key, infos[key].null), dtype=float))
        at += list(value)
        low += [infos[key].low] * len(value)
        high += [infos[key].high] * len(value)
    assert len(at) == count
    return np.array(at), np.array(low), np.array(high)


def _learnable(normal: Normal, groups: list[tuple], batch: Batch, base: int) -> float:
    """Share of the excess over noise that explanations chosen on the other recordings predict."""
    names = np.unique(batch.recording[batch.recording >= 0])
    # A share of next to nothing would mean nothing.
    if len(names) < 2 or not groups or normal.cost.sum() < _EXCESS * normal.count.sum():
        return 0.0
    removed, excess = 0.0, 0.0
    for r in names:
        inside = batch.recording == r
        left_out = normal.over(inside)
        chosen = _greedy(normal.over(~inside), groups, base)
        excess += max(left_out.cost - float(normal.count[inside].sum()), 0.0)
        if chosen is not None:
            removed += left_out.cost - left_out.after(*chosen)
    return float(np.clip(removed / excess, 0.0, 1.0)) if excess > 0 else 0.0


def _greedy(others: Sum, groups: list[tuple], base: int) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Explanations added one after the other while they pay for their parameters: columns and step."""
    current: tuple | None = None
    result = None
    cost = others.cost
    left = list(range(len(groups)))
    for _ in range(_GREEDY):
        trials = []
        for g in left:
            trial = groups[g] if current is None else _joined(current, groups[g], base)
            step = others.step(*trial)
            predicted = others.after(trial[0], step)
            penalty = (len(trial[0]) - base) * np.log(EFFECTIVE) / EFFECTIVE
            trials.append((np.log(max(predicted, 1e-12)) + penalty, g, trial, step, predicted))
        _, g, trial, step, predicted = min(trials, key=lambda t: t[0])
        if predicted > cost * (1 - 1e-2):
            break
        current, result, cost = trial, (trial[0], step), predicted
        left.remove(g)
        if current is not None and len(left) > _KEPT:
            # Later additions come from those that were best on their own.
            left = [t[1] for t in sorted(trials, key=lambda t: t[0])[:_KEPT] if t[1] != g]
    return result


def _joined(a: tuple, b: tuple, base: int) -> tuple:
    return tuple(np.concatenate([x, y[base:]]) for x, y in zip(a, b, strict=True))
