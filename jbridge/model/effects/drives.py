"""Between the commanded input and the motor's force."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..._math import sincos
from ..._types import Scalar
from ..fields import parameter
from .base import (
    AXIS_OF_SITE,
    CART_DRIVE,
    HOIST_DRIVE,
    AbstractDrive,
    AbstractEffect,
    Scene,
    Seed,
    waves,
)

DRIVES = (CART_DRIVE, HOIST_DRIVE)
"""Sites at which a law of a drive may act."""


def largest_input(site: str, scene: Scene) -> float:
    """Returns the largest input of a drive that recordings show [input unit]."""
    name = f"u_{AXIS_OF_SITE[site]}"
    return max(abs(scene.low[name]), abs(scene.high[name]), 1e-6)


class Saturation(AbstractDrive):
    """`clip(u, -limit, limit)`."""

    kind: ClassVar[str] = "saturation"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a limit of the {axis}: larger inputs have no further effect"
    order: ClassVar[int] = 1
    limit: Scalar = parameter("{input}", "largest input that counts", null=1e6, low=0.0)
    site: str = eqx.field(static=True)

    def apply(self, t: Float[Array, "*time"], u: Float[Array, "*time"]) -> Float[Array, "*time"]:
        return jnp.clip(u, -self.limit, self.limit)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        largest = largest_input(site, scene)
        return [Seed({"limit": share * largest}, ("limit",), finite=True) for share in (0.92, 0.75, 0.55)]


class DeadZone(AbstractDrive):
    """`u` minus its clip to [-negative, positive]."""

    kind: ClassVar[str] = "dead_zone"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a dead zone of the {axis}: small inputs do nothing"
    order: ClassVar[int] = 2
    positive: Scalar = parameter("{input}", "width above zero", low=0.0)
    negative: Scalar = parameter("{input}", "width below zero", low=0.0)
    site: str = eqx.field(static=True)

    def apply(self, t: Float[Array, "*time"], u: Float[Array, "*time"]) -> Float[Array, "*time"]:
        # At a zero width the two branches still differ for u > 0 and u < 0, which a clip's gradient would not tell.
        return jnp.where(u > self.positive, u - self.positive, jnp.where(u < -self.negative, u + self.negative, 0.0))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("positive", "negative"))]


class GainAsymmetry(AbstractDrive):
    """Gain `1 + ratio` for positive, `1 - ratio` for negative inputs."""

    kind: ClassVar[str] = "gain_asymmetry"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a {axis} that is stronger in one direction than in the other"
    order: ClassVar[int] = 3
    ratio: Scalar = parameter("1", "half the difference over the mean", low=-1.0, high=1.0)
    site: str = eqx.field(static=True)

    def apply(self, t: Float[Array, "*time"], u: Float[Array, "*time"]) -> Float[Array, "*time"]:
        return u + self.ratio * jnp.abs(u)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("ratio",))]


class GainDrift(AbstractDrive):
    """Gain `1 + rate t`, `t` from the first row that is used: a motor that heats, a supply that sags."""

    kind: ClassVar[str] = "gain_drift"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a {axis} whose strength changes while it runs (heating, sagging supply)"
    order: ClassVar[int] = 4
    in_time: ClassVar[bool] = True
    rate: Scalar = parameter("1/s", "relative change of the gain with time")
    site: str = eqx.field(static=True)

    def apply(self, t: Float[Array, "*time"], u: Float[Array, "*time"]) -> Float[Array, "*time"]:
        return u * (1.0 + self.rate * t)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("rate",))]


class AbstractDelay(AbstractEffect):
    """A time [s] by which a drive answers late. The engine averages its input over a step, which gives the time a
    gradient."""

    sites: ClassVar[tuple[str, ...]] = DRIVES
    delay: eqx.AbstractVar[Scalar]

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # At exactly zero the delayed input has a kink; a microsecond is no delay, and has a tangent.
        return [Seed({"delay": 1e-6}, ("delay",))]


class InputDelay(AbstractDelay):
    """`u(t - delay)`, 0 before the first known row. The engine averages it over a step, which gives it a gradient."""

    kind: ClassVar[str] = "input_delay"
    sentence: ClassVar[str] = "a dead time of the {axis}: it answers late, but then at once"
    delay: Scalar = parameter("s", "dead time", low=0.0)
    site: str = eqx.field(static=True)


class StartDelay(AbstractDelay):
    """`u` once it has been other than zero for `delay`, 0 until then: starts come late, reversals and stops do not.

    A holding brake that has to release and an amplifier that wakes up do that; what the input asked for meanwhile is
    lost. Zero is what saturation, dead zone and gains leave at zero, so that a voltage that was measured, and is never
    quite zero, has starts beside a dead zone alone. (Data sheets of brakes and drives call it the release time.)
    """

    kind: ClassVar[str] = "start_delay"
    sentence: ClassVar[str] = (
        "a {axis} that starts late, as behind a brake that has to release or an amplifier that wakes up"
    )
    delay: Scalar = parameter("s", "time from an input other than zero to its effect", low=0.0)
    site: str = eqx.field(static=True)


class ActuatorLag(AbstractEffect):
    """First order: `time_constant s' = u - s`, solved exactly over a step (`s` is a hidden state); lags of one drive
    act as one of the sum of their time constants."""

    kind: ClassVar[str] = "actuator_lag"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a lag of the {axis}: it answers gradually"
    time_constant: Scalar = parameter("s", "time constant", low=0.0, high=2.0)
    site: str = eqx.field(static=True)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # At exactly zero there is no lag to have a tangent.
        return [Seed({"time_constant": 1e-5}, ("time_constant",))]


class DrumRadiusChange(AbstractEffect):
    """Gain `1 + slope (l - length)`: the rope winds up in layers."""

    kind: ClassVar[str] = "drum_radius_change"
    sites: ClassVar[tuple[str, ...]] = (HOIST_DRIVE,)
    sentence: ClassVar[str] = "a {axis} whose strength changes with the rope's length, as rope layers on the drum do"
    slope: Scalar = parameter("1/m", "relative change of the gain with the length")
    length: Scalar = parameter("m", "reference length", null=float("nan"), fitted=False, default=float("nan"))
    site: str = eqx.field(static=True, default=HOIST_DRIVE)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({"length": scene.length}, ("slope",))]


class TorqueRipple(AbstractEffect):
    """Gain `1 + amplitude sin(2 pi q / period + phase)`, `q` at the motor: poles and commutation, felt under load.

    `periodic_force` is there without an input, too, as cogging is; this one grows with the motor's force (Jahns and
    Soong, Pulsating torque minimization techniques for permanent magnet AC motor drives, 1996). It comes last, behind
    the lag, since the motor's angle changes what its current does.
    """

    kind: ClassVar[str] = "torque_ripple"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a {axis} whose strength repeats with the motor's angle"
    amplitude: Scalar = parameter("1", "relative amplitude", low=-1.0, high=1.0)
    period: Scalar = parameter("{position}", "distance after which it repeats", null=0.1, low=1e-3)
    phase: Scalar = parameter("rad", "phase at the origin")
    site: str = eqx.field(static=True)

    def gain(self, q: Scalar) -> Scalar:
        """Relative gain at the motor's place [m]."""
        sine, _ = sincos(2 * jnp.pi * q / self.period + self.phase)
        return 1.0 + self.amplitude * sine

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return waves(max(scene.span(AXIS_OF_SITE[site]), 1e-2), 40)
