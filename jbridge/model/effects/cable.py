"""What a cart drags along: a cable chain."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._math import decay
from ..._types import Scalar
from ..fields import parameter
from .base import CART, AbstractHysteresis, Contained, Scene, Seed


class CableDrag(AbstractHysteresis):
    """`-stiffness (q - rest) - level z` with `z' = v/travel (1 - z sign(v))`: elastic, with a place of rest and a loop.

    The relative deflection `z` in [-1, 1] is hidden; after a reversal the force changes by `2 level` over a few
    `travel`. This is the law of Bouc and Wen (Wen, Method for random vibration of hysteretic systems, 1976) with
    exponent 1 and `gamma = 0`. Without `level` it is `spring_force`, without `stiffness` `presliding_friction` with
    stiffness `level/travel`. Like friction it acts on the motor's side of a belt or a play.
    """

    kind: ClassVar[str] = "cable_drag"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = (
        "a drag on the {axis} that pulls to a place and lags behind reversals, as a cable chain's does"
    )
    contains: ClassVar[tuple[Contained, ...]] = (
        Contained(
            "spring_force",
            lambda own: {"stiffness": own["stiffness"], "rest": own["rest"]},
            lambda law, own: {**law, "level": 0.0},
        ),
        Contained(
            "presliding_friction",
            lambda own: {"level": own["level"], "stiffness": own["level"] / own["travel"]},
            lambda law, own: {"stiffness": 0.0, "level": law["level"], "travel": law["level"] / law["stiffness"]},
        ),
    )
    stiffness: Scalar = parameter("{force}/{position}", "stiffness about the place of rest", low=0.0)
    rest: Scalar = parameter("{position}", "place without force, in the middle of the loop")
    level: Scalar = parameter("{force}", "half the loop's height", low=0.0)
    travel: Scalar = parameter("{position}", "way over which the loop opens", null=0.05, low=1e-3)
    site: str = eqx.field(static=True, default=CART)

    def force(self, q: Scalar, z: Scalar) -> Scalar:
        return -self.stiffness * (q - self.rest) - self.level * z

    def deflection(self, z: Scalar, way: Scalar) -> Scalar:
        target = jnp.where(way < 0, -1.0, 1.0)
        # `abs` would have no slope at rest, and the spring none in its gradient.
        return target - (target - z) * decay(jnp.where(way < 0, -way, way) / self.travel)

    def steepness(self) -> Scalar:
        return self.stiffness + self.level / self.travel

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        span = max(scene.span("x"), 1e-2)
        values = {"stiffness": 0.3 / span, "rest": scene.low["x"] + 0.5 * span, "level": 0.3}
        free = ("stiffness", "rest", "level", "travel")
        return [Seed({**values, "travel": share * span}, free, finite=True) for share in (0.02, 0.1)]
