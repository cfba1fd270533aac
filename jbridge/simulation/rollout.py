"""The one place where time passes: a plant rolled out over a lane of held inputs.

Everything is written for one lane; `jax.vmap` makes batches of lanes, plants and initial states. What the drives do
before their lags (`inputs`) and the sensors are computed for the whole lane at once, outside the loop; the loop
carries positions, velocities, the lags and a hidden spring.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._math import materialise
from .._types import Axes, Scalar
from ..compilation.programs import returned
from ..model.effects.base import AXIS_OF_SITE, L_SENSOR, AbstractSensor
from ..model.effects.drives import LAGS, SpeedDrive
from ..model.effects.flexible import Backlash, DoublePendulum, HoistBacklash
from ..model.effects.sensors import SensorDelay, SensorOffset, SensorScale
from ..model.equations import Push, Stage, Step, accelerations
from ..model.plant import Motion, Plant
from .collect import AbstractCollector, Everything
from .inputs import INSTANT, Lane, drive_inputs, in_true_time, step_edges


@returned
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
    bends: tuple[float, ...] = eqx.field(static=True)
    """How much of a stage's h^2 * acceleration the next stage's position takes beyond h * velocity."""
    leads: tuple[float, ...] = eqx.field(static=True)
    """How much of (early - mean) every stage's input takes, so that an input that changes within a step moves velocity
    and position as it should."""


RK4 = Method((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6), (0.0,) * 4, (3.0, 0.0, 0.0, -3.0))
"""The classical method of order 4."""
MIDPOINT = Method((0.0, 0.5), (0.0, 1.0), (1 / 3, 0.0), (1.0, 0.0))
"""Order 2, at half the cost of a step. With this bend a swing keeps its phase to order 4, where errors add up over a
recording; what damping takes from a momentum along a way is the same with any."""


def initial_motion(plant: Plant, initial: Float[Array, " state"], active: Axes) -> tuple[Motion, Motion]:
    """Positions and velocities from an initial-state vector.

    A locked rope's length is a reading like any other, so an offset or a wrong scale of the length's sensor means
    that the true length is another one.

    Args:
        plant: what moves.
        initial: `x, psi, l` [m, rad, m], their velocities, and for each hidden coordinate its deflection from rest
            and that deflection's velocity. A hysteresis' relative deflection may follow (see `start`).
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
    train = plant.drive_train
    if train is not None:
        apart = folded(initial[k], 0.5 * train.gap) if isinstance(train, Backlash) else initial[k]
        q, v = q._replace(motor=q.x + apart), v._replace(motor=v.x + initial[k + 1])
        k += 2
    rope = plant.rope_end
    if rope is not None:
        below = plant.stretch() + initial[k]
        if isinstance(rope, HoistBacklash):
            below = folded(0.5 * rope.gap + initial[k], 0.5 * rope.gap)
        q, v = q._replace(loaded=q.l + below), v._replace(loaded=v.l + initial[k + 1])
        k += 2
    if plant.only(DoublePendulum) is not None:
        q, v = q._replace(phi=q.psi + initial[k]), v._replace(phi=v.psi + initial[k + 1])
    return q, v


def folded(value: Scalar, most: Scalar) -> Scalar:
    """A value kept within `most` of 0 by reflection at either end, so that a fit finds a slope wherever it looks."""
    turned = jnp.mod(value + most, 4.0 * most)
    return most - jnp.abs(turned - 2.0 * most)


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
    return moved_on(plant, first, told, lane.active, method=method)


class Sample(NamedTuple):
    """An open loop at one sample."""

    q: Motion
    v: Motion
    times: Scalar
    """[s]"""


def play(  # noqa: PLR0913
    plant: Plant,
    initial: Float[Array, " state"],
    inputs: Float[Array, "time 2"],
    *,
    period: Scalar | float,
    substeps: int,
    active: Axes | None = None,
    method: Method = RK4,
    collect: AbstractCollector = Everything(),
    reverse: bool = False,
) -> Any:
    """Plays held inputs to a plant, and keeps of its motion what is asked for.

    Args:
        plant: what moves.
        initial: see `initial_motion`; inputs before the first are 0.
        inputs: of cart and hoist [input unit], each held over one period.
        period: time between inputs [s].
        substeps: integration steps in each period.
        active: 1 for an axis that moves; by default all do.
        method: the Runge-Kutta method.
        collect: what to keep; a `Sample` at the beginning of every period by default.
        reverse: whether it is to be differentiated in reverse mode, as `jax.grad` does. The backward pass computes
            every period anew in any case, which takes far less memory than keeping it; then it does so with every stage
            of a step, too, which takes less time and compiles in a third of it.
    """
    one = jnp.ones_like(initial[0])
    moving = Axes(one, one, one) if active is None else active
    span = jnp.asarray(period, one.dtype)
    lane = Lane(jnp.zeros_like(one), jnp.broadcast_to(span, inputs.shape[:1]), inputs, jnp.zeros(0, one.dtype), moving)
    first, told = prepare(plant, initial, lane, substeps)

    def step(carry: Motions, now: Interval) -> tuple[Motions, Sample]:
        return advance(plant, carry, now, moving, method=method, looped=reverse), Sample(carry.q, carry.v, now.t[0])

    return collect.run(jax.checkpoint(step), first, told)


class _Part(NamedTuple):
    """What makes one stage of a step different from another."""

    node: Scalar | float
    weight: Scalar | float
    reach: Scalar | float
    """How far from the step's beginning the next stage is, as a share of the step."""
    bend: Scalar | float
    volts: Axes
    lead: Scalar | float


class _Stage(NamedTuple):
    """Where a stage looks at the bridge, and what the stages before add up to."""

    q: Motion
    v: Motion
    z: Scalar | None
    dq: Motion
    dv: Motion


@returned
class Interval(NamedTuple):
    """What is known of an interval's steps before the motion is. Every field but the number has an axis of steps."""

    number: Int[Array, ""]
    t: Array
    """Time at the beginning [s]."""
    h: Array
    """Length [s]."""
    mean: Axes
    """Inputs behind the chains' memoryless parts and delays: see `Drives`."""
    early: Axes
    left: Axes
    """How much of each lag's distance to its target is left after the step,"""
    left_mean: Axes
    """how much is left in the mean over it,"""
    left_early: Axes
    """and in the mean weighted by the time left."""


def prepare(plant: Plant, initial: Float[Array, " state"], lane: Lane, substeps: int) -> tuple[Motions, Interval]:
    """The first motion, and the intervals of a lane (each field with a leading axis of time)."""
    told, lags = timetable(plant, lane, substeps)
    return start(plant, initial, lags, lane.active), told


def start(plant: Plant, initial: Float[Array, " state"], lags: Float[Array, " 2"], active: Axes) -> Motions:
    """The first motion, from an initial-state vector (see `initial_motion`) and the states of both drives' lags."""
    q, v = initial_motion(plant, initial, active)
    zero = jnp.zeros_like(q.x)
    z, k = None, plant.states
    if plant.hysteresis is not None:
        z = folded(initial[k], jnp.ones_like(zero)) if initial.shape[0] > k else zero
    return Motions(q, v, Axes(lags[0], zero, lags[1]), z)


def timetable(plant: Plant, lane: Lane, substeps: int) -> tuple[Interval, Float[Array, " 2"]]:
    """The intervals of a lane (each field with a leading axis of time), and the lags' states at its beginning.

    Args:
        plant: what moves.
        lane: inputs and times.
        substeps: integration steps in each interval.
    """
    lane = in_true_time(plant, lane)
    steps = step_edges(plant, lane, substeps)
    drives = drive_inputs(plant, lane, steps)
    return intervals(plant, steps[lane.before.shape[0] :], drives.mean, drives.early), drives.lags


def intervals(
    plant: Plant,
    steps: Float[Array, "interval edge"],
    mean: Float[Array, "interval step 2"],
    early: Float[Array, "interval step 2"],
) -> Interval:
    """Some intervals, from their steps' edges [s] and the inputs at the drives (see `inputs.Drives`)."""
    h = jnp.diff(steps, axis=1)
    # What counts of a lag are its means over the step: then one that is shorter than a step is not lost.
    constants = plant.time_constants()
    ratios = [h / jnp.maximum(constant, INSTANT) for constant in constants]
    shares = [constant / jnp.where(h > 0, h, 1.0) for constant in constants]
    left = Axes(*(jnp.exp(-ratio) for ratio in ratios))
    left_mean = Axes(*(-share * jnp.expm1(-ratio) for share, ratio in zip(shares, ratios, strict=True)))
    left_early = Axes(*(_early(share, ratio, m) for share, ratio, m in zip(shares, ratios, left_mean, strict=True)))

    def held(inputs: Float[Array, "interval step 2"]) -> Axes:
        return Axes(inputs[:, :, 0], jnp.zeros_like(h), inputs[:, :, 1])

    number = jnp.arange(h.shape[0])
    return Interval(number, steps[:, :-1], h, held(mean), held(early), left, left_mean, left_early)


def _early(share: Array, ratio: Array, mean: Array) -> Array:
    """Mean of `exp(-t / constant)` over a step, weighted by the time left."""
    # Where the lag is long the difference from 1 would be lost in rounding.
    series = 1.0 - ratio / 3.0 + ratio**2 / 12.0 - ratio**3 / 60.0
    return jnp.where(ratio < 0.02, series, 2.0 * share * (1.0 - mean))


def moved_on(plant: Plant, first: Motions, told: Interval, active: Axes, *, method: Method) -> Motions:
    """The motion at every sample of the intervals that `told` has, the first one included."""

    def interval(carry: Motions, now: Interval) -> tuple[Motions, Motions]:
        carry = advance(plant, carry, now, active, method=method)
        return carry, carry

    _, later = jax.lax.scan(interval, first, told)
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)


def advance(
    plant: Plant,
    carry: Motions,
    now: Interval,
    active: Axes,
    *,
    method: Method = MIDPOINT,
    push: Push | None = None,
    looped: bool = False,
) -> Motions:
    """The motion one interval later, with an optional push held over it (for linearisation).

    With `looped`, stages are a loop, which compiles in three quarters of the time. A backward pass computes each stage
    anew from its positions and velocities: that is less work than to write all of it to memory and to read it back.
    Tangents take as long with a loop as without; a simulation alone takes longer.
    """
    spring = plant.hysteresis
    # In one order in every process, so that compiled programs are found again.
    lagging = sorted({AXIS_OF_SITE[effect.site] for cls in LAGS for effect in plant.all(cls)})
    loops = any(plant.all(SpeedDrive))
    most = max(-lead for lead in method.leads)
    # Unknown to the compiler, but true, and the same for a whole batch: see `materialise`.
    go = now.number < 2**30

    def step(carry: Motions, now: Interval) -> tuple[Motions, None]:
        t, h = now.t, now.h
        drum = plant.drum_gain(carry.q.l)
        target, first_target = (held._replace(l=held.l * drum) for held in (now.mean, now.early))

        # By axis the input's mean over the step, and how much its early part is ahead of that.
        held, ahead = {}, {}
        for axis in Axes._fields:
            g, e, s = (getattr(each, axis) for each in (target, first_target, carry.lag))
            held[axis], ahead[axis] = g, e - g
            if axis in lagging:
                mean, early = getattr(now.left_mean, axis), getattr(now.left_early, axis)
                # No stage may have more than the target: an axis that friction holds would break away.
                gap = jnp.minimum(early - mean, mean / most) if most > 1.0 else early - mean
                held[axis], ahead[axis] = g + (s - g) * mean, (e - g) * (1.0 - early) + (s - g) * gap

        def volts_at(lead: float) -> Axes:
            return Axes(*(held[axis] if lead == 0.0 else held[axis] + lead * ahead[axis] for axis in Axes._fields))

        # Inputs that change evenly and have these means.
        ends = (volts_at(3.0), volts_at(-3.0)) if loops else None
        whole = Step(carry.q, carry.v, h, active, go, push, ends)

        def stage(at: _Stage, part: _Part) -> tuple[_Stage, None]:
            here = Stage(t + part.node * h, at.q, at.v, part.volts, at.z, part.lead)
            a = materialise(_accelerations(plant, here, whole), go)
            z = at.z
            if spring is not None and carry.z is not None:
                z = spring.deflection(carry.z, part.reach * h * at.v.at_drives().x)
            q, v = _add(carry.q, at.v, part.reach, h), _add(carry.v, a, part.reach, h)
            q = _add(q, a, part.bend, h * h)
            return _Stage(q, v, z, _add(at.dq, at.v, part.weight, h), _add(at.dv, a, part.weight, h)), None

        still = jax.tree.map(jnp.zeros_like, (carry.q, carry.v))
        at = _Stage(carry.q, carry.v, carry.z, *still)
        reaches = (*method.nodes[1:], 0.0)
        volts = [volts_at(lead) for lead in method.leads]
        shares = method.nodes, method.weights, reaches, method.bends, volts, method.leads
        parts = [_Part(*numbers) for numbers in zip(*shares, strict=True)]
        if looped:
            rows = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf, h.dtype) for leaf in leaves]), *parts)
            at, _ = jax.lax.scan(jax.checkpoint(stage), at, rows)
        else:
            for part in parts:
                at, _ = stage(at, part)
        q_next, v_next = _add(carry.q, at.dq), _add(carry.v, at.dv)
        z_next = carry.z
        if spring is not None and carry.z is not None:
            # There and back where the drive turns round: what is lost of a loop, turn by turn, would be a creep.
            was, becomes, way = carry.v.at_drives().x, v_next.at_drives().x, at.dq.at_drives().x
            turns = was * becomes < 0
            there = jnp.where(turns, 0.5 * h * was * was / jnp.where(turns, was - becomes, 1.0), way)
            z_next = spring.deflection(spring.deflection(carry.z, there), way - there)
        lag = target
        for axis in lagging:
            g, s = getattr(target, axis), getattr(carry.lag, axis)
            lag = lag._replace(**{axis: g + (s - g) * getattr(now.left, axis)})
        return Motions(q_next, v_next, lag, z_next), None

    steps = now._replace(number=jnp.zeros_like(now.h, dtype=now.number.dtype))
    if now.h.shape[0] == 1:  # a loop over one step would only be traced and transformed for nothing
        return step(carry, jax.tree.map(lambda leaf: leaf[0], steps))[0]
    return jax.lax.scan(step, carry, steps)[0]


def readings(plant: Plant, lane: Lane, motions: Motions) -> Float[Array, "sample 3"]:
    """What the encoders report of a rollout: `x`, `psi`, `l` at every sample [m, rad, m], without noise or rounding."""
    return read(plant, sample_times(plant, lane), motions.q, motions.v)


def sample_times(plant: Plant, lane: Lane) -> Float[Array, " sample"]:
    """True times of a lane's samples [s]."""
    lane = in_true_time(plant, lane)
    return lane.start + jnp.concatenate([jnp.zeros(1, lane.dt.dtype), jnp.cumsum(lane.dt)])


class Path(NamedTuple):
    """A motion as the encoders follow it."""

    times: Float[Array, " sample"]
    q: Axes
    v: Axes


def read(plant: Plant, times: Float[Array, " sample"], motion: Motion, rate: Motion) -> Float[Array, "sample 3"]:
    """The same of any motion, given at some times [s]."""
    q, v = encoded(plant, motion, rate)
    return sensed(plant, times, q, Path(times, q, v))


def encoded(plant: Plant, motion: Motion, rate: Motion) -> tuple[Axes, Axes]:
    """Coordinates that the encoders sit at, and their rates."""
    q, v = motion.axes, rate.axes
    train = plant.drive_train
    if train is not None:
        assert motion.motor is not None and rate.motor is not None
        q = q._replace(x=q.x + train.encoder * (motion.motor - q.x))
        v = v._replace(x=v.x + train.encoder * (rate.motor - v.x))
    play = plant.only(HoistBacklash)
    if play is not None:
        q = q._replace(l=q.l + play.encoder * (motion.at_load().l - q.l))
        v = v._replace(l=v.l + play.encoder * (rate.at_load().l - v.l))
    return q, v


def sensed(plant: Plant, times: Float[Array, " sample"], q: Axes, path: Path) -> Float[Array, "sample 3"]:
    """Readings at some times.

    Args:
        plant: whose sensors they are.
        times: [s].
        q: coordinates at the encoders then.
        path: the motion up to then, into which late sensors look back.
    """
    channels = []
    for axis in ("x", "psi", "l"):
        truth = getattr(q, axis)
        for effect in plant.all(SensorDelay):
            if AXIS_OF_SITE[effect.site] == axis:
                seen = path.times, getattr(path.q, axis), getattr(path.v, axis)
                law = functools.partial(_late, times, *seen, effect.delay)
                truth = plant.after(law, truth, effect)
        reading = truth
        for sensor in sorted(plant.all(AbstractSensor), key=lambda sensor: sensor.order):
            if AXIS_OF_SITE[sensor.site] == axis:
                law = functools.partial(sensor.read, times, truth=truth)
                reading = plant.after(law, reading, sensor)
        channels.append(reading)
    return jnp.stack(channels, axis=1)


def _late(
    at: Float[Array, " time"],
    times: Float[Array, " sample"],
    value: Float[Array, " sample"],
    rate: Float[Array, " sample"],
    delay: Scalar,
    now: Float[Array, " time"],
) -> Float[Array, " time"]:
    """A path `delay` before some times, by cubic Hermite interpolation; before its first sample the motion is continued
    backwards. What is read `now` is not needed."""
    wanted = at - delay
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


_accelerations = jax.jit(accelerations)
"""Jitted on its own, so that the stages of a step share one trace: half the time before the compiler starts."""


def _add(base: Motion, change: Motion, share: Scalar | float = 1.0, h: Scalar | float = 1.0) -> Motion:
    if isinstance(share, float) and share == 0.0:
        return base
    return jax.tree.map(lambda b, c: b + share * h * c, base, change)
