"""Recordings tiled with windows of several lengths.

A tiling is one recording cut into windows of one length (a horizon). A window is simulated from its own initial state,
so that short windows show forces and long ones show what adds up: drifts, scales, slow damping.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from ..._types import AXES, Axes
from ...errors import InputError
from ...recordings import Recording
from ...simulation.inputs import Lane
from .grid import Grid, grid
from .initial_states import initial_states
from .noise import noise_floor

WHOLE = math.inf
"""The horizon of a whole recording."""
HORIZONS = (0.3, 1.0, 3.0, WHOLE)
"""Lengths of windows [s]."""
_EARLY, _MOVING = 0.05, 0.02
"""Time [s] over which, and speed [m/s] from which, an axis is seen to move when its recording begins."""
_FEWEST = 6
"""Samples of a window, at least, for a horizon to be used,"""
_MOST = 0.6
"""and share of the recording's time, at most."""


class Course(eqx.Module):
    """Inputs of one recording, padded to the length of the longest."""

    lane: Lane
    override_at: Float[Array, " parameter"]
    """1 where the recording sets a parameter of its own,"""
    override_to: Float[Array, " parameter"]
    starts: Float[Array, " parameter"]
    """When its run starts on the clock of events [s], at the places of moments, see `Setting.slot`; else infinite."""
    early: Float[Array, ""]
    """How long before that its slot begins [s]."""


@dataclasses.dataclass(frozen=True)
class Tiling:
    """One recording cut into windows of one horizon. Window `w` has the samples from `begins[w]` up to `stops[w]`."""

    recording: int
    horizon: float
    begins: NDArray[np.int64]
    stops: NDArray[np.int64]
    states: NDArray[np.float64]
    """First guess of each window's readings and rates at its beginning, `(window, 6)`."""
    precision: NDArray[np.float64]
    """One over the standard deviations of these guesses; infinite where a number is held."""
    count_from: NDArray[np.int64]
    """Sample from which a window's error counts (`begins` where all of it does)."""

    @property
    def windows(self) -> int:
        return len(self.begins)

    def sums(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums over the samples that count of each window, of values by sample; each for itself, since a simulation
        that runs away in one window leaves values beside which those of the next would be lost in a running total."""
        padded = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
        found = np.add.reduceat(padded, np.stack([self.count_from, self.stops], axis=1).ravel(), axis=0)[::2]
        found[self.stops <= self.count_from] = 0.0
        return found


@dataclasses.dataclass(frozen=True)
class Data:
    """Recordings on the engine's grid, in units of their noise, with tilings."""

    recordings: tuple[Recording, ...]
    grids: tuple[Grid, ...]
    noise: NDArray[np.float64]
    """Standard deviation by recording and channel [m, rad, m]; NaN where a channel is not measured."""
    y: NDArray[np.float64]
    """Measurements `(recording, sample, 3)`, 0 where there is none."""
    measured: NDArray[np.bool_]
    tilings: tuple[Tiling, ...]
    period: float
    """Median time between samples [s]."""

    @property
    def samples(self) -> int:
        return self.y.shape[1]

    @functools.cached_property
    def weight(self) -> NDArray[np.float64]:
        """One over the noise `(recording, sample, 3)`, 0 where nothing is measured."""
        return np.where(self.measured, 1.0 / np.where(np.isnan(self.noise), 1.0, self.noise)[:, None], 0.0)

    @functools.cached_property
    def measured_before(self) -> NDArray[np.int64]:
        """Measurements before each sample, and in all, `(recording, sample + 1, 3)`."""
        return np.pad(np.cumsum(self.measured, axis=1), [(0, 0), (1, 0), (0, 0)])

    def with_tilings(self, tilings: Sequence[Tiling]) -> "Data":
        """The same recordings cut into other windows."""
        return dataclasses.replace(self, tilings=tuple(tilings))

    @property
    def horizons(self) -> tuple[float, ...]:
        return tuple(sorted({t.horizon for t in self.tilings}))


def make_data(
    recordings: Sequence[Recording],
    horizons: Sequence[float] = HORIZONS,
    noise: Mapping[str, float] | None = None,
    samples: int = 0,
) -> Data:
    """Puts recordings on the grid and tiles them with windows of each horizon.

    Args:
        recordings: measured runs.
        horizons: lengths of windows [s]; those that a recording has too few samples for, or that are hardly shorter
            than the recording itself, are left out.
        noise: standard deviation of each channel for all recordings; estimated for each recording by default.
        samples: length of the grid at least, so that programs that are compiled for it serve again.
    """
    period = float(np.median([recording.period for recording in recordings]))
    grids = tuple(grid(recording, max(1.5 * period, 1e-4)) for recording in recordings)
    samples = max(rounded(max(g.intervals for g in grids)) + 1, samples)
    shape = (len(grids), samples, 3)
    y, measured, sigma = np.zeros(shape), np.zeros(shape, bool), deviations(recordings, noise)
    tilings = []
    for r, g in enumerate(grids):
        y[r, : g.intervals + 1], measured[r, : g.intervals + 1] = g.y, g.measured
        for horizon in horizons:
            edges = _edges(g, horizon)
            if edges is not None:
                tilings.append(tiling(g, r, horizon, edges[:-1], edges[1:], sigma[r]))
    return Data(tuple(recordings), grids, sigma, y, measured, tuple(tilings), period)


def make_windows(recordings: Sequence[Recording], horizon: float) -> Data:
    """Recordings with windows of one length [s] in each.

    Raises:
        InputError: a recording is too short for them, or has too few samples in each.
    """
    data = make_data(recordings, (horizon,))
    cut = {tiling.recording for tiling in data.tilings}
    for r, (recording, g) in enumerate(zip(recordings, data.grids, strict=True)):
        if r not in cut:
            most = _MOST * float(g.times[-1])
            long, bound = horizon > most, f"at most {most:.2g} s"
            if not long:
                bound = f"at least {_FEWEST * float(np.median(np.diff(g.times[g.measured.any(axis=1)]))):.2g} s"
            raise InputError(
                f"{recording.name}: windows of {horizon:g} s are too {'long' if long else 'short'} for a recording of "
                f"{recording.duration:.3g} s with a sample every {recording.period:.2g} s ({bound}); leave it out, or "
                f"record {'longer' if long else 'more often'}"
            )
    return data


def deviations(recordings: Sequence[Recording], noise: Mapping[str, float] | None = None) -> NDArray[np.float64]:
    """Standard deviation of the noise by recording and channel [m, rad, m], NaN where a channel is not measured: the
    given one for all recordings, or each recording's own."""
    sigma = np.full((len(recordings), 3), np.nan)
    for r, recording in enumerate(recordings):
        own = noise_floor([recording]) if noise is None else noise
        for k, axis in enumerate(AXES):
            if getattr(recording, axis) is not None:
                sigma[r, k] = own[axis]
    return sigma


def tiling(
    g: Grid,
    recording: int,
    horizon: float,
    begins: NDArray[np.int64],
    stops: NDArray[np.int64],
    noise: NDArray[np.float64],
) -> Tiling:
    """A tiling with first guesses of its initial states."""
    sigma = {axis: float(value) for axis, value in zip(AXES, noise, strict=True)}
    states, precision = initial_states(g, begins, sigma)
    return Tiling(recording, horizon, begins, stops, states, precision, begins)


def _edges(g: Grid, horizon: float) -> NDArray[np.int64] | None:
    """Samples at which windows begin, and the end; None where the horizon does not suit the recording."""
    end, last = g.intervals + 1, float(g.times[-1])
    if math.isinf(horizon):
        return np.array([0, end])
    rows = np.flatnonzero(g.measured.any(axis=1))
    if horizon < _FEWEST * float(np.median(np.diff(g.times[rows]))) or horizon > _MOST * last:
        return None
    count = max(round(last / horizon), 1)
    edges = np.searchsorted(g.times, np.arange(count) * horizon)
    # What begins within a gap would be told of its state across it.
    edges = np.unique(rows[np.minimum(np.searchsorted(rows, edges), len(rows) - 1)])
    return np.append(edges[edges < end - 1], end)


def rounded(count: int) -> int:
    """A length a little above `count`, from a coarse list, so that few lengths of programs are compiled."""
    unit = max(1, 2 ** (count.bit_length() - 3))
    return -(-count // unit) * unit


def course(
    g: Grid,
    samples: int,
    history: float,
    period: float,
    override: Mapping[int, float],
    starts: NDArray[np.float64],
    early: float,
) -> Course:
    """A recording's inputs as the engine wants them.

    Args:
        g: the recording's grid.
        samples: number of samples of the longest recording's grid.
        history: time before the first sample [s] whose inputs a delay or a lag still feels.
        period: of the intervals before, where none were recorded [s].
        override: the recording's own parameters, by place.
        starts, early: see `Course`.
    """
    earlier = max(1, math.ceil(history / period))
    dt, u, before = np.zeros(samples - 1), np.zeros((earlier + samples - 1, 2)), np.full(earlier, period)
    dt[: g.intervals] = np.diff(g.times)
    u[earlier : earlier + g.intervals] = g.u
    known = len(g.u_before[-earlier:])
    if known:
        u[earlier - known : earlier], before[earlier - known :] = g.u_before[-earlier:], g.dt_before[-earlier:]
    else:
        for axis, column in ((0, 0), (2, 1)):
            if _under_way(g, axis):
                u[:earlier, column] = g.u[0, column]
    at, to = np.zeros(len(starts)), np.zeros(len(starts))
    for place, value in override.items():
        at[place], to[place] = 1.0, value
    begun, moving = np.asarray(float(g.recording.begun)), [np.asarray(float(moves)) for moves in g.active]
    begun, dt, u, before, moving = jax.device_put((begun, dt, u, before, moving))
    return Course(Lane(begun, dt, u, before, Axes(*moving)), *jax.device_put((at, to, starts, np.asarray(early))))


def _under_way(g: Grid, axis: int) -> bool:
    """Whether an axis moves when its recording begins: then what drives it at the first row has done so before.

    One that starts from rest gains its speed in the recording. So the rate at the first row, of a parabola, is looked
    at, and must be nearer to the mean rate of the first moments than to rest.
    """
    rows = np.flatnonzero(g.measured[:, axis] & (g.times <= _EARLY))
    if not g.active[axis] or len(rows) < 4:
        return False
    mean = np.polyfit(g.times[rows], g.y[rows, axis], 1)[0]
    first = np.polyfit(g.times[rows], g.y[rows, axis], 2)[1]
    return bool(abs(mean) > _MOVING and first / mean > 0.5)
