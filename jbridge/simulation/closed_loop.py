"""The closed loop: the one place where a plant and a controller meet.

Between two samples of the controller its command is held, and the plant moves as in `rollout`, with the same drives,
frictions, hidden states and sensors. What drives and sensors remember (delays) is kept for a number of periods.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._types import Axes, Scalar
from ..control.base import AbstractController, Reference
from ..model.effects.drives import AbstractDelay
from ..model.effects.sensors import SensorDelay
from ..model.plant import Motion, Plant
from .inputs import Lane
from .measurement import read
from .outputs import AbstractCollector, Everything
from .rollout import timetable
from .runge_kutta import RK4, Method, advance
from .state import Motions, start


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


class Sampled(NamedTuple):
    """A plant between two commands, with what its drives and sensors remember."""

    motions: Motions
    past: Float[Array, "memory 2"]
    """Commands that may still be on their way [input unit]."""
    trail: tuple[Motion, Motion]
    """Positions and velocities at the latest samples, the present one last."""


class SampledPlant(NamedTuple):
    """A plant as a controller has it: sampled in equal periods, with commands that are held between them."""

    plant: Plant
    period: Scalar
    """[s]"""
    substeps: int
    """Integration steps in each period."""
    memory: int
    """Periods that the plant's delays reach back."""
    active: Axes
    """1 for an axis that moves."""
    method: Method = RK4
    looped: bool = False
    """See `runge_kutta.advance`."""

    def begin(self, initial: Float[Array, " state"]) -> Sampled:
        """The first sample, before which everything was at rest (see `state.initial_motion`)."""
        dtype = initial.dtype
        first = start(self.plant, initial, jnp.zeros(2, dtype), self.active)
        trail = jax.tree.map(lambda leaf: jnp.repeat(leaf[None], self.memory + 1, axis=0), (first.q, first.v))
        rest = jax.tree.map(lambda leaf: leaf.at[:-1].set(0.0), trail[1])
        return Sampled(first, jnp.zeros((self.memory, 2), dtype), (trail[0], rest))

    def measured(self, now: Sampled, time: Scalar) -> Axes:
        """What the encoders read at a sample [m, rad, m]."""
        back = self.period * jnp.arange(-self.memory, 1, dtype=self.period.dtype)
        reading = read(self.plant, self.plant.time_scale() * (time + back), *now.trail)[-1]
        return Axes(reading[0], reading[1], reading[2])

    def after(self, now: Sampled, number: Int[Array, ""], time: Scalar, command: Float[Array, " 2"]) -> Sampled:
        """The plant one period later.

        Args:
            now: the plant.
            number: of the sample, from 0.
            time: of the sample [s].
            command: of cart and hoist, held over the period [input unit].
        """
        inputs = jnp.concatenate([now.past, command[None]])
        lane = Lane(time, self.period[None], inputs, jnp.full(self.memory, self.period), self.active)
        told, _ = timetable(self.plant, lane, self.substeps)
        interval = jax.tree.map(lambda leaf: leaf[0], told)._replace(number=number)
        motions = advance(self.plant, now.motions, interval, self.active, method=self.method, looped=self.looped)
        trail = jax.tree.map(
            lambda trail, leaf: jnp.concatenate([trail[1:], leaf[None]]), now.trail, (motions.q, motions.v)
        )
        return Sampled(motions, inputs[1:] if self.memory else now.past, trail)


def periods_remembered(plant: Plant, period: float) -> int:
    """How many periods of the controller the plant's delays reach back, for a plant whose numbers are known."""
    delays = [sum(float(effect.delay) for effect in plant.all(AbstractDelay, site)) for site in AbstractDelay.sites]
    delays += [float(effect.delay) for effect in plant.all(SensorDelay)]
    late = any(plant.all(AbstractDelay)) or any(plant.all(SensorDelay))
    # Delays are in true time, of which a period by a slow clock is another one.
    return math.ceil(max(delays) / (period * float(plant.time_scale())) - 1e-9) + 1 if late else 0


def closed_loop(  # noqa: PLR0913
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
        initial: see `state.initial_motion`; commands before the first sample are 0.
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
    if memory == 0 and (*plant.all(AbstractDelay), *plant.all(SensorDelay)):
        raise ValueError("the plant has a delay: pass memory=periods_remembered(plant, period)")
    one = jnp.ones_like(initial[0])
    moving = Axes(one, one, one) if active is None else Axes(*(moves * one for moves in active))
    step = jnp.asarray(period, one.dtype)
    sampled = SampledPlant(plant, step, substeps, memory, moving, method, reverse)
    controller = controller.ready()
    first = sampled.begin(initial)

    def tick(carry: tuple[Sampled, Any], now: tuple[Array, Reference]) -> tuple[tuple[Sampled, Any], Response]:
        (bridge, state), (number, wanted) = carry, now
        t = number.astype(one.dtype) * step
        measured = sampled.measured(bridge, t)
        command, state = controller.command(state, measured, wanted, step)
        response = Response(bridge.motions.q, bridge.motions.v, measured, command, t, wanted)
        return (sampled.after(bridge, number, t, command), state), response

    begin = first, controller.start(sampled.measured(first, jnp.zeros_like(one)))
    count = reference.x.shape[0]
    return collect.run(jax.checkpoint(tick), begin, (jnp.arange(count), reference))
