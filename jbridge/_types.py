"""Shapes and coordinates that every layer shares.

Axis names in annotations: `time`, `dof`, `state`, `channel`, `row`, `lane`, `parameter`.
"""

from typing import NamedTuple

from jaxtyping import Array, Float

from .compilation.programs import returned

Scalar = Float[Array, ""]
"""One number; batches come from `jax.vmap`."""


@returned
class Axes(NamedTuple):
    """One value for each axis of the bridge: cart, swing and hoist."""

    x: Scalar
    psi: Scalar
    l: Scalar


AXES = ("x", "psi", "l")
"""The axes' names, which are the measured channels' names too."""
EQUATIONS = {"x": "cart", "psi": "swing", "l": "hoist"}
"""The equation of motion that belongs to each axis."""
AXIS_OF_EQUATION = {equation: axis for axis, equation in EQUATIONS.items()}
