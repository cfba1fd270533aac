"""Input shaping: a reference split into impulses that cancel the swing they cause (Singer and Seering 1990)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._toml import Where, as_value, number, positive, word
from ..trajectory import Path

KINDS = ("zv", "zvd")
SLOWEST = 0.01
"""Swing [rad/s] that is slower than any: on a rope of 100 km."""


@dataclass(frozen=True)
class Shaping:
    """What a controller does to its reference before it follows it; see `shaped`."""

    kind: str
    """`zv` or `zvd`."""
    frequency: float
    """Of the swing that is cancelled [rad/s]."""
    damping: float = 0.0
    """Damping ratio of that swing [1]."""

    def impulses(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the impulses into which a change of the reference is split [1], and their delays [s].

        Raises:
            ValueError: the kind is neither `zv` nor `zvd`, or there is no such swing.
        """
        if self.kind not in KINDS:
            raise ValueError(f"{self.kind!r} is neither of {', '.join(KINDS)}")
        if not (SLOWEST <= self.frequency < np.inf and 0.0 <= self.damping < 1.0):
            raise ValueError(
                f"a swing of {self.frequency:g} rad/s with a damping ratio of {self.damping:g}: give at least"
                f" {SLOWEST:g} rad/s, and a ratio from 0 to below 1"
            )
        root = np.sqrt(1.0 - self.damping**2)
        ratio = np.exp(-self.damping * np.pi / root)
        weights = np.array([1.0, ratio] if self.kind == "zv" else [1.0, 2.0 * ratio, ratio**2])
        return weights / weights.sum(), np.arange(len(weights)) * np.pi / (self.frequency * root)

    def __call__(self, path: Path) -> Path:
        """The reference as the controller follows it."""
        return shaped(path, self.frequency, self.damping, self.kind)


def read_shaping(file: Where, table: Any) -> Shaping | None:
    """The table [shaping] of a controller's file, if there is one.

    Raises:
        InputError: naming the key and what to do.
    """
    if table is None:
        return None
    if not isinstance(table, Mapping):
        file.refuse('shaping is not a table; write [shaping] with kind = "zvd" and frequency = 4.4 (rad/s)')
    where = file.within("[shaping]")
    where.check_keys(table, ("kind", "frequency", "damping"), "key")
    if "frequency" not in table:
        where.refuse("no frequency; add frequency = 4.4, that of the free swing in rad/s, sqrt(9.81 / length)")
    damping = number(where, table, "damping", 0.0)
    if not 0.0 <= damping < 1.0:
        where.refuse(f"damping = {damping:g} is no damping ratio; write it as damping = 0.0 (below 1)")
    kind = word(where, "kind", table.get("kind"), KINDS)
    frequency = positive(where, table, "frequency", 4.4)
    if frequency < SLOWEST:
        where.refuse(f"frequency = {frequency:g} rad/s is slower than any swing; write it as frequency = 4.4")
    return Shaping(kind, frequency, damping)


def shaping_lines(shaping: Shaping | None) -> list[str]:
    """The table's lines, from which `read_shaping` reads the same."""
    if shaping is None:
        return []
    keys = ("kind", "frequency", "damping")
    return ["", "[shaping]", *(f"{key} = {as_value(getattr(shaping, key))}" for key in keys)]


def shaped(path: Path, frequency: float, damping: float = 0.0, kind: str = "zvd") -> Path:
    """The same path with the cart's reference shaped, longer by half a period of the swing (`zv`) or a whole one.

    Args:
        path: at equally spaced times.
        frequency: of the free swing [rad/s], `sqrt(g / l)` on a rope of length `l`.
        damping: damping ratio of the swing [1].
        kind: `zv` leaves no swing if the frequency is right; `zvd` little even if it is not quite.

    Raises:
        ValueError: the kind is neither.
    """
    weights, delays = Shaping(kind, frequency, damping).impulses()
    period = float(path.times[1] - path.times[0])
    extra = int(np.ceil(delays[-1] / period))
    times = path.times[0] + period * np.arange(len(path.times) + extra)

    def late(values: np.ndarray, after: float) -> np.ndarray:
        return np.interp(times - after, path.times, values)

    x, v_x = (
        sum(weight * late(values, delay) for weight, delay in zip(weights, delays, strict=True))
        for values in (path.x, path.v_x)
    )
    return Path(times, x, late(path.l, 0.0), v_x, late(path.v_l, 0.0))
