"""Commands and references in time."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


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


def smooth_path(
    points: Sequence[tuple[float, float]],
    *,
    speed: tuple[float, float],
    rest: float,
    period: float,
) -> Path:
    """From point to point with bounded speed, at rest in between.

    Each leg is the polynomial of degree 5 whose speed and acceleration vanish at both ends (Flash and Hogan 1985);
    cart and rope start and arrive together, as fast as the slower of the two may.

    Args:
        points: cart position and rope length [m], the first one where the path begins.
        speed: largest speeds of cart and rope [m/s].
        rest: time at rest after each leg [s].
        period: time between entries [s].

    Raises:
        ValueError: there is no leg, or a limit or time is not positive.
    """
    if len(points) < 2:
        raise ValueError("a path needs at least two points")
    if min(*speed, period) <= 0 or rest < 0:
        raise ValueError("speeds and period must be positive, and the rest not negative")
    places, rates = [np.array([points[0]], float)], [np.zeros((1, 2))]
    for begin, end in zip(points, points[1:], strict=False):
        start, way = np.array(begin, float), np.subtract(end, begin)
        # The polynomial's largest speed is 15/8 of the mean.
        duration = float(np.max(1.875 * np.abs(way) / np.array(speed)))
        count, pause = int(np.ceil(duration / period)), int(round(rest / period))
        if count:
            s = np.arange(1, count + 1)[:, None] / count
            places.append(start + way * s**3 * (10 - 15 * s + 6 * s**2))
            rates.append(way * 30 * s**2 * (1 - s) ** 2 / (count * period))
        places.append(np.repeat([np.array(end, float)], pause, axis=0))
        rates.append(np.zeros((pause, 2)))
    place, rate = np.concatenate(places), np.concatenate(rates)
    times = np.arange(len(place), dtype=np.float64) * period
    return Path(times, place[:, 0], place[:, 1], rate[:, 0], rate[:, 1])
