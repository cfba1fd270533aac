"""What a motor and its amplifier make of the input: limits of the force, induced voltage, speed loops."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._types import Scalar
from ..fields import parameter
from .base import (
    AXIS_OF_SITE,
    CART,
    CART_DRIVE,
    HOIST,
    HOIST_DRIVE,
    AbstractEffect,
    Alike,
    Contained,
    Scene,
    Seed,
)
from .drives import DRIVES, ActuatorLag, largest_input

UNLIMITED = 1e6
"""A limit that nothing reaches [N]."""


class ForceLimit(AbstractEffect):
    """Force of the drive, `K (u - k v)`, clipped to [-limit, limit]: the current that the amplifier can give.

    `saturation` limits the input ahead of dead zone, lag and back-EMF; this one limits what comes out. It is absent at
    an infinite limit, has a gradient where recordings reach it, and is one with `saturation` at `limit / K` where
    nothing stands between the two. (Current limits of servo amplifiers: Ellis, Control System Design Guide, 2012,
    chapter 14.)
    """

    kind: ClassVar[str] = "force_limit"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a limit of the {axis}'s force, as of an amplifier's current"
    beside: ClassVar[tuple[str, ...]] = ("actuator_lag", "dead_zone", "back_emf", "freewheeling", "torque_ripple")
    alike: ClassVar[tuple[Alike, ...]] = tuple(
        Alike(
            site,
            "saturation",
            site,
            "recordings of a drive without lag, dead zone, back-EMF or freewheeling",
            "An input that jumps to its limit and back within the drive's lag",
        )
        for site in DRIVES
    )
    limit: Scalar = parameter("N", "largest force of the drive", null=UNLIMITED, low=0.0)
    site: str = eqx.field(static=True)

    def clipped(self, force: Scalar) -> Scalar:
        """The drive's force [N] behind its limit."""
        return jnp.clip(force, -self.limit, self.limit)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        gain = scene.bridge["cart_gain" if site == CART_DRIVE else "hoist_gain"]
        largest = max(abs(gain) * largest_input(site, scene), 1e-6)
        return [Seed({"limit": share * largest}, ("limit",), finite=True) for share in (0.85, 0.6)]


class AbstractInduced(AbstractEffect):
    """A voltage that a motor induces against its input as it turns."""

    constant: eqx.AbstractVar[Scalar]
    """Input that is induced at unit speed."""

    @abc.abstractmethod
    def less(self, commanded: Scalar, v: Scalar, u: Scalar) -> Scalar:
        """What is left of an input `u` [input unit] at a motor's speed [m/s]; `commanded` is the input as it came."""


_COASTING = (
    (CART_DRIVE, "cart_damping", "cart_gain"),
    (HOIST_DRIVE, "hoist_damping", "hoist_gain"),
)


class BackEmf(AbstractInduced):
    """Force `K (u - constant v)` in place of `K u`: a motor fed with a voltage slows itself down as it turns.

    `K constant` adds to the axis' viscous damping, and only where the drive's force is limited, or its gain `K` is
    another one in some recording, do the two differ. At `constant = 0` it is absent and has a gradient. (DC motor with
    a permanent magnet: Krause, Wasynczuk and Sudhoff, Analysis of Electric Machinery, 2002, chapter 2.)
    """

    kind: ClassVar[str] = "back_emf"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a voltage that the {axis}'s motor induces against its input as it turns"
    beside: ClassVar[tuple[str, ...]] = ("force_limit",)
    alike: ClassVar[tuple[Alike, ...]] = tuple(
        Alike(
            site,
            "wrong_value",
            damping,
            "recordings with one gain of the drive and no limit of its force",
            f"A recording that coasts with the motor's circuit open ([override] {gain} = 0 in its sidecar),"
            " or one in which the drive's force reaches its limit",
        )
        for site, damping, gain in _COASTING
    )
    constant: Scalar = parameter("{input}/({speed})", "input that is induced at unit speed", low=0.0)
    site: str = eqx.field(static=True)

    def less(self, commanded: Scalar, v: Scalar, u: Scalar) -> Scalar:
        return u - self.constant * v

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("constant",))]


class Freewheeling(AbstractInduced):
    """Force `K (u - constant v min(|u| / width, 1))`: a motor that an open circuit lets coast at zero input.

    A bridge of transistors whose enable line is pulsed opens the motor's circuit between pulses and at zero input, so
    that the motor brakes itself while it is driven and runs on freely when it is not; the axis' viscous damping is what
    is felt in either case. Up to `width`, pulses are too short for the current to flow from one to the next, and the
    braking grows with them. At `constant = 0` it is absent and has a gradient. (Data sheet of the L298 dual full-bridge
    driver, STMicroelectronics, 2000, figure 6: a low enable line is a free running stop, equal inputs are a fast one.)
    """

    kind: ClassVar[str] = "freewheeling"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a {axis} that coasts where its input is zero, and slows itself down only while it drives"
    alike: ClassVar[tuple[Alike, ...]] = tuple(
        Alike(
            site,
            "wrong_value",
            damping,
            "recordings in which nothing moves while its input is zero",
            "An input that falls to zero at speed",
        )
        for site, damping, _ in _COASTING
    )
    constant: Scalar = parameter("{input}/({speed})", "input that is induced at unit speed while driven", low=0.0)
    width: Scalar = parameter("{input}", "input from which all of it is induced", null=1e-3, low=1e-9)
    site: str = eqx.field(static=True)

    def less(self, commanded: Scalar, v: Scalar, u: Scalar) -> Scalar:
        return u - self.constant * v * jnp.minimum(jnp.abs(commanded) / self.width, 1.0)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        largest = largest_input(site, scene)
        return [
            Seed({"constant": 0.0, "width": share * largest}, ("constant", "width"), linear=("constant",))
            for share in (0.05, 1.0)
        ]


class SpeedDrive(AbstractEffect):
    """Speed loop: force `clip(K s - share R v, -limit, limit)`, with the setpoint `time_constant s' = u - s`.

    The axis' gain `K` [N per input] and damping `R` [N s/m] are those of the loop: without a load the drive holds the
    speed `K/R` per unit of input, and `R` tells how much a force slows it. `share` is the loop's part of the damping;
    the rest stays a friction that the limit does not cut.

    In the limit of a stiff loop recordings determine `K/R`, `time_constant` and `limit`, and of `R` alone that it is
    large. The loop is solved over a whole step in closed form (`speed_loop`), so that no stiffness asks for shorter
    steps; beside a mechanism that parts a drive from its axis it counts as damping does. With an infinite limit it is
    the viscous axis with an `actuator_lag`, which acts on the setpoint alone, too: new are the limit and the stiff
    loop. (Cascaded speed loops of servo drives: Ellis, Control System Design Guide, 2012, chapters 14 and 17.)
    """

    kind: ClassVar[str] = "speed_drive"
    sites: ClassVar[tuple[str, ...]] = DRIVES
    sentence: ClassVar[str] = "a {axis} that holds a speed in proportion to its input, as far as its force goes"
    contains: ClassVar[tuple[Contained, ...]] = (
        Contained(
            "actuator_lag",
            lambda own: {"time_constant": own["time_constant"]},
            lambda law, own: {"time_constant": law["time_constant"], "limit": UNLIMITED},
        ),
    )
    time_constant: Scalar = parameter("s", "time constant of the setpoint", low=0.0, high=2.0)
    limit: Scalar = parameter("N", "largest force of the drive", null=UNLIMITED, low=0.0)
    share: Scalar = parameter(
        "1", "the loop's share of the damping", null=1.0, low=0.0, high=1.0, fitted=False, default=1.0
    )
    site: str = eqx.field(static=True, default=CART_DRIVE)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # The force that the motion shows, not the gain: of a stiff loop nothing but its speed per input is known.
        own, pull = scene.bridge, scene.acceleration[AXIS_OF_SITE[site]]
        if site == CART_DRIVE:
            force = own["cart_mass"] * pull + scene.friction[CART]
        else:
            weight = own["load_mass"] * own["gravity"]
            force = (own["winch_mass"] + own["load_mass"]) * pull + weight + scene.friction[HOIST]
        felt = max(force, 1e-6)
        return [
            Seed({"time_constant": 0.04, "limit": share * felt, "share": 1.0}, ("time_constant", "limit"), finite=True)
            for share in (0.5, 1.0, 2.0)
        ]


LAGS = (ActuatorLag, SpeedDrive)
"""What delays a drive's input gradually, by its `time_constant`."""
