"""Predictions of windows and their forward sensitivities, for many parameter vectors at once.

Predictions decide, so their steps are short enough that integration errors do not show beside the noise. Tangents lead
to the next prediction and say how sure a number is; they cost ten times as much, and their steps are as long as they
may be.

Forward mode, since a fit has few parameters and many residuals: one tangent for each free parameter and one for each
coordinate and velocity of a window's beginning. A window's tangents end where the next one begins, so that those six
columns (fewer where an axis does not move) serve all windows of a recording together. Which parameters are free is data
as well.
"""

import copy
import math
import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from ...model.parameters import ParameterTable
from ...model.plant import Plant
from ..data.windows import Course
from .windowed_rollout import LOST, SHIFTED, STATES, Lanes, Stepping, Steps, predicted, tangents

_WIDEST = 24
"""Most parameter columns of a call; more are taken in several."""
_LANES = 8
"""Most simulations of a call. They share the cost of a step; more gain nothing."""
_DIFFERENCE, _LEAST_DIFFERENCE = 1e-5, 1e-7
"""Changes by which derivatives are taken as differences, over a number and at least."""
_ROOM = 2**21
"""Readings that wait in memory for their differences to be taken, about."""
_CALL = 2**23
"""Numbers that a call gives at most, about, unless one simulation alone has more: tangents of a recording of ten
minutes take 100 MB, and several calls wait in memory."""
_HELD = 2**25
"""Tangents of unfinished jobs in memory, in numbers, unless one job alone has more."""
_THREADS = max(1, min(2, os.cpu_count() or 1))


class Job(NamedTuple):
    """One simulation of a recording."""

    vector: NDArray[np.float64]
    """All parameters of the plant."""
    recording: int
    begins: NDArray[np.int64]
    """Samples at which windows begin,"""
    states: NDArray[np.float64]
    """and the readings and their rates there, `(window, 6)`."""
    free: NDArray[np.int64] = np.zeros(0, np.int64)
    """Places of the parameters whose tangents are wanted."""
    shifted: NDArray[np.int64] = np.zeros(0, np.int64)
    """Samples at which coordinates and velocities are shifted,"""
    shifts: NDArray[np.float64] = np.zeros((0, STATES))
    """and by how much, `(sample, 6)`."""


class Sensitivity(NamedTuple):
    """Derivatives of a job's readings, on the recording's grid."""

    columns: tuple[NDArray[np.float64], ...]
    """By the free parameters and by the six numbers of a beginning, each `(3, sample)`; 0 where a simulation runs
    away."""

    @property
    def tangents(self) -> NDArray[np.float64]:
        """The same as one array, `(column, sample, 3)`."""
        return np.moveaxis(np.stack(self.columns), 1, 2)


class Engine:
    """Compiled simulations of one plant structure, or of all structures that lack some of its effects."""

    def __init__(
        self,
        plant: Plant,
        courses: Sequence[Course],
        steps: Stepping,
        jobs: int,
        given: int | None = None,
        width: int = 0,
        lanes: int = 0,
    ):
        """Args:
        plant: gives the structure, and the numbers at which effects are absent.
        courses: inputs of the recordings.
        steps: how time passes.
        jobs: simulations that are usually wanted at a time.
        given: number of effects, from the first, that all structures have; of the others a simulation computes those
            alone of which some number is free or not the plant's. By default all structures have all.
        width: parameter columns of a call; simulations that want more have several, so that one program serves all. By
            default as many as are wanted at a time.
        lanes: simulations of a call; by default as many as `jobs` ask for.
        """
        self.table = ParameterTable(plant)
        self._absent = np.array(self.table.ravel(plant), dtype=float)
        self._given = None if given is None else np.arange(len(plant.effects)) < given
        self.steps = steps
        self.count = len(courses)
        # Enough for all processors, and mostly the same, so that programs serve other recordings as well.
        self.lanes = lanes or (_LANES if jobs > _LANES else max(1, math.ceil(jobs / _THREADS)))
        self._width, self._grows = min(width, _WIDEST), width == 0
        self._courses = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *courses)
        self.samples = self._courses.lane.dt.shape[1] + 1
        moving = np.array([np.any(flag) for flag in self._courses.lane.active])
        self._moving = np.flatnonzero(np.tile(moving, 2))
        self._by_differences = False

    def by_differences(self) -> "Engine":
        """The same with derivatives as differences of predictions, which takes longer than tangents do and spares the
        time to compile these: for a structure that is looked at a few times."""
        other = copy.copy(self)
        other._by_differences, other.lanes = True, _LANES
        return other

    def predicting_in(self, steps: Steps) -> "Engine":
        """The same with other integration steps of its predictions; tangents, which only lead to them, stay."""
        other = copy.copy(self)
        other.steps = self.steps._replace(predictions=steps)
        return other

    @property
    def width(self) -> int:
        """Parameter columns of a call so far."""
        return self._width

    def predict(self, jobs: Sequence[Job]) -> list[NDArray[np.float64]]:
        """Readings of every job, `(sample, 3)`."""
        out: list[NDArray[np.float64]] = [np.zeros(0)] * len(jobs)

        def keep(i: int, places: NDArray[np.int64], lane: int, found: NDArray[np.float64]) -> None:
            out[i] = found[lane]

        self._run(jobs, [(i, np.zeros(0, np.int64)) for i in range(len(jobs))], None, self.lanes, keep)
        return out

    def sensitivities(self, jobs: Sequence[Job], take: Callable[[int, Sensitivity], None]) -> None:
        """Tangents of every job, each handed to `take` with the job's number when it is there.

        They are handed over one by one because those of all jobs together would not fit into memory.
        """
        if self._by_differences:
            most = 1 + STATES + max((len(job.free) for job in jobs), default=0)
            abreast = max(1, _ROOM // (most * self.samples * 3))
            for a in range(0, len(jobs), abreast):
                for i, found in enumerate(self._differences(jobs[a : a + abreast]), a):
                    take(i, found)
            return
        most = max((len(job.free) for job in jobs), default=0)
        if self._grows:
            self._width = max(self._width, math.ceil(most / max(math.ceil(most / _WIDEST), 1)), 1)
        abreast = max(1, _HELD // ((most + STATES) * 3 * self.samples))
        for first in range(0, len(jobs), abreast):

            def complete(k: int, found: Sensitivity, first: int = first) -> None:
                take(first + k, found)

            self._tangents(jobs[first : first + abreast], complete)

    def _tangents(self, jobs: Sequence[Job], take: Callable[[int, Sensitivity], None]) -> None:
        """Tangents of jobs whose columns are in memory at the same time."""
        parts, width = [], self._width
        for i, job in enumerate(jobs):
            edges = range(0, max(len(job.free), 1), width)
            parts += [(i, job.free[a : a + width]) for a in edges]
        room = _CALL // ((width + len(self._moving)) * 3 * self.samples)
        lanes = max(1, min(self.lanes, room))
        # Those with the same columns side by side, since a call computes the effects of all of its parts.
        parts.sort(key=lambda part: part[1].tolist())
        none = np.zeros((3, self.samples))
        columns = [[none] * (len(job.free) + STATES) for job in jobs]
        missing = [max(len(job.free), 1) for job in jobs]

        def keep(i: int, places: NDArray[np.int64], lane: int, found: NDArray[np.float64]) -> None:
            own, free = found[lane], jobs[i].free
            for column, place in enumerate(np.flatnonzero(np.isin(free, places))):
                columns[i][int(place)] = own[:, column]
            for column, place in enumerate(self._moving):
                columns[i][len(free) + int(place)] = own[:, width + column]
            missing[i] -= max(len(places), 1)
            if missing[i] == 0:
                take(i, Sensitivity(tuple(columns[i])))
                columns[i] = []

        self._run(jobs, parts, width, lanes, keep)

    def _differences(self, jobs: Sequence[Job]) -> list[Sensitivity]:
        """What predictions of jobs change by with each number."""
        every: list[Job] = []
        sizes: list[list[float]] = []
        for job in jobs:
            every.append(job)
            own = []
            for place in job.free:
                vector = job.vector.copy()
                own.append(max(_DIFFERENCE * abs(vector[place]), _LEAST_DIFFERENCE))
                vector[place] += own[-1]
                every.append(job._replace(vector=vector))
            for place in self._moving:
                states = job.states.copy()
                states[:, place] += _DIFFERENCE
                own.append(_DIFFERENCE)
                every.append(job._replace(states=states))
            sizes.append(own)
        predicted, out = iter(self.predict(every)), []
        for job, own in zip(jobs, sizes, strict=True):
            here = next(predicted)
            columns = [np.zeros((3, self.samples))] * (len(job.free) + STATES)
            for place, size in zip([*range(len(job.free)), *(len(job.free) + self._moving)], own, strict=True):
                change = (next(predicted) - here).T / size
                # A simulation that runs away has no derivative to go by.
                columns[place] = np.where(np.abs(change) < LOST, change, 0.0)
            out.append(Sensitivity(tuple(columns)))
        return out

    def _present(self, parts: Sequence[tuple[NDArray[np.float64], NDArray[np.int64]]]) -> NDArray[np.bool_] | None:
        """Which effects some of the parts of a call have: their parameters, and which of these are free."""
        if self._given is None:
            return None
        used = np.zeros(self.table.size, bool)
        for vector, places in parts:
            used |= (vector != self._absent) & ~(np.isnan(vector) & np.isnan(self._absent))
            used[places] = True
        owners = self.table.owners()
        present = self._given.copy()
        present[owners[used & (owners >= 0)]] = True
        return present

    def _run(
        self,
        jobs: Sequence[Job],
        parts: Sequence[tuple[int, NDArray[np.int64]]],
        width: int | None,
        lanes: int,
        keep: Callable[[int, NDArray[np.int64], int, NDArray[np.float64]], None],
    ) -> None:
        """Runs parts of jobs, so many at a time, on all processors. Results are handed over in order.

        Args:
            jobs: what is simulated.
            parts: numbers of jobs, and places of the parameters whose tangents are wanted.
            width: parameter columns of a call; without tangents None.
            lanes: parts of a call.
            keep: takes a part's job, its places, its lane, and what the call gave.
        """
        calls = [parts[a : a + lanes] for a in range(0, len(parts), lanes)]

        def call(own: Sequence[tuple[int, NDArray[np.int64]]]) -> NDArray[np.float64]:
            # A short call repeats its last part: one shape, one program.
            full = [*own, *([own[-1]] * (lanes - len(own)))]
            size = self.table.size
            vectors = np.zeros((lanes, size))
            along: Any = np.zeros((lanes, width or 0, size))
            present = self._present([(jobs[i].vector, places) for i, places in own])
            restart = np.zeros((lanes, self.samples))
            states = np.zeros((lanes, self.samples, STATES))
            which = np.zeros(lanes, np.int64)
            for k, (i, places) in enumerate(full):
                job = jobs[i]
                vectors[k], which[k] = job.vector, job.recording
                along[k, np.arange(len(places)), places] = 1.0
                restart[k, job.begins] = 1.0
                states[k, job.begins] = job.states
                restart[k, job.shifted], states[k, job.shifted] = SHIFTED, job.shifts
            courses = jax.tree.map(lambda leaf: leaf[which], self._courses)
            # Programs take arrays of NumPy as they are.
            arrays: Any = vectors, courses, restart, states, present
            given = Lanes(*arrays)
            if width is None:
                return np.asarray(predicted(self.table, given, self.steps.predictions))
            begun: Any = np.eye(STATES)[self._moving]
            return np.asarray(tangents(self.table, given, along, begun, self.steps.tangents))

        def take(own: Sequence[tuple[int, NDArray[np.int64]]], found: NDArray[np.float64]) -> None:
            for lane, (i, places) in enumerate(own):
                keep(i, places, lane, found)

        # Few calls wait in memory at a time, and no processor waits for the others.
        waiting: deque[tuple[Sequence[tuple[int, NDArray[np.int64]]], Future]] = deque()
        with ThreadPoolExecutor(_THREADS) as pool:
            for own in calls:
                if len(waiting) == 2 * _THREADS:
                    first, found = waiting.popleft()
                    take(first, found.result())
                waiting.append((own, pool.submit(call, own)))
            while waiting:
                first, found = waiting.popleft()
                take(first, found.result())
