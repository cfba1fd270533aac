"""The closed loop: the one place where a plant and a controller meet.

Between two samples of the controller its command is held, and the plant moves as in `rollout`, with the same drives,
frictions, hidden states and sensors. What drives and sensors remember (delays) is kept for a number of periods.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._types import Axes, Scalar
from .collect import AbstractCollector, Everything
from .control.base import AbstractController, Reference
from .inputs import Lane
from .model.effects.drives import InputDelay
from .model.effects.sensors import SensorDelay
from .model.plant import Motion, Plant
from .rollout import RK4, Method, Motions, advance, read, start, timetable


class Response(NamedTuple):
    """A closed loop at the controller's samples, each field with a leading axis of time."""

    q: Motion
    """True positions [m, rad, m] and those of hidden coordinates."""
    v: Motion
    measured: Axes
    """What the encoders read [m, rad, m]."""
    command: Float[Array, "time 2"]
    """Voltages of cart and hoist [V], held until the next sample."""
    times: Float[Array, " time"]
    """[s]"""
    reference: Reference
    """What was wanted."""


class _Carry(NamedTuple):
    motions: Motions
    controller: Any
    past: Float[Array, "memory 2"]
    trail: tuple[Motion, Motion]
    """Positions and velocities at the latest samples, the present one last."""


def periods_remembered(plant: Plant, period: float) -> int:
    """How many periods of the controller the plant's delays reach back, for a plant whose numbers are known."""
    delays = [float(effect.delay) for effect in plant.all(InputDelay)]
    delays += [float(effect.delay) for effect in plant.all(SensorDelay)]
    return 0 if not delays else int(-(-max(delays) // period)) + 1


def closed_loop(
    plant: Plant,
    controller: AbstractController,
    initial: Float[Array, " state"],
    reference: Reference,
    *,
    period: Scalar | float,
    substeps: int,
    memory: int = 0,
    active: Axes | None = None,
    method: Method = RK4,
    collect: AbstractCollector = Everything(),
    reverse: bool = False,
) -> Any:
    """Lets a controller move a plant along a reference.

    Args:
        plant: what moves.
        controller: what commands it.
        initial: see `rollout.initial_motion`; commands before the first sample are 0.
        reference: with a leading axis of time, one entry for each sample.
        period: of the controller's sampling [s].
        substeps: integration steps in each period.
        memory: periods that the plant's delays reach back (`periods_remembered`); 0 without delays.
        active: 1 for an axis that moves; by default all do.
        method: the Runge-Kutta method.
        collect: what to keep; a `Response` of all samples by default.
        reverse: whether it is to be differentiated in reverse mode, as `jax.grad` does. The backward pass computes
            every period anew in any case, which takes far less memory than keeping it; then it does so with every stage
            of a step, too, which takes less time and compiles in a third of it.

    Raises:
        ValueError: the plant has a delay, but nothing is to be remembered.
    """
    if memory == 0 and (*plant.all(InputDelay), *plant.all(SensorDelay)):
        raise ValueError("the plant has a delay: pass memory=periods_remembered(plant, period)")
    one = jnp.ones_like(initial[0])
    moving = Axes(one, one, one) if active is None else active
    step = jnp.asarray(period, one.dtype)
    first = start(plant, initial, jnp.zeros(2, one.dtype), moving)
    trail = jax.tree.map(lambda leaf: jnp.repeat(leaf[None], memory + 1, axis=0), (first.q, first.v))
    # Before the first sample everything was at rest.
    rest = jax.tree.map(lambda leaf: leaf.at[:-1].set(0.0), trail[1])
    times_back = step * jnp.arange(-memory, 1, dtype=one.dtype)

    def look(carry: _Carry, t: Array) -> Axes:
        reading = read(plant, plant.time_scale() * (t + times_back), *carry.trail)[-1]
        return Axes(reading[0], reading[1], reading[2])

    controller = controller.ready()
    begin = _Carry(first, None, jnp.zeros((memory, 2), one.dtype), (trail[0], rest))
    begin = begin._replace(controller=controller.start(look(begin, jnp.zeros_like(one))))

    def tick(carry: _Carry, now: tuple[Array, Reference]) -> tuple[_Carry, Response]:
        number, wanted = now
        t = number.astype(one.dtype) * step
        measured = look(carry, t)
        command, state = controller.command(carry.controller, measured, wanted, step)
        inputs = jnp.concatenate([carry.past, command[None]])
        lane = Lane(t, step[None], inputs, jnp.full(memory, step), moving)
        told, _ = timetable(plant, lane, substeps)
        interval = jax.tree.map(lambda leaf: leaf[0], told)._replace(number=number)
        motions = advance(plant, carry.motions, interval, moving, method=method, looped=reverse)
        later = jax.tree.map(
            lambda trail, leaf: jnp.concatenate([trail[1:], leaf[None]]), carry.trail, (motions.q, motions.v)
        )
        response = Response(carry.motions.q, carry.motions.v, measured, command, t, wanted)
        return _Carry(motions, state, inputs[1:] if memory else carry.past, later), response

    count = reference.x.shape[0]
    return collect.run(jax.checkpoint(tick), begin, (jnp.arange(count), reference))
