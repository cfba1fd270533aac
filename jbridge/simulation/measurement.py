"""What the encoders read of a motion: where they sit, late, scaled and shifted, without noise or rounding."""

import functools
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Axes, Scalar
from ..model.effects.base import AXIS_OF_SITE, AbstractSensor
from ..model.effects.flexible import HoistBacklash
from ..model.effects.sensors import SensorDelay
from ..model.plant import Motion, Plant
from .inputs import Lane, in_true_time
from .state import Motions


def readings(plant: Plant, lane: Lane, motions: Motions) -> Float[Array, "sample 3"]:
    """What the encoders report of a rollout: `x`, `psi`, `l` at every sample [m, rad, m], without noise or rounding."""
    return read(plant, sample_times(plant, lane), motions.q, motions.v)


def sample_times(plant: Plant, lane: Lane) -> Float[Array, " sample"]:
    """True times of a lane's samples [s]."""
    lane = in_true_time(plant, lane)
    return lane.start + jnp.concatenate([jnp.zeros(1, lane.dt.dtype), jnp.cumsum(lane.dt)])


class History(NamedTuple):
    """The motion at the encoders up to now, which late sensors still read."""

    times: Float[Array, " sample"]
    q: Axes
    v: Axes


def read(plant: Plant, times: Float[Array, " sample"], motion: Motion, rate: Motion) -> Float[Array, "sample 3"]:
    """What the sensors read of a motion that is given at some times [s], without noise or rounding."""
    q, v = encoded(plant, motion, rate)
    return sensed(plant, times, q, History(times, q, v))


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


def sensed(plant: Plant, times: Float[Array, " sample"], q: Axes, history: History) -> Float[Array, "sample 3"]:
    """Readings at some times.

    Args:
        plant: whose sensors they are.
        times: [s].
        q: coordinates at the encoders then.
        history: the motion up to then, into which late sensors look back.
    """
    channels = []
    for axis in ("x", "psi", "l"):
        truth = getattr(q, axis)
        for effect in plant.all(SensorDelay):
            if AXIS_OF_SITE[effect.site] == axis:
                seen = history.times, getattr(history.q, axis), getattr(history.v, axis)
                law = functools.partial(_late, times, *seen, effect.delay)
                truth = plant.after(law, truth, effect)

        def read_off(sensor: AbstractSensor, reading: Array, truth: Array = truth) -> Array:
            return sensor.read(times, reading, truth=truth)

        own = (sensor for sensor in plant.all(AbstractSensor) if AXIS_OF_SITE[sensor.site] == axis)
        channels.append(plant.after_each(read_off, truth, sorted(own, key=lambda sensor: sensor.order)))
    return jnp.stack(channels, axis=1)


def _late(
    at: Float[Array, " time"],
    times: Float[Array, " sample"],
    value: Float[Array, " sample"],
    rate: Float[Array, " sample"],
    delay: Scalar,
    now: Float[Array, " time"],
) -> Float[Array, " time"]:
    """A coordinate `delay` before some times, by cubic Hermite interpolation; before its first sample it is continued
    backwards. What is read `now` is not needed."""
    wanted = at - delay
    # The interval that ends there: the next one may not have been simulated yet.
    k = jnp.clip(jnp.searchsorted(times, wanted, side="left") - 1, 0, times.shape[0] - 2)
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
