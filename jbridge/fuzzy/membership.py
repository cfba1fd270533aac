"""Fuzzy sets: the degree to which a value belongs, between 0 and 1.

A set's parameters are what one would draw: corners of a trapezoid, centre and width of a bell. Corners are in
ascending order; equal corners make a vertical flank, which has the value of its upper end, and an infinite outer corner
makes an open shoulder. Kinds, names and formulas are those of MATLAB's Fuzzy Logic Toolbox.
"""

import abc
import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._math import decay
from .._types import Scalar
from .flanks import least_width, ramps, spline
from .norms import Softness, between, lesser


def as_number(value: Any) -> Array:
    return jnp.asarray(value, dtype=jnp.result_type(float))


class Unit(NamedTuple):
    """What a set's parameter is measured in."""

    power: int
    """Of the variable's unit."""
    counted: bool = False
    """Whether it is counted from somewhere: a place, not a width."""


_PLACE, _WIDTH, _NUMBER, _RATE = Unit(1, counted=True), Unit(1), Unit(0), Unit(-1)


def _parameter(unit: Unit = _PLACE) -> Any:
    return eqx.field(converter=as_number, metadata={"unit": unit})


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

    @abc.abstractmethod
    def general(self) -> "AbstractMembership":
        """The same set as one of a kind that holds this kind's, so that sets of both are computed alike."""

    def units(self) -> tuple[Unit, ...]:
        """Of its parameters, in the order of its fields."""
        return tuple(field.metadata["unit"] for field in dataclasses.fields(self))

    def parameters(self) -> tuple[Array, ...]:
        """Its numbers."""
        return tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    def within(self, low: Array, high: Array) -> tuple[Array, ...]:
        """Its parameters where the universe reaches from -1/2 to 1/2: at each share of it, the degree is the same."""
        middle, span = 0.5 * (low + high), high - low
        found = zip(self.parameters(), self.units(), strict=True)
        return tuple((number - middle if unit.counted else number) / span**unit.power for number, unit in found)


class Triangular(AbstractMembership):
    """Rises from `left` to `peak`, falls to `right`."""

    kind: ClassVar[str] = "trimf"
    left: Scalar = _parameter()
    peak: Scalar = _parameter()
    right: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return self.general().degree(value, softness)

    def general(self) -> "Trapezoidal":
        return Trapezoidal(self.left, self.peak, self.peak, self.right)


class Trapezoidal(AbstractMembership):
    """Rises from `left` to `top_left`, is 1 up to `top_right`, falls to `right`."""

    kind: ClassVar[str] = "trapmf"
    left: Scalar = _parameter()
    top_left: Scalar = _parameter()
    top_right: Scalar = _parameter()
    right: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return ramps(value, self.left, self.top_left, self.top_right, self.right, softness)

    def general(self) -> "Trapezoidal":
        return self


class LinearS(AbstractMembership):
    """0 up to `foot`, rises to `shoulder`, and is 1 beyond it."""

    kind: ClassVar[str] = "linsmf"
    foot: Scalar = _parameter()
    shoulder: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return self.general().degree(value, softness)

    def general(self) -> "Trapezoidal":
        open_ = jnp.full_like(self.shoulder, jnp.inf)
        return Trapezoidal(self.foot, self.shoulder, open_, open_)


class LinearZ(AbstractMembership):
    """1 up to `shoulder`, falls to `foot`, and is 0 beyond it."""

    kind: ClassVar[str] = "linzmf"
    shoulder: Scalar = _parameter()
    foot: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return self.general().degree(value, softness)

    def general(self) -> "Trapezoidal":
        open_ = jnp.full_like(self.shoulder, -jnp.inf)
        return Trapezoidal(open_, open_, self.shoulder, self.foot)


class SShaped(AbstractMembership):
    """0 up to `foot`, 1 from `shoulder` on, and two parabolas between that meet in the middle at 1/2."""

    kind: ClassVar[str] = "smf"
    foot: Scalar = _parameter()
    shoulder: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return spline(value, self.foot, self.shoulder)

    def general(self) -> "SShaped":
        return self


class ZShaped(AbstractMembership):
    """1 up to `shoulder`, 0 from `foot` on, and two parabolas between that meet in the middle at 1/2."""

    kind: ClassVar[str] = "zmf"
    shoulder: Scalar = _parameter()
    foot: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return spline(-value, -self.foot, -self.shoulder)

    def general(self) -> "ZShaped":
        return self


class PiShaped(AbstractMembership):
    """The product of an S from `left` to `top_left` and a Z from `top_right` to `right`."""

    kind: ClassVar[str] = "pimf"
    left: Scalar = _parameter()
    top_left: Scalar = _parameter()
    top_right: Scalar = _parameter()
    right: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        rise = SShaped(self.left, self.top_left).degree(value)
        return rise * ZShaped(self.top_right, self.right).degree(value)

    def general(self) -> "PiShaped":
        return self


class Gaussian(AbstractMembership):
    """`exp(-(value - centre)^2 / (2 width^2))`."""

    kind: ClassVar[str] = "gaussmf"
    width: Scalar = _parameter(_WIDTH)
    centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        away = (value - self.centre) / jnp.maximum(jnp.abs(self.width), least_width(self.width))
        # Beyond 38 widths the degree is 0 in double precision; the square must stay finite for the gradient.
        away = between(away, -40.0, 40.0)
        return decay(0.5 * away * away)

    def general(self) -> "Gaussian":
        return self


class TwoSidedGaussian(AbstractMembership):
    """The product of a Gaussian flank left of `left_centre` and another one right of `right_centre`."""

    kind: ClassVar[str] = "gauss2mf"
    left_width: Scalar = _parameter(_WIDTH)
    left_centre: Scalar = _parameter()
    right_width: Scalar = _parameter(_WIDTH)
    right_centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        left = Gaussian(self.left_width, self.left_centre).degree(lesser(value, self.left_centre))
        right = Gaussian(self.right_width, -self.right_centre).degree(lesser(-value, -self.right_centre))
        return left * right

    def general(self) -> "TwoSidedGaussian":
        return self


class Bell(AbstractMembership):
    """Generalised bell, `1 / (1 + |(value - centre) / width|^(2 slope))`."""

    kind: ClassVar[str] = "gbellmf"
    width: Scalar = _parameter(_WIDTH)
    slope: Scalar = _parameter(_NUMBER)
    centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        away = jnp.abs(value - self.centre) / jnp.maximum(jnp.abs(self.width), least_width(self.width))
        # At the centre the logarithm has no value, and a flat bell no gradient.
        # Beyond e^60 the degree is 0 in double precision; its square must stay finite for the gradient.
        return 1.0 / (1.0 + jnp.exp(jnp.clip(2.0 * self.slope * jnp.log(jnp.clip(away, 1e-9, 1e9)), -60.0, 60.0)))

    def general(self) -> "Bell":
        return self


class Sigmoidal(AbstractMembership):
    """`1 / (1 + exp(-slope (value - centre)))`."""

    kind: ClassVar[str] = "sigmf"
    slope: Scalar = _parameter(_RATE)
    centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return 1.0 / (1.0 + jnp.exp(-jnp.clip(self.slope * (value - self.centre), -60.0, 60.0)))

    def general(self) -> "Sigmoidal":
        return self


class SigmoidalDifference(AbstractMembership):
    """The distance between two sigmoids, `|sigmoid 1 - sigmoid 2|`."""

    kind: ClassVar[str] = "dsigmf"
    first_slope: Scalar = _parameter(_RATE)
    first_centre: Scalar = _parameter()
    second_slope: Scalar = _parameter(_RATE)
    second_centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        first = Sigmoidal(self.first_slope, self.first_centre).degree(value)
        return jnp.abs(first - Sigmoidal(self.second_slope, self.second_centre).degree(value))

    def general(self) -> "SigmoidalDifference":
        return self


class SigmoidalProduct(AbstractMembership):
    """The product of two sigmoids."""

    kind: ClassVar[str] = "psigmf"
    first_slope: Scalar = _parameter(_RATE)
    first_centre: Scalar = _parameter()
    second_slope: Scalar = _parameter(_RATE)
    second_centre: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        first = Sigmoidal(self.first_slope, self.first_centre).degree(value)
        return first * Sigmoidal(self.second_slope, self.second_centre).degree(value)

    def general(self) -> "SigmoidalProduct":
        return self


class Gathered(eqx.Module):
    """The sets of one variable, for loops in which they do not change.

    Sets of one kind take turns in a loop of their own: their program is compiled once, and so is its gradient's, which
    adds up a few arrays in place of many numbers.
    """

    kinds: tuple[AbstractMembership, ...]
    """Of every kind the sets, each number an array of them."""
    places: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Which sets these are."""

    @classmethod
    def of(cls, sets: Sequence[AbstractMembership]) -> "Gathered":
        """From the sets one by one."""
        found: dict[type[AbstractMembership], list[int]] = {}
        members = [member.general() for member in sets]
        for place, member in enumerate(members):
            found.setdefault(type(member), []).append(place)
        kinds = [jax.tree.map(lambda *n: jnp.stack(n), *(members[i] for i in places)) for places in found.values()]
        return cls(tuple(kinds), tuple(map(tuple, found.values())))

    def degrees(self, value: Array, softness: Softness = None) -> list[Array]:
        """Degree of membership of a value in each set."""
        found: dict[int, Array] = {}
        for kind, places in zip(self.kinds, self.places, strict=True):
            _, rows = jax.lax.scan(lambda _, member: (None, member.degree(value, softness)), None, kind)
            found |= {place: rows[row] for row, place in enumerate(places)}
        return [found[place] for place in sorted(found)]


MEMBERSHIPS: dict[str, type[AbstractMembership]] = {
    cls.kind: cls
    for cls in (
        Triangular, Trapezoidal, Gaussian, Bell, Sigmoidal, LinearS, LinearZ, SShaped, ZShaped, PiShaped,
        TwoSidedGaussian, SigmoidalDifference, SigmoidalProduct,
    )
}  # fmt: skip


def membership(kind: str, numbers: Sequence[float]) -> AbstractMembership:
    """A set from a kind of `MEMBERSHIPS` and its numbers, in the order of the kind's fields.

    Raises:
        ValueError: there are too few or too many numbers, one is NaN, corners do not ascend, or a number other than a
            corner of straight flanks is infinite. The text continues a sentence that begins with the set's name.
    """
    cls = MEMBERSHIPS[kind]
    wanted = [field.name for field in dataclasses.fields(cls)]
    if len(numbers) != len(wanted):
        raise ValueError(f"has {len(numbers)} numbers; it needs {', '.join(wanted)}")
    if any(math.isnan(number) for number in numbers):
        raise ValueError("has a number that is NaN; correct it")
    if cls in _STRAIGHT:
        if any(b < a for a, b in itertools.pairwise(numbers)):
            raise ValueError("has corners that do not ascend; sort them")
    elif not all(math.isfinite(number) for number in numbers):
        raise ValueError("has an infinite number; only corners of straight flanks may be infinite")
    return cls(*map(as_number, numbers))


_STRAIGHT = (Triangular, Trapezoidal, LinearS, LinearZ)
