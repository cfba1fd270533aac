"""Flanks of fuzzy sets: straight ones with sharp or rounded corners and written-out derivatives, and curved ones."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .norms import Softness, between, lesser, weighed

_ROUNDING = 4.0
"""Corners that are nearer to each other than so many units in the last place make a vertical flank."""


def least_width(value: Array) -> float:
    """Least width that is divided by: small against every universe, and its square against no number."""
    return 1e-100 if value.dtype == jnp.float64 else 1e-12


@jax.custom_jvp
def _flanks(
    value: Array, left: Array, top_left: Array, top_right: Array, right: Array, softness: Array | None
) -> Array:
    """The same, with the softness as an array."""
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
def ramps(value: Array, left: Array, top_left: Array, top_right: Array, right: Array, softness: Softness) -> Array:
    """Degree of a shape that rises between two corners, stays, and falls between two others.

    Jitted on its own, so that all sets share one trace, which costs more than it.

    Args:
        value: any shape, in the corners' unit.
        left, top_left, top_right, right: the corners; outer ones may be infinite.
        softness: width, in degrees, over which corners are rounded; None leaves them sharp.
    """
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
    rounding = _ROUNDING * jnp.finfo(width.dtype).eps * jnp.where(size == jnp.inf, 0.0, size)
    sloped = ~(width <= rounding + least_width(width))
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


def spline(value: Array, begin: Array, end: Array) -> Array:
    """0 up to one place, 1 from another on, two parabolas between; a step in the middle if the places are exchanged."""
    sloped, slope = _slope(begin, end)
    share = between((value - begin) * slope, 0.0, 1.0)
    curve = jnp.where(share < 0.5, 2.0 * share * share, 1.0 - 2.0 * (1.0 - share) * (1.0 - share))
    return jnp.where(sloped, curve, jnp.where(value >= 0.5 * (begin + end), 1.0, 0.0))
