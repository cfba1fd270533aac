"""What a sampled controller is: measurements and a reference in, voltages out. It knows no plant."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Axes, Scalar
from ..fuzzy.membership import as_number


class Reference(eqx.Module):
    """Where cart and rope are to be, and how fast they are to move there."""

    x: Array
    """Cart position [m]."""
    l: Array
    """Rope length [m]."""
    v_x: Array
    """Cart speed [m/s]."""
    v_l: Array
    """Speed of the rope's length [m/s]."""


class AbstractController(eqx.Module):
    """A law that is asked once every sampling period."""

    def ready(self) -> "AbstractController":
        """The same law for use in a loop, with what does not depend on the measurements computed."""
        return self

    @abc.abstractmethod
    def start(self, measured: Axes) -> Any:
        """The controller's own state before the first sample.

        Args:
            measured: what the encoders read at rest [m, rad, m].
        """

    @abc.abstractmethod
    def command(
        self, state: Any, measured: Axes, reference: Reference, period: Scalar | float
    ) -> tuple[Float[Array, " 2"], Any]:
        """Voltages of cart and hoist [V], held until the next sample, and the new state.

        Args:
            state: from `start` or from the sample before.
            measured: what the encoders read [m, rad, m].
            reference: at this sample.
            period: of sampling [s].
        """


class Differences(eqx.Module):
    """Velocities from encoder readings: differences from sample to sample, smoothed by a first-order filter."""

    time_constant: Scalar = eqx.field(converter=as_number, default=0.02)
    """Of the filter [s]."""

    def start(self, measured: Axes) -> tuple[Axes, Axes]:
        zero = jnp.zeros_like(measured.x)
        return measured, Axes(zero, zero, zero)

    def __call__(
        self, state: tuple[Axes, Axes], measured: Axes, period: Scalar | float
    ) -> tuple[Axes, tuple[Axes, Axes]]:
        """Velocities [m/s, rad/s, m/s] and the new state."""
        last, smooth = state
        share = period / (period + self.time_constant)
        pairs = zip(measured, last, smooth, strict=True)
        velocity = Axes(*(s + share * ((now - before) / period - s) for now, before, s in pairs))
        return velocity, (measured, velocity)
