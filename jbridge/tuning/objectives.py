"""What a move is judged by, as functions with gradients: error, settling, swing, overshoot, chatter, reversals.

Where a measure counts (time outside a band, say), the count is blurred over a fraction of the band, so that it has a
slope; what is reported about a tuned controller is measured anew by `move_summary`.
"""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .._math import sincos
from .._types import Scalar
from ..control.move_metrics import NEAR
from ..simulation.closed_loop import Response
from ..simulation.move_summary import late_from

_EVEN = 1e-3
"""Blur of an absolute value [m]: a tenth of what counts as near."""
DRIVE = 0.05
"""Time constant of a drive [s], as those of laboratory bridges have it: what changes faster does not reach the load."""


class Leg(NamedTuple):
    """What a move is measured against."""

    start: Array
    """Cart position and rope length at its beginning [m]."""
    goal: Array
    """The same at its end [m]."""
    arrival: Array
    """When the reference comes to rest [s]."""


class AbstractObjective(eqx.Module):
    """A number of one move that is to be small."""

    @abc.abstractmethod
    def __call__(self, response: Response, leg: Leg) -> Scalar:
        """The number, from the samples of one move."""


def _errors(response: Response, leg: Leg) -> tuple[Array, Array]:
    return response.q.x - leg.goal[0], response.q.l - leg.goal[1]


def _size(value: Array) -> Array:
    return jnp.sqrt(value * value + _EVEN**2) - _EVEN


class Itae(AbstractObjective):
    """Time-weighted absolute error of cart and rope to the reference [m s²]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        x, l = response.q.x - response.reference.x, response.q.l - response.reference.l
        period = response.times[1] - response.times[0]
        return jnp.sum(response.times * (_size(x) + _size(l))) * period


class Settling(AbstractObjective):
    """Time that the load spends farther than 1 cm from the goal, sideways or in height [s]."""

    blur: Scalar | float = 0.005
    """Distance over which being outside turns into being inside [m]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        x, l = _errors(response, leg)
        sideways = x + response.q.l * sincos(response.q.psi)[0]
        period = response.times[1] - response.times[0]
        away = jnp.maximum(jnp.abs(sideways), jnp.abs(l))
        return jnp.sum(0.5 + 0.5 * jnp.tanh((away - NEAR) / self.blur)) * period


class ResidualSwing(AbstractObjective):
    """Root mean square of the swing angle over the last quarter of the rest [rad]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        late = response.times >= late_from(leg.arrival, response.times[-1])
        return jnp.sqrt(jnp.mean(response.q.psi**2, where=late) + 1e-12)


class Overshoot(AbstractObjective):
    """Largest distance beyond the goal, of cart and rope together [m]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        way = jnp.sign(leg.goal - leg.start)
        x, l = _errors(response, leg)
        return jnp.maximum(jnp.max(way[0] * x), 0.0) + jnp.maximum(jnp.max(way[1] * l), 0.0)


class Chatter(AbstractObjective):
    """Mean square change of the voltages from sample to sample [V²]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        return jnp.mean(jnp.sum(jnp.diff(response.command, axis=0) ** 2, axis=1))


class Travel(AbstractObjective):
    """How far the drives' voltages are behind the commands on average, for drives of first order [V].

    A drive of time constant `T` is behind its command by `T |du/dt|`. What a controller commands faster than the drive
    answers moves nothing, heats the drive and wears its gear.
    """

    time_constant: Scalar | float = DRIVE
    """Of a drive [s]."""
    blur: Scalar | float = 0.01
    """Change of a voltage below which its size is blurred [V]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        change = jnp.diff(response.command, axis=0)
        size = jnp.sqrt(change * change + self.blur**2) - self.blur
        return self.time_constant * jnp.mean(jnp.sum(size, axis=1)) / (response.times[1] - response.times[0])


class Reversals(AbstractObjective):
    """Time that the drives lose by changes of their voltages' sign, a time constant of a drive each [s].

    A change counts in full if the voltage goes from well above the blur to well below its negative.
    """

    time_constant: Scalar | float = DRIVE
    """Of a drive [s]."""
    blur: Scalar | float = 0.1
    """Voltage at which a sign is worth three quarters of a full one [V]."""

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        sign = jnp.tanh(response.command / self.blur)
        return self.time_constant * 0.5 * jnp.sum(jnp.abs(jnp.diff(sign, axis=0)))


class Goal(eqx.Module):
    """A weighted sum of objectives."""

    parts: tuple[AbstractObjective, ...]
    weights: tuple[float, ...]

    def __check_init__(self) -> None:
        if len(self.parts) != len(self.weights):
            raise ValueError(f"{len(self.weights)} weights for {len(self.parts)} objectives")

    def __call__(self, response: Response, leg: Leg) -> Scalar:
        return sum(
            (weight * part(response, leg) for part, weight in zip(self.parts, self.weights, strict=True)),
            start=jnp.zeros(()),
        )


def usual_goal() -> Goal:
    """Settling and error first, then swing and overshoot, and voltages that drives can follow.

    A second that drives lose by reversals counts like half a second of settling, and so do 0.25 V that the commands are
    ahead of the drives on average. Measured on the extended rules (60 steps, 128 held-out moves, encoders without
    noise): without both terms the cart's voltage travels 5.8 times as far as before the tuning, and 128 moves settle;
    so it travels 1.45 times as far and 127 settle; with twice the weights it travels as far as before and 120 settle.
    """
    return Goal(
        (Itae(), Settling(), ResidualSwing(), Overshoot(), Chatter(), Travel(), Reversals()),
        (2.0, 1.0, 100.0, 20.0, 0.5, 2.0, 0.5),
    )
