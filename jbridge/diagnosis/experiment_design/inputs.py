"""Inputs from which an experiment is chosen: forms of voltage over time, each with a size and a period.

The forms are those that tell mechanisms apart by construction: creeping reversals (play or presliding), one voltage
both ways (Coulomb friction or an offset), staircases and ramps from rest (a dead zone or stiction), pulses with rests
between them (what acts while the motor does not), moves after which the load swings freely (damping and drag), sums
of sines (delays, lags, compliances), and steps of the rope's length in between (what depends on the length).
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from .limits import Reach, Volts

Form = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""From time over period to a share of the size, -1 to 1."""


def _held(*levels: float) -> Form:
    """Levels held one after the other for equal parts of the period."""
    table = np.array(levels, dtype=np.float64)
    return lambda phase: table[(np.floor(phase % 1.0 * len(table) + 1e-9)).astype(int) % len(table)]


def _ramps(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Up, down through zero, and back."""
    return 1.0 - np.abs((4.0 * phase - 1.0) % 4.0 - 2.0)


def _sines(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Five sines, the slowest the largest; what they move starts in the middle."""
    waves = [(1.0, 0.55, 0.0), (2.3, 0.2, 0.0), (5.1, 0.12, 0.0), (9.7, 0.08, 0.0), (17.0, 0.05, 0.0)]
    return sum((a * np.cos(2 * np.pi * f * phase + p) for f, a, p in waves), np.zeros_like(phase))


FORMS: dict[str, tuple[str, Form, float]] = {
    "square": ("constant voltages both ways", _held(1.0, -1.0, -1.0, 1.0), 0.5),
    "pulses": ("pulses both ways with rests between", _held(1.0, 0.0, -1.0, 0.0), 0.25),
    "stairs": ("staircases of voltage both ways", _held(0.25, 0.5, 0.75, 1.0, -0.25, -0.5, -0.75, -1.0), 0.2),
    "ramps": ("slow ramps of voltage both ways", _ramps, 0.35),
    "sines": ("a sum of sines", _sines, 0.4),
    "moves": ("moves with long rests", _held(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0), 0.25),
}
"""By name: what it is called, the form, and where in the range it starts, as a share, so that it stays inside."""


@dataclasses.dataclass(frozen=True)
class Wave:
    """One drive's input over time."""

    form: str
    size: float
    """0 is what just sets the axis in motion, 1 the largest voltage recorded; below 0 a share less than the former."""
    period: float
    """[s]"""

    def volts(self, times: NDArray[np.float64], drive: Volts) -> NDArray[np.float64]:
        """Input at every time, within what was recorded."""
        share = FORMS[self.form][1](times / self.period)
        tops = [drive.least[k] + self.size * (drive.most[k] - drive.least[k]) for k in range(2)]
        if self.size < 0:
            tops = [drive.rest + (1.0 + self.size) * (drive.least[k] - drive.rest) for k in range(2)]
        u = drive.rest + np.where(share > 0, share * (tops[0] - drive.rest), -share * (tops[1] - drive.rest))
        # Rounded towards nothing, so that nothing is exceeded.
        return np.asarray(np.trunc(np.clip(u, drive.most[1], drive.most[0]) * 1e4) / 1e4, dtype=np.float64)


@dataclasses.dataclass(frozen=True)
class Play:
    """Inputs of all drives, and where they start."""

    waves: Mapping[str, Wave]
    """By input; a drive that is not named rests."""
    start: Mapping[str, float]

    @property
    def words(self) -> str:
        """What it is, for whoever plays it."""
        parts = []
        for name, wave in self.waves.items():
            creep = ", creeping" if wave.size <= 0.15 else ""
            axis = "cart" if name == "u_x" else "hoist"
            parts.append(f"{FORMS[wave.form][0]} for the {axis} drive{creep} (period {wave.period:.3g} s)")
        return " and ".join(parts)


def library(reach: Reach, axes: set[str]) -> list[Play]:
    """Inputs worth a try.

    Args:
        reach: room.
        axes: that the rivals are about; `x` calls for the cart's drive, `l` for the hoist's, `psi` for both.
    """
    cart = _waves(reach, "u_x", "x")
    hoist = _waves(reach, "u_l", "l")
    plays = []
    if cart and (axes & {"x", "psi"} or not hoist):
        plays += [{"u_x": wave} for wave in cart]
    if hoist and ("l" in axes or not cart):
        plays += [{"u_l": wave} for wave in hoist]
    if hoist and cart and axes != {"x"}:
        # The load swings at several lengths.
        plays += [{"u_x": a, "u_l": b} for a in cart[-4:] for b in hoist[-2:]]
    return [Play(waves, start_of(reach, waves)) for waves in plays]


def variants(play: Play, reach: Reach) -> list[Play]:
    """The same with other sizes and periods."""
    found = []
    for size, period in ((0.15, 1.0), (-0.15, 1.0), (0.0, 0.7), (0.0, 1.4), (0.1, 0.7), (-0.1, 1.4)):
        waves = {
            name: dataclasses.replace(w, size=float(np.clip(w.size + size, -0.3, 1.0)), period=w.period * period)
            for name, w in play.waves.items()
        }
        found.append(Play(waves, play.start))
    return found


def start_of(reach: Reach, waves: Mapping[str, Wave]) -> dict[str, float]:
    """Where to begin so that the input stays inside, in the middle of what is not driven."""
    start = {axis: 0.5 * (reach.low[axis] + reach.high[axis]) for axis in ("x", "l")} | {"psi": 0.0}
    for name, axis in (("u_x", "x"), ("u_l", "l")):
        if name in waves:
            share = FORMS[waves[name].form][2]
            start[axis] = reach.low[axis] + share * (reach.high[axis] - reach.low[axis])
    return {axis: float(np.round(value, 3)) for axis, value in start.items()}


def _waves(reach: Reach, name: str, axis: str) -> list[Wave]:
    """Inputs of one drive, the creeping ones first."""
    if name not in reach.drives:
        return []
    span = reach.high[axis] - reach.low[axis]
    out = []
    for form, sizes in (
        ("square", (0.05, 0.15)),
        ("ramps", (0.1, 0.3)),
        ("pulses", (0.1, 0.3)),
        ("stairs", (0.2, 0.5, 0.9)),
        ("square", (0.4, 0.9)),
        ("ramps", (0.9,)),
        ("sines", (0.4, 0.9)),
        ("pulses", (0.6, 0.9)),
        ("moves", (0.4, 0.9)),
    ):
        for size in sizes:
            speed = max(size, 0.04) * max(reach.speed[axis], 1e-3)
            # Half of the range is crossed while the voltage has one sign, on average at half of its largest value.
            longest = span / speed
            for share in (1.0, 0.4):
                period = float(np.clip(share * longest, 0.4, reach.seconds))
                wave = Wave(form, size, float(np.round(period, 2)))
                if wave not in out:
                    out.append(wave)
    return out
