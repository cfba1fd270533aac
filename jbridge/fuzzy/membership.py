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
from .norms import Softness, between, lesser, weighed

_ROUNDING = 4.0
"""Corners that are nearer to each other than so many units in the last place make a vertical flank."""


def _least(value: Array) -> float:
    """Least width that is divided by: small against every universe, and its square against no number."""
    return 1e-100 if value.dtype == jnp.float64 else 1e-12


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


@jax.custom_jvp
def _flanks(
    value: Array, left: Array, top_left: Array, top_right: Array, right: Array, softness: Array | None
) -> Array:
    """Degree of a shape that rises between two corners, stays, and falls between two others."""
    _, _, up, down = _slopes(value, left, top_left, top_right, right)
    return _height(up, down, softness)[0]


def _flanks_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    """Written out, since what the chain rule gives is several times the code."""
    per_rise, per_fall, up, down = _slopes(*primals[:5])
    height, by_up, by_down, by_softness = _height(up, down, primals[5])
    rise, fall = by_up * per_rise, by_down * per_fall
    derivatives = [rise - fall, rise * (up - 1.0), -rise * up, fall * down, fall * (1.0 - down), by_softness]
    return height, weighed(*zip(*((t, d) for t, d in zip(tangents, derivatives, strict=True) if t is not None)))


_flanks.defjvp(_flanks_jvp, symbolic_zeros=True)


@jax.jit
def _ramps(value: Array, left: Array, top_left: Array, top_right: Array, right: Array, softness: Softness) -> Array:
    """The same for any softness. Jitted on its own, so that all sets share one trace, which costs more than it."""
    blur = None if softness is None else jnp.asarray(softness, jnp.result_type(value, left))
    return _flanks(value, left, top_left, top_right, right, blur)


def _slopes(
    value: Array, left: Array, top_left: Array, top_right: Array, right: Array
) -> tuple[Array, Array, Array, Array]:
    """Slopes of the flanks (0 for vertical and open ones), and the heights of their straight lines at a value."""
    (sloped_rise, rise), (sloped_fall, fall) = _slope(left, top_left), _slope(top_right, right)
    up = jnp.where(sloped_rise, (value - left) * rise, jnp.where(value >= top_left, 1.0, 0.0))
    down = jnp.where(sloped_fall, (right - value) * fall, jnp.where(value <= top_right, 1.0, 0.0))
    return rise, fall, jnp.where(left == -jnp.inf, 1.0, up), jnp.where(right == jnp.inf, 1.0, down)


def _slope(begin: Array, end: Array) -> tuple[Array, Array]:
    """Whether a flank between two corners is neither vertical nor endless, and its slope, 0 otherwise."""
    size = jnp.maximum(jnp.abs(begin), jnp.abs(end))
    width = jnp.where(size == jnp.inf, 0.0, end - begin)
    # A corner that is no number makes a slope that is none.
    sloped = ~(width <= _ROUNDING * jnp.finfo(width.dtype).eps * jnp.where(size == jnp.inf, 0.0, size) + _least(width))
    return sloped, jnp.where(sloped, 1.0 / jnp.where(sloped, width, 1.0), 0.0)


def flank_slope(begin: Array, end: Array) -> Array:
    """Slope of a straight flank between two corners, 0 if it is vertical or endless."""
    return _slope(begin, end)[1]


def _height(up: Array, down: Array, softness: Array | None) -> tuple[Array, Array, Array, Array | None]:
    """The smaller of two heights, kept between 0 and 1, and its derivatives by both and by the softness."""
    if softness is None:
        least = lesser(up, down)
        inside = jnp.where((least < 0.0) | (least > 1.0), 0.0, 1.0)
        return between(least, 0.0, 1.0), jnp.where(up < down, inside, 0.0), jnp.where(up < down, 0.0, inside), None
    least, up_share, by_width = _at_most(up, down, softness)
    capped, under, cap_by_width = _at_most(least, 1.0, softness)
    # At least 0, its corner rounded alike.
    below, beyond, below_by_width = _at_most(capped, 0.0, softness)
    share = (1.0 - beyond) * under
    by_softness = (1.0 - beyond) * (under * by_width + cap_by_width) - below_by_width
    return capped - below, share * up_share, share * (1.0 - up_share), by_softness


def _at_most(a: Array, b: Array | float, width: Array) -> tuple[Array, Array, Array]:
    """The smaller of two heights, its corner rounded where they are closer than a width.

    Returns:
        The height, and its derivatives by the first one and by the width.
    """
    near = 1.0 - lesser(jnp.abs(a - b) / width, 1.0)
    by_a = jnp.where(a < b, 1.0 - 0.5 * near, 0.5 * near)
    return lesser(a, b) - 0.25 * width * near * near, by_a, 0.25 * near * near - 0.5 * near


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
        return _ramps(value, self.left, self.top_left, self.top_right, self.right, softness)

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


def _spline(value: Array, begin: Array, end: Array) -> Array:
    """0 up to one place, 1 from another on, two parabolas between; a step in the middle if the places are exchanged."""
    sloped, slope = _slope(begin, end)
    share = between((value - begin) * slope, 0.0, 1.0)
    curve = jnp.where(share < 0.5, 2.0 * share * share, 1.0 - 2.0 * (1.0 - share) * (1.0 - share))
    return jnp.where(sloped, curve, jnp.where(value >= 0.5 * (begin + end), 1.0, 0.0))


class SShaped(AbstractMembership):
    """0 up to `foot`, 1 from `shoulder` on, and two parabolas between that meet in the middle at 1/2."""

    kind: ClassVar[str] = "smf"
    foot: Scalar = _parameter()
    shoulder: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return _spline(value, self.foot, self.shoulder)

    def general(self) -> "SShaped":
        return self


class ZShaped(AbstractMembership):
    """1 up to `shoulder`, 0 from `foot` on, and two parabolas between that meet in the middle at 1/2."""

    kind: ClassVar[str] = "zmf"
    shoulder: Scalar = _parameter()
    foot: Scalar = _parameter()

    def degree(self, value: Array, softness: Softness = None) -> Array:
        return _spline(-value, -self.foot, -self.shoulder)

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
        away = (value - self.centre) / jnp.maximum(jnp.abs(self.width), _least(self.width))
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
        away = jnp.abs(value - self.centre) / jnp.maximum(jnp.abs(self.width), _least(self.width))
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
