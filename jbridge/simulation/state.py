"""What a rollout carries from one sample to the next, and how it begins."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Axes, Scalar
from ..compilation.programs import returned
from ..model.effects.base import L_SENSOR, AbstractSensor
from ..model.effects.flexible import Backlash, DoublePendulum, HoistBacklash
from ..model.effects.sensors import SensorOffset, SensorScale
from ..model.plant import Motion, Plant


@returned
class Motions(NamedTuple):
    """A rollout at the samples: positions and velocities of all coordinates, and the hidden states."""

    q: Motion
    v: Motion
    lag: Axes
    z: Scalar | None


def start(plant: Plant, initial: Float[Array, " state"], lags: Float[Array, " 2"], active: Axes) -> Motions:
    """The first motion, from an initial-state vector (see `initial_motion`) and the states of both drives' lags."""
    q, v = initial_motion(plant, initial, active)
    zero = jnp.zeros_like(q.x)
    z, k = None, plant.states
    if plant.hysteresis is not None:
        z = folded(initial[k], jnp.ones_like(zero)) if initial.shape[0] > k else zero
    return Motions(q, v, Axes(lags[0], zero, lags[1]), z)


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
