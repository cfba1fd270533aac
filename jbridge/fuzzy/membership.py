"""Fuzzy sets: the degree to which a value belongs, between 0 and 1.

A set's parameters are what one would draw: corners of a trapezoid, centre and width of a bell. Corners are in
ascending order; equal corners make a vertical flank, which has the value of its upper end.
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._math import decay
from .._types import Scalar
from .norms import Softness, between, lesser, weighed

_NARROW = 1e-9
"""Width below which a flank counts as vertical, and a bell has this width."""


def as_number(value: Any) -> Array:
    return jnp.asarray(value, dtype=jnp.result_type(float))


def _parameter() -> Any:
    return eqx.field(converter=as_number)


class AbstractMembership(eqx.Module):
    """A fuzzy set over one variable."""

    kind: eqx.AbstractClassVar[str]
    """As in a `.fis` file."""

    @abc.abstractmethod
    def degree(self, value: Array, softness: Softness = None) -> Array:
        """Degree of membership [1].

        Args:
            value: any shape, in the variable's unit.
            softness: width, in degrees of membership, over which corners are rounded; None leaves them sharp.
        """


@jax.jit
def _flanks(value: Array, rise: tuple[Array, Array], fall: tuple[Array, Array], softness: Softness) -> Array:
    """Degree of a shape that rises between two corners, stays, and falls between two others.

    Jitted on its own, so that all sets share one trace: a third less before the compiler starts.
    """

    def flank(low: Array, high: Array, distance: Array, inside: Array) -> Array:
        width = high - low
        steep = width <= _NARROW
        return jnp.where(steep, inside.astype(distance.dtype), distance / jnp.where(steep, 1.0, width))

    up = flank(*rise, value - rise[0], value >= rise[1])
    down = flank(*fall, fall[1] - value, value <= fall[0])
    if softness is None:
        return between(lesser(up, down), 0.0, 1.0)
    width = jnp.asarray(softness, up.dtype)
    height = _at_most(_at_most(up, down, width), 1.0, width)
    # At least 0, its corner rounded alike.
    return height - _at_most(height, 0.0, width)


@jax.custom_jvp
def _at_most(a: Array, b: Array | float, width: Array) -> Array:
    """The smaller of two heights, its corner rounded where they are closer than a width."""
    near = 1.0 - lesser(jnp.abs(a - b) / width, 1.0)
    return lesser(a, b) - 0.25 * width * near * near


def _at_most_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    a, b, width = primals
    near = 1.0 - lesser(jnp.abs(a - b) / width, 1.0)
    by_a = jnp.where(a < b, 1.0 - 0.5 * near, 0.5 * near)
    by_width = 0.25 * near * near - 0.5 * near
    return _at_most(a, b, width), weighed(tangents, (by_a, 1.0 - by_a, by_width))


_at_most.defjvp(_at_most_jvp, symbolic_zeros=True)


class Triangular(AbstractMembership):
    """Rises from `left` to `peak`, falls to `right`."""

    kind: ClassVar[str] = "trimf"
    left: Scalar = _parameter()
    peak: Scalar = _parameter()
    right: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return _flanks(value, (self.left, self.peak), (self.peak, self.right), softness)


class Trapezoidal(AbstractMembership):
    """Rises from `left` to `top_left`, is 1 up to `top_right`, falls to `right`."""

    kind: ClassVar[str] = "trapmf"
    left: Scalar = _parameter()
    top_left: Scalar = _parameter()
    top_right: Scalar = _parameter()
    right: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return _flanks(value, (self.left, self.top_left), (self.top_right, self.right), softness)


class Gaussian(AbstractMembership):
    """`exp(-(value - centre)^2 / (2 width^2))`."""

    kind: ClassVar[str] = "gaussmf"
    width: Scalar = _parameter()
    centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        away = (value - self.centre) / jnp.maximum(jnp.abs(self.width), _NARROW)
        # Beyond 38 widths the degree is 0 in double precision; the square must stay finite for the gradient.
        away = between(away, -40.0, 40.0)
        return decay(0.5 * away * away)


class Bell(AbstractMembership):
    """Generalised bell, `1 / (1 + |(value - centre) / width|^(2 slope))`."""

    kind: ClassVar[str] = "gbellmf"
    width: Scalar = _parameter()
    slope: Scalar = _parameter()
    centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        away = jnp.abs(value - self.centre) / jnp.maximum(jnp.abs(self.width), _NARROW)
        # At the centre the logarithm has no value, and a flat bell no gradient.
        # Beyond e^60 the degree is 0 in double precision; its square must stay finite for the gradient.
        return 1.0 / (1.0 + jnp.exp(jnp.clip(2.0 * self.slope * jnp.log(jnp.clip(away, 1e-9, 1e9)), -60.0, 60.0)))


class Sigmoidal(AbstractMembership):
    """`1 / (1 + exp(-slope (value - centre)))`."""

    kind: ClassVar[str] = "sigmf"
    slope: Scalar = _parameter()
    centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return 1.0 / (1.0 + jnp.exp(-jnp.clip(self.slope * (value - self.centre), -60.0, 60.0)))


MEMBERSHIPS: dict[str, type[AbstractMembership]] = {
    cls.kind: cls for cls in (Triangular, Trapezoidal, Gaussian, Bell, Sigmoidal)
}
