"""Recordings simulated from their first sample to their last, the measured coordinates set anew where windows begin.

Where windows begin is data, so that one program serves windows of every length. Hidden states (a lag, a bent spring, a
belt, a second pendulum) are never set; they follow from the simulation of what came before.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..._types import AXES, Axes
from ...compilation.programs import kept
from ...model.effects.base import AbstractSensor
from ...model.effects.sensors import SensorDelay, SensorScale
from ...model.parameters import ParameterTable
from ...model.plant import Motion, Plant
from ...simulation.inputs import Lane, arriving, fixed_steps, in_true_time, lags_at_start, supply
from ...simulation.measurement import History, encoded, sensed
from ...simulation.runge_kutta import MIDPOINT, RK4, Interval, advance, intervals
from ...simulation.state import Motions, start
from ..data.windows import Course

STATES = 6
"""Coordinates and velocities of a window's beginning: `x, psi, l` and their rates."""
SHIFTED = 2.0
"""Mark of a sample at which what is simulated so far is shifted."""
BLOCK = 64
"""Samples of a block of time: what is computed before and after the steps of a block stays in the processor's cache."""
FAR = 1e3
_FAST = 1e3
"""Bounds of coordinates [m, rad] and velocities, beyond which a simulation has run away: it goes on there, so that it
counts as one that is far off, not as one that says nothing."""
LOST = 1e12
"""Largest tangent."""
_WOUND_IN = 0.01
"""Shortest rope [m]."""


@dataclasses.dataclass(frozen=True)
class Steps:
    """How time passes."""

    number: int
    """Integration steps in each interval."""
    fine: bool = False
    """Whether they are of the classical method of order 4, at twice the cost of the midpoint method."""
    damped: tuple[str, ...] = ()
    """Axes whose viscous damping would ask for more steps: it is solved in closed form instead, at up to twice the cost
    of a step."""


class Stepping(NamedTuple):
    """How time passes in predictions, which decide, and in tangents, which lead to the next prediction."""

    predictions: Steps
    tangents: Steps


class Lanes(NamedTuple):
    """Simulations side by side, each of one recording."""

    vectors: Float[Array, "lane parameter"]
    """Parameters."""
    courses: Course
    """Inputs, with a leading axis of lanes."""
    restart: Float[Array, "lane sample"]
    """1 where a window begins, 2 where coordinates are shifted, 0 elsewhere."""
    states: Float[Array, "lane sample state"]
    """Readings and their rates where a window begins, and what is added to either where they are shifted."""
    present: Bool[Array, " effect"] | None
    """Which effects act in some lane; all if None."""


@kept(static=(0, 2))
def predicted(table: ParameterTable, lanes: Lanes, steps: Steps) -> Array:
    """Readings `(lane, sample, 3)`."""
    return _readings(table, lanes, steps)


@kept(static=(0, 4))
def tangents(
    table: ParameterTable,
    lanes: Lanes,
    towards: Float[Array, "lane column parameter"],
    begun: Float[Array, "beginning state"],
    steps: Steps,
) -> Array:
    """Derivatives of readings, `(lane, 3, column, sample)`, 0 where a simulation runs away.

    Args:
        table: of the parameters.
        lanes: what is simulated.
        towards: directions among the parameters.
        begun: directions among the numbers of a window's beginning, whose columns follow the others.
        steps: how time passes.
    """

    def of(vectors: Array, moved: Array) -> Array:
        return _readings(table, lanes._replace(vectors=vectors), steps, moved)

    def push(direction: Array, change: Array) -> Array:
        _, tangent = jax.jvp(of, (lanes.vectors, jnp.zeros(STATES)), (direction, change))
        tangent = jnp.swapaxes(tangent, 1, 2)
        # A simulation that runs away has no tangents to go by.
        return jnp.where(jnp.abs(tangent) < LOST, tangent, 0.0)

    count, width, size = towards.shape
    along = jnp.concatenate([jnp.swapaxes(towards, 0, 1), jnp.zeros((len(begun), count, size))])
    change = jnp.concatenate([jnp.zeros((width, STATES)), begun])
    # Columns outside, lanes inside: processors take neighbours together, and all lanes do the same.
    return jax.vmap(push, out_axes=2)(along, change)


def _readings(table: ParameterTable, lanes: Lanes, steps: Steps, moved: Array | None = None) -> Array:
    """Readings of all lanes, where windows begin moved by `moved` [m, rad, m and per second]."""

    def one(vector: Array, course: Course, restart: Array, states: Array) -> Array:
        # What happens in another recording lies far before this one's start or behind its end.
        vector = jnp.where(vector >= course.starts - course.early, vector - course.starts, vector)
        plant = table.unravel(jnp.where(course.override_at > 0, course.override_to, vector), fitted=True)
        plant = Plant(plant.bridge, plant.effects, lanes.present)
        return _simulated(plant, course.lane, restart, states, steps, moved)

    return jax.vmap(one)(lanes.vectors, lanes.courses, lanes.restart, lanes.states)


def _simulated(
    plant: Plant,
    lane: Lane,
    restart: Float[Array, " sample"],
    states: Float[Array, "sample state"],
    steps: Steps,
    moved: Float[Array, " state"] | None,
) -> Float[Array, "sample 3"]:
    """Readings of one recording, in blocks of time."""
    samples, earlier = restart.shape[0], lane.before.shape[0]
    blocks = -(-samples // BLOCK)
    lane = in_true_time(plant, _padded(lane, blocks * BLOCK))
    restart, states = (_lengthened(part, blocks * BLOCK) for part in (restart, states))
    given = supply(plant, lane)
    before = fixed_steps(plant, given, given.edges[: earlier + 1], steps.number)
    lags = lags_at_start(plant, lane, before, arriving(plant, given, before, 0)[0])
    method = RK4 if steps.fine else MIDPOINT
    late = tuple(plant.all(SensorDelay))

    def own(values: Array, begin: Array | int, count: int = BLOCK) -> Array:
        return jax.lax.dynamic_slice_in_dim(values, begin, count)

    def behind(times: Array, states: Array, restart: Array) -> tuple[Axes, Axes]:
        told = _behind_sensors(plant, times, states if moved is None else states + moved[None])
        # A reading that is to move by so much asks for another change of the coordinate where a sensor has a scale.
        scales = jnp.stack([_scale(plant, axis) for axis in AXES])
        shifted = Axes(*(states[:, :3] / scales[None]).T), Axes(*(states[:, 3:] / scales[None]).T)
        return jax.tree.map(lambda a, b: jnp.where(restart == SHIFTED, b, a), told, shifted)

    q, v = behind(given.edges[earlier : earlier + 1], states[:1], restart[:1])
    first = start(plant, jnp.stack([*(part[0] for part in q), *(part[0] for part in v)]), lags, lane.active)

    def interval(carry: Motions, now: tuple[Interval, Array, Axes, Axes]) -> tuple[Motions, tuple[Motion, Motion]]:
        told, begins, q, v = now
        carry = _set(carry, begins, q, v)
        after = _bounded(advance(plant, carry, told, lane.active, method=method, looped=True, damped=steps.damped))
        return after, (carry.q, carry.v)

    def block(
        carry: tuple[Motions, tuple[Axes, Axes] | None], number: Array
    ) -> tuple[tuple[Motions, tuple[Axes, Axes] | None], Array]:
        motions, history = carry
        begin = number * BLOCK
        edges = own(given.edges, earlier + begin, BLOCK + 1)
        cut = fixed_steps(plant, given, edges, steps.number)
        told = intervals(plant, cut, *arriving(plant, given, cut, earlier + begin))
        begins = own(restart, begin)
        q, v = behind(edges[:-1], own(states, begin), begins)
        motions, moving = jax.lax.scan(interval, motions, (told, begins, q, v))
        now = encoded(plant, *moving)
        if history is None:
            return (motions, None), sensed(plant, edges[:-1], now[0], History(edges[:-1], *now))

        def longer(history: tuple[Axes, Axes]) -> tuple[Axes, Axes]:
            return jax.tree.map(lambda all, new: jax.lax.dynamic_update_slice_in_dim(all, new, begin, 0), history, now)

        history = plant.after(longer, history, *late)
        return (motions, history), sensed(plant, edges[:-1], now[0], History(times, *history))

    times, history = given.edges[earlier:-1], None
    if late:
        # Late sensors look back over blocks; what is still to come lies ahead of all that they ask for. So does what
        # follows a recording's end, where sums of no time may differ by a rounding error.
        times = jax.lax.cummax(times)
        still = Axes(*(jnp.zeros_like(times) for _ in AXES))
        history = still, still
    _, found = jax.lax.scan(block, (first, history), jnp.arange(blocks))
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

    def behind(sensor: AbstractSensor, read: tuple[Array, Array]) -> tuple[Array, Array]:
        reading, rate = read
        if isinstance(sensor, SensorScale):
            return reading / sensor.scale, rate / sensor.scale
        return reading - (sensor.read(times, reading, reading) - reading), rate

    for k, axis in enumerate(AXES):
        sensors = sorted(plant.all(AbstractSensor, f"{axis}_sensor"), key=lambda sensor: -sensor.order)
        q[k], v[k] = plant.after_each(behind, (q[k], v[k]), sensors)
        for late in plant.all(SensorDelay, f"{axis}_sensor"):
            q[k] = q[k] + late.delay * v[k]
    return Axes(*q), Axes(*v)


def _scale(plant: Plant, axis: str) -> Array:
    """What a change of a coordinate is multiplied with in the reading."""
    scale = jnp.asarray(1.0)
    for sensor in plant.all(SensorScale, f"{axis}_sensor"):
        scale = scale * sensor.scale
    return scale


def _set(carry: Motions, begins: Array, q: Axes, v: Axes) -> Motions:
    """The motion with measured coordinates set anew where a window begins; what is hidden keeps its deflection."""

    def moved(old: Motion, new: Axes) -> Motion:
        x, psi, l = (
            jnp.where(begins > 0, a + jnp.where(begins == SHIFTED, b, 0.0), b)
            for a, b in zip(new, old.axes, strict=True)
        )
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
        None if part is None else within(part, _WOUND_IN if k in least else -FAR, FAR) for k, part in enumerate(carry.q)
    ]
    v = [None if part is None else within(part, -_FAST, _FAST) for part in carry.v]
    return carry._replace(q=Motion._make(q), v=Motion._make(v))
