"""Sensors of the concealed rig: encoders with counts and noise, and what can be wrong with them.

A reading is the true coordinate, late if there is a delay, then scaled, shifted or rippled, then noisy,
then rounded to counts. Rounding to steps of h adds h^2/12 of variance; the Gaussian part fills up to the
total (0.04 mm, 0.64 mrad).
"""

import math

import numpy as np

from effects import Effect

RESOLUTION = {"x": 1e-4, "psi": 2 * math.pi / 4096, "l": 1e-4}
"""Encoder counts [m, rad, m]."""
NOISE = {"x": 4.0e-5, "psi": 6.4e-4, "l": 4.0e-5}
"""Total noise of a reading, rounding included, root mean square [m, rad, m]."""


def quantise(value: float, step: float) -> float:
    """The nearest multiple of `step`."""
    return step * round(value / step)


def gaussian_share(channel: str, total: float | None = None) -> float:
    """Standard deviation to add before rounding, so that the sum has the wanted total."""
    total = NOISE[channel] if total is None else total
    return math.sqrt(total**2 - RESOLUTION[channel] ** 2 / 12)


class Sensor:
    """One channel.

    Args:
        channel: "x", "psi" or "l".
        effects: the effects at this sensor's site.
        samples: how many readings will be taken.
        noise: optional `{"total": rms, "correlation": seconds}`, else white noise of the usual size.
        key: the noise's own random generator.
    """

    def __init__(
        self,
        channel: str,
        effects: list[Effect],
        samples: int,
        sample: float,
        noise: dict,
        key: np.random.Generator,
    ):
        self.step = RESOLUTION[channel]
        self.effects = effects
        self.delay = sum(e["delay"] for e in effects if e["kind"] == "sensor_delay")
        white = key.standard_normal(samples)
        keep = math.exp(-sample / noise["correlation"]) if noise.get("correlation") else 0.0
        fresh, level = math.sqrt(1 - keep**2), 0.0
        self.noise = []
        for k, draw in enumerate(white):
            level = draw if k == 0 else keep * level + fresh * draw
            self.noise.append(level * gaussian_share(channel, noise.get("total")))

    def distort(self, t: float, true: float) -> float:
        """What a perfect encoder with this sensor's faults shows at `t` [s]; delay is the rig's business."""
        reading = true
        for e in self.effects:
            match e["kind"]:
                case "sensor_offset":
                    reading += e["offset"]
                case "sensor_scale":
                    reading *= e["scale"]
                case "missed_counts":
                    reading += e["jump"] if t >= e["time"] else 0.0
                case "sensor_eccentricity":
                    reading += e["amplitude"] * math.sin(2 * math.pi * true / e["period"] + e["phase"])
        return reading

    def read(self, k: int, t: float, true: float) -> float:
        """Reading number `k`, at time `t` [s]: with noise, in counts."""
        return quantise(self.distort(t, true) + self.noise[k], self.step)
