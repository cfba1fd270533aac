"""The bridge as a linear system between two samples, for those who design controllers on one."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import Axes
from ..inputs import Lane
from ..model.plant import Plant
from ..rollout import RK4, advance, start, timetable

_SUBSTEPS = 16
_SLOW = 1e-6
"""Speed at which the bridge counts as still and yet moves [m/s, rad/s]."""


def linear_model(
    plant: Plant, length: float, period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The bridge alone, without its effects, about the load hanging still: `s' = A s + B (u - rest)`.

    Args:
        plant: whose bridge.
        length: of the rope [m].
        period: from one sample to the next, over which the voltages are held [s].

    Returns:
        `A` `(6, 6)` and `B` `(6, 2)` of the state `x, psi, l` and their velocities, and the voltages `rest` at which it
        stays.
    """
    bridge = Plant(plant.bridge)
    numbers = plant.bridge
    rest = np.array([0.0, -float(numbers.load_mass * numbers.gravity / numbers.hoist_gain)])
    one = jnp.ones(())
    moving = Axes(one, one, one)

    def after(state: jax.Array, volts: jax.Array) -> jax.Array:
        motions = start(bridge, state, jnp.zeros(2), moving)
        lane = Lane(jnp.zeros(()), jnp.asarray([period]), volts[None], jnp.zeros(0), moving)
        told, _ = timetable(bridge, lane, _SUBSTEPS)
        end = advance(bridge, motions, jax.tree.map(lambda leaf: leaf[0], told), moving, method=RK4)
        return jnp.stack([*end.q.axes, *end.v.axes])

    # Exactly at rest nothing moves, with friction or without, and nothing has a slope.
    still = jnp.full(6, _SLOW).at[:3].set(jnp.asarray([0.0, 0.0, length]))
    a, b = jax.jit(jax.jacfwd(after, (0, 1)))(still, jnp.asarray(rest))
    return np.asarray(a), np.asarray(b), rest
