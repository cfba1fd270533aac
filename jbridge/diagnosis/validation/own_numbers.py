"""Numbers that one recording asks for and the others do not: another supply, another load, another unit of an input.

A structure has one set of numbers for all recordings. Where one of them was made with an amplifier that was set
differently, its error says nothing of what the model lacks, and no effect of the catalogue takes it away.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from ..._types import AXES
from ...identification.estimation import Problem, engine_for
from ...identification.solver import Point, Start, bounded_step, moved_states
from ...model.effects.base import AXIS_OF_SITE
from ..criteria import CRITERIA
from ..structures.candidates import SITE_OF_NUMBER
from ..structures.structure import squares
from .refits import Fixed

_FEWEST = 4
"""Recordings: three that agree, and one that does not."""
_STATES, _STEPS = 5, 6
"""Iterations of the initial states, and reweightings of the step in a number."""


class OwnNumber(NamedTuple):
    """A number that one recording asks for."""

    recording: str
    number: str
    value: float
    given: float
    """That of the model."""
    closed: float
    """Share of the excess of the squared typical error that it closes there."""


def own_numbers(problem: Problem, model: Fixed) -> list[OwnNumber]:
    """Numbers of the bridge that one recording asks for, while the others agree on another one, and that would take
    more than half off its error.

    What a model lacks makes numbers differ from recording to recording, too; but then they differ among the others.

    Args:
        problem: all recordings, those of the hold-out among them.
        model: with its numbers from all of its own.
    """
    if len(problem.data.grids) < _FEWEST:
        return []
    setting, data = problem.setting, problem.data
    engine = engine_for(setting, data, model.plant, width=model.engine.width, lanes=model.engine.lanes)
    numbers = [n for n, site in SITE_OF_NUMBER.items() if AXIS_OF_SITE[site] in setting.axes]
    places = np.array([engine.table.positions(n)[0] for n in numbers], np.int64)
    vector = np.array(engine.table.ravel(model.plant), dtype=float)
    [there] = problem.solve(engine, [Start(vector, np.zeros(0, np.int64), problem.guesses)], _STATES)
    problem = problem.judged_by(problem.residuals(engine, there))
    [point] = problem.evaluate(engine, [Start(vector, places, there.states)])
    [normal] = problem.normal(engine, [point])
    low, high = (bound[places] for bound in problem.likelihood.prior.bounds(engine.table))
    asked = np.zeros((len(data.grids), len(numbers)))
    chosen = []
    for r in range(len(data.grids)):
        own = problem.of_recordings([r])
        products = normal.products[problem.windows.recording == r]
        found = [_best(own, products, i, low[i] - vector[p], high[i] - vector[p]) for i, p in enumerate(places)]
        asked[r] = [step for step, _ in found]
        chosen.append(min(range(len(numbers)), key=lambda i: found[i][1]))
    apart = [
        asked.size * _chance(asked[r, i], np.delete(asked[:, i], r)) < CRITERIA.apart for r, i in enumerate(chosen)
    ]
    starts = []
    for r, i in enumerate(chosen):
        moved = vector.copy()
        moved[places[i]] += asked[r, i]
        change = normal.shift + normal.back[:, :, i] * asked[r, i]
        starts.append(Start(moved, places, moved_states(data, problem.windows, there.states, change)))
    price = 0.5 * math.log(max(problem.likelihood.total, 2.0)) + math.log(asked.size)
    out = []
    for r, (i, after) in enumerate(zip(chosen, problem.evaluate(engine, starts), strict=True)):
        gain, closed = _closed(problem, r, point, after)
        if apart[r] and gain > price and closed > CRITERIA.named:
            value, given = float(after.vector[places[i]]), float(vector[places[i]])
            out.append(OwnNumber(data.recordings[r].name, numbers[i], value, given, closed))
    return out


def _best(
    problem: Problem, products: NDArray[np.float64], column: int, least: float, most: float
) -> tuple[float, float]:
    """The step of one number that a recording's quadratics ask for, and the criterion there."""
    n = products.shape[2] - 1
    pair = np.array([column, n])
    products = products[:, :, pair[:, None], pair]
    step = np.zeros(1)
    square = squares(problem, products, step)
    best = (0.0, problem.likelihood.value(square))
    for _ in range(_STEPS):
        total = np.tensordot(problem.likelihood.weights(square), products, axes=2)
        if not total[0, 0] > 0.0:
            break
        step = bounded_step(total[:1, :1], total[:1, 1], np.array([least]), np.array([most]), 1e-6)
        square = squares(problem, products, step)
        best = min(best, (float(step[0]), problem.likelihood.value(square)), key=lambda found: found[1])
    return best


def _chance(one: float, others: NDArray[np.float64]) -> float:
    """How likely a value as far off as one is among others, by Student's t."""
    count = len(others)
    spread = float(others.std(ddof=1)) * math.sqrt(1.0 + 1.0 / count)
    return float(2.0 * t.sf(abs(one - float(others.mean())) / max(spread, 1e-300), count - 1))


def _closed(problem: Problem, recording: int, before: Point, after: Point) -> tuple[float, float]:
    """What the criterion of one recording gains, and the share of the excess of its squared typical error that is
    closed, in the channel and at the horizon where it gains most and the excess is larger than the noise."""
    windows, criterion = problem.windows, problem.likelihood
    own = windows.recording == recording
    gains = (criterion.by_window(before.square) - criterion.by_window(after.square))[own]
    best, closed = 0.0, 0.0
    for horizon in np.unique(windows.horizon[own]):
        there = windows.horizon[own] == horizon
        for k in range(len(AXES)):
            gain = float(gains[there, k].sum())
            first, last = (float(criterion.scale(p.square)[own][there, k].mean()) for p in (before, after))
            if gain > best and first > 2.0:
                best, closed = gain, (first - last) / (first - 1.0)
    return float(gains.sum()), closed
