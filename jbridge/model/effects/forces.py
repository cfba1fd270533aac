"""Smooth forces on cart, load and winch."""

import itertools
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from ..._math import sincos
from ..._types import Axes, Scalar
from ..fields import option, parameter
from .base import (
    AXIS_OF_SITE,
    CART,
    HOIST,
    MAP_KNOTS,
    PSI_SENSOR,
    SWING,
    AbstractDamping,
    AbstractForce,
    Alike,
    Contained,
    Scene,
    Seed,
    interpolate,
    uniform_knots,
    waves,
)

_EDGE = 0.005
"""Time over which a gust rises [s]: about one sample, so that its ends have a gradient."""
_SLOW_SWING = 1e-3
"""Speed below which a power law is linear [rad/s], below what an encoder of 4096 counts shows in a second."""
_SEVERAL_LENGTHS = "Swings at several rope lengths"


def _on_axis(site: str, value: Scalar) -> Axes:
    """A force on the site's own axis alone."""
    return Axes(*(value if axis == AXIS_OF_SITE[site] else jnp.zeros_like(value) for axis in Axes._fields))


class QuadraticDrag(AbstractDamping):
    """`-coefficient v |v|`."""

    kind: ClassVar[str] = "quadratic_drag"
    sites: ClassVar[tuple[str, ...]] = (CART, HOIST)
    sentence: ClassVar[str] = "a resistance of the {axis} that grows with the square of its speed"
    coefficient: Scalar = parameter("{force}/({speed})^2", "drag", low=0.0)
    site: str = eqx.field(static=True)

    def resistance(self, q: Axes, v: Axes) -> Scalar:
        speed = getattr(v, AXIS_OF_SITE[self.site])
        return -self.coefficient * speed * jnp.abs(speed)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("coefficient",))]


class LengthDependentDamping(AbstractDamping):
    """`-slope (l - length) psi'`: the swing's damping changes with the rope's length."""

    kind: ClassVar[str] = "length_dependent_damping"
    sites: ClassVar[tuple[str, ...]] = (SWING,)
    sentence: ClassVar[str] = "a damping of the swing that changes with the length of the rope"
    slope: Scalar = parameter("N s", "change of the damping with the length")
    length: Scalar = parameter("m", "reference length", null=float("nan"), fitted=False, default=float("nan"))
    site: str = eqx.field(static=True, default=SWING)

    def resistance(self, q: Axes, v: Axes) -> Scalar:
        return -self.slope * (q.l - self.length) * v.psi

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({"length": scene.length}, ("slope",))]


class PowerLawDamping(AbstractDamping):
    """`-coefficient |w|^exponent sign(w)` with `w = psi'`: a pivot's damping between dry friction and drag.

    Exponent 1 is the bridge's own viscous damping, 2 a drag; Squire (Pendulum damping, American Journal of Physics 54,
    1986) measures both beside dry friction, which holds at rest and is `coulomb_friction`. Below 1 mrad/s the law is
    linear, since an exponent below 1 has no slope at rest that a step could follow.
    """

    kind: ClassVar[str] = "power_law_damping"
    sites: ClassVar[tuple[str, ...]] = (SWING,)
    sentence: ClassVar[str] = "a damping of the {axis} that grows with a power of its speed"
    alike: ClassVar[tuple[Alike, ...]] = (
        Alike(SWING, "load_drag", SWING, "swings at one rope length, if the exponent is near 2", _SEVERAL_LENGTHS),
    )
    coefficient: Scalar = parameter("{force}/({speed})^n", "torque at 1 rad/s", low=0.0)
    exponent: Scalar = parameter("1", "the power n", null=2.0, low=0.3, high=4.0)
    site: str = eqx.field(static=True, default=SWING)

    def resistance(self, q: Axes, v: Axes) -> Scalar:
        speed = jnp.maximum(jnp.abs(v.psi), _SLOW_SWING)
        return -self.coefficient * v.psi * jnp.exp((self.exponent - 1.0) * jnp.log(speed))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        free = ("coefficient", "exponent")
        return [Seed({"coefficient": 0.0, "exponent": n}, free, linear=("coefficient",)) for n in (0.5, 1.5, 2.5)]


class ConstantForce(AbstractForce):
    """A force that never changes: a tilted rail, a pivot out of balance, an amplifier's offset."""

    kind: ClassVar[str] = "constant_force"
    sites: ClassVar[tuple[str, ...]] = (CART, SWING, HOIST)
    sentence: ClassVar[str] = (
        "a constant force on the {axis}, as from a tilted rail, a pivot out of balance or an offset of the amplifier"
    )
    alike: ClassVar[tuple[Alike, ...]] = (
        Alike(SWING, "sensor_offset", PSI_SENSOR, "swings at one rope length with one load", _SEVERAL_LENGTHS),
    )
    level: Scalar = parameter("{force}", "force")
    site: str = eqx.field(static=True, default=CART)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        return _on_axis(self.site, self.level + jnp.zeros_like(q.x))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("level",))]


class SpringForce(AbstractForce):
    """`-stiffness (q - rest)`: a cable chain that pulls back."""

    kind: ClassVar[str] = "spring_force"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "a force on the {axis} that grows with its distance from a place, as from a cable chain"
    stiffness: Scalar = parameter("{force}/{position}", "stiffness")
    rest: Scalar = parameter("{position}", "place without force")
    site: str = eqx.field(static=True, default=CART)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        zero = jnp.zeros_like(q.x)
        return Axes(-self.stiffness * (q.x - self.rest), zero, zero)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [
            Seed({"stiffness": 0.0, "rest": scene.low["x"] + share * scene.span("x")}, ("stiffness", "rest"))
            for share in (0.5, 0.0, 1.0)
        ]


class RailInclination(AbstractForce):
    """A force by place, piecewise linear in `q` and constant beyond the ends: a rail that rises and falls.

    A rail that rises by an angle `a` pulls the cart back with `(m1 + m2) g sin a`, the load's weight included, while
    `psi` is measured from the vertical: by virtual work, moving along the rail lifts both. Beside a `constant_force` of
    the cart the same offset may stand in either; a search leaves the constant one out.
    """

    kind: ClassVar[str] = "rail_inclination"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = (
        "a force on the {axis} that changes from place to place, as on a rail that rises and falls"
    )
    contains: ClassVar[tuple[Contained, ...]] = (
        Contained(
            "constant_force",
            lambda own: {"level": np.mean(own["forces"])},
            lambda law, own: {"forces": law["level"]},
        ),
        Contained(
            "spring_force",
            lambda own: _line(own["knots"], own["forces"]),
            lambda law, own: {"forces": -law["stiffness"] * (np.asarray(own["knots"]) - law["rest"])},
        ),
    )
    knots: Float[Array, " knot"] = parameter("{position}", "places", fitted=False, vector=True)
    forces: Float[Array, " knot"] = parameter("{force}", "force at each knot", vector=True)
    site: str = eqx.field(static=True, default=CART)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        return _on_axis(self.site, interpolate(self.knots, self.forces, q.x))

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({"knots": uniform_knots(scene, "x", MAP_KNOTS), "forces": [0.0] * MAP_KNOTS}, ("forces",))]


def _line(knots: ArrayLike, forces: ArrayLike) -> dict[str, float]:
    """Stiffness and rest of the spring that comes nearest to forces at places."""
    slope, offset = np.polyfit(np.asarray(knots, float), np.asarray(forces, float), 1)
    steep = slope if abs(slope) > 1e-9 else -1e-9
    return {"stiffness": -steep, "rest": -offset / steep}


class PeriodicForce(AbstractForce):
    """`amplitude sin(2 pi q / period + phase)`: the belt's teeth, a motor's cogging."""

    kind: ClassVar[str] = "periodic_force"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "a force on the {axis} that repeats with its position, as from belt teeth or cogging"
    amplitude: Scalar = parameter("{force}", "amplitude")
    period: Scalar = parameter("{position}", "distance after which it repeats", null=0.1, low=1e-3)
    phase: Scalar = parameter("rad", "phase at the origin")
    site: str = eqx.field(static=True, default=CART)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        sine, _ = sincos(2 * jnp.pi * q.x / self.period + self.phase)
        zero = jnp.zeros_like(q.x)
        return Axes(self.amplitude * sine, zero, zero)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        span = max(scene.span("x"), 1e-2)
        return waves(span, 80)


class EndStop(AbstractForce):
    """Spring and damper beyond `position`, while in contact; it pushes and never pulls."""

    kind: ClassVar[str] = "end_stop"
    sites: ClassVar[tuple[str, ...]] = (CART,)
    sentence: ClassVar[str] = "an elastic stop that the {axis} runs into"
    position: Scalar = parameter("{position}", "place of first contact")
    stiffness: Scalar = parameter("{force}/{position}", "stiffness", low=0.0)
    damping: Scalar = parameter("{force} s/m", "damping in contact", low=0.0)
    site: str = eqx.field(static=True, default=CART)
    end: Scalar = option("high", ("high", "low"))

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        sign = 1.0 - 2.0 * self.end
        depth = sign * (q.x - self.position)
        push = self.stiffness * depth + self.damping * sign * v.x
        zero = jnp.zeros_like(q.x)
        return Axes(-sign * jnp.where(depth > 0, jnp.maximum(push, 0.0), 0.0), zero, zero)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        low, span = scene.low["x"], scene.span("x")
        shares = (0.97, 0.9, 0.8)
        return [
            Seed(
                {
                    "end": end,
                    "position": low + (s if end == "high" else 1 - s) * span,
                    "stiffness": 0.0,
                    "damping": 0.0,
                },
                ("position", "stiffness", "damping"),
                linear=("stiffness", "damping"),
            )
            for end in ("high", "low")
            for s in shares
        ]


class LoadDrag(AbstractForce):
    """Air drag on the load's absolute velocity, `-coefficient |V| V`; it acts on all three equations, and on the hook
    of a double pendulum."""

    kind: ClassVar[str] = "load_drag"
    sites: ClassVar[tuple[str, ...]] = (SWING,)
    sentence: ClassVar[str] = "air drag on the load"
    coefficient: Scalar = parameter("N s^2/m^2", "drag", low=0.0)
    site: str = eqx.field(static=True, default=SWING)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        sine, cosine = sincos(q.psi)
        across = v.x + v.l * sine + q.l * v.psi * cosine
        down = v.l * cosine - q.l * v.psi * sine
        # The floor keeps the gradient of the root finite at rest; 1e-9 m/s is no motion.
        speed = jnp.sqrt(across * across + down * down + 1e-18)
        f_across, f_down = -self.coefficient * speed * across, -self.coefficient * speed * down
        return Axes(f_across, q.l * (f_across * cosine - f_down * sine), f_across * sine + f_down * cosine)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        return [Seed({}, ("coefficient",))]


class Wind(AbstractForce):
    """A horizontal force on the load, or on the hook of a double pendulum, from `start` to `stop`: `force (1,
    l cos psi, sin psi)`."""

    kind: ClassVar[str] = "wind"
    sites: ClassVar[tuple[str, ...]] = (SWING,)
    sentence: ClassVar[str] = "a horizontal push on the load during a certain time, as from wind"
    strength: Scalar = parameter("N", "force", key="force")
    start: Scalar = parameter("s", "when it begins")
    stop: Scalar = parameter("s", "when it ends", null=1.0)
    site: str = eqx.field(static=True, default=SWING)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        rise = jnp.clip((t - self.start) / _EDGE + 0.5, 0.0, 1.0)
        fall = jnp.clip((t - self.stop) / _EDGE + 0.5, 0.0, 1.0)
        push = self.strength * (rise - fall)
        sine, cosine = sincos(q.psi)
        return Axes(push, q.l * push * cosine, push * sine)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        spans = []
        for sixths in scene.moments([i / 6 for i in range(7)]):
            # The longest first, but for the one that lasts throughout, which is a constant force.
            spans += sorted(itertools.combinations(sixths, 2), key=lambda span: span[0] - span[1])[1:]
        return [
            Seed({"force": 0.0, "start": start, "stop": stop}, ("force", "start", "stop"), linear=("force",))
            for start, stop in spans
        ]


class ResidualForce(AbstractForce):
    """What no named effect explains: a force that is piecewise linear in place plus one piecewise linear in velocity.

    It is never a name for physics. `diagnose` learns it to ask whether anything repeatable is missing, and where it
    can give no name it keeps the curve so that the simulation is usable all the same.
    """

    kind: ClassVar[str] = "residual_force"
    sites: ClassVar[tuple[str, ...]] = (CART, SWING, HOIST)
    sentence: ClassVar[str] = "a force on the {axis} without a name, as a curve over place and velocity"
    places: Float[Array, " knot"] = parameter("{position}", "knots in place", fitted=False, vector=True)
    by_place: Float[Array, " knot"] = parameter("{force}", "force at each place", vector=True)
    speeds: Float[Array, " knot"] = parameter("{speed}", "knots in velocity", fitted=False, vector=True)
    by_speed: Float[Array, " knot"] = parameter("{force}", "force at each velocity", vector=True)
    site: str = eqx.field(static=True)

    def force(self, t: Scalar, q: Axes, v: Axes) -> Axes:
        axis = AXIS_OF_SITE[self.site]
        value = interpolate(self.places, self.by_place, getattr(q, axis))
        value = value + interpolate(self.speeds, self.by_speed, getattr(v, axis))
        return _on_axis(self.site, value)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        axis = AXIS_OF_SITE[site]
        places = uniform_knots(scene, axis, 7)
        top = max(scene.speed[axis], 1e-3)
        speeds = [share * top for share in (-1.0, -0.5, -0.2, -0.05, 0.05, 0.2, 0.5, 1.0)]
        values = {"places": places, "by_place": [0.0] * 7, "speeds": speeds, "by_speed": [0.0] * 8}
        return [Seed(values, ("by_place", "by_speed"))]
