"""How degrees of membership are combined: minimum, product, maximum, probabilistic sum, sum.

Every norm has a hard form, equal to the textbook's, and a smooth form with continuous first derivatives that differs
from it only where two degrees are closer to each other than the softness `s` times their sum:

    smooth_min(a, b) = min(a, b) - max(s (a + b) - |a - b|, 0)^2 / (4 s (a + b))

In proportion to the degrees, so that a degree of 0 stays 0; and algebraic, since exponentials cost more than all the
rest of an inference.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .._types import Scalar

Softness = Scalar | float | None
"""How close two degrees must be, relative to their sum [1], for the choice between them to be blurred; at most 1.
None is the textbook's hard choice."""


def _blur(a: Array, b: Array, softness: Scalar | float) -> Array:
    reach = softness * (a + b)
    near = jnp.maximum(reach - jnp.abs(a - b), 0.0)
    # Where both degrees are 0 so is the blur.
    return 0.25 * near * near / jnp.maximum(reach, 1e-30)


def minimum(a: Array, b: Array, softness: Softness = None) -> Array:
    """The smaller of two degrees, neither of them negative."""
    lower = jnp.minimum(a, b)
    return lower if softness is None else lower - _blur(a, b, softness)


def maximum(a: Array, b: Array, softness: Softness = None) -> Array:
    """The larger of two degrees, neither of them negative."""
    upper = jnp.maximum(a, b)
    return upper if softness is None else upper + _blur(a, b, softness)


class AbstractNorm(eqx.Module):
    """A way to combine two degrees of membership into one."""

    name: eqx.AbstractClassVar[str]
    """As in a `.fis` file."""

    @abc.abstractmethod
    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        """The combined degree."""

    def all(self, degrees: Sequence[Array], softness: Softness = None) -> Array:
        """Several degrees, combined in their order."""
        total = degrees[0]
        for degree in degrees[1:]:
            total = self(total, degree, softness)
        return total


class Minimum(AbstractNorm):
    """The smaller degree (Zadeh 1965)."""

    name: ClassVar[str] = "min"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return minimum(a, b, softness)


class Product(AbstractNorm):
    """The product of both, smooth in itself."""

    name: ClassVar[str] = "prod"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return a * b


class Maximum(AbstractNorm):
    """The larger degree."""

    name: ClassVar[str] = "max"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return maximum(a, b, softness)


class ProbabilisticSum(AbstractNorm):
    """`a + b - a b`, smooth in itself."""

    name: ClassVar[str] = "probor"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return a + b - a * b


class Sum(AbstractNorm):
    """`a + b`, which may exceed 1; for aggregation."""

    name: ClassVar[str] = "sum"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return a + b


NORMS: dict[str, type[AbstractNorm]] = {cls.name: cls for cls in (Minimum, Product, Maximum, ProbabilisticSum, Sum)}
