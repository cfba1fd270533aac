"""How degrees of membership are combined: minimum, product, maximum, probabilistic sum, sum.

Every norm has a hard form, equal to the textbook's, and a smooth form with continuous first derivatives that differs
from it only where two degrees are closer to each other than the softness `s` times their sum:

    smooth_min(a, b) = min(a, b) - max(s (a + b) - |a - b|, 0)^2 / (4 s (a + b))

In proportion to the degrees, so that a degree of 0 stays 0; and algebraic, since exponentials cost more than all the
rest of an inference.
"""

import abc
import functools
import operator
from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from .._types import Scalar

Softness = Scalar | float | None
"""How close two degrees must be, relative to their sum [1], for the choice between them to be blurred; at most 1.
None is the textbook's hard choice."""

_TINY = 1e-30


def lesser(a: Array, b: Array | float) -> Array:
    """The smaller of two numbers; the second one where they are equal, and nan where either is.

    A choice, whose derivative is a choice again: that of `jnp.minimum` takes several times the code.
    """
    return jnp.where((a < b) | (a != a), a, b)


def between(value: Array, low: Array | float, high: Array | float) -> Array:
    """The nearest number between two others, by choices alone."""
    return jnp.where(value < low, low, jnp.where(value > high, high, value))


@jax.custom_jvp
def _blurred_minimum(a: Array, b: Array, softness: Array) -> Array:
    reach = softness * (a + b)
    near = lesser(jnp.abs(a - b) - reach, 0.0)
    # Where both degrees are 0 so is the blur.
    return lesser(a, b) - 0.25 * near * near / (reach + _TINY)


def _blurred_minimum_jvp(primals: tuple[Array, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    a, b, softness = primals
    reach = softness * (a + b)
    share = -lesser(jnp.abs(a - b) - reach, 0.0) / (reach + _TINY)
    # What a sum of degrees that grows takes from the blur, and what the gap between them gives.
    sum_ = 0.5 * share * softness * (1.0 - 0.5 * share)
    gap = 0.5 * share
    by_a = jnp.where(a < b, 1.0 - gap, gap) - sum_
    by_b = jnp.where(a < b, gap, 1.0 - gap) - sum_
    by_softness = -0.5 * share * (a + b) * (1.0 - 0.5 * share)
    return _blurred_minimum(*primals), weighed(tangents, (by_a, by_b, by_softness))


_blurred_minimum.defjvp(_blurred_minimum_jvp, symbolic_zeros=True)


def weighed(tangents: Sequence[Any], derivatives: Sequence[Array]) -> Array:
    """The sum of tangents times derivatives, without those that are zero by structure."""
    parts = [d * t for t, d in zip(tangents, derivatives, strict=True) if not isinstance(t, SymbolicZero)]
    return functools.reduce(operator.add, parts)


def minimum(a: Array, b: Array, softness: Softness = None) -> Array:
    """The smaller of two degrees, neither of them negative."""
    return lesser(a, b) if softness is None else _blurred_minimum(a, b, jnp.asarray(softness, a.dtype))


def maximum(a: Array, b: Array, softness: Softness = None) -> Array:
    """The larger of two degrees, neither of them negative."""
    return jnp.where((a > b) | (a != a), a, b) if softness is None else a + b - minimum(a, b, softness)


class AbstractNorm(eqx.Module):
    """A way to combine two degrees of membership into one."""

    name: eqx.AbstractClassVar[str]
    """As in a `.fis` file."""

    @abc.abstractmethod
    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        """The combined degree."""

    @abc.abstractmethod
    def of_numbers(self, a: Array, b: Array) -> Array:
        """The hard form where both are numbers: what is none may be lost, and half the instructions are saved."""

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

    def of_numbers(self, a: Array, b: Array) -> Array:
        return jnp.where(a < b, a, b)


class Product(AbstractNorm):
    """The product of both, smooth in itself."""

    name: ClassVar[str] = "prod"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return self.of_numbers(a, b)

    def of_numbers(self, a: Array, b: Array) -> Array:
        return a * b


class Maximum(AbstractNorm):
    """The larger degree."""

    name: ClassVar[str] = "max"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return maximum(a, b, softness)

    def of_numbers(self, a: Array, b: Array) -> Array:
        return jnp.where(a > b, a, b)


class ProbabilisticSum(AbstractNorm):
    """`a + b - a b`, smooth in itself."""

    name: ClassVar[str] = "probor"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return self.of_numbers(a, b)

    def of_numbers(self, a: Array, b: Array) -> Array:
        return a + b - a * b


class Sum(AbstractNorm):
    """`a + b`, which may exceed 1; for aggregation."""

    name: ClassVar[str] = "sum"

    def __call__(self, a: Array, b: Array, softness: Softness = None) -> Array:
        return self.of_numbers(a, b)

    def of_numbers(self, a: Array, b: Array) -> Array:
        return a + b


NORMS: dict[str, type[AbstractNorm]] = {cls.name: cls for cls in (Minimum, Product, Maximum, ProbabilisticSum, Sum)}
