"""Linear laws as rivals of the fuzzy ones, PID and state feedback, with what friction and dead zone take given back."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Axes, Scalar
from ..fuzzy.membership import as_number
from .base import AbstractController, Differences, Reference
from .compensation import Compensation


def _number(default: float) -> Any:
    return eqx.field(converter=as_number, default=default)


class _PidState(NamedTuple):
    differences: tuple[Axes, Axes]
    sums: Float[Array, " 2"]


class Pid(AbstractController):
    """Position controllers of cart and hoist, each of its own; the derivative acts on the error of the speed."""

    tunable: ClassVar[tuple[str, ...]] = ("cart_p", "cart_i", "cart_d", "hoist_p", "hoist_i", "hoist_d")
    cart_p: Scalar = _number(10.0)
    """[V/m]"""
    cart_i: Scalar = _number(1.0)
    """[V/(m s)]"""
    cart_d: Scalar = _number(1.0)
    """[V s/m]"""
    hoist_p: Scalar = _number(30.0)
    hoist_i: Scalar = _number(3.0)
    hoist_d: Scalar = _number(1.0)
    differences: Differences = eqx.field(default_factory=Differences)
    compensation: Compensation = eqx.field(default_factory=Compensation)
    most: Scalar = _number(1.0)
    """Largest share of the limits that the integrals may take."""

    def start(self, measured: Axes) -> _PidState:
        return _PidState(self.differences.start(measured), jnp.zeros(2))

    def command(
        self, state: _PidState, measured: Axes, reference: Reference, period: Scalar | float
    ) -> tuple[Float[Array, " 2"], _PidState]:
        speed, differences = self.differences(state.differences, measured, period)
        error = jnp.stack([reference.x - measured.x, reference.l - measured.l])
        slope = jnp.stack([reference.v_x - speed.x, reference.v_l - speed.l])
        p, i, d = (jnp.stack([getattr(self, f"{axis}_{term}") for axis in ("cart", "hoist")]) for term in "pid")
        room = self.most * self.compensation.limits
        sums = jnp.clip(state.sums + i * error * period, -room, room)
        return self.compensation(p * error + sums + d * slope), _PidState(differences, sums)


class StateFeedback(AbstractController):
    """`u = -K (state - reference)`, the state being positions and velocities of cart, swing and rope."""

    tunable: ClassVar[tuple[str, ...]] = ("gains",)
    gains: Float[Array, "2 6"]
    """Of `x, psi, l` and their velocities [V/m, V/rad, V s/m, V s/rad]; one row each for cart and hoist."""
    differences: Differences = eqx.field(default_factory=Differences)
    compensation: Compensation = eqx.field(default_factory=Compensation)

    def start(self, measured: Axes) -> tuple[Axes, Axes]:
        return self.differences.start(measured)

    def command(
        self, state: tuple[Axes, Axes], measured: Axes, reference: Reference, period: Scalar | float
    ) -> tuple[Float[Array, " 2"], tuple[Axes, Axes]]:
        speed, state = self.differences(state, measured, period)
        away = jnp.stack(
            [
                measured.x - reference.x,
                measured.psi,
                measured.l - reference.l,
                speed.x - reference.v_x,
                speed.psi,
                speed.l - reference.v_l,
            ]
        )
        return self.compensation(-self.gains @ away), state


class _Estimate(NamedTuple):
    state: Float[Array, " 6"]
    """`x, psi, l` and their velocities."""
    given: Float[Array, " 2"]
    """Voltages of the last sample, without what is lost on their way [V]."""


class ObserverFeedback(AbstractController):
    """State feedback on what an observer estimates: `u = -K (s - reference)`, `s <- A s + B u + L (y - C (A s + B u))`.

    `C` takes `x, psi, l` from the state. The matrices hold for one sampling period. Source: Kwakernaak and Sivan
    (1972), section 6.6.
    """

    tunable: ClassVar[tuple[str, ...]] = ("gains",)
    gains: Float[Array, "2 6"]
    """`K`, as those of `StateFeedback`."""
    transition: Float[Array, "6 6"]
    """`A`, from one sample to the next, of `x, psi, l` [m, rad, m] and their velocities."""
    drive: Float[Array, "6 2"]
    """`B`, of voltages that friction and dead zones take nothing from."""
    correction: Float[Array, "6 3"]
    """`L`, of what is measured beyond what is foreseen [m, rad, m]."""
    compensation: Compensation = eqx.field(default_factory=Compensation)

    def start(self, measured: Axes) -> _Estimate:
        zero = jnp.zeros_like(measured.x)
        return _Estimate(jnp.stack([*measured, zero, zero, zero]), jnp.zeros(2))

    def command(
        self, state: _Estimate, measured: Axes, reference: Reference, period: Scalar | float
    ) -> tuple[Float[Array, " 2"], _Estimate]:
        foreseen = self.transition @ state.state + self.drive @ state.given
        found = foreseen + self.correction @ (jnp.stack([*measured]) - foreseen[:3])
        zero = jnp.zeros_like(measured.x)
        wanted = jnp.stack([reference.x, zero, reference.l, reference.v_x, zero, reference.v_l])
        asked = -self.gains @ (found - wanted)
        command = self.compensation(asked)
        return command, _Estimate(found, command - self.compensation.lost(asked))
