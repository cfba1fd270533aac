"""The one place where time passes: a plant rolled out over a lane of held inputs.

A lane is a stretch of one recording: intervals between samples with the input held, each divided into equal steps.
Everything is written for one lane; `jax.vmap` makes batches of lanes, plants and initial states. What is linear in
time or has no memory (the drives' chains before the lag, the sensors) is computed for the whole lane at once, outside
the loop; the loop carries positions, velocities, the lags and a presliding spring.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._math import materialise
from ._types import Axes, Scalar
from .model.effects.base import AXIS_OF_SITE, L_SENSOR, AbstractDrive, AbstractSensor
from .model.effects.drives import InputDelay
from .model.effects.flexible import DoublePendulum, RopeElasticity
from .model.effects.friction import PreslidingFriction
from .model.effects.sensors import SensorDelay, SensorOffset, SensorScale
from .model.plant import Motion, Plant, Push


class Lane(eqx.Module):
    """A stretch of recording as the engine wants it. Times count from the recording's start."""

    start: Float[Array, ""]
    """Time of the first sample [s]."""
    dt: Float[Array, " time"]
    """Length of each interval [s]; 0 in padding."""
    u: Float[Array, "history 2"]
    """Held inputs of cart and hoist (input unit), of the intervals before the lane and then of the lane's."""
    before: Float[Array, " before"]
    """Lengths of the intervals before the lane [s], whose inputs a delay or lag still feels."""
    active: Axes
    """1 for an axis that moves, 0 for one that is locked or absent."""


class Motions(NamedTuple):
    """A rollout at the samples: positions and velocities of all coordinates, and the hidden states."""

    q: Motion
    v: Motion
    lag: Axes
    z: Scalar | None


class Method(eqx.Module):
    """An explicit Runge-Kutta method whose every stage builds on the one before."""

    nodes: tuple[float, ...] = eqx.field(static=True)
    weights: tuple[float, ...] = eqx.field(static=True)


RK4 = Method((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6))
"""The classical method of order 4."""
MIDPOINT = Method((0.0, 0.5), (0.0, 1.0))
"""Order 2, at half the cost of a step."""


def hidden_count(plant: Plant) -> int:
    """Number of hidden coordinates that the plant's mechanisms add."""
    return len(plant.mechanisms)


def initial_motion(plant: Plant, initial: Float[Array, " state"], active: Axes) -> tuple[Motion, Motion]:
    """Positions and velocities from an initial-state vector.

    A locked rope's length is a reading like any other, so an offset or a wrong scale of the length's sensor means
    that the true length is another one.

    Args:
        plant: what moves.
        initial: `x, psi, l` [m, rad, m], their velocities, and for each hidden coordinate its deflection from rest
            and that deflection's velocity.
        active: 1 for an axis that moves.
    """
    length = initial[2]
    for sensor in sorted(plant.all(AbstractSensor, L_SENSOR), key=lambda sensor: -sensor.order):
        if isinstance(sensor, SensorOffset):
            length = length - sensor.offset
        elif isinstance(sensor, SensorScale):
            length = length / sensor.scale
    q = Motion(initial[0], initial[1], jnp.where(active.l > 0, initial[2], length))
    v = Motion(initial[3], initial[4], initial[5])
    k = 6
    if plant.drive_train is not None:
        q, v = q._replace(motor=q.x + initial[k]), v._replace(motor=v.x + initial[k + 1])
        k += 2
    if plant.only(RopeElasticity) is not None:
        q, v = q._replace(loaded=q.l + plant.stretch() + initial[k]), v._replace(loaded=v.l + initial[k + 1])
        k += 2
    if plant.only(DoublePendulum) is not None:
        q, v = q._replace(phi=q.psi + initial[k]), v._replace(phi=v.psi + initial[k + 1])
    return q, v


def drive_inputs(plant: Plant, lane: Lane) -> tuple[Float[Array, "time 2"], Float[Array, " 2"]]:
    """Inputs behind saturation, dead zone, gains and delay, over the lane's intervals, and the lags' initial values."""
    spans = jnp.concatenate([lane.before, lane.dt])
    edges = jnp.concatenate([jnp.zeros(1, spans.dtype), jnp.cumsum(spans)]) + (lane.start - jnp.sum(lane.before))
    n = lane.before.shape[0]
    inputs, lags = [], []
    constants = plant.time_constants()
    for column, axis in enumerate(("x", "l")):
        w = lane.u[:, column]
        chain = [effect for effect in plant.all(AbstractDrive) if AXIS_OF_SITE[effect.site] == axis]
        chain.sort(key=lambda effect: effect.order)
        middle = edges[:-1] + 0.5 * spans
        for effect in chain:
            if not effect.in_time:
                w = effect.apply(middle, w)
        for late_by in plant.all(InputDelay):
            if AXIS_OF_SITE[late_by.site] == axis:
                # The mean over each interval of the delayed input: exact for its impulse, and smooth in the delay.
                # What has no memory and no clock may stand before the delay as well as behind it.
                total = jnp.concatenate([jnp.zeros(1, w.dtype), jnp.cumsum(w * spans)])
                late = jnp.interp(edges - late_by.delay, edges, total)
                w = (late[1:] - late[:-1]) / jnp.where(spans > 0, spans, 1.0)
        for effect in chain:
            if effect.in_time:
                w = effect.apply(middle, w)
        constant = jnp.maximum(getattr(constants, axis), 1e-9)
        since = lane.start - edges[: n + 1]
        # Outside the time loop the library's exponential costs nothing.
        fading = jnp.exp(-since / constant)
        lags.append(jnp.sum(w[:n] * (fading[1:] - fading[:-1])))
        inputs.append(w[n:])
    return jnp.stack(inputs, axis=1), jnp.stack(lags)


def rollout(
    plant: Plant, initial: Float[Array, " state"], lane: Lane, *, substeps: int, method: Method = RK4
) -> Motions:
    """Motion at every sample of the lane, the first included.

    Args:
        plant: what moves.
        initial: see `initial_motion`.
        lane: inputs and times.
        substeps: integration steps in each interval.
        method: the Runge-Kutta method.
    """
    first, told = prepare(plant, initial, lane, substeps)

    def interval(carry: Motions, now: Interval) -> tuple[Motions, Motions]:
        carry = advance(plant, carry, now, lane.active, substeps=substeps, method=method)
        return carry, carry

    _, later = jax.lax.scan(interval, first, told)
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)


class Interval(NamedTuple):
    """What is known of an interval before the motion is."""

    number: Int[Array, ""]
    start: Scalar
    """Time at its beginning [s]."""
    h: Scalar
    """Length of a step [s]."""
    inputs: Axes
    """Held inputs behind the chains' memoryless parts and delays."""
    left_half: Axes
    """How much of each lag's distance to its target is left after half a step, and after a step."""
    left_whole: Axes


def prepare(plant: Plant, initial: Float[Array, " state"], lane: Lane, substeps: int) -> tuple[Motions, Interval]:
    """The first motion, and the intervals of a lane (each field with a leading axis of time)."""
    inputs, lags = drive_inputs(plant, lane)
    constants = plant.time_constants()
    q, v = initial_motion(plant, initial, lane.active)
    zero = jnp.zeros_like(q.x)
    starts = lane.start + jnp.concatenate([jnp.zeros(1, lane.dt.dtype), jnp.cumsum(lane.dt)[:-1]])
    h = lane.dt / substeps
    none = jnp.zeros_like(h)

    def left(share: float) -> Axes:
        x, l_ = (jnp.exp(-share * h / jnp.maximum(constant, 1e-9)) for constant in (constants.x, constants.l))
        return Axes(x, none, l_)

    told = Interval(
        jnp.arange(starts.shape[0]), starts, h, Axes(inputs[:, 0], none, inputs[:, 1]), left(0.5), left(1.0)
    )
    z = None if plant.only(PreslidingFriction) is None else zero
    return Motions(q, v, Axes(lags[0], zero, lags[1]), z), told


def advance(
    plant: Plant,
    carry: Motions,
    now: Interval,
    active: Axes,
    *,
    substeps: int,
    method: Method = MIDPOINT,
    push: Push | None = None,
) -> Motions:
    """The motion one interval later, with an optional push held over it (for linearisation)."""
    constants = plant.time_constants()
    presliding = plant.only(PreslidingFriction)
    h, zero = now.h, jnp.zeros_like(now.h)
    # Unknown to the compiler, but true, and the same for a whole batch: see `materialise`.
    go = now.number < 2**30

    def step(carry: Motions, t: Scalar) -> Motions:
        target = Axes(now.inputs.x, zero, now.inputs.l * plant.drum_gain(carry.q.l))

        def lag_at(node: float) -> Axes:
            if node == 0.0:
                # With no lag the drive follows at once, from the step's first instant.
                return Axes(*(jnp.where(c > 0, s, g) for c, s, g in zip(constants, carry.lag, target, strict=True)))
            rest = now.left_half if node == 0.5 else now.left_whole
            return Axes(*(g + (s - g) * r for g, s, r in zip(target, carry.lag, rest, strict=True)))

        first = carry.v.at_drives()
        dq, dv = _zeros_like(carry.q), _zeros_like(carry.v)
        stage_q, stage_v, stage_z = carry.q, carry.v, carry.z
        for i, (node, weight) in enumerate(zip(method.nodes, method.weights, strict=True)):
            a = _acceleration(
                plant, t + node * h, stage_q, stage_v, lag_at(node), stage_z, active, (carry.q, carry.v), h, go, push
            )
            a = materialise(a, go)
            if weight:
                dq, dv = _add(dq, stage_v, weight * h), _add(dv, a, weight * h)
            if i + 1 < len(method.nodes):
                reach = method.nodes[i + 1] * h
                if presliding is not None and carry.z is not None:
                    stage_z = presliding.deflection(carry.z, stage_v.at_drives().x, reach)
                stage_q, stage_v = _add(carry.q, stage_v, reach), _add(carry.v, a, reach)
        q_next, v_next = _add(carry.q, dq, 1.0), _add(carry.v, dv, 1.0)
        z_next = carry.z
        if presliding is not None and carry.z is not None:
            mean = 0.5 * (first.x + v_next.at_drives().x)
            z_next = presliding.deflection(carry.z, mean, h)
        return Motions(q_next, v_next, lag_at(1.0), z_next)

    def substep(inner: tuple[Motions, Scalar], _: None) -> tuple[tuple[Motions, Scalar], None]:
        return (step(*inner), inner[1] + h), None

    (carry, _), _ = jax.lax.scan(substep, (carry, now.start), None, length=substeps)
    return carry


def readings(plant: Plant, lane: Lane, motions: Motions) -> Float[Array, "sample 3"]:
    """What the encoders report of a rollout: `x`, `psi`, `l` at every sample [m, rad, m], without noise or rounding."""
    times = lane.start + jnp.concatenate([jnp.zeros(1, lane.dt.dtype), jnp.cumsum(lane.dt)])
    q, v = motions.q.axes, motions.v.axes
    train = plant.drive_train
    if train is not None:
        assert motions.q.motor is not None and motions.v.motor is not None
        q = q._replace(x=q.x + train.encoder * (motions.q.motor - q.x))
        v = v._replace(x=v.x + train.encoder * (motions.v.motor - v.x))
    channels = []
    for axis in ("x", "psi", "l"):
        truth = getattr(q, axis)
        for effect in plant.all(SensorDelay):
            if AXIS_OF_SITE[effect.site] == axis:
                truth = _late(times, truth, getattr(v, axis), effect.delay)
        reading = truth
        for sensor in sorted(plant.all(AbstractSensor), key=lambda sensor: sensor.order):
            if AXIS_OF_SITE[sensor.site] == axis:
                reading = sensor.read(times, reading, truth)
        channels.append(reading)
    return jnp.stack(channels, axis=1)


def _late(
    times: Float[Array, " sample"], value: Float[Array, " sample"], rate: Float[Array, " sample"], delay: Scalar
) -> Float[Array, " sample"]:
    """`value(t - delay)` by cubic Hermite interpolation; before the first sample the motion is continued backwards."""
    wanted = times - delay
    k = jnp.clip(jnp.searchsorted(times, wanted, side="right") - 1, 0, times.shape[0] - 2)
    span = times[k + 1] - times[k]
    span = jnp.where(span > 0, span, 1.0)
    s = (wanted - times[k]) / span
    inside = jnp.clip(s, 0.0, 1.0)
    s2, s3 = inside * inside, inside * inside * inside
    smooth = (
        (2 * s3 - 3 * s2 + 1) * value[k]
        + (s3 - 2 * s2 + inside) * span * rate[k]
        + (3 * s2 - 2 * s3) * value[k + 1]
        + (s3 - s2) * span * rate[k + 1]
    )
    return smooth + jnp.where(s < 0, s * span * rate[k], 0.0)


@jax.jit
def _acceleration(
    plant: Plant,
    t: Scalar,
    q: Motion,
    v: Motion,
    volts: Axes,
    z: Scalar | None,
    active: Axes,
    first: tuple[Motion, Motion],
    h: Scalar,
    go: Array,
    push: Push | None,
) -> Motion:
    """Jitted on its own, so that the stages of a step share one trace: half the time before the compiler starts."""
    return plant.acceleration(t, q, v, volts, z, active, first, h, go, push)


def _zeros_like(motion: Motion) -> Motion:
    return jax.tree.map(jnp.zeros_like, motion)


def _add(base: Motion, change: Motion, factor: Scalar | float) -> Motion:
    return jax.tree.map(lambda b, c: b + factor * c, base, change)
