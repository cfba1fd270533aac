"""How a simulation answers small changes, without simulating again.

Along a trajectory every step is linearised at once, in parallel over time: towards the state, the inputs, forces and
friction levels. What an absent effect would add is evaluated along the same trajectory, and its influence on the
readings is a linear recursion. One structure of program serves every candidate there is, and its cost per candidate
is a matrix product a step.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._programs import kept, returned
from .._types import Axes
from ..model.parameters import ParameterTable
from ..model.plant import Plant, Push
from ..rollout import MIDPOINT as _METHOD
from ..rollout import Interval, Motions, advance, kicked, prepare, readings, rollout
from .lanes import Lanes
from .stages import of_part, parts_of

PORTS = 13
"""What may act on an interval: changes of the inputs of cart and hoist, forces and friction levels up and down on the
three axes, all held, and impulses of the two inputs at the interval's beginning."""
FORCES = slice(2, 5)
"""Those of the generalized forces."""


@returned
class Along(NamedTuple):
    """A trajectory of every lane, with its linearisation."""

    motions: Motions
    """Lane, sample."""
    to_state: Float[Array, "lane time state state"]
    to_ports: Float[Array, "lane time state 13"]


def linearise(
    table: ParameterTable,
    vector: NDArray[np.float64],
    initial: NDArray[np.float64],
    lanes: Lanes,
    forces: Float[Array, "lane time 3"] | NDArray[np.float64] | None = None,
) -> Along:
    """Trajectories of all lanes and the linearised map of every interval, which is one step (`lanes.refined`).

    Args:
        table: of the plant's parameters.
        vector: their values.
        initial: initial state of every lane.
        lanes: the lanes, refined.
        forces: generalized forces that act besides [N, N m, N], held over each interval; none by default.
    """
    part = parts_of(table).motion
    return _linearise(part.table, np.asarray(vector)[part.places], initial, of_part(part, lanes), forces)


@kept(static=(0,), once=True)
def _linearise(
    table: ParameterTable,
    vector: Float[Array, " parameter"],
    initial: Float[Array, "lane state"],
    lanes: Lanes,
    forces: Float[Array, "lane time 3"] | None,
) -> Along:
    def one(start: Array, lanes: Lanes, forces: Array | None) -> Along:
        plant = _plant(table, vector, lanes)
        first, told = prepare(plant, start, lanes.lane, 1)

        def moved(carry: Motions, now: Interval, ports: Array) -> Motions:
            mean, early = (Axes(h.x + ports[0], h.psi, h.l + ports[1]) for h in (now.mean, now.early))
            at_once = Axes(ports[11], jnp.zeros(()), ports[12])
            push = Push(Axes(*ports[2:5]), Axes(*ports[5:8]), Axes(*ports[8:11]))
            return advance(
                plant,
                kicked(plant, carry, now, lanes.lane.active, at_once),
                now._replace(mean=mean, early=early),
                lanes.lane.active,
                push=push,
                reverse=True,  # stages as a loop: half as much to compile, and run once a screen
            )

        if forces is None:
            ports = jnp.zeros((told.number.shape[0], PORTS))
            motions = rollout(plant, start, lanes.lane, substeps=1, method=_METHOD)
        else:
            ports = jnp.zeros((told.number.shape[0], PORTS)).at[:, FORCES].set(forces)

            def interval(carry: Motions, now: tuple[Interval, Array]) -> tuple[Motions, Motions]:
                carry = moved(carry, *now)
                return carry, carry

            _, later = jax.lax.scan(interval, first, (told, ports))
            motions = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)
        at = jax.tree.map(lambda leaf: leaf[:-1], motions)
        # One interval's number stands for all: what tells `materialise` to go must not depend on time.
        number = told.number[0]

        def jacobian(carry: Motions, now: Interval, ports: Array) -> tuple[Array, Array]:
            flat, restore = ravel_pytree(carry)

            def after(state: Array, ports: Array) -> Array:
                return ravel_pytree(moved(restore(state), now._replace(number=number), ports))[0]

            return jax.jacfwd(after, (0, 1))(flat, ports)

        return Along(motions, *jax.vmap(jacobian)(at, told, ports))

    return jax.vmap(one)(initial, lanes, forces)


def respond(
    table: ParameterTable,
    vector: Float[Array, " parameter"],
    lanes: Lanes,
    along: Along,
    ports: Float[Array, "lane time 13 column"],
) -> Float[Array, "lane column sample 3"]:
    """Change of the readings for changes that act through ports, from an unchanged initial state."""

    def one(lanes: Lanes, along: Along, ports: Array) -> Array:
        plant = _plant(table, vector, lanes)
        inject = jnp.einsum("tsp,tpc->tsc", along.to_ports, ports)

        def interval(change: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
            change = now[0] @ change + now[1]
            return change, change

        zero = jnp.zeros(inject.shape[1:])
        _, later = jax.lax.scan(interval, zero, (along.to_state, inject))
        changes = jnp.concatenate([zero[None], later])
        first = jax.tree.map(lambda leaf: leaf[0], along.motions)
        _, restore = ravel_pytree(first)
        tangents = jax.vmap(jax.vmap(restore), in_axes=2, out_axes=0)(changes)

        def read(motions: Motions) -> Array:
            return readings(plant, lanes.lane, motions)

        return jax.vmap(lambda tangent: jax.jvp(read, (along.motions,), (tangent,))[1])(tangents)

    return jax.vmap(one)(lanes, along, ports)


def _plant(table: ParameterTable, vector: Array, lanes: Lanes) -> Plant:
    return table.unravel(lanes.own(vector))
