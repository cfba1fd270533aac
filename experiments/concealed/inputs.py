"""What the operator of the concealed rig does: a hand on two knobs, sums of sines, or a sampled controller.

A hand looks where the cart and the hook are and turns before the end of the rail, as a person would, so
recordings are open loop on every time scale that matters and yet stay on the rail. All voltages are rounded
to 0.1 mV, which is what is logged.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

PERIOD = 0.02
"""Period of the controller [s]."""


@dataclasses.dataclass
class Hand:
    """One axis driven by hand, in one of several styles, between two limits.

    Args:
        style: "steps", "ramps", "pulses", "staircase", "creep" or "mixed" (one of them anew for each move).
        low, high: where the hand turns round [m].
        volts: smallest and largest voltage of a move [V].
        creep: voltages around breakaway, for the style "creep" [V].
        speed: expected speed per direction, a function of (voltage, direction) [m/s].
        hold: voltage at rest [V].
        busy: share of moves among moves and rests.
    """

    key: np.random.Generator
    style: str
    low: float
    high: float
    volts: tuple[float, float]
    creep: tuple[float, float]
    speed: Callable[[float, float], float]
    hold: float = 0.0
    busy: float = 0.7

    def __post_init__(self):
        self.start = self.until = 0.0
        self.level, self.shape = 0.0, "steps"

    def _draw(self, t: float, place: float) -> None:
        """The next move or rest."""
        key = self.key
        self.start = t
        style = key.choice(["steps", "ramps", "pulses", "staircase", "creep"]) if self.style == "mixed" else self.style
        self.shape = str(style)
        if key.random() > self.busy:
            self.level, self.until = 0.0, t + key.uniform(0.15, 0.6)
            return
        share = (place - self.low) / (self.high - self.low)
        direction = 1.0 if key.random() > np.clip(0.5 + 1.2 * (share - 0.5), 0.05, 0.95) else -1.0
        level = key.uniform(*(self.creep if style == "creep" else self.volts))
        room = self.high - place if direction > 0 else place - self.low
        longest = room / max(self.speed(level, direction), 1e-2)
        wanted = key.uniform(0.12, 0.35) if style == "pulses" else key.uniform(0.3, 1.4)
        self.level, self.until = direction * level, t + min(wanted, max(longest, 0.1))

    def __call__(self, t: float, place: float) -> float:
        """Voltage at time `t` [s] with the axis at `place` [m]."""
        if t >= self.until - 1e-9:
            self._draw(t, place)
        outwards = self.level > 0 and place > self.high or self.level < 0 and place < self.low
        if outwards:
            self.level, self.start, self.until = 0.0, t, t + 0.2
        share = (t - self.start) / max(self.until - self.start, 1e-6)
        if self.shape == "ramps":
            factor = 1.0 - abs(2 * share - 1.0)
        elif self.shape == "staircase":
            factor = (1.0, 0.6, 0.8, 0.4)[min(int(4 * share), 3)]
        else:
            factor = 1.0
        return self.hold + self.level * factor if self.level else self.hold


class Sines:
    """One axis driven by a sum of sines; every half second the knob's centre is nudged towards the middle.

    Args:
        middle: where the axis is nudged to [m].
        volts: amplitude of the largest sine [V].
        nudge: voltage per metre away from the middle [V/m].
    """

    def __init__(self, key, middle, volts, nudge, hold=0.0, limit=1.0):
        self.middle, self.nudge, self.hold, self.limit = middle, nudge, hold, limit
        self.waves = [
            (volts * key.uniform(0.5, 1.0) / math.sqrt(i + 1), key.uniform(a, b), key.uniform(0, 2 * math.pi))
            for i, (a, b) in enumerate(((0.25, 0.4), (0.4, 0.7), (0.7, 1.1), (1.1, 1.9)))
        ]
        self.next, self.centre = 0.0, 0.0

    def __call__(self, t: float, place: float) -> float:
        if t >= self.next - 1e-9:
            self.next += 0.5
            self.centre = float(np.clip(self.nudge * (self.middle - place), -self.limit, self.limit))
        return self.hold + self.centre + sum(a * math.sin(2 * math.pi * f * t + p) for a, f, p in self.waves)


class Rest:
    """A knob nobody touches."""

    def __call__(self, t: float, place: float) -> float:
        return 0.0


class Operator:
    """Both knobs by hand: open loop."""

    def __init__(self, cart, hoist):
        self.cart, self.hoist = cart, hoist

    def __call__(self, t: float, reading: dict[str, float]) -> tuple[float, float]:
        return round(self.cart(t, reading["x"]), 4), round(self.hoist(t, reading["l"]), 4)


class Controller:
    """Closed loop: a sampled PD controller on the readings, with swing feedback and a dithering reference.

    Args:
        kind: "steps" (references jump) or "sines" (references wander smoothly).
        places, lengths: ranges of the two references [m].
        limits: largest voltages of cart and hoist [V].
    """

    def __init__(self, key, kind, places, lengths, limits, hold=0.0):
        self.key, self.kind, self.limits, self.hold = key, kind, limits, hold
        self.gains = {"cart": (key.uniform(16, 26), key.uniform(1.5, 4)), "hoist": (key.uniform(25, 40), 1.0)}
        self.ranges = {"x": places, "l": lengths}
        self.next = dict.fromkeys(self.ranges, 0.0)
        self.reference = {c: 0.5 * (a + b) for c, (a, b) in self.ranges.items()}
        self.waves = {c: [(key.uniform(0.1, 0.5), key.uniform(0, 6.28)) for _ in range(3)] for c in self.ranges}
        self.dither = [(key.uniform(0.8, 3.0), key.uniform(0, 6.28)) for _ in range(3)]
        self.before: dict[str, float] | None = None
        self.due, self.out = 0.0, (0.0, 0.0)

    def _aim(self, channel: str, t: float) -> float:
        low, high = self.ranges[channel]
        if self.kind == "sines":
            wave = sum(math.sin(2 * math.pi * f * t + p) for f, p in self.waves[channel]) / 3
            return 0.5 * (low + high) + 0.5 * (high - low) * wave
        if t >= self.next[channel]:
            self.next[channel] = t + self.key.uniform(1.2, 3.0)
            self.reference[channel] = self.key.uniform(low, high)
        return self.reference[channel]

    def __call__(self, t: float, reading: dict[str, float]) -> tuple[float, float]:
        if t < self.due - 1e-9:
            return self.out
        self.due += PERIOD
        before = self.before or reading
        self.before = dict(reading)
        ripple = sum(math.sin(2 * math.pi * f * t + p) for f, p in self.dither)
        volts = []
        for axis, channel, dither in (("cart", "x", 0.012), ("hoist", "l", 0.006)):
            gain, damping = self.gains[axis]
            rate = (reading[channel] - before[channel]) / PERIOD
            error = self._aim(channel, t) + dither * ripple - reading[channel]
            volts.append(gain * error - damping * rate)
        volts[0] += 2.0 * reading["psi"]
        volts[1] += self.hold
        self.out = tuple(round(float(np.clip(u, -m, m)), 4) for u, m in zip(volts, self.limits, strict=True))
        return self.out
