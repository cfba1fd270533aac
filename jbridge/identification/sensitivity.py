"""Predictions of windows and their forward sensitivities, for many parameter vectors at once.

A recording is simulated from its first sample to its last, and the measured coordinates are set anew wherever a window
begins. So one program serves windows of every length: where they begin is data. Hidden states (a lag, a bent spring, a
belt, a second pendulum) are never set; they follow from the simulation of what came before.

Forward mode, since a fit has few parameters and many residuals: one tangent for each free parameter and one for each
coordinate and velocity of a window's beginning. A window's tangents end where the next one begins, so that those six
columns (fewer where an axis does not move) serve all windows of a recording together. Which parameters are free is data
as well.
"""

import dataclasses
import functools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from .._programs import kept
from .._types import AXES, Axes
from ..inputs import Lane, arriving, even_steps, in_true_time, lags_at_start, supply
from ..model.effects.base import AbstractSensor
from ..model.effects.sensors import SensorDelay, SensorScale
from ..model.parameters import ParameterTable
from ..model.plant import Motion, Plant
from ..rollout import MIDPOINT, RK4, Interval, Motions, Path, advance, encoded, intervals, sensed, start
from .data.windows import Course

STATES = 6
"""Coordinates and velocities of a window's beginning: `x, psi, l` and their rates."""
_WIDEST = 24
"""Most parameter columns of a call; more are taken in several."""
_LANES = 8
"""Most simulations of a call. They share the cost of a step; more gain nothing."""
_TANGENT_LANES = 4
"""The same where tangents are wanted, of which each simulation has a dozen or two."""
_THREADS = max(1, min(2, os.cpu_count() or 1))
_FAR = 1e3
_FAST = 1e3
"""Bounds of coordinates [m, rad] and velocities, beyond which a simulation has run away: it goes on there, so that it
counts as one that is far off, not as one that says nothing."""
_BLOCK = 64
"""Samples of a block of time."""
_LOST = 1e12
"""Largest tangent."""
_WOUND_IN = 0.01
"""Shortest rope [m]."""


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


class Sensitivity(NamedTuple):
    """What a job gives, on the recording's grid."""

    predicted: NDArray[np.float64]
    """Readings, `(sample, 3)`."""
    columns: tuple[NDArray[np.float64], ...]
    """Their derivatives by the free parameters and by the six numbers of a beginning, each `(3, sample)`; 0 where a
    simulation runs away."""

    @property
    def tangents(self) -> NDArray[np.float64]:
        """The same as one array, `(column, sample, 3)`."""
        return np.moveaxis(np.stack(self.columns), 1, 2)


@dataclasses.dataclass(frozen=True)
class Steps:
    """How time passes."""

    number: int
    """Integration steps in each interval."""
    fine: bool = False
    """Whether they are of the classical method of order 4, at twice the cost of the midpoint method."""


class Engine:
    """Compiled simulations of one plant structure, or of all structures that lack some of its effects."""

    def __init__(
        self,
        plant: Plant,
        courses: Sequence[Course],
        steps: Steps,
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
        width: parameter columns of a call; by default as many as are wanted at a time.
        lanes: simulations of a call; by default as many as `jobs` ask for.
        """
        self.table = ParameterTable(plant)
        self._absent = np.array(self.table.ravel(plant), dtype=float)
        self._given = None if given is None else np.arange(len(plant.effects)) < given
        self.steps = steps
        self.count = len(courses)
        # Enough for all processors, and mostly the same, so that programs serve other recordings as well.
        self.lanes = lanes or (_LANES if jobs > _LANES else max(1, math.ceil(jobs / _THREADS)))
        self._width, self._wider = min(width, _WIDEST), width == 0
        self._courses = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *courses)
        self.samples = self._courses.lane.dt.shape[1] + 1
        moving = np.array([np.any(flag) for flag in self._courses.lane.active])
        self._moving = np.flatnonzero(np.tile(moving, 2))

    @property
    def width(self) -> int:
        """Parameter columns of a call so far."""
        return self._width

    def predict(self, jobs: Sequence[Job]) -> list[NDArray[np.float64]]:
        """Readings of every job, `(sample, 3)`."""
        out: list[NDArray[np.float64]] = [np.zeros(0)] * len(jobs)

        def keep(i: int, places: NDArray[np.int64], lane: int, found: tuple[NDArray[np.float64], ...]) -> None:
            out[i] = found[0][lane]

        self._run(jobs, [(i, np.zeros(0, np.int64)) for i in range(len(jobs))], 0, self.lanes, _predicted, keep)
        return out

    def sensitivities(self, jobs: Sequence[Job], take: Callable[[int, Sensitivity], None]) -> None:
        """Predictions and tangents of every job, each handed to `take` with the job's number when it is there.

        They are handed over one by one because those of all jobs together would not fit into memory.
        """
        if self._wider:
            most = max((len(job.free) for job in jobs), default=0)
            self._width = max(self._width, math.ceil(most / max(math.ceil(most / _WIDEST), 1)))
        width = max(self._width, 1)
        parts = []
        for i, job in enumerate(jobs):
            edges = range(0, max(len(job.free), 1), width)
            parts += [(i, job.free[a : a + width]) for a in edges]
        # Those with the same columns side by side, since a call computes the effects of all of its parts.
        parts.sort(key=lambda part: part[1].tolist())
        none = np.zeros((3, self.samples))
        columns = [[none] * (len(job.free) + STATES) for job in jobs]
        missing = [max(len(job.free), 1) for job in jobs]

        def keep(i: int, places: NDArray[np.int64], lane: int, found: tuple[NDArray[np.float64], ...]) -> None:
            predicted, tangents = found[0][lane], found[1][lane]
            free = jobs[i].free
            for column, place in enumerate(np.flatnonzero(np.isin(free, places))):
                columns[i][int(place)] = tangents[:, column]
            for column, place in enumerate(self._moving):
                columns[i][len(free) + int(place)] = tangents[:, width + column]
            missing[i] -= max(len(places), 1)
            if missing[i] == 0:
                take(i, Sensitivity(predicted, tuple(columns[i])))
                columns[i] = []

        self._run(jobs, parts, width, min(self.lanes, _TANGENT_LANES), _pushed, keep)

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
        width: int,
        lanes: int,
        program: Callable,
        keep: Callable[[int, NDArray[np.int64], int, tuple[NDArray[np.float64], ...]], None],
    ) -> None:
        """Runs parts of jobs, so many at a time, on all processors. Results are handed over in order."""
        calls = [parts[a : a + lanes] for a in range(0, len(parts), lanes)]

        def call(own: Sequence[tuple[int, NDArray[np.int64]]]) -> tuple[NDArray[np.float64], ...]:
            # A short call repeats its last part: one shape, one program.
            full = [*own, *([own[-1]] * (lanes - len(own)))]
            size = self.table.size
            vectors, towards = np.zeros((lanes, size)), np.zeros((lanes, width, size))
            present = self._present([(jobs[i].vector, places) for i, places in own])
            restart = np.zeros((lanes, self.samples))
            states = np.zeros((lanes, self.samples, STATES))
            which = np.zeros(lanes, np.int64)
            for k, (i, places) in enumerate(full):
                job = jobs[i]
                vectors[k], which[k] = job.vector, job.recording
                towards[k, np.arange(len(places)), places] = 1.0
                restart[k, job.begins] = 1.0
                states[k, job.begins] = job.states
            courses = jax.tree.map(lambda leaf: leaf[which], self._courses)
            begun = np.eye(STATES)[self._moving]
            given = (vectors, towards, begun, courses, restart, states, present)
            return tuple(np.asarray(part) for part in program(self.table, *given, self.steps))

        with ThreadPoolExecutor(_THREADS) as pool:
            # Few calls wait in memory at a time.
            for a in range(0, len(calls), 2 * _THREADS):
                some = calls[a : a + 2 * _THREADS]
                for own, found in zip(some, pool.map(call, some), strict=True):
                    for lane, (i, places) in enumerate(own):
                        keep(i, places, lane, found)


@kept(static=(0, 8))
def _predicted(
    table: ParameterTable,
    vectors: Float[Array, "lane parameter"],
    towards: Float[Array, "lane column parameter"],
    begun: Float[Array, "moving state"],
    courses: Course,
    restart: Float[Array, "lane sample"],
    states: Float[Array, "lane sample state"],
    present: Bool[Array, " effect"] | None,
    steps: Steps,
) -> tuple[Array]:
    def one(vector: Array, course: Course, restart: Array, states: Array) -> Array:
        return _simulated(table, vector, course, restart, states, present, steps)

    return (jax.vmap(one)(vectors, courses, restart, states),)


@kept(static=(0, 8))
def _pushed(
    table: ParameterTable,
    vectors: Float[Array, "lane parameter"],
    towards: Float[Array, "lane column parameter"],
    begun: Float[Array, "moving state"],
    courses: Course,
    restart: Float[Array, "lane sample"],
    states: Float[Array, "lane sample state"],
    present: Bool[Array, " effect"] | None,
    steps: Steps,
) -> tuple[Array, Array]:
    def all_lanes(vectors: Array, moved: Array) -> Array:
        def one(vector: Array, course: Course, restart: Array, states: Array) -> Array:
            return _simulated(table, vector, course, restart, states, present, steps, moved)

        return jax.vmap(one)(vectors, courses, restart, states)

    def push(direction: Array, change: Array) -> tuple[Array, Array]:
        predicted, tangent = jax.jvp(all_lanes, (vectors, jnp.zeros(STATES)), (direction, change))
        tangent = jnp.swapaxes(tangent, 1, 2)
        # A simulation that runs away has no tangents to go by.
        return predicted, jnp.where(jnp.abs(tangent) < _LOST, tangent, 0.0)

    lanes, width, size = towards.shape
    along = jnp.concatenate([jnp.swapaxes(towards, 0, 1), jnp.zeros((len(begun), lanes, size))])
    change = jnp.concatenate([jnp.zeros((width, STATES)), begun])
    # Columns outside, lanes inside: processors take neighbours together, and all lanes do the same.
    return jax.vmap(push, out_axes=(None, 2))(along, change)


def _simulated(
    table: ParameterTable,
    vector: Float[Array, " parameter"],
    course: Course,
    restart: Float[Array, " sample"],
    states: Float[Array, "sample state"],
    present: Bool[Array, " effect"] | None,
    steps: Steps,
    moved: Float[Array, " state"] | None = None,
) -> Float[Array, "sample 3"]:
    """Readings of one recording, with the measured coordinates set anew where `restart` is 1, moved by `moved`.

    Time passes in blocks: what is computed before and after the steps of a block stays in the processor's cache.
    """
    plant = table.unravel(jnp.where(course.override_at > 0, course.override_to, vector), fitted=True)
    plant = Plant(plant.bridge, plant.effects, present)
    samples, earlier = restart.shape[0], course.lane.before.shape[0]
    blocks = -(-samples // _BLOCK)
    lane = in_true_time(plant, _padded(course.lane, blocks * _BLOCK))
    restart, states = (_lengthened(part, blocks * _BLOCK) for part in (restart, states))
    given = supply(plant, lane)
    before = even_steps(given.edges[: earlier + 1], steps.number)
    lags = lags_at_start(plant, lane, before, arriving(plant, given, before, 0)[0])
    method = RK4 if steps.fine else MIDPOINT

    def own(values: Array, begin: Array | int, count: int = _BLOCK) -> Array:
        return jax.lax.dynamic_slice_in_dim(values, begin, count)

    def behind(times: Array, states: Array) -> tuple[Axes, Axes]:
        return _behind_sensors(plant, times, states if moved is None else states + moved[None])

    q, v = behind(given.edges[earlier : earlier + 1], states[:1])
    first = start(plant, jnp.stack([*(part[0] for part in q), *(part[0] for part in v)]), lags, lane.active)

    def interval(carry: Motions, now: tuple[Interval, Array, Axes, Axes]) -> tuple[Motions, tuple[Motion, Motion]]:
        told, begins, q, v = now
        carry = _set(carry, begins, q, v)
        after = _bounded(advance(plant, carry, told, lane.active, method=method, looped=True))
        return after, (carry.q, carry.v)

    def block(
        carry: tuple[Motions, tuple[Axes, Axes] | None], number: Array
    ) -> tuple[tuple[Motions, tuple[Axes, Axes] | None], Array]:
        motions, path = carry
        begin = number * _BLOCK
        edges = own(given.edges, earlier + begin, _BLOCK + 1)
        cut = even_steps(edges, steps.number)
        told = intervals(plant, cut, *arriving(plant, given, cut, earlier + begin))
        q, v = behind(edges[:-1], own(states, begin))
        motions, moving = jax.lax.scan(interval, motions, (told, own(restart, begin), q, v))
        now = encoded(plant, *moving)
        if path is None:
            return (motions, None), sensed(plant, edges[:-1], now[0], Path(edges[:-1], *now))
        path = jax.tree.map(lambda all, new: jax.lax.dynamic_update_slice_in_dim(all, new, begin, 0), path, now)
        return (motions, path), sensed(plant, edges[:-1], now[0], Path(times, *path))

    times, path = given.edges[earlier:-1], None
    if any(plant.all(SensorDelay)):
        # Late sensors look back over blocks; what is still to come lies ahead of all that they ask for.
        still = Axes(*(jnp.zeros_like(times) for _ in AXES))
        path = still, still
    _, found = jax.lax.scan(block, (first, path), jnp.arange(blocks))
    return found.reshape(-1, 3)[:samples]


def _padded(lane: Lane, count: int) -> Lane:
    """A lane of so many intervals; those that are added take no time."""
    return Lane(
        lane.start,
        _lengthened(lane.dt, count),
        _lengthened(lane.u, lane.before.shape[0] + count),
        lane.before,
        lane.active,
    )


def _lengthened(values: Array, count: int) -> Array:
    return jnp.pad(values, [(0, count - values.shape[0])] + [(0, 0)] * (values.ndim - 1))


def _behind_sensors(plant: Plant, times: Array, states: Array) -> tuple[Axes, Axes]:
    """Coordinates and rates of which the sensors read `states`, for every sample.

    A sensor's error is taken at the reading in place of the true coordinate, which differs by the error itself.
    """
    q, v = [states[:, k] for k in range(3)], [states[:, k + 3] for k in range(3)]
    for k, axis in enumerate(AXES):
        for sensor in sorted(plant.all(AbstractSensor, f"{axis}_sensor"), key=lambda sensor: -sensor.order):
            if isinstance(sensor, SensorScale):
                q[k], v[k] = q[k] / sensor.scale, v[k] / sensor.scale
            else:
                q[k] = plant.after(functools.partial(_less_error, sensor, times), q[k], sensor)
        for late in plant.all(SensorDelay, f"{axis}_sensor"):
            q[k] = q[k] + late.delay * v[k]
    return Axes(*q), Axes(*v)


def _less_error(sensor: AbstractSensor, times: Array, reading: Array) -> Array:
    return reading - (sensor.read(times, reading, reading) - reading)


def _set(carry: Motions, begins: Array, q: Axes, v: Axes) -> Motions:
    """The motion with measured coordinates set anew where a window begins; what is hidden keeps its deflection."""

    def moved(old: Motion, new: Axes) -> Motion:
        x, psi, l = (jnp.where(begins > 0, a, b) for a, b in zip(new, old.axes, strict=True))  # noqa: E741
        motor = None if old.motor is None else old.motor + (x - old.x)
        loaded = None if old.loaded is None else old.loaded + (l - old.l)
        phi = None if old.phi is None else old.phi + (psi - old.psi)
        return Motion(x, psi, l, motor, loaded, phi)

    return carry._replace(q=moved(carry.q, q), v=moved(carry.v, v))


def _bounded(carry: Motions) -> Motions:
    def within(value: Array, low: float, high: float) -> Array:
        return jnp.clip(jnp.where(jnp.isfinite(value), value, high), low, high)

    least = Motion._fields.index("l"), Motion._fields.index("loaded")
    q = [
        None if part is None else within(part, _WOUND_IN if k in least else -_FAR, _FAR)
        for k, part in enumerate(carry.q)
    ]
    v = [None if part is None else within(part, -_FAST, _FAST) for part in carry.v]
    return carry._replace(q=Motion._make(q), v=Motion._make(v))
