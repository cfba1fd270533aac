"""Reference trajectories read from TOML, and the reference of the paper."""

import os
from pathlib import Path as FilePath
from typing import Any

from .._toml import Where, read_toml, shown
from ..trajectory import Path, smooth_path

PAPER_POINTS = ((0.0, 0.185), (1.2, 0.6), (0.5, 0.3))
"""The paper's T_z, T_1 and T_2: cart position and rope length [m]."""
SPEED = (0.3, 0.2)
"""Largest speeds of cart and rope where nothing else is said [m/s]; the paper does not give its own."""
REST = 4.0
"""Time at rest after each leg where nothing else is said [s]."""


def paper_path(period: float) -> Path:
    """The paper's reference, at the assumed speeds, with an entry every `period` [s]."""
    return smooth_path(PAPER_POINTS, speed=SPEED, rest=REST, period=period)


def load_reference(path: str | os.PathLike[str], period: float) -> Path:
    """Reads a reference: `points = [[x, l], ...]` [m], and optionally `speed = [x, l]` [m/s] and `rest` [s].

    Args:
        path: of the file.
        period: of the controller's sampling [s].

    Raises:
        InputError: naming the file, the key and what to do.
    """
    document = read_toml(FilePath(path), "reference", "points = [[0.0, 0.185], [1.2, 0.6]]")
    file = Where(str(path))
    file.check_keys(document, ("points", "speed", "rest"), "key")
    points = document.get("points")
    if not isinstance(points, list) or len(points) < 2:
        file.refuse("no points; add at least two, such as points = [[0.0, 0.185], [1.2, 0.6]] (x and l in metres)")
    places = [_pair(file, f"points[{i}]", point) for i, point in enumerate(points)]
    for i, (_, length) in enumerate(places):
        if length <= 0:
            file.refuse(f"points[{i}] has the rope length {length:g}; it must be positive")
    speed = _pair(file, "speed", document.get("speed", list(SPEED)))
    rest = document.get("rest", REST)
    if min(speed) <= 0:
        file.refuse(f"speed = {shown(document['speed'])} is not positive; write it as speed = [0.3, 0.2] (m/s)")
    if isinstance(rest, bool) or not isinstance(rest, int | float) or not 0 <= rest < 1e6:
        file.refuse(f"rest = {shown(rest)} is not a time; write it as rest = 4.0 (s)")
    try:
        return smooth_path(places, speed=speed, rest=float(rest), period=period)
    except ValueError as problem:
        file.refuse(f"{problem}; raise the speed or shorten the rest")


def _pair(file: Where, key: str, value: Any) -> tuple[float, float]:
    if (
        not isinstance(value, list)
        or len(value) != 2
        or any(isinstance(v, bool) or not isinstance(v, int | float) or not abs(v) < 1e6 for v in value)
    ):
        file.refuse(f"{key} = {shown(value)} is not a pair of numbers; write one for the cart and one for the rope")
    return float(value[0]), float(value[1])
