"""Effects with a hidden coordinate: something between motor and load that gives or has play."""

import math
from typing import ClassVar

import equinox as eqx

from ..._types import Scalar
from ..fields import option, parameter
from .base import CART, HOIST, SWING, AbstractMechanism, Scene, Seed


class RopeElasticity(AbstractMechanism):
    """A longitudinal spring and damper in the rope; `l` stays the unstretched length that is paid out."""

    kind: ClassVar[str] = "rope_elasticity"
    sites: ClassVar[tuple[str, ...]] = (HOIST,)
    sentence: ClassVar[str] = "a rope that stretches under the load"
    stiffness: Scalar = parameter("N/m", "longitudinal stiffness", null=1e4, low=1.0, high=1e9, reciprocal=True)
    damping: Scalar = parameter("N s/m", "longitudinal damping", null=5.0, low=0.0)
    site: str = eqx.field(static=True, default=HOIST)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        weight = scene.bridge["load_mass"] * scene.bridge["gravity"]
        return [
            Seed({"stiffness": weight / stretch, "damping": 0.3}, ("stiffness", "damping"), finite=True)
            for stretch in (0.003, 0.02)
        ]


class DoublePendulum(AbstractMechanism):
    """The load hangs `link` below a hook at `l`; `load_mass` is the sum and `psi` the upper angle."""

    kind: ClassVar[str] = "double_pendulum"
    sites: ClassVar[tuple[str, ...]] = (SWING,)
    sentence: ClassVar[str] = "a load that swings below its hook (double pendulum)"
    hook_mass: Scalar = parameter("kg", "mass at the rope's end", null=0.05, low=1e-3)
    link: Scalar = parameter("m", "distance from hook to load", null=0.1, low=5e-3)
    damping: Scalar = parameter("N m s", "damping between the two angles", null=1e-4, low=0.0)
    site: str = eqx.field(static=True, default=SWING)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        mass = scene.bridge["load_mass"]
        return [
            Seed(
                {"hook_mass": share * mass, "link": link, "damping": 1e-4},
                ("hook_mass", "link", "damping"),
                finite=True,
            )
            for share, link in ((0.35, 0.015), (0.35, 0.06), (0.35, 0.18))
        ]


class BeltCompliance(AbstractMechanism):
    """Motor - spring - cart; `cart_mass` is the sum, friction and damping act at the motor."""

    kind: ClassVar[str] = "belt_compliance"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "a belt that gives between motor and cart"
    stiffness: Scalar = parameter("N/m", "stiffness", null=1e4, low=10.0, high=1e9, reciprocal=True)
    damping: Scalar = parameter("N s/m", "damping", null=10.0, low=0.0)
    motor_mass: Scalar = parameter("kg", "motor's inertia seen along the belt", null=1.0, low=1e-2)
    site: str = eqx.field(static=True, default=CART)
    encoder: Scalar = option("cart", ("cart", "motor"))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        half = 0.5 * scene.bridge["cart_mass"]
        # Of the cart on its belt [rad/s], as far as the sampling shows them: a fit finds a frequency from within a
        # factor of about two.
        rates = [rate for rate in (19.0, 47.0, 117.0, 290.0) if rate * scene.period < math.pi]
        return [
            Seed(
                {"stiffness": half * rate**2, "damping": 2.0 * half, "motor_mass": half, "encoder": encoder},
                ("stiffness", "damping", "motor_mass"),
                finite=True,
            )
            for encoder in ("cart", "motor")
            for rate in rates
        ]


class Backlash(AbstractMechanism):
    """Free play `gap` in total between motor and cart, inelastic contact; friction and damping act at the motor."""

    kind: ClassVar[str] = "backlash"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "play between motor and cart (backlash)"
    gap: Scalar = parameter("m", "total free play", null=1e-3, low=1e-6)
    motor_mass: Scalar = parameter("kg", "motor's inertia seen along the belt", null=1.0, low=1e-2)
    site: str = eqx.field(static=True, default=CART)
    encoder: Scalar = option("cart", ("cart", "motor"))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        mass = scene.bridge["cart_mass"]
        return [
            Seed(
                {"gap": gap, "motor_mass": 0.2 * mass, "encoder": encoder},
                ("gap", "motor_mass"),
                finite=True,
            )
            for encoder in ("cart", "motor")
            for gap in (2e-4, 7e-4, 3e-3)
        ]


class HoistBacklash(AbstractMechanism):
    """Free play `gap` in total between the winch's motor and its drum, inelastic contact; friction acts at the motor.

    `l` is the length that the motor pays out; the load hangs at most `gap/2` below or above it, and at rest below.
    `winch_mass` is the sum of motor and drum. The load's weight keeps the play closed unless the motor pays out faster
    than the load falls, or the swing throws the load up.
    """

    kind: ClassVar[str] = "hoist_backlash"
    sites: ClassVar[tuple[str, ...]] = (HOIST,)
    sentence: ClassVar[str] = "play between the winch's motor and its drum (backlash)"
    gap: Scalar = parameter("m", "total free play", null=1e-3, low=1e-6)
    motor_mass: Scalar = parameter("kg", "motor's inertia seen along the rope", null=0.05, low=1e-3)
    site: str = eqx.field(static=True, default=HOIST)
    encoder: Scalar = option("motor", ("motor", "drum"))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        mass = 0.5 * scene.bridge["winch_mass"]
        return [
            Seed({"gap": gap, "motor_mass": mass, "encoder": encoder}, ("gap", "motor_mass"), finite=True)
            for encoder in ("motor", "drum")
            for gap in (1e-3, 5e-3)
        ]
