"""The paper's two fuzzy controllers: one for the cart's position, one for the rope's length."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Axes, Scalar
from ..fuzzy.inference import AbstractSystem
from ..fuzzy.membership import as_number
from ..fuzzy.norms import Softness
from .base import AbstractController, Differences, Reference
from .compensation import LIMITS, Compensation

INPUTS = {"cart": ("error", "velocity", "angle"), "hoist": ("error", "velocity")}
"""What the system of each axis can be asked with."""


class FuzzyController(AbstractController):
    """Two fuzzy systems of their own, as in Figure 7 of the paper.

    The cart's system takes the normalised `error`, the speed `velocity` [m/s] and the swing `angle` [degrees]; the
    hoist's takes the normalised `error` and the speed `velocity`. Each input is found by its name, and may be left out.
    Both give a voltage. Errors are divided by a scale, which the paper does not give. Not the paper's: speeds relative
    to the reference's, and a compensation of what friction and dead zone take.
    """

    cart: AbstractSystem
    hoist: AbstractSystem
    cart_scale: Scalar = eqx.field(converter=as_number, default=1.0)
    """Error of the cart's position that counts as 1 [m]."""
    hoist_scale: Scalar = eqx.field(converter=as_number, default=1.0)
    """Error of the rope's length that counts as 1 [m]."""
    differences: Differences = eqx.field(default_factory=Differences)
    softness: Softness = None
    """See `fuzzy.inference`; None for the textbook's inference."""
    compensation: Compensation | None = None
    relative_speed: bool = eqx.field(static=True, default=False)
    """Whether the systems are asked with the speed beyond the reference's: a wanted motion is not braked."""

    def __check_init__(self) -> None:
        for axis, names in INPUTS.items():
            found = [variable.name for variable in getattr(self, axis).inputs]
            if not set(found) <= set(names) or len(set(found)) < len(found):
                raise ValueError(f"the {axis}'s system has the inputs {', '.join(found)}, not {', '.join(names)}")

    def ready(self) -> "FuzzyController":
        return dataclasses.replace(self, cart=self.cart.ready(), hoist=self.hoist.ready())

    def start(self, measured: Axes) -> tuple[Axes, Axes]:
        return self.differences.start(measured)

    def command(
        self, state: tuple[Axes, Axes], measured: Axes, reference: Reference, period: Scalar | float
    ) -> tuple[Float[Array, " 2"], tuple[Axes, Axes]]:
        speed, state = self.differences(state, measured, period)
        cart, hoist = self._inputs(measured, reference, speed)
        volts = (
            system.infer(values, softness=self.softness).output[0]
            for system, values in ((self.cart, cart), (self.hoist, hoist))
        )
        command = jnp.stack(list(volts))
        if self.compensation is not None:
            return self.compensation(command), state
        return jnp.clip(command, -jnp.asarray(LIMITS), jnp.asarray(LIMITS)), state

    def inputs(
        self, measured: Axes, reference: Reference, period: float
    ) -> tuple[Float[Array, "time cart"], Float[Array, "time hoist"]]:
        """What both systems were asked over a run.

        Args:
            measured: encoder readings with a leading axis of time [m, rad, m].
            reference: at the same samples.
            period: of sampling [s].
        """

        def ask(state: tuple[Axes, Axes], now: tuple[Axes, Reference]) -> tuple[tuple[Axes, Axes], tuple[Array, Array]]:
            speed, state = self.differences(state, now[0], period)
            return state, self._inputs(*now, speed)

        first = Axes(*(values[0] for values in measured))
        return jax.lax.scan(ask, self.start(first), (measured, reference))[1]

    def _inputs(self, measured: Axes, reference: Reference, speed: Axes) -> tuple[Array, Array]:
        if self.relative_speed:
            speed = Axes(speed.x - reference.v_x, speed.psi, speed.l - reference.v_l)
        cart = {
            "error": (reference.x - measured.x) / self.cart_scale,
            "velocity": speed.x,
            "angle": jnp.degrees(measured.psi),
        }
        hoist = {"error": (reference.l - measured.l) / self.hoist_scale, "velocity": speed.l}
        return (
            jnp.stack([cart[variable.name] for variable in self.cart.inputs]),
            jnp.stack([hoist[variable.name] for variable in self.hoist.inputs]),
        )
