"""Point-to-point reference trajectories of cart and rope: polynomials of fifth degree with bounded speed."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

_FASTEST = 1.875
"""Largest speed of the polynomial of degree 5, over its mean."""


MOST_ENTRIES = 1_000_000
"""Entries of the longest path: more than five hours at 50 Hz."""


class Path(NamedTuple):
    """A reference at equally spaced times."""

    times: NDArray[np.float64]
    """[s]"""
    x: NDArray[np.float64]
    """Cart position [m]."""
    l: NDArray[np.float64]
    """Rope length [m]."""
    v_x: NDArray[np.float64]
    """Cart speed [m/s]."""
    v_l: NDArray[np.float64]
    """Speed of the rope's length [m/s]."""


def durations(points: Float[Array, "point 2"], speed: Float[Array, " 2"]) -> Float[Array, " leg"]:
    """Time that each leg between points [m] takes at the largest speeds of cart and rope [m/s]."""
    return _FASTEST * jnp.max(jnp.abs(jnp.diff(points, axis=0)) / speed[None], axis=1)


def along(
    points: Float[Array, "point 2"], speed: Float[Array, " 2"], rest: Float[Array, ""], times: Float[Array, " time"]
) -> tuple[Float[Array, "time 2"], Float[Array, "time 2"]]:
    """Where a smooth path from point to point is at some times, and how fast; every number may be traced.

    Each leg is the polynomial of degree 5 whose speed and acceleration vanish at both ends (Flash and Hogan 1985);
    cart and rope start and arrive together, as fast as the slower of the two may, and rest after each leg.

    Args:
        points: cart position and rope length [m], the first one where the path begins.
        speed: largest speeds of cart and rope [m/s].
        rest: time at rest after each leg [s].
        times: [s].
    """
    spans = durations(points, speed)
    place = jnp.broadcast_to(points[0], (times.shape[0], 2))
    rate = jnp.zeros_like(place)
    begin = jnp.zeros_like(rest)
    for leg in range(points.shape[0] - 1):
        way, span = (points[leg + 1] - points[leg])[None], jnp.where(spans[leg] > 0, spans[leg], 1.0)
        s = jnp.clip((times - begin) / span, 0.0, 1.0)[:, None]
        place = place + way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        rate = rate + way * 30.0 * s**2 * (1.0 - s) ** 2 / span
        begin = begin + spans[leg] + rest
    return place, rate


def smooth_path(
    points: Sequence[tuple[float, float]], *, speed: tuple[float, float], rest: float, period: float
) -> Path:
    """From point to point with bounded speed, at rest after each: `along`, sampled until the last rest is over.

    Args:
        points: cart position and rope length [m], the first one where the path begins.
        speed: largest speeds of cart and rope [m/s].
        rest: time at rest after each leg [s].
        period: time between entries [s].

    Raises:
        ValueError: there is no leg, a limit or time is not positive, or the path has more than a million entries.
    """
    if len(points) < 2:
        raise ValueError("a path needs at least two points")
    if min(*speed, period) <= 0 or rest < 0:
        raise ValueError("speeds and period must be positive, and the rest not negative")
    places, limits = np.array(points, float), np.array(speed, float)
    total = float(np.sum(np.asarray(durations(jnp.asarray(places), jnp.asarray(limits)))) + rest * (len(points) - 1))
    if not total / period < MOST_ENTRIES:
        raise ValueError(f"the path takes {total:.4g} s, more than {MOST_ENTRIES:,} entries of {period:g} s")
    times = np.arange(int(np.ceil(total / period - 1e-9)) + 1, dtype=np.float64) * period
    place, rate = along(jnp.asarray(places), jnp.asarray(limits), jnp.asarray(float(rest)), jnp.asarray(times))
    return Path(times, *np.asarray(place).T, *np.asarray(rate).T)
