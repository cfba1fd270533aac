"""What friction and dead zone take from a drive, given back."""

import dataclasses
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._toml import Where, as_value, number, positive, shown
from .._types import Scalar
from ..errors import InputError
from ..fuzzy.membership import as_number
from .base import AbstractController

LIMITS = (3.0, 10.0)
"""Voltages beyond which the paper's drives saturate [V]: cart, hoist."""


def _number(default: float) -> Any:
    return eqx.field(converter=as_number, default=default)


class Compensation(eqx.Module):
    """Command that friction and dead zone take before anything moves, given back in its direction.

    All numbers are in the unit of the inputs, volts where nothing else is said.
    """

    cart: Scalar = _number(0.0)
    """Of the cart."""
    hoist: Scalar = _number(0.0)
    """Of the hoist."""
    hoist_bias: Scalar = _number(0.0)
    """What holds the load at rest."""
    blur: Scalar = _number(0.05)
    """Command over which the compensation changes its sign."""
    cart_limit: Scalar = _number(LIMITS[0])
    """Command beyond which the cart's drive saturates."""
    hoist_limit: Scalar = _number(LIMITS[1])
    """The same of the hoist."""

    @property
    def limits(self) -> Float[Array, " 2"]:
        """Commands beyond which the drives saturate: cart, hoist."""
        return jnp.stack([self.cart_limit, self.hoist_limit])

    def __call__(self, command: Float[Array, " 2"]) -> Float[Array, " 2"]:
        """The command with what is lost on its way, within the drives' limits."""
        limits = self.limits
        return jnp.clip(command + self.lost(command), -limits, limits)

    def lost(self, command: Float[Array, " 2"]) -> Float[Array, " 2"]:
        """What is lost on the way of a command, and what holds the load."""
        lost = jnp.stack([self.cart, self.hoist]) * jnp.tanh(command / self.blur)
        return lost + jnp.stack([jnp.zeros(()), self.hoist_bias])


def limits_of(law: AbstractController) -> Float[Array, " 2"]:
    """Commands of cart and hoist beyond which a controller's drives saturate; the paper's if it does not say."""
    given = getattr(law, "compensation", None)
    return jnp.asarray(LIMITS) if given is None else given.limits


def read_compensation(file: Where, table: Any) -> Compensation | None:
    """The table [compensation] of a controller's file, if there is one.

    Raises:
        InputError: naming the key and what to do.
    """
    if table is None:
        return None
    names = [f.name for f in dataclasses.fields(Compensation)]
    if not isinstance(table, dict):
        file.refuse(f"compensation = {shown(table)} is not a table; write [compensation] with {', '.join(names)}")
    where = file.within("[compensation]")
    where.check_keys(table, names, "key")
    read = {key: positive if key in _POSITIVE else number for key in table}
    return Compensation(**{key: as_number(take(where, table, key, 0.05)) for key, take in read.items()})


def compensation_lines(path: Path, compensation: Compensation | None) -> list[str]:
    """The table's lines, from which `read_compensation` reads the same.

    Raises:
        InputError: a number is not finite, or not positive where it must be.
    """
    if compensation is None:
        return []
    numbers = {f.name: float(getattr(compensation, f.name)) for f in dataclasses.fields(compensation)}
    for key, value in numbers.items():
        if not np.isfinite(value) or (key in _POSITIVE and value <= 0.0):
            raise InputError(f"{path}: [compensation] {key} is {value:g}; correct it before it is written")
    return ["", "[compensation]", *(f"{key} = {as_value(value)}" for key, value in numbers.items())]


_POSITIVE = ("blur", "cart_limit", "hoist_limit")
