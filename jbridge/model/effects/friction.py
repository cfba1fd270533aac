"""Dry friction: how large it is, by place, direction, velocity, load and time. How it sticks is the engine's affair.

Beside a plain Coulomb friction on the same axis the level common to both would be counted twice. A seed therefore
frees only what an added law has of its own, and `diagnose` keeps the smallest added level at zero.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._math import decay
from ..._types import Scalar
from ..fields import parameter
from .base import (
    AXIS_OF_SITE,
    CART,
    HOIST,
    MAP_KNOTS,
    SWING,
    AbstractFriction,
    AbstractHysteresis,
    Alike,
    Contained,
    Scene,
    Seed,
    interpolate,
    uniform_knots,
)


class CoulombFriction(AbstractFriction):
    """`-level sign(v)`, and holds when stuck."""

    kind: ClassVar[str] = "coulomb_friction"
    sites: ClassVar[tuple[str, ...]] = (CART, SWING, HOIST)
    sentence: ClassVar[str] = "dry friction of constant size on the {axis}"
    level: Scalar = parameter("{force}", "sliding and holding level", low=0.0)
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        return self.level, self.level

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({"level": 0.0}, ("level",))]


class StribeckFriction(AbstractFriction):
    """`-(level + max(breakaway - level, 0) exp(-(v/velocity)^2)) sign(v)`: breaking away costs more than sliding."""

    kind: ClassVar[str] = "stribeck_friction"
    sites: ClassVar[tuple[str, ...]] = (CART, SWING, HOIST)
    sentence: ClassVar[str] = "dry friction of the {axis} that is larger at rest and in slow motion (stiction)"
    level: Scalar = parameter("{force}", "sliding level", low=0.0)
    breakaway: Scalar = parameter("{force}", "level at rest, not below the sliding level", low=0.0)
    velocity: Scalar = parameter("{speed}", "velocity over which the extra fades", null=0.05, low=1e-4)
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        ratio = v / self.velocity
        # Friction that grows with speed is damping, and is called so.
        size = self.level + jnp.maximum(self.breakaway - self.level, 0.0) * jnp.exp(-ratio * ratio)
        return size, size

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        speed = max(scene.speed[AXIS_OF_SITE[site]], 1e-3)
        # Beside a Coulomb friction the sliding level is the Coulomb friction's, and only the extra is new.
        free = ("breakaway", "velocity") if scene.friction[site] > 0 else ("level", "breakaway", "velocity")
        return [Seed({"level": 0.0, "breakaway": 0.0, "velocity": share * speed}, free) for share in (0.02, 0.08, 0.3)]


class DirectionDependentFriction(AbstractFriction):
    """Coulomb friction with one level for `v > 0` and another for `v < 0`."""

    kind: ClassVar[str] = "direction_dependent_friction"
    sites: ClassVar[tuple[str, ...]] = (CART, HOIST)
    sentence: ClassVar[str] = "dry friction of the {axis} that differs between the two directions of motion"
    positive: Scalar = parameter("{force}", "level against positive motion", low=0.0)
    negative: Scalar = parameter("{force}", "level against negative motion", low=0.0)
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        return self.positive, self.negative

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        if scene.friction[site] > 0:
            return [Seed({}, ("positive",)), Seed({}, ("negative",))]
        return [Seed({}, ("positive", "negative"))]


class PositionDependentFriction(AbstractFriction):
    """Coulomb friction whose level is piecewise linear in the axis' coordinate."""

    kind: ClassVar[str] = "position_dependent_friction"
    sites: ClassVar[tuple[str, ...]] = (CART, HOIST)
    sentence: ClassVar[str] = "dry friction of the {axis} that changes from place to place"
    contains: ClassVar[tuple[Contained, ...]] = (
        Contained(
            "coulomb_friction",
            lambda own: {"level": np.mean(own["levels"])},
            lambda law, own: {"levels": law["level"]},
        ),
        # No limit of a map, but a law that a map is easily taken for where each part of the rail has its direction.
        Contained(
            "direction_dependent_friction",
            lambda own: {"positive": np.mean(own["levels"]), "negative": np.mean(own["levels"])},
            lambda law, own: {"levels": 0.5 * (law["positive"] + law["negative"])},
        ),
    )
    knots: Float[Array, " knot"] = parameter("{position}", "places", fitted=False, vector=True)
    levels_at: Float[Array, " knot"] = parameter("{force}", "level at each knot", low=0.0, vector=True, key="levels")
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        size = interpolate(self.knots, self.levels_at, q)
        return size, size

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        knots = uniform_knots(scene, AXIS_OF_SITE[site], MAP_KNOTS)
        return [Seed({"knots": knots, "levels": [0.0] * MAP_KNOTS}, ("levels",))]


class PositionDirectionFriction(AbstractFriction):
    """Coulomb friction by place and by direction: the paper's lookup tables (section 3.1)."""

    kind: ClassVar[str] = "position_direction_friction"
    sites: ClassVar[tuple[str, ...]] = (CART, HOIST)
    sentence: ClassVar[str] = "dry friction of the {axis} that changes from place to place and with direction"
    contains: ClassVar[tuple[Contained, ...]] = (
        Contained(
            "coulomb_friction",
            lambda own: {"level": np.mean([own["positive"], own["negative"]])},
            lambda law, own: {"positive": law["level"], "negative": law["level"]},
        ),
        Contained(
            "direction_dependent_friction",
            lambda own: {"positive": np.mean(own["positive"]), "negative": np.mean(own["negative"])},
            lambda law, own: law,
        ),
    )
    knots: Float[Array, " knot"] = parameter("{position}", "places", fitted=False, vector=True)
    positive: Float[Array, " knot"] = parameter("{force}", "level against positive motion", low=0.0, vector=True)
    negative: Float[Array, " knot"] = parameter("{force}", "level against negative motion", low=0.0, vector=True)
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        return interpolate(self.knots, self.positive, q), interpolate(self.knots, self.negative, q)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        knots = uniform_knots(scene, AXIS_OF_SITE[site], MAP_KNOTS)
        null = [0.0] * MAP_KNOTS
        return [Seed({"knots": knots, "positive": null, "negative": null}, ("positive", "negative"))]


class LoadDependentFriction(AbstractFriction):
    """`-(level + share |load|) sign(v)`, and holds when stuck; `load` is the drive's force or the pull on the pivot.

    At cart and hoist the load is the force of the motor, which presses gears and guides together; at the swing it is
    the force with which load and rod hang on the pivot, `m2 (g cos psi + l psi'^2)`, and `share` is the bearing's
    radius times its coefficient of friction. The reaction to accelerations of cart and winch, small beside it, is left
    out. Duclusaud et al. (Extended friction models for the physics simulation of servo actuators, 2024) identify it for
    geared motors.
    """

    kind: ClassVar[str] = "load_dependent_friction"
    sites: ClassVar[tuple[str, ...]] = (CART, SWING, HOIST)
    sentence: ClassVar[str] = "dry friction of the {axis} that grows with the load that it carries"
    alike: ClassVar[tuple[Alike, ...]] = (
        Alike(SWING, "coulomb_friction", SWING, "swings of small angles with one load", "Wide swings"),
    )
    contains: ClassVar[tuple[Contained, ...]] = (
        Contained("coulomb_friction", lambda own: {"level": own["level"]}, lambda law, own: {**law, "share": 0.0}),
    )
    level: Scalar = parameter("{force}", "level without a load", low=0.0)
    share: Scalar = parameter("{force}/N", "growth with the load", low=0.0, high=0.9)
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        size = self.level + self.share * jnp.abs(load)
        return size, size

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("share",) if scene.friction[site] > 0 else ("level", "share"))]


class PreslidingFriction(AbstractFriction, AbstractHysteresis):
    """Dahl's friction: a hysteretic spring before slip (Dahl 1968).

    The spring's relative deflection `z` in [-1, 1] is hidden: `z' = stiffness/level v (1 - z sign(v))`, and the
    force is `-level z`. It replaces sticking, so its level does not enter the clip.
    """

    kind: ClassVar[str] = "presliding_friction"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "friction of the {axis} that yields like a spring before it slips (presliding)"
    level: Scalar = parameter("{force}", "sliding level", low=0.0)
    stiffness: Scalar = parameter(
        "{force}/{position}", "stiffness before slip", null=1e4, low=10.0, high=1e9, reciprocal=True
    )
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        return jnp.zeros_like(v), jnp.zeros_like(v)

    def force(self, q: Scalar, z: Scalar) -> Scalar:
        return -self.level * z

    def deflection(self, z: Scalar, way: Scalar) -> Scalar:
        target = jnp.where(way < 0, -1.0, 1.0)
        # `abs` would have no slope at rest, and the spring none in its gradient.
        return target - (target - z) * decay(
            self.stiffness * jnp.where(way < 0, -way, way) / jnp.maximum(self.level, 1e-3)
        )

    def steepness(self) -> Scalar:
        return self.stiffness

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        level = max(scene.friction[site], 1.0)
        # It takes the plain friction's place: `coulomb` tells the search what is left of that one.
        return [
            Seed({"level": level, "stiffness": level / travel, "coulomb": 0.0}, ("level", "stiffness"), finite=True)
            for travel in (2e-4, 1.5e-3)
        ]


class FrictionDrift(AbstractFriction):
    """Coulomb friction that grows or fades with time: level `max(level + rate t, 0)`."""

    kind: ClassVar[str] = "friction_drift"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "dry friction of the {axis} that changes while the rig runs (warming up)"
    level: Scalar = parameter("{force}", "level at the recording's start", low=0.0)
    rate: Scalar = parameter("{force}/s", "change of the level with time")
    site: str = eqx.field(static=True)

    def levels(self, t: Scalar, q: Scalar, v: Scalar, load: Scalar) -> tuple[Scalar, Scalar]:
        size = jnp.maximum(self.level + self.rate * t, 0.0)
        return size, size

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # A falling level needs something to fall from, so both numbers are free beside a Coulomb friction, too.
        return [Seed({"level": 0.0, "rate": 1e-9}, ("level", "rate"))]
