"""How large an effect may be that was not named: 95 % bounds from the recordings.

Beside the fitted model, an absent effect's numbers have the standard deviations that the criterion's curvature gives
them, with the model's own numbers free. What the bound would do to a simulation tells whether it matters.
"""

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from ..identification.estimation import Problem
from ..identification.solver import Normal, Point, Start
from ..identification.uncertainty import inverse_normal, widened
from ..model.effects.base import unit_at
from ..model.effects.catalogue import CATALOGUE
from ..model.fields import parameters_of
from ..model.parameters import ParameterTable
from .criteria import CRITERIA
from .result import NotSeen
from .selection.screening import AmongAll, seen_among_all
from .structures.candidates import WRONG_VALUE, Candidate
from .structures.space import Name, is_apart, proposals
from .structures.structure import Structure
from .words import limit_sentence

_NORMAL = 1.645
"""Of a one-sided 95 % bound, in standard deviations."""
_UNTOLD = 1e5
"""Variance of a number beside the model's own, over that with them held, beyond which the recordings tell nothing."""


def not_seen(problem: Problem, now: Structure, named: Collection[Name] = ()) -> tuple[NotSeen, ...]:
    """What may hide beside a fitted model, the notable first.

    Args:
        problem: recordings and criterion.
        now: the model.
        named: kind and site of what is reported anyway.
    """
    among = seen_among_all(problem, problem, now)
    space, there, table = among.space, among.point, among.space.table
    rows, seen = [], set(named) | set(now.names)
    wanted = []
    for candidate in proposals(problem.setting, now.plant, now.known):
        if candidate.name not in seen and not candidate.finite and not is_apart(candidate.kind):
            seen.add(candidate.name)
            wanted.append(candidate)
    vector, free = there.vector, [int(p) for p in there.free]
    for candidate in wanted:
        vector = candidate.set(table, vector)
        if candidate.harmonic:
            vector[table.positions(candidate.group("amplitude"))] = 1e-6
        free += [int(p) for p in candidate.places(table, candidate.linear) if p not in free]
    [point] = problem.evaluate(space.engine, [Start(vector, np.array(free, np.int64), there.states)])
    [normal] = problem.normal(space.engine, [point])
    weight = problem.likelihood.weights(point.square)
    units = ParameterTable(space.plant, problem.setting.units)
    for candidate in wanted:
        rows.append(_row(problem, among, point, normal, weight, candidate, units))
    return tuple(sorted(rows, key=lambda row: (not row.notable, row.kind, row.site)))


def _row(
    problem: Problem,
    now: AmongAll,
    point: Point,
    normal: Normal,
    weight: NDArray[np.float64],
    candidate: Candidate,
    units: ParameterTable,
) -> NotSeen:
    n, table = len(point.free), now.space.table
    own = [int(np.flatnonzero(point.free == p)[0]) for p in candidate.places(table, candidate.linear)]
    base = [int(np.flatnonzero(point.free == p)[0]) for p in now.point.free]
    take = [*base, *own]
    total = np.einsum("wc,wcij->ij", weight, normal.products[:, :, :, [*take, n]][:, :, [*take, n]])
    covariance = inverse_normal(total[:-1, :-1])
    step = -covariance @ total[:-1, -1]
    mine = np.arange(len(base), len(take))
    at = point.vector[point.free[own]]
    estimate = np.abs(step[mine])
    key = candidate.linear[0]
    # An amplitude is small where the phase is looked at, which stands for the other half of a wave.
    scale = np.where(np.arange(len(mine)) > 0, np.abs(at[0]), 1.0) if candidate.harmonic else np.ones(len(mine))
    std = widened(np.sqrt(np.maximum(np.diag(covariance)[mine], 0.0)), estimate)
    bounds = (estimate + _NORMAL * std) * scale
    worst = int(np.argmax(bounds))
    limit = float(bounds[worst]) if not candidate.harmonic else float(np.hypot.reduce(bounds))
    along = covariance[:, mine[worst]] / max(covariance[mine[worst], mine[worst]], 1e-300)
    whole = np.isinf(problem.windows.horizon)
    square = np.einsum("wcij,i,j->wc", normal.products[:, :, take][:, :, :, take], along, along)[whole].sum(axis=0)
    count = problem.windows.count[whole].sum(axis=0)
    rms = np.sqrt(np.maximum(square, 0.0) / np.maximum(count, 1.0)).max(initial=0.0)
    change = float(rms * bounds[worst] / scale[worst])
    # What the model's own numbers take up is not told, whatever rounding leaves of it.
    alone = np.diag(total)[mine[worst]] * covariance[mine[worst], mine[worst]]
    told = math.isfinite(limit) and alone < _UNTOLD and change > 0.0
    group = candidate.group(key)
    unit = units.entry(units.positions(group)[0]).unit
    if candidate.kind != WRONG_VALUE:
        unit = unit_at(parameters_of(CATALOGUE[candidate.kind])[key].unit, candidate.site, problem.setting.units)
    notable = not told or change > CRITERIA.met
    return NotSeen(
        candidate.kind,
        candidate.site,
        "value" if candidate.kind == WRONG_VALUE else key,
        limit if told else None,
        unit,
        change if told else None,
        notable,
        limit_sentence(key, limit if told else None, unit, change if told else None, notable),
    )
