"""Bodies that swing beside the load: what they add to the inertia matrix and to gravity."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from ..._types import Axes, Scalar
from ..bridge import Symmetric
from ..fields import parameter
from .base import L_SENSOR, SWING, AbstractEffect, Alike, Scene, Seed


class AbstractBody(AbstractEffect):
    """A body of its own mass, moved by cart and swing."""

    @abc.abstractmethod
    def mass_matrix(self, swing: tuple[Scalar, Scalar]) -> Symmetric:
        """What the body adds to `M(q)` [kg, kg m, kg m^2]; nothing between swing and hoist.

        Args:
            swing: sine and cosine of the swing angle.
        """

    @abc.abstractmethod
    def bias(self, v: Axes, gravity: Scalar, swing: tuple[Scalar, Scalar]) -> Axes:
        """What the body adds to `bias(q, v)` [N, N m, N].

        Args:
            v: velocities.
            gravity: acceleration [m/s^2].
            swing: sine and cosine of the swing angle.
        """

    @abc.abstractmethod
    def pull(self, v: Axes, gravity: Scalar, swing: tuple[Scalar, Scalar]) -> Scalar:
        """What the body adds to the pull on the pivot by its weight and rotation [N]; arguments as for `bias`."""


class RodInertia(AbstractBody):
    """A rigid rod that hangs from the pivot and turns with the load, which is fixed to it or slides along it.

    With `s = centre`, `S = mass s` and `I = mass s^2 + inertia` the rod adds `mass`, `S cos psi` and `I` to the cart's,
    the coupling and the swing's entry of the inertia matrix, `-S psi'^2 sin psi` to the cart's and `S g sin psi` to the
    swing's equation, and nothing to the hoist's: winch and load move along the rod (Lagrange's equations of a compound
    pendulum on a cart; Khalil and Dombre, Modeling, Identification and Control of Robots, 2002, on the inertial
    parameters of a link that a motion determines).

    A free swing at one rope length `l` determines the equivalent length `(m2 l^2 + I) / (m2 l + S)` alone, as a wrong
    rope length would. A driven cart determines the first moment over the moved mass, `(m2 l + S) / (m1 + m2 + mass)`,
    beside it, and ropes of several lengths determine `S` and `I` one by one. Where the cart's gain is unknown nothing
    tells `mass` and `centre` apart but their product `S`, so `centre` is not estimated. At `mass = inertia = 0` the rod
    is absent and both have a gradient; every `mass` and `inertia >= 0` gives a positive definite inertia matrix.
    """

    kind: ClassVar[str] = "rod_inertia"
    sites: ClassVar[tuple[str, ...]] = (SWING,)
    sentence: ClassVar[str] = "a rod that swings with the load, with a mass and a moment of inertia of its own"
    alike: ClassVar[tuple[Alike, ...]] = (
        Alike(
            SWING,
            "sensor_offset",
            L_SENSOR,
            "swings at one rope length that do not move the cart",
            "Swings at several rope lengths, or of a cart that is free to move and whose mass is known",
        ),
    )
    mass: Scalar = parameter("kg", "mass of the rod", low=0.0)
    centre: Scalar = parameter("m", "distance of its centre of gravity below the pivot", null=0.3, fitted=False)
    inertia: Scalar = parameter("kg m^2", "moment of inertia about its centre of gravity", low=0.0)
    site: str = eqx.field(static=True, default=SWING)

    def mass_matrix(self, swing: tuple[Scalar, Scalar]) -> Symmetric:
        sine, cosine = swing
        zero = jnp.zeros_like(sine)
        first = self.mass * self.centre
        second = first * self.centre + self.inertia
        return Symmetric(self.mass + zero, first * cosine, zero, second + zero, zero, zero)

    def bias(self, v: Axes, gravity: Scalar, swing: tuple[Scalar, Scalar]) -> Axes:
        sine, _ = swing
        pull = self.mass * self.centre * sine
        return Axes(-pull * v.psi * v.psi, pull * gravity, jnp.zeros_like(sine))

    def pull(self, v: Axes, gravity: Scalar, swing: tuple[Scalar, Scalar]) -> Scalar:
        _, cosine = swing
        return self.mass * (gravity * cosine + self.centre * v.psi * v.psi)

    @classmethod
    def seeds(cls, site: str, scene: Scene) -> list[Seed]:
        # A uniform rod from the pivot to the load.
        return [Seed({"mass": 0.0, "centre": 0.5 * scene.length, "inertia": 0.0}, ("mass", "inertia"))]
