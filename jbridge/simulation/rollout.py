"""A plant rolled out over a lane of held inputs: the open loop.

Everything is written for one lane; `jax.vmap` makes batches of lanes, plants and initial states. What the drives do
before their lags (`inputs`) and the sensors (`measurement`) are computed for the whole lane at once, outside the loop;
the loop carries positions, velocities, the lags and a hidden spring (`runge_kutta`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Axes, Scalar
from ..model.plant import Motion, Plant
from .inputs import Lane, drive_inputs, in_true_time, step_edges, supply
from .outputs import AbstractCollector, Everything
from .runge_kutta import RK4, Interval, Method, advance, intervals
from .state import Motions, start


def rollout(
    plant: Plant, initial: Float[Array, " state"], lane: Lane, *, substeps: int, method: Method = RK4
) -> Motions:
    """Motion at every sample of the lane, the first included.

    Args:
        plant: what moves.
        initial: see `state.initial_motion`.
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
        initial: see `state.initial_motion`; inputs before the first are 0.
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


def prepare(plant: Plant, initial: Float[Array, " state"], lane: Lane, substeps: int) -> tuple[Motions, Interval]:
    """The first motion, and the intervals of a lane (each field with a leading axis of time)."""
    told, lags = timetable(plant, lane, substeps)
    return start(plant, initial, lags, lane.active), told


def timetable(plant: Plant, lane: Lane, substeps: int) -> tuple[Interval, Float[Array, " 2"]]:
    """The intervals of a lane (each field with a leading axis of time), and the lags' states at its beginning.

    Args:
        plant: what moves.
        lane: inputs and times.
        substeps: integration steps in each interval.
    """
    lane = in_true_time(plant, lane)
    given = supply(plant, lane)
    steps = step_edges(plant, given, substeps)
    drives = drive_inputs(plant, lane, given, steps)
    return intervals(plant, steps[lane.before.shape[0] :], drives.mean, drives.early), drives.lags


def moved_on(plant: Plant, first: Motions, told: Interval, active: Axes, *, method: Method) -> Motions:
    """The motion at every sample of the intervals that `told` has, the first one included."""

    def interval(carry: Motions, now: Interval) -> tuple[Motions, Motions]:
        carry = advance(plant, carry, now, active, method=method)
        return carry, carry

    _, later = jax.lax.scan(interval, first, told)
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, later)
