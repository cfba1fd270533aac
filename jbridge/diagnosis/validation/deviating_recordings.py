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
from ...identification.solver import Normal, Point, Start, bounded_step
from ...model.effects.base import AXIS_OF_SITE
from ..criteria import CRITERIA
from ..structures.candidates import SITE_OF_NUMBER
from ..structures.structure import squares
from .refits import Fixed

_OTHERS = 3
"""Recordings that must agree before one is said to differ."""
_STATES, _STEPS, _FIT = 5, 6, 6
"""Iterations of initial states, reweightings of a linear step, and iterations of a fit of one number."""


class OwnNumber(NamedTuple):
    """A number that one recording asks for."""

    number: str
    value: float
    others: float
    """What the other recordings ask for, in the mean."""
    axis: str
    """The channel in which it matters most,"""
    closed: float
    """and the share of the excess of its squared typical error that it closes there."""


class Apart(NamedTuple):
    """A recording that differs from the others."""

    recording: str
    numbers: tuple[OwnNumber, ...]
    """Each of which makes it like the others, the best first."""


def own_numbers(problem: Problem, model: Fixed) -> list[Apart]:
    """Numbers of the bridge that one recording asks for, while three others or more agree on another one, and that
    would take more than half off its error.

    What a model lacks makes numbers differ from recording to recording, too; but then they differ among the others.

    Args:
        problem: all recordings, those of the hold-out among them.
        model: fitted to some of them.
    """
    setting, data = problem.setting, problem.data
    if len(data.grids) <= _OTHERS:
        return []
    engine = engine_for(setting, data, model.plant, width=model.engine.width, lanes=model.engine.lanes)
    numbers = [n for n, site in SITE_OF_NUMBER.items() if AXIS_OF_SITE[site] in setting.axes]
    places = np.array([engine.table.positions(n)[0] for n in numbers], np.int64)
    vector = np.array(engine.table.ravel(model.plant), dtype=float)
    start = Start(vector, np.zeros(0, np.int64), problem.guesses)
    # Tangents by six numbers of a beginning alone are not worth a program.
    alone = engine.by_differences()
    [there] = problem.solve(alone, [start], _STATES)
    problem = problem.judged_by(problem.residuals(engine, there))
    if problem.likelihood.scale(there.square).max() - 1.0 <= 1.0:
        return []
    [point] = problem.evaluate(engine, [Start(vector, places, there.states)])
    [normal] = problem.normal(engine, [point])
    asked, spread = _asked(problem, engine.table.bounds(), point, normal)
    alternatives = int(np.isfinite(asked).sum())
    price = problem.likelihood.price + math.log(max(alternatives, 1))
    out = []
    for r in range(len(data.grids)):
        # What others tell less of than is asked for says neither that they agree nor that they do not.
        telling = {i: np.flatnonzero(spread[:, i] < abs(asked[r, i])) for i in range(len(numbers))}
        others = {i: asked[k[k != r], i] for i, k in telling.items() if r in k}
        apart = [i for i, own in others.items() if alternatives * _chance(asked[r, i], own) < CRITERIA.apart]
        if not apart:
            continue
        own = problem.of_recordings([r])
        states = problem.states_of(there.states, own)
        [before] = own.solve(alone, [Start(vector, start.free, states)], _FIT)
        begun = [Start(vector, places[[i]], before.states) for i in apart]
        fitted = sorted(zip(apart, own.solve(engine, begun, _FIT), strict=True), key=lambda found: found[1].value)
        found = []
        for i, after in fitted:
            axis, closed = _closed(own, before, after)
            if before.value - after.value > price and closed > CRITERIA.named:
                mean = float(vector[places[i]] + others[i].mean())
                found.append(OwnNumber(numbers[i], float(after.vector[places[i]]), mean, axis, closed))
        if found:
            out.append(Apart(data.recordings[r].name, tuple(found)))
    return out


def _asked(
    problem: Problem, bounds: tuple[NDArray[np.float64], NDArray[np.float64]], point: Point, normal: Normal
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Linear step of each number alone that minimises the criterion of each recording alone, and its standard
    deviation, `(recording, number)`; NaN and infinite where the recording says nothing of the number."""
    n = len(point.free)
    asked = np.full((len(problem.data.grids), n), np.nan)
    spread = np.full(asked.shape, np.inf)
    for r in range(len(asked)):
        own = problem.of_recordings([r])
        products = normal.products[problem.windows.recording == r]
        for i, place in enumerate(point.free):
            pair = products[:, :, [[i], [n]], [i, n]]
            least, most = (np.array([bound[place] - point.vector[place]]) for bound in bounds)
            step = np.zeros(1)
            for _ in range(_STEPS):
                total = np.tensordot(own.likelihood.weights(squares(own, pair, step)), pair, axes=2)
                if not total[0, 0] > 0.0:
                    break
                step = bounded_step(total[:1, :1], total[:1, 1], least, most, 1e-6)
                asked[r, i], spread[r, i] = step[0], total[0, 0] ** -0.5
    return asked, spread


def _chance(one: float, others: NDArray[np.float64]) -> float:
    """How likely a value as far off as one is among others, by Student's t; 1 where they are too few to say."""
    count = len(others)
    if count < _OTHERS:
        return 1.0
    scatter = float(others.std(ddof=1)) * math.sqrt(1.0 + 1.0 / count)
    return float(2.0 * t.sf(abs(one - float(others.mean())) / max(scatter, 1e-300), count - 1))


def _closed(problem: Problem, before: Point, after: Point) -> tuple[str, float]:
    """The channel in which a recording gains most, and the share of the excess of its squared typical error that is
    closed there, at the horizon where it gains most; only what exceeds the noise counts."""
    criterion, windows = problem.likelihood, problem.windows
    gains = criterion.by_window(before.square) - criterion.by_window(after.square)
    first, last = criterion.scale(before.square), criterion.scale(after.square)
    best, axis, closed = 0.0, "", 0.0
    for horizon in problem.data.horizons:
        there = windows.horizon == horizon
        for k, name in enumerate(AXES):
            excess = float(first[there, k].mean()) - 1.0
            gain = float(gains[there, k].sum())
            if gain > best and excess > 1.0:
                best, axis, closed = gain, name, float((first - last)[there, k].mean()) / excess
    return axis, closed
