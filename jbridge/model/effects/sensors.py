"""What encoders make of true coordinates, and time stamps of time."""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._types import Scalar
from ..fields import parameter
from .base import (
    AXIS_OF_SITE,
    CLOCK,
    L_SENSOR,
    PSI_SENSOR,
    X_SENSOR,
    AbstractEffect,
    AbstractSensor,
    Alike,
    Scene,
    Seed,
    waves,
)

_SENSORS = (X_SENSOR, PSI_SENSOR, L_SENSOR)
_TIMES = 40
"""Times at which a reading is thought to step."""
_PER_TURN = range(1, 9)
"""How often an angle's error may repeat in a turn: once where the disc is off its centre, twice where it is out of
round, and more often behind a gear."""


class SensorOffset(AbstractSensor):
    """Reading plus `offset`."""

    kind: ClassVar[str] = "sensor_offset"
    sites: ClassVar[tuple[str, ...]] = _SENSORS
    sentence: ClassVar[str] = "a constant error of the {axis}"
    order: ClassVar[int] = 3
    offset: Scalar = parameter("{position}", "error of the reading")
    site: str = eqx.field(static=True)

    def read(
        self, t: Float[Array, " time"], reading: Float[Array, " time"], truth: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        return reading + self.offset

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # Where x is 0 is a matter of choice: only effects of a place depend on it, and their places are estimated.
        return [] if site == X_SENSOR else [Seed({}, ("offset",))]


class SensorScale(AbstractSensor):
    """Reading times `scale`."""

    kind: ClassVar[str] = "sensor_scale"
    sites: ClassVar[tuple[str, ...]] = _SENSORS
    sentence: ClassVar[str] = "a wrong scale of the {axis}"
    alike: ClassVar[tuple[Alike, ...]] = (
        Alike(
            L_SENSOR, "sensor_offset", L_SENSOR, "recordings at one rope length", "Recordings at several rope lengths"
        ),
    )
    order: ClassVar[int] = 2
    scale: Scalar = parameter("1", "reading over truth", null=1.0, low=0.1, high=10.0)
    site: str = eqx.field(static=True)

    def read(
        self, t: Float[Array, " time"], reading: Float[Array, " time"], truth: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        return reading * self.scale

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # A free swing says nothing of its angle's scale. If that is far from 1, all that the cart does to the load is
        # amiss, and the criterion has a minimum near 1, where free swings are met.
        far = (0.3, 3.0) if site == "psi_sensor" else ()
        return [Seed({"scale": 1.0}, ("scale",)), *(Seed({"scale": s}, ("scale",), finite=True) for s in far)]


class SensorEccentricity(AbstractSensor):
    """Reading plus `amplitude sin(2 pi q / period + phase)` of the true coordinate: a wheel off its centre."""

    kind: ClassVar[str] = "sensor_eccentricity"
    sites: ClassVar[tuple[str, ...]] = _SENSORS
    sentence: ClassVar[str] = "an error of the {axis} that repeats with the position, as from an eccentric wheel"
    order: ClassVar[int] = 1
    amplitude: Scalar = parameter("{position}", "amplitude")
    period: Scalar = parameter("{position}", "distance after which it repeats", null=0.1, low=1e-3)
    phase: Scalar = parameter("rad", "phase at the origin")
    site: str = eqx.field(static=True)

    def read(
        self, t: Float[Array, " time"], reading: Float[Array, " time"], truth: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        return reading + self.amplitude * jnp.sin(2 * jnp.pi * truth / self.period + self.phase)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        if site == PSI_SENSOR:
            # Its disc turns with the pivot, or a whole number of times as fast behind a gear.
            free = ("amplitude", "phase")
            return [Seed({"amplitude": 0.0, "period": 2 * math.pi / k, "phase": 0.0}, free) for k in _PER_TURN]
        span = max(scene.span(AXIS_OF_SITE[site]), 1e-2)
        return waves(span, 60)


class MissedCounts(AbstractSensor):
    """The reading steps once by `jump`, at `time` since its run began."""

    kind: ClassVar[str] = "missed_counts"
    sites: ClassVar[tuple[str, ...]] = _SENSORS
    sentence: ClassVar[str] = "a step of the {axis}'s reading, as from lost encoder counts"
    order: ClassVar[int] = 4
    jump: Scalar = parameter("{position}", "size of the step")
    time: Scalar = parameter("s", "when it happens", null=1.0)
    site: str = eqx.field(static=True)

    def read(
        self, t: Float[Array, " time"], reading: Float[Array, " time"], truth: Float[Array, " time"]
    ) -> Float[Array, " time"]:
        # One sample's rise gives the moment a gradient; a step between two samples cannot be timed better anyway.
        # Samples that follow a recording's end take no time.
        period = (t[-1] - t[0]) / jnp.maximum(jnp.sum(jnp.where(t[1:] > t[:-1], 1.0, 0.0)), 1.0)
        return reading + self.jump * jnp.clip((t - self.time) / jnp.maximum(period, 1e-6) + 0.5, 0.0, 1.0)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # What happens in a recording's first or last moments is its start's or nobody's.
        shares = [0.05 + 0.9 * i / (_TIMES - 1) for i in range(_TIMES)]
        times = [time for run in scene.moments(shares) for time in run]
        return [Seed({"jump": 0.0, "time": time}, ("jump", "time"), linear=("jump",)) for time in times]


class SensorDelay(AbstractEffect):
    """The reading is late by `delay`; the engine interpolates the motion."""

    kind: ClassVar[str] = "sensor_delay"
    sites: ClassVar[tuple[str, ...]] = _SENSORS
    sentence: ClassVar[str] = "a delay of the {axis}: it reports late"
    delay: Scalar = parameter("s", "how late the reading is", low=0.0)
    site: str = eqx.field(static=True)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # At exactly zero the interpolation has a kink; a microsecond is no delay, and has a tangent.
        return [Seed({"delay": 1e-6}, ("delay",))]


class ClockScale(AbstractEffect):
    """`scale` seconds pass in a second by the time stamps: a timer's wrong divider, a sample time that is not kept.

    Of a cart or a winch alone, gains and dampings in proportion look the same; only the swing, whose period gravity and
    the rope's length set, tells. Other numbers of a model with this effect are by true time.
    """

    kind: ClassVar[str] = "clock_scale"
    sites: ClassVar[tuple[str, ...]] = (CLOCK,)
    sentence: ClassVar[str] = "a {axis} that runs fast or slow"
    alike: ClassVar[tuple[Alike, ...]] = (
        Alike(CLOCK, "sensor_scale", L_SENSOR, "free swings of a held cart", "Swings that the cart's motion drives"),
        Alike(
            CLOCK,
            "sensor_offset",
            L_SENSOR,
            "swings at one rope length",
            "Swings at several rope lengths, or a minute of recording beside a stopwatch",
        ),
    )
    scale: Scalar = parameter("1", "true time over recorded time", null=1.0, low=0.5, high=2.0)
    site: str = eqx.field(static=True, default=CLOCK)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({"scale": 1.0}, ("scale",))]
