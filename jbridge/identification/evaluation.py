"""How well a fixed model meets recordings: free runs, and windows of several horizons.

The initial state of a window is estimated from the half second before it (that of a recording's first from its own
first half second), and nothing in the window itself is looked at. So an error says what the model foresees. What a
model lacks has moved it away from the rig by the end of that half second; a Kalman filter makes up for that.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..model.plant import Plant
from ..recordings import Recording
from .data.grid import Grid
from .data.windows import WHOLE, Data, Tiling, deviations, make_data, tiling
from .estimation import engine_for
from .kalman import corrections
from .likelihood import Index, index, likelihood
from .result import Errors
from .sensitivity.engine import Engine, Job, Sensitivity
from .sensitivity.windowed_rollout import STATES
from .setting import Setting, resolve, setting_of
from .solver import Point, Start, residual, residuals, solve, squares

REPORTED = (0.1, 0.3, 1.0, 2.0, 3.0, WHOLE)
"""Horizons of a report [s]."""
WINDOW = 2.0
"""Length of the windows whose errors stand beside those of free runs [s]."""
_BEFORE = 0.5
"""Time that an initial state is estimated from [s]."""
_ITERATIONS = 5


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Errors of one model on some recordings."""

    data: Data
    windows: Index
    square: NDArray[np.float64]
    """Mean square of each window's errors over the noise's variance, by window and channel."""
    predicted: tuple[NDArray[np.float64], ...]
    """Free run of each recording, `(sample, 3)`."""
    left: tuple[NDArray[np.float64], ...]
    """What each tiling leaves over the noise, `(sample, 3)`; 0 outside of its windows."""
    undetermined: NDArray[np.float64]
    """Mean variance of a window's prediction, by window and channel, over the noise's: what the half second before it
    leaves open of its initial state, carried on. A wide swing's period hangs on its amplitude, so a small part of the
    noise grows over a long recording, whatever the model."""

    @property
    def horizons(self) -> tuple[float, ...]:
        return self.data.horizons

    def of(self, horizon: float) -> NDArray[np.bool_]:
        """Which windows are of a horizon."""
        return np.asarray(self.windows.horizon == horizon)

    def noise(self) -> NDArray[np.float64]:
        """Noise by window and channel [m, rad, m]; 1 where a channel is not measured."""
        own = self.data.noise[self.windows.recording]
        return np.where(np.isnan(own), 1.0, own)

    def errors(self, horizon: float) -> dict[str, float]:
        """Root mean square error by channel [m, rad, m], over all samples."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            count = self.windows.count[own, k]
            if count.any():
                squares = self.square[own, k] * self.noise()[own, k] ** 2
                out[axis] = float(np.sqrt(np.sum(squares * count) / np.sum(count)))
        return out

    def foreseen(self, horizon: float) -> dict[str, float]:
        """Root mean square error that the true model stays below in 19 of 20 such recordings, by channel [m, rad, m]:
        the noise, and what is not determined of initial states."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            count = self.windows.count[own, k]
            if count.any():
                noise = self.noise()[own, k] ** 2 * count
                # A window's error comes from two numbers mostly, an angle and its rate: its square has their two
                # degrees of freedom, a mean like its standard deviation.
                state = self.undetermined[own, k] * noise
                total = np.sum(noise) + np.sum(state) + 2.0 * np.sqrt(np.sum(state**2))
                out[axis] = float(np.sqrt(total / np.sum(count)))
        return out

    def typical(self, horizon: float) -> dict[str, float]:
        """Geometric mean over windows in motion of the error by channel [m, rad, m]."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            weight = self.windows.motion[own, k]
            if weight.any():
                size = np.log(np.maximum(self.square[own, k], 1e-12)) / 2 + np.log(self.noise()[own, k])
                out[axis] = float(np.exp(np.average(size, weights=weight)))
        return out

    def excess(self, horizon: float) -> dict[str, float]:
        """Sum over samples of squared error less noise, by channel [m^2, rad^2, m^2]."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            count = self.windows.count[own, k]
            if count.any():
                variance = self.noise()[own, k] ** 2
                out[axis] = float(np.sum((self.square[own, k] - 1.0) * variance * count))
        return out

    def as_errors(self) -> Errors:
        """Errors of free runs and of windows."""
        return Errors(self.errors(WHOLE), self.errors(WINDOW))

    def ratios(self, horizon: float) -> dict[str, float]:
        """Root mean square error over the noise by channel."""
        own = self.of(horizon)
        return {
            axis: float(np.sqrt(np.average(self.square[own, k], weights=self.windows.count[own, k])))
            for k, axis in enumerate(AXES)
            if self.windows.count[own, k].any()
        }


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
        jobs = self._jobs(self._of_windows(begun), self._corrections(engine, begun))
        predicted = engine.predict(jobs)
        square = np.concatenate([squares(data, k, found) for k, found in enumerate(predicted)])
        left = [_counted(residual(data, k, predicted[k]), t) for k, t in enumerate(data.tilings)]
        whole = {t.recording: found for t, found in zip(data.tilings, predicted, strict=True) if math.isinf(t.horizon)}
        free = tuple(whole[r] for r in range(len(data.grids)))
        return Evaluation(data, index(data), square, free, tuple(left), self._undetermined(engine, jobs))

    def start(self, engine: Engine, vector: NDArray[np.float64]) -> Start:
        """A model with the initial state of each window, estimated from the half second before it.

        Nothing but its own recording bears on a window: neither the noise of others, nor how soon they are met. So
        whoever simulates one of several recordings alone arrives at the same state.
        """
        return self._of_windows(self._begun(engine, vector))

    def _begun(self, engine: Engine, vector: NDArray[np.float64]) -> Point:
        """A model fitted to the stretches by their initial states."""
        found = index(self.starts)
        criterion = likelihood(self.starts, found, [self.starts.y[t.recording] for t in self.starts.tilings])
        begun = Start(vector, np.zeros(0, np.int64), tuple(t.states for t in self.starts.tilings))
        [point] = solve(engine, self.starts, found, criterion, [begun], iterations=_ITERATIONS, tolerance=0.0)
        return point

    def _of_windows(self, begun: Point) -> Start:
        every = np.concatenate(begun.states)
        return dataclasses.replace(begun.start, states=tuple(every[own] for own in self.places))

    def _corrections(self, engine: Engine, begun: Point) -> list[NDArray[np.float64]]:
        """What is added to coordinates and velocities where windows begin, by tiling `(window, 6)`: where a Kalman
        filter finds the rig by then, less where the stretch's simulation is."""
        tilings, starts = self.data.tilings, self.starts.tilings
        left = residuals(engine, self.starts, begun)
        of_stretch = np.concatenate([np.full(t.windows, k) for k, t in enumerate(starts)])
        precision = np.concatenate([t.precision for t in starts])
        out = [np.zeros((t.windows, STATES)) for t in tilings]
        for r, g in enumerate(self.data.grids):
            own = [k for k, t in enumerate(tilings) if t.recording == r]
            ends, first = np.unique(np.concatenate([tilings[k].count_from for k in own]), return_index=True)
            begins = np.concatenate([tilings[k].begins for k in own])[first]
            places = np.concatenate([self.places[k] for k in own])[first]
            rows = np.minimum(begins[:, None] + np.arange(int((ends - begins).max()) + 1), ends[:, None])
            before = rows[:, :-1] < ends[:, None]
            found = np.zeros((len(ends), STATES))
            for k in np.flatnonzero(g.active):
                noise = self.starts.noise[r, k]
                if np.isnan(noise):
                    continue
                seen = before & self.data.measured[r][rows[:, :-1], k]
                miss = -np.stack(left)[of_stretch[places][:, None], rows[:, :-1], k]
                spread = 1.0 / np.maximum(precision[places][:, [k, k + 3]], 1e-6) / noise
                found[:, [k, k + 3]] = noise * corrections(g.times[rows], miss, seen, spread)
            for number in own:
                out[number] = found[np.searchsorted(ends, tilings[number].count_from)]
        return out

    def _jobs(self, start: Start, shifts: Sequence[NDArray[np.float64]] | None = None) -> list[Job]:
        """Simulations of all windows."""
        tilings = self.data.tilings
        jobs = [Job(start.vector, t.recording, t.begins, s) for t, s in zip(tilings, start.states, strict=True)]
        if shifts is None:
            return jobs
        # Where nothing counts a window only leads to the next.
        counted = [own.any(axis=1) & (t.count_from < t.stops) for own, t in zip(shifts, tilings, strict=True)]
        moved = zip(jobs, tilings, shifts, counted, strict=True)
        return [job._replace(shifted=t.count_from[own], shifts=each[own]) for job, t, each, own in moved]

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

        engine.sensitivities(jobs, take)
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


def scatter(data: Data, horizon: float) -> dict[str, float] | None:
    """How far runs of one input differ, by channel [m, rad, m]: rms difference over sqrt 2 of windows of one length.

    A window's difference is counted from what the two differ by at its beginning. None where no input was recorded
    twice.
    """
    pairs = [(i, j) for i in range(len(data.grids)) for j in range(i) if _same_input(data.grids[i], data.grids[j])]
    if not pairs:
        return None
    sums, counts = np.zeros(3), np.zeros(3)
    for i, j in pairs:
        n = min(data.grids[i].intervals, data.grids[j].intervals) + 1
        both = data.measured[i, :n] & data.measured[j, :n]
        apart = np.where(both, data.y[i, :n] - data.y[j, :n], 0.0)
        length = n if math.isinf(horizon) else max(int(round(horizon / data.period)), 2)
        for a in range(0, n - length + 1, length):
            own = apart[a : a + length]
            seen = both[a : a + length]
            head = max(min(int(round(0.02 / data.period)), length // 4), 1)
            begin = own[:head].sum(axis=0) / np.maximum(seen[:head].sum(axis=0), 1)
            sums += (((own - begin) ** 2) * seen).sum(axis=0)
            counts += seen.sum(axis=0)
    return {axis: float(np.sqrt(sums[k] / counts[k] / 2.0)) for k, axis in enumerate(AXES) if counts[k] > 0}


def _same_input(a: Grid, b: Grid) -> bool:
    n = min(len(a.u), len(b.u))
    if n < 0.9 * max(len(a.u), len(b.u)):
        return False
    size = float(np.ptp(a.u[:n]))
    return size > 0 and float(np.sqrt(np.mean((a.u[:n] - b.u[:n]) ** 2))) < 0.01 * size
