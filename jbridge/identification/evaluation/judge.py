"""How well a fixed model meets recordings: free runs, and windows of several horizons.

The initial state of a window is estimated from the half second before it (that of a recording's first from its own
first half second), and no reading of the window itself bears on it. So an error says what the model foresees. What a
model lacks has moved it away from the rig by the end of that half second; a Kalman filter makes up for that, whose one
number is chosen by all of a recording's half seconds.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...model.plant import Plant
from ...recordings import Recording
from ..data.grid import Grid
from ..data.windows import WHOLE, Data, Tiling, deviations, make_data, tiling
from ..estimation import engine_for
from ..likelihood import index, likelihood
from ..sensitivity.engine import Engine, Job, Sensitivity
from ..sensitivity.windowed_rollout import STATES
from ..setting import Setting, resolve, setting_of
from ..solver import Limits, Point, Start, residual, residuals, solve, squares
from .errors import Evaluation
from .kalman_filter import corrections

REPORTED = (0.1, 0.3, 1.0, 2.0, 3.0, WHOLE)
"""Horizons of a report [s]."""
_BEFORE = 0.5
"""Time that an initial state is estimated from [s]."""
_ITERATIONS = 5
_SHORTEST = 0.01
"""Rope length [m] for which a swing's frequency is computed at least."""


@dataclasses.dataclass(frozen=True)
class Judge:
    """Recordings cut into the windows of a report, with what an evaluation of any model needs."""

    setting: Setting
    starts: Data
    """The stretches that initial states are estimated from; each serves all windows that begin half a second later,"""
    data: Data
    """and the windows, which are simulated from there; their errors count from their own beginning."""
    places: tuple[NDArray[np.int64], ...]
    """Which of the stretches each window is simulated from, by tiling, over all tilings of `starts`."""

    def evaluate(self, plant: Plant, like: Engine | None = None) -> Evaluation:
        """Errors of a model.

        Args:
            plant: the model.
            like: an engine of such a plant on other recordings, whose programs serve again.
        """
        engine = self.engine(plant, like)
        vector = np.array(engine.table.ravel(plant), dtype=float)
        return self.at(engine, vector)

    def engine(self, plant: Plant, like: Engine | None = None) -> Engine:
        """Compiled simulations of a plant on these recordings, see `evaluate`."""
        width, lanes = (0, 0) if like is None else (like.width, like.lanes)
        return engine_for(self.setting, self.data, plant, width=width, lanes=lanes)

    def at(self, engine: Engine, vector: NDArray[np.float64]) -> Evaluation:
        """Errors of a model, by its engine and parameters."""
        data, begun = self.data, self._begun(engine, vector)
        jobs = self._shifted(self._jobs(self._of_windows(begun)), self._corrections(engine, begun))
        predicted = engine.predict(jobs)
        square = np.concatenate([squares(data, k, found) for k, found in enumerate(predicted)])
        left = [_counted(residual(data, k, predicted[k]), t) for k, t in enumerate(data.tilings)]
        whole = {t.recording: found for t, found in zip(data.tilings, predicted, strict=True) if math.isinf(t.horizon)}
        free = tuple(whole[r] for r in range(len(data.grids)))
        left_open = functools.partial(self._undetermined, engine, jobs)
        return Evaluation(data, index(data), square, free, tuple(left), left_open)

    def start(self, engine: Engine, vector: NDArray[np.float64]) -> Start:
        """A model with the initial state of each window, estimated from the half second before it.

        Nothing but its own recording bears on a window: neither the noise of others, nor how soon they are met. So
        whoever simulates one of several recordings alone arrives at the same state.
        """
        return self._of_windows(self._begun(engine, vector))

    def _begun(self, engine: Engine, vector: NDArray[np.float64]) -> Point:
        """A model fitted to the stretches by their initial states."""
        found = index(self.starts)
        criterion = likelihood(self.starts, found)
        begun = Start(vector, np.zeros(0, np.int64), tuple(t.states for t in self.starts.tilings))
        # Six numbers of a beginning take fewer simulations than the tangents of a fit have columns.
        alone = engine.by_differences()
        [point] = solve(alone, self.starts, found, criterion, [begun], Limits(_ITERATIONS, tolerance=0.0))
        return point

    def _of_windows(self, begun: Point) -> Start:
        every = np.concatenate(begun.states)
        return dataclasses.replace(begun.start, states=tuple(every[own] for own in self.places))

    def _corrections(self, engine: Engine, begun: Point) -> list[NDArray[np.float64]]:
        """What is added to coordinates and velocities where windows begin, by tiling `(window, 6)`: where a Kalman
        filter finds the rig by then, less where the stretch's simulation is."""
        tilings, starts = self.data.tilings, self.starts.tilings
        left = np.stack(residuals(engine, self.starts, begun))
        of_stretch = np.concatenate([np.full(t.windows, k) for k, t in enumerate(starts)])
        precision = np.concatenate([t.precision for t in starts])
        out = [np.zeros((t.windows, STATES)) for t in tilings]
        for r, g in enumerate(self.data.grids):
            own = [k for k, t in enumerate(tilings) if t.recording == r]
            # Nothing is before the first sample, and what nothing counts of only leads to another window.
            told = [(t.begins < t.count_from) & (t.count_from < t.stops) for t in (tilings[k] for k in own)]
            ends = np.concatenate([tilings[k].count_from[which] for k, which in zip(own, told, strict=True)])
            if not len(ends):
                continue
            ends, first = np.unique(ends, return_index=True)
            begins = np.concatenate([tilings[k].begins[which] for k, which in zip(own, told, strict=True)])[first]
            places = np.concatenate([self.places[k][which] for k, which in zip(own, told, strict=True)])[first]
            rows = np.minimum(begins[:, None] + np.arange(int((ends - begins).max()) + 1), ends[:, None])
            before = rows[:, :-1] < ends[:, None]
            found = np.zeros((len(ends), STATES))
            gravity = float(begun.vector[engine.table.positions("gravity")[0]])
            frequency = math.sqrt(gravity / max(g.length, _SHORTEST))
            for k in np.flatnonzero(g.active):
                noise = self.starts.noise[r, k]
                if np.isnan(noise):
                    continue
                seen = before & self.data.measured[r][rows[:, :-1], k]
                miss = -left[of_stretch[places][:, None], rows[:, :-1], k]
                spread = 1.0 / np.maximum(precision[places][:, [k, k + 3]], 1e-6) / noise
                pulled = frequency if AXES[k] == "psi" else 0.0
                found[:, [k, k + 3]] = noise * corrections(g.times[rows], miss, seen, spread, pulled)
            for number, which in zip(own, told, strict=True):
                out[number][which] = found[np.searchsorted(ends, tilings[number].count_from[which])]
        return out

    def _jobs(self, start: Start) -> list[Job]:
        """Simulations of all windows."""
        tilings = self.data.tilings
        return [Job(start.vector, t.recording, t.begins, s) for t, s in zip(tilings, start.states, strict=True)]

    def _shifted(self, jobs: Sequence[Job], shifts: Sequence[NDArray[np.float64]]) -> list[Job]:
        """The same, corrected where windows begin."""
        out = []
        for job, t, moved in zip(jobs, self.data.tilings, shifts, strict=True):
            own = moved.any(axis=1)
            out.append(job._replace(shifted=t.count_from[own], shifts=moved[own]))
        return out

    def _undetermined(self, engine: Engine, jobs: Sequence[Job]) -> NDArray[np.float64]:
        """See `Evaluation`; to first order."""
        tilings = self.data.tilings
        precisions = np.concatenate([t.precision for t in self.starts.tilings])
        lengths = np.concatenate([t.stops - t.begins for t in self.starts.tilings])
        out: list[NDArray[np.float64]] = [np.zeros(0)] * len(jobs)

        def take(k: int, found: Sensitivity) -> None:
            own = tilings[k]
            measured = self.data.measured[own.recording]
            noise, early = (
                np.where(np.isnan(sigma), 1.0, sigma)
                for sigma in (self.data.noise[own.recording], self.starts.noise[own.recording])
            )
            tangents = np.where(measured, found.tangents, 0.0)
            out[k] = np.zeros((own.windows, 3))
            for w, place in enumerate(self.places[k]):
                precision = precisions[place]
                free = np.isfinite(precision)
                stretch = tangents[free, own.begins[w] : own.begins[w] + lengths[place]]
                seen = (stretch / early).reshape(int(free.sum()), -1)
                told = seen @ seen.T + np.diag(precision[free] ** 2)
                unit = np.sqrt(np.maximum(np.diag(told), 1e-150))
                covariance = np.linalg.pinv(told / np.outer(unit, unit), 1e-9, hermitian=True) / np.outer(unit, unit)
                later = tangents[free, own.count_from[w] : own.stops[w]] / noise
                total = np.sum(later * np.tensordot(covariance, later, 1), axis=(0, 1))
                out[k][w] = total / np.maximum(measured[own.count_from[w] : own.stops[w]].sum(axis=0), 1)

        engine.by_differences().sensitivities(jobs, take)
        return np.concatenate(out)

    def free_runs(self, engine: Engine, start: Start) -> list[NDArray[np.float64]]:
        """Readings of each recording's simulation as a whole, at every sample, `(sample, 3)`."""
        jobs = [j for j, t in zip(self._jobs(start), self.data.tilings, strict=True) if math.isinf(t.horizon)]
        return engine.predict(jobs)


def _counted(left: NDArray[np.float64], own: Tiling) -> NDArray[np.float64]:
    """Residuals of the samples that count."""
    out = np.zeros_like(left)
    for begin, stop in zip(own.count_from, own.stops, strict=True):
        out[begin:stop] = left[begin:stop]
    return out


def make_judge(
    setting: Setting,
    recordings: Sequence[Recording],
    noise: Mapping[str, float] | None = None,
    horizons: Sequence[float] = REPORTED,
    samples: int = 0,
) -> Judge:
    """Cuts recordings into the windows of a report.

    Args:
        setting: of the model and all recordings.
        recordings: measured runs.
        noise: standard deviation of each channel for all recordings, in whose units errors are counted; estimated for
            each recording by default, as it always is where initial states are.
        horizons: lengths of windows [s].
        samples: length of the grid at least, so that programs that are compiled for it serve again.
    """
    data = make_data(recordings, horizons, noise, samples)
    sigma = deviations(recordings)
    starts: list[Tiling] = []
    runs, places = [], []
    for r, g in enumerate(data.grids):
        own = [(t, _early(g, t.begins)) for t in data.tilings if t.recording == r]
        at = np.unique(np.concatenate([[0], *(early for _, early in own)]))
        until = np.maximum(np.searchsorted(g.times, g.times[at] + _BEFORE - 1e-9), at + 2)
        until = np.minimum(until, g.intervals + 1)
        place = np.zeros(g.intervals + 1, np.int64)
        for chosen in _passes(at, until):
            begins, stops = _from_the_first(at[chosen], until[chosen])
            first = sum(t.windows for t in starts) + len(begins) - len(chosen)
            place[at[chosen]] = first + np.arange(len(chosen))
            starts.append(tiling(g, r, WHOLE, begins, stops, sigma[r]))
        for t, early in own:
            for chosen in _passes(early, t.stops):
                begins, counts, stops = _from_the_first(early[chosen], t.begins[chosen], t.stops[chosen])
                none = np.zeros((len(begins), STATES))
                runs.append(Tiling(r, t.horizon, begins, stops, none, none, counts))
                places.append(place[begins])
    starting = dataclasses.replace(data, noise=sigma, tilings=tuple(starts))
    return Judge(setting, starting, data.with_tilings(runs), tuple(places))


def free_run(plant: Plant, recording: Recording) -> NDArray[np.float64]:
    """Simulates a recording as a report does, from an initial state that its first half second tells.

    Args:
        plant: the model.
        recording: what was measured.

    Returns:
        Readings of `x` [m], `psi` [rad] and `l` [m] at the recording's rows, `(row, 3)`.
    """
    whole = setting_of(plant, [recording])
    setting = whole.thinned()
    plant = resolve(plant, setting.length)
    judge = make_judge(setting, setting.recordings, setting.noise)
    engine = judge.engine(plant)
    start = judge.start(engine, np.array(engine.table.ravel(plant), dtype=float))
    if setting.recordings[0] is not recording:
        # From the state that the fewer samples told, at the rows between them as well.
        [state] = [s for s, t in zip(start.states, judge.data.tilings, strict=True) if math.isinf(t.horizon)]
        judge = make_judge(whole, [recording], whole.noise, (WHOLE,))
        engine, start = judge.engine(plant), dataclasses.replace(start, states=(state,))
    [found] = judge.free_runs(engine, start)
    times = judge.data.grids[0].times
    return found[np.searchsorted(times, recording.times - recording.start)]


def _early(g: Grid, begins: NDArray[np.int64]) -> NDArray[np.int64]:
    """The measured samples half a second before windows begin, or the first."""
    early = np.searchsorted(g.times, g.times[np.minimum(begins, g.intervals)] - _BEFORE + 1e-9)
    rows = np.flatnonzero(g.measured.any(axis=1))
    early = rows[np.minimum(np.searchsorted(rows, early), len(rows) - 1)]
    return np.minimum(early, begins)


def _from_the_first(begins: NDArray[np.int64], *ends: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """Windows with one before them from the first sample on, if there is room: what is hidden where the first of them
    begins follows from the simulation of what came before."""
    if begins[0] == 0:
        return begins, *ends
    return np.r_[0, begins], *(np.r_[begins[0], end] for end in ends)


def _passes(begins: NDArray[np.int64], stops: NDArray[np.int64]) -> list[list[int]]:
    """Stretches by number, so many at a time that none reaches into another."""
    waiting, out = list(range(len(begins))), []
    while waiting:
        chosen: list[int] = []
        for w in waiting:
            if not chosen or begins[w] >= stops[chosen[-1]]:
                chosen.append(w)
        out.append(chosen)
        waiting = [w for w in waiting if w not in chosen]
    return out
