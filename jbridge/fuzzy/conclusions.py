"""How the conclusions about one output become one value: what depends on the sets alone is computed beforehand.

Sets change from one controller to another, not from one sample to the next. A loop asks for these before it begins, and
has the degrees over the grid, or no more than their sums, as numbers: for gradients that is most of the work.
"""

import abc
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Scalar
from .columns import Column, area_and_moment
from .defuzzify import AbstractDefuzzifier, Centroid
from .norms import AbstractNorm, Softness


class AbstractConclusions(eqx.Module):
    """The sets in which rules conclude about one output."""

    @abc.abstractmethod
    def value(self, weights: Sequence[Array], softness: Softness) -> Scalar:
        """One value of the universe.

        Args:
            weights: firing strength of each set.
            softness: see `AbstractSystem.infer`.
        """


class Gridded(AbstractConclusions):
    """Sets put together point by point."""

    shapes: tuple[Float[Array, " point"], ...]
    grid: Float[Array, " point"]
    implication: AbstractNorm
    aggregation: AbstractNorm
    defuzzifier: AbstractDefuzzifier

    def value(self, weights: Sequence[Array], softness: Softness) -> Scalar:
        parts = [self.implication(shape, weight) for shape, weight in zip(self.shapes, weights, strict=True)]
        return self.defuzzifier(self.grid, self.aggregation.all(parts), softness)


class Columned(AbstractConclusions):
    """Sets known while a program is traced, in columns of like points; for the centroid."""

    found: tuple[Column, ...] = eqx.field(static=True)
    middle: float = eqx.field(static=True)
    points: int = eqx.field(static=True)
    implication: AbstractNorm
    aggregation: AbstractNorm

    def value(self, weights: Sequence[Array], softness: Softness) -> Scalar:
        area, moment = area_and_moment(self.found, weights, self.implication, self.aggregation)
        return Centroid().balance(self.middle, area, moment, self.points, softness)


class Weighed(AbstractConclusions):
    """Sets that are scaled and added up; for the centroid: their areas and moments are, too."""

    areas: tuple[Scalar, ...]
    moments: tuple[Scalar, ...]
    """About the middle of the universe."""
    middle: Scalar
    points: int = eqx.field(static=True)

    @classmethod
    def of(cls, shapes: Sequence[Any], grid: Any) -> "Weighed":
        """From degrees at the points of a grid, either kind of array."""
        middle = 0.5 * (grid[0] + grid[-1])
        areas = tuple(jnp.asarray(shape.sum()) for shape in shapes)
        moments = tuple(jnp.asarray((shape * (grid - middle)).sum()) for shape in shapes)
        return cls(areas, moments, jnp.asarray(middle), len(grid))

    def value(self, weights: Sequence[Array], softness: Softness) -> Scalar:
        area = moment = jnp.zeros_like(weights[0])
        for weight, own_area, own_moment in zip(weights, self.areas, self.moments, strict=True):
            area, moment = area + weight * own_area, moment + weight * own_moment
        return Centroid().balance(self.middle, area, moment, self.points, softness)
