"""Noise of encoders in a closed loop: what a controller reads beside the plant's own sensors."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from .._types import Axes, Scalar
from ..control.base import AbstractController, Reference

NOISE = (4e-5, 6e-4, 4e-5)
"""Standard deviations of the readings of x, psi and l [m, rad, m], of encoders of 0.1 mm and 4096 counts a turn."""
_SEED = 0


def drawn(noise: tuple[float, float, float], count: int) -> NDArray[np.float64] | None:
    """White noise of so many samples, `(sample, 3)`, the same in every run; None where there is none."""
    draws = np.random.default_rng(_SEED).standard_normal((count, 3))
    return np.array(noise) * draws if any(noise) else None


class Noisy(AbstractController):
    """A controller whose encoders add noise to what they read."""

    law: AbstractController
    noise: Float[Array, "time 3"]
    """Of x, psi and l at each sample [m, rad, m]."""

    def ready(self) -> "Noisy":
        return Noisy(self.law.ready(), self.noise)

    def start(self, measured: Axes) -> tuple[Int[Array, ""], Any]:
        return jnp.zeros((), int), self.law.start(self._read(measured, 0))

    def command(
        self, state: tuple[Int[Array, ""], Any], measured: Axes, reference: Reference, period: Scalar | float
    ) -> tuple[Float[Array, " 2"], tuple[Int[Array, ""], Any]]:
        number, inner = state
        command, inner = self.law.command(inner, self._read(measured, number), reference, period)
        return command, (number + 1, inner)

    def _read(self, measured: Axes, number: Int[Array, ""] | int) -> Axes:
        return Axes(*(value + own for value, own in zip(measured, self.noise[number], strict=True)))
