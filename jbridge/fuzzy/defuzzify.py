"""From an aggregated fuzzy set to one number."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Scalar
from .norms import Softness

EMPTY = 1e-3
"""In smooth mode an aggregate this small relative to the softness is drawn to the middle of the universe, so that the
gradient stays bounded where no rule fires."""
_LEVEL = 1e-12
"""Degrees that differ by less are equally high."""


class AbstractDefuzzifier(eqx.Module):
    """A way to choose one value of the universe."""

    name: eqx.AbstractClassVar[str]
    """As in a `.fis` file."""

    @abc.abstractmethod
    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        """The chosen value; the middle of the grid for an empty set."""

    def as_matlab(self) -> "AbstractDefuzzifier":
        """The same choice as MATLAB's `defuzz` makes it."""
        return self


class Centroid(AbstractDefuzzifier):
    """Centre of gravity of the points of the grid."""

    name: ClassVar[str] = "centroid"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        middle = 0.5 * (grid[0] + grid[-1])
        return self.balance(middle, jnp.sum(degree), jnp.sum(degree * (grid - middle)), grid.shape[0], softness)

    def balance(
        self, middle: Scalar | float, area: Scalar, moment: Scalar, points: int, softness: Softness = None
    ) -> Scalar:
        """The centre from the sum of the degrees and the sum of their moments about the middle."""
        if softness is None:
            empty = area <= 0.0
            return middle + jnp.where(empty, 0.0, moment / jnp.where(empty, 1.0, area))
        return middle + moment / (area + EMPTY * softness * points)


class Bisector(AbstractDefuzzifier):
    """The value that halves the area under the set, linear between the points of the grid."""

    name: ClassVar[str] = "bisector"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        step = grid[1] - grid[0]
        piece = 0.5 * (degree[1:] + degree[:-1]) * step
        area = jnp.concatenate([jnp.zeros(1, degree.dtype), jnp.cumsum(piece)])
        half = 0.5 * area[-1]
        k = jnp.clip(jnp.searchsorted(area, half, side="right") - 1, 0, piece.shape[0] - 1)
        # Within the step the area grows by a parabola; its root in a form that also serves a flat one.
        low, slope, left = degree[k], (degree[k + 1] - degree[k]) / step, half - area[k]
        under = jnp.maximum(low * low + 2.0 * slope * left, 0.0)
        below = low + jnp.where(under > 0, jnp.sqrt(jnp.where(under > 0, under, 1.0)), 0.0)
        inside = jnp.where(below > 0, 2.0 * left / jnp.where(below > 0, below, 1.0), 0.0)
        return jnp.where(area[-1] > 0, grid[k] + jnp.clip(inside, 0.0, step), 0.5 * (grid[0] + grid[-1]))

    def as_matlab(self) -> "BisectorOnGrid":
        return BisectorOnGrid()


class BisectorOnGrid(AbstractDefuzzifier):
    """The first point of the grid up to which the degrees add up to half of their sum, as MATLAB has it."""

    name: ClassVar[str] = "bisector"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        sums = jnp.cumsum(degree)
        return jnp.where(sums[-1] > 0, grid[jnp.argmax(sums >= 0.5 * sums[-1])], 0.5 * (grid[0] + grid[-1]))


class MeanOfMaximum(AbstractDefuzzifier):
    """Mean of the points where the set is highest; with softness, of the points that are nearly as high."""

    name: ClassVar[str] = "mom"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        top = jnp.max(degree)
        if softness is None:
            weight = jnp.where(degree >= top - _LEVEL, 1.0, 0.0)
        else:
            weight = jnp.maximum(1.0 - (top - degree) / softness, 0.0) ** 2
        middle = 0.5 * (grid[0] + grid[-1])
        return middle + jnp.where(top > 0, jnp.sum(weight * (grid - middle)) / jnp.sum(weight), 0.0)


def _at_top(grid: Array, degree: Array, key: Array) -> Array:
    """The point of the grid with the least key among those where the set is highest; the middle of an empty set."""
    top = jnp.max(degree)
    chosen = grid[jnp.argmin(jnp.where(degree >= top - _LEVEL, key, jnp.inf))]
    return jnp.where(top > 0, chosen, 0.5 * (grid[0] + grid[-1]))


class SmallestOfMaximum(AbstractDefuzzifier):
    """The smallest point where the set is highest."""

    name: ClassVar[str] = "som"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        return _at_top(grid, degree, grid)

    def as_matlab(self) -> "NearestOfMaximum":
        return NearestOfMaximum()


class LargestOfMaximum(AbstractDefuzzifier):
    """The largest point where the set is highest."""

    name: ClassVar[str] = "lom"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        return _at_top(grid, degree, -grid)

    def as_matlab(self) -> "FarthestOfMaximum":
        return FarthestOfMaximum()


class NearestOfMaximum(AbstractDefuzzifier):
    """The point of the least size where the set is highest: MATLAB's `som`."""

    name: ClassVar[str] = "som"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        return _at_top(grid, degree, jnp.abs(grid))


class FarthestOfMaximum(AbstractDefuzzifier):
    """The point of the greatest size where the set is highest: MATLAB's `lom`."""

    name: ClassVar[str] = "lom"

    def __call__(
        self, grid: Float[Array, " point"], degree: Float[Array, " point"], softness: Softness = None
    ) -> Scalar:
        return _at_top(grid, degree, -jnp.abs(grid))


DEFUZZIFIERS: dict[str, type[AbstractDefuzzifier]] = {
    cls.name: cls for cls in (Centroid, Bisector, MeanOfMaximum, SmallestOfMaximum, LargestOfMaximum)
}
