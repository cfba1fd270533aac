"""Estimation of one model structure from recordings: from short windows to whole recordings.

In short windows a wrong number cannot carry the simulation away, so that a fit there is nearly a linear regression on
the motion; nothing is refused because a free run falls or runs away. Longer windows join one after the other.
"""

import dataclasses
import math
import time
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..model.effects.drives import AbstractDelay
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..model.step_size import allows_order_4, stiff_axes, substeps
from .data.windows import Data, course
from .likelihood import Index, Likelihood, index, likelihood
from .prior import Prior
from .sensitivity.engine import Engine
from .sensitivity.windowed_rollout import Stepping, Steps
from .setting import FINER, Setting, free_places, moments_of, overrides
from .solver import Limits, Normal, Point, Start, evaluate, normal_equations, residuals, solve

_HISTORY = 0.6
"""Time before a recording [s] whose inputs its drives feel, unless a model has longer delays or lags."""
_FIRST, _NEXT = 6, 12
"""Iterations on the shorter windows, and on all."""
_SOME = 3
"""Recordings on which fits from several starts are compared."""
_ELSEWHERE = (1.0 / 3.0, 3.0)
"""Lags and delays from which a fit is tried again, over those that it found."""


@dataclasses.dataclass(frozen=True)
class FittedModel:
    """A structure with the parameters that meet the recordings best, and how well they do."""

    plant: Plant
    known: frozenset[str]
    point: Point
    """Parameters, initial states, and each window's error."""
    engine: Engine

    @property
    def table(self) -> ParameterTable:
        return self.engine.table

    @property
    def vector(self) -> NDArray[np.float64]:
        return self.point.vector

    @property
    def free(self) -> NDArray[np.int64]:
        return self.point.free


@dataclasses.dataclass(frozen=True)
class Problem:
    """Recordings with their windows and the criterion: what does not change while models are compared."""

    setting: Setting
    data: Data
    windows: Index
    likelihood: Likelihood
    until: float = math.inf
    """Time of `time.monotonic` [s] at which fits end wherever they are."""

    @property
    def recordings(self) -> list[int]:
        """Numbers of the recordings that it has windows of."""
        return sorted({tiling.recording for tiling in self.data.tilings})

    @property
    def is_late(self) -> bool:
        """Whether the time for fits is over."""
        return time.monotonic() > self.until

    def of_horizons(self, horizons: Sequence[float]) -> "Problem":
        """The same with the windows of some horizons only; the criterion of the others is left out."""
        return self._of([t.horizon in horizons for t in self.data.tilings])

    def shortest(self) -> "Problem":
        """The same with the windows of the two shortest horizons only: those in which a fit is nearly linear."""
        return self.of_horizons(self.data.horizons[:2])

    def of_some(self, most: int, point: Point | None = None) -> "Problem":
        """The same with so many of the recordings' tilings, evenly chosen; of other ones, or of more, where it takes
        these for every axis that moves to do so in one of them.

        Args:
            most: recordings.
            point: a fit whose worst recording, in which something may have happened once, is to be among them.
        """
        held = self.recordings
        if len(held) <= most:
            return self
        moving = {r: frozenset(np.flatnonzero(self.data.grids[r].active).tolist()) for r in held}

        def seen(recordings: Sequence[int]) -> frozenset[int]:
            return frozenset[int]().union(*(moving[r] for r in recordings))

        even = [held[i] for i in np.linspace(0, len(held) - 1, most).round().astype(int)]
        chosen: list[int] = []
        if point is not None:
            lost, share = self.likelihood.by_window(point.square).sum(axis=1), self.likelihood.share.sum(axis=1)
            own = [self.windows.recording == r for r in held]
            chosen = [held[int(np.argmax([lost[w].sum() / max(float(share[w].sum()), 1e-300) for w in own]))]]
            even[int(np.argmin(np.abs(np.array(even) - chosen[0])))] = chosen[0]
        if seen(even) == seen(held):
            return self.of_recordings(even)
        while seen(chosen) != seen(held):
            chosen.append(max(held, key=lambda r: (len(moving[r] - seen(chosen)), r in even)))
        return self.of_recordings([*chosen, *(r for r in even if r not in chosen)][: max(most, len(chosen))])

    def recordings_for_each_of(self, part: "Problem") -> float:
        """How many recordings this has for each one of a part: what some of them gain, all are taken to gain in
        proportion."""
        return len(self.recordings) / len(part.recordings)

    def of_recordings(self, numbers: Sequence[int]) -> "Problem":
        """The same with the tilings of some recordings only."""
        return self._of([t.recording in numbers for t in self.data.tilings])

    def _of(self, keep: Sequence[bool]) -> "Problem":
        data = self.data.with_tilings([t for t, k in zip(self.data.tilings, keep, strict=True) if k])
        chosen = np.array(keep)[self.windows.tiling]
        own = self.likelihood
        part = Likelihood(
            own.share[chosen], own.within[chosen], own.count[chosen], own.group[chosen], own.total, own.prior
        )
        return Problem(self.setting, data, index(data), part, self.until)

    def states_of(self, states: Sequence[NDArray[np.float64]], part: "Problem") -> tuple[NDArray[np.float64], ...]:
        """Those initial states that belong to the tilings of a part of this problem."""
        kept = {(t.recording, t.horizon) for t in part.data.tilings}
        tilings = self.data.tilings
        return tuple(s for s, t in zip(states, tilings, strict=True) if (t.recording, t.horizon) in kept)

    def states_with(
        self, states: Sequence[NDArray[np.float64]], part: "Problem", own: Sequence[NDArray[np.float64]]
    ) -> tuple[NDArray[np.float64], ...]:
        """Initial states of all tilings, with those of a part of this problem put in."""
        found = {(t.recording, t.horizon): s for t, s in zip(part.data.tilings, own, strict=True)}
        return tuple(found.get((t.recording, t.horizon), s) for t, s in zip(self.data.tilings, states, strict=True))

    @property
    def guesses(self) -> tuple[NDArray[np.float64], ...]:
        """First guesses of all initial states, by tiling."""
        return tuple(t.states for t in self.data.tilings)

    def judged_by(self, left: Sequence[NDArray[np.float64]]) -> "Problem":
        """The same with effective numbers of samples from what a model leaves."""
        return dataclasses.replace(self, likelihood=likelihood(self.data, self.windows, left, self.likelihood.prior))

    def solve(self, engine: Engine, starts: Sequence[Start], iterations: int = _NEXT) -> list[Point]:
        limits = Limits(iterations, until=self.until)
        return solve(engine, self.data, self.windows, self.likelihood, starts, limits)

    def solved_anew(self, engine: Engine, point: Point) -> Point:
        """A point, or a better one that fits to short windows find from other lags and delays.

        What a lag takes away a larger gain and damping give back in part, so that the criterion has minima at other
        time constants than the true one: between them it rises by little, but it rises.
        """
        moments = moments_of(engine.table)
        times = [int(p) for p in point.free if engine.table.entry(int(p)).info.unit == "s" and p not in moments]
        times = [p for p in times if point.vector[p] > 0.0]
        low = self.shortest().of_some(_SOME)
        states = self.states_of(point.states, low)
        starts = [Start(point.vector, point.free, states)]
        for place in times:
            for factor in _ELSEWHERE:
                vector = point.vector.copy()
                vector[place] *= factor
                starts.append(Start(vector, point.free, states))
        if len(starts) == 1:
            return point
        here, *others = low.solve(engine, starts, _FIRST)
        best = min(others, key=lambda p: p.value)
        if best.value >= here.value:
            return point
        there = Start(best.vector, best.free, self.states_with(point.states, low, best.states))
        [found] = self.solve(engine, [there])
        return min(point, found, key=lambda p: p.value)

    def evaluate(self, engine: Engine, starts: Sequence[Start]) -> list[Point]:
        return evaluate(engine, self.data, self.likelihood, starts)

    def normal(self, engine: Engine, points: Sequence[Point]) -> list[Normal]:
        return normal_equations(engine, self.data, self.windows, self.likelihood, points)

    def residuals(self, engine: Engine, point: Start | Point) -> list[NDArray[np.float64]]:
        return residuals(engine, self.data, point)

    def revalued(self, point: Point) -> Point:
        """A point by this problem's criterion."""
        return dataclasses.replace(point, value=self.likelihood.value(point.square) + point.prior)


def make_problem(setting: Setting, data: Data) -> Problem:
    """A problem whose criterion takes every sample of what is measured for a part of one smooth error."""
    windows = index(data)
    return Problem(setting, data, windows, likelihood(data, windows, prior=Prior(setting.masses)))


def engine_for(
    setting: Setting, data: Data, plant: Plant, given: int | None = None, width: int = 0, lanes: int = 0
) -> Engine:
    """Compiled simulations of a plant on recordings.

    Args:
        setting, data: of the recordings.
        plant: what is simulated.
        given, width, lanes: see `Engine`.
    """
    table = ParameterTable(plant)
    own, clocks = overrides(table, data.recordings), np.full((len(data.grids), table.size), math.inf)
    clocks[:, moments_of(table)] = np.array([setting.starts(g.recording) for g in data.grids])[:, None]
    early = 0.25 * setting.slot if math.isfinite(setting.slot) else 0.0
    memory = 1.5 * sum(float(e.delay) for e in plant.all(AbstractDelay)) + 5.0 * max(map(float, plant.time_constants()))
    history = max(_HISTORY, min(memory, max(r.duration for r in data.recordings)))
    courses = [
        course(g, data.samples, history, data.period, override, starts, early)
        for g, override, starts in zip(data.grids, own, clocks, strict=True)
    ]

    damped = stiff_axes(plant)
    number, fine = substeps(plant, data.period, damped=damped), setting.fine and allows_order_4(plant, damped)
    paces = Stepping(Steps(FINER * number, fine, damped), Steps(number, False, damped))
    return Engine(plant, courses, paces, len(data.tilings), given, width, lanes)


def start_of(problem: Problem, engine: Engine, plant: Plant, known: frozenset[str]) -> Start:
    """The plant's own numbers, and the first guesses of all initial states."""
    free = free_places(engine.table, known, problem.setting)
    return Start(np.array(engine.table.ravel(plant), dtype=float), free, problem.guesses)


def fit_structure(problem: Problem, plant: Plant, known: frozenset[str]) -> tuple[Problem, FittedModel]:
    """Fits a plant from its own numbers, from short windows to all.

    Returns:
        The problem with the effective numbers of samples that the fitted model's residuals have, and the model.
    """
    engine = engine_for(problem.setting, problem.data, plant)
    start = start_of(problem, engine, plant, known)
    horizons = problem.data.horizons
    for last in dict.fromkeys((min(2, len(horizons)), len(horizons))):
        some = horizons[:last]
        part = problem.of_horizons(some)
        begun = Start(start.vector, start.free, problem.states_of(start.states, part))
        part = part.judged_by(part.residuals(engine, begun))
        [point] = part.solve(engine, [begun], _FIRST if last < len(horizons) else _NEXT)
        states = iter(point.states)
        merged = tuple(
            next(states) if t.horizon in some else s for s, t in zip(start.states, problem.data.tilings, strict=True)
        )
        start = Start(point.vector, point.free, merged)
    problem = problem.judged_by(problem.residuals(engine, start))
    [point] = problem.solve(engine, [start])
    point = problem.solved_anew(engine, point)
    return problem, FittedModel(engine.table.unravel(point.vector), known, point, engine)
