"""What friction and dead zone take from a drive, given back."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Scalar
from ..fuzzy.membership import as_number

LIMITS = (3.0, 10.0)
"""Voltages beyond which the paper's drives saturate [V]: cart, hoist."""


def _number(default: float) -> Any:
    return eqx.field(converter=as_number, default=default)


class Compensation(eqx.Module):
    """Voltage that friction and dead zone take before anything moves, given back in the direction of the command."""

    cart: Scalar = _number(0.0)
    """[V]"""
    hoist: Scalar = _number(0.0)
    """[V]"""
    hoist_bias: Scalar = _number(0.0)
    """What holds the load at rest [V]."""
    blur: Scalar = _number(0.05)
    """Command over which the compensation changes its sign [V]."""
    cart_limit: Scalar = _number(LIMITS[0])
    """Voltage beyond which the drive saturates [V]."""
    hoist_limit: Scalar = _number(LIMITS[1])
    """[V]"""

    def __call__(self, command: Float[Array, " 2"]) -> Float[Array, " 2"]:
        """The command with what is lost on its way, within the drives' limits [V]."""
        lost = jnp.stack([self.cart, self.hoist]) * jnp.tanh(command / self.blur)
        limits = jnp.stack([self.cart_limit, self.hoist_limit])
        return jnp.clip(command + lost + jnp.stack([jnp.zeros(()), self.hoist_bias]), -limits, limits)
