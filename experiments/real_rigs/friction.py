"""Which force a model's cart must overcome, by place and direction, whatever effects make it up."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jbridge import AbstractForce, AbstractFriction, Axes, Plant

_SLOW = 0.1
"""Velocity at which levels are read [m/s]: typical of the recordings."""


def levels_by_place(plant: Plant, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Resistance to motion in +x and in -x [N] at every place `x` [m], damping left out.

    A constant force or a spring counts, too: beside dry friction it is the same law as a difference by direction.
    """
    zero = jnp.zeros(())

    def at(place: jnp.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
        up, down = zero, zero
        for effect in plant.effects:
            if effect.site != "cart":
                continue
            if isinstance(effect, AbstractFriction):
                up = up + effect.levels(zero, place, jnp.asarray(_SLOW))[0]
                down = down + effect.levels(zero, place, jnp.asarray(-_SLOW))[1]
            elif isinstance(effect, AbstractForce):
                force = effect.force(zero, Axes(place, zero, zero), Axes(zero, zero, zero)).x
                up, down = up - force, down + force
        return up, down

    positive, negative = jax.vmap(at)(jnp.asarray(x))
    return np.asarray(positive), np.asarray(negative)
