"""Implication and aggregation of a Mamdani system: what depends on its sets alone is computed beforehand.

Sets change from one controller to another, not from one sample to the next. A loop asks for these before it begins, and
has the degrees over the grid, or no more than their sums, as numbers: for gradients that is most of the work.
"""

import abc
import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._math import materialise
from .._types import Scalar
from .defuzzify import AbstractDefuzzifier, Centroid
from .membership import AbstractMembership, Unit
from .merged_grid import Column, area_and_moment, nothing
from .norms import AbstractNorm, Softness
from .rules import universe


def concluded(member: AbstractMembership, negated: bool, values: Array) -> Array:
    """Degrees of `is`, or of `is not`."""
    degree = member.degree(values)
    return 1.0 - degree if negated else degree


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


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _part(implication: AbstractNorm, numbers: tuple[Array, ...], weight: Array, degree: Array, slopes: Array) -> Array:
    """What a set contributes at a point: its degree there, and how that depends on the set's numbers, are known."""
    return implication.of_numbers(degree, weight)


@_part.defjvp
def _part_jvp(implication: AbstractNorm, primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    """In first derivatives the slopes take the degree's place; in second ones both tell how they change themselves."""
    _, weight, degree, slopes = primals
    rise = sum((slopes[place] * tangent for place, tangent in enumerate(tangents[0])), jnp.zeros_like(degree))
    return jax.jvp(implication.of_numbers, (degree, weight), (rise, tangents[1]))


@jax.custom_jvp
def _apart(degrees: list[Array], go: Array) -> list[Array]:
    """The same degrees, whose cotangents the compiler computes once and not anew for every number that they reach."""
    return degrees


@_apart.defjvp
def _apart_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[list[Array], list[Array]]:
    return primals[0], materialise(tangents[0], primals[1])


class Swept(AbstractConclusions):
    """Sets put together one point after the other, all rollouts of a batch abreast; for the centroid.

    Neither the batch's degrees over the grid nor their gradients are ever written to memory: how a degree depends on
    its set's numbers is known beforehand, too, so that a gradient adds up a few numbers a set, and no point. In units
    of the universe degrees do not depend on its ends.
    """

    numbers: Float[Array, " number"]
    """The sets' own, where the universe reaches from -1/2 to 1/2."""
    places: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Which of them each set has."""
    degrees: tuple[Float[Array, " point"], ...]
    slopes: tuple[Float[Array, "point _"], ...]
    """Derivatives of each set's degrees by its numbers."""
    low: Scalar
    high: Scalar
    implication: AbstractNorm
    aggregation: AbstractNorm

    @classmethod
    def of(
        cls,
        sets: Sequence[tuple[AbstractMembership, bool]],
        low: Scalar,
        high: Scalar,
        points: int,
        implication: AbstractNorm,
        aggregation: AbstractNorm,
    ) -> "Swept":
        """From sets, each with whether it is negated, and the ends of their universe."""
        # One array, since a loop's gradient is added up leaf by leaf. What several sets share is one number.
        shared: dict[tuple[int, Unit], tuple[int, Array]] = {}
        places = []
        for member, _ in sets:
            own = zip(member.parameters(), member.units(), member.within(low, high), strict=True)
            places.append(tuple(shared.setdefault((id(p), unit), (len(shared), n))[0] for p, unit, n in own))
        numbers = jnp.stack([number for _, number in shared.values()])
        grid, span = universe(low, high, points), high - low
        degrees, slopes = [], []
        for member, negated in sets:
            shape = functools.partial(concluded, negated=negated, values=grid)
            degrees.append(shape(member))
            # By the numbers in the variable's unit, lest a point on a corner come to lie beside it.
            by = jax.jacfwd(shape)(member)
            each = zip(by.parameters(), member.units(), strict=True)
            slopes.append(jnp.stack([slope * span**unit.power for slope, unit in each], axis=1))
        return cls(numbers, tuple(places), tuple(degrees), tuple(slopes), low, high, implication, aggregation)

    def value(self, weights: Sequence[Array], softness: Softness) -> Scalar:
        points = len(self.degrees[0])
        # Every rollout's own, so that cotangents are added up over a batch once, and not at every point.
        own = self.numbers + nothing(weights)
        each = [jnp.squeeze(number, 0) for number in jnp.split(own, len(own))]
        numbers = [tuple(each[place] for place in places) for places in self.places]
        levers = jnp.linspace(-0.5, 0.5, points, dtype=own.dtype)

        def add(sums: tuple[Array, Array], point: Any) -> tuple[tuple[Array, Array], None]:
            degrees, slopes, lever = point
            parts = list(map(functools.partial(_part, self.implication), numbers, weights, degrees, slopes))
            parts = _apart(parts, lever < 1.0)
            total = functools.reduce(self.aggregation.of_numbers, parts)
            return (sums[0] + total, sums[1] + total * lever), None

        # Neither is a set's number that is none; that of an open shoulder is infinite.
        zero = nothing(weights) + jnp.sum(jnp.where(jnp.isnan(self.numbers), self.numbers, 0.0))
        begin = zero, zero
        along = (self.degrees, self.slopes, levers)
        (area, moment), _ = jax.lax.scan(jax.checkpoint(add, prevent_cse=False), begin, along)
        middle = 0.5 * (self.low + self.high)
        return Centroid().balance(middle, area, moment * (self.high - self.low), points, softness)


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
