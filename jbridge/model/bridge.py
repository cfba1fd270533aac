"""The rigid bridge: cart, point load and winch, from the paper's energies.

With `q = (x, psi, l)` the equations of motion are `M(q) a + bias(q, v) = force`, equations (8) to (10) of the paper
with its misprints corrected. `M` is an arrow (swing and hoist are coupled through the cart alone), so its inverse
has a closed form.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from .._math import sincos
from .._types import Axes, Scalar
from .fields import parameter


class Symmetric(NamedTuple):
    """A symmetric 3 by 3 matrix over the axes cart, swing, hoist."""

    xx: Scalar
    xp: Scalar
    xl: Scalar
    pp: Scalar
    pl: Scalar
    ll: Scalar

    def __matmul__(self, f: Axes) -> Axes:
        return Axes(
            self.xx * f.x + self.xp * f.psi + self.xl * f.l,
            self.xp * f.x + self.pp * f.psi + self.pl * f.l,
            self.xl * f.x + self.pl * f.psi + self.ll * f.l,
        )


class Bridge(eqx.Module):
    """Cart with a point load on a massless rope, in one vertical plane."""

    cart_mass: Scalar = parameter("kg", "cart with its drive", null=5.5, low=1e-3, default=5.5)
    load_mass: Scalar = parameter("kg", "load at the rope's end", null=0.143, low=1e-4, default=0.143)
    winch_mass: Scalar = parameter("kg", "winch inertia J/r^2 seen along the rope", null=0.1, low=1e-4, default=0.1)
    gravity: Scalar = parameter("m/s^2", "gravitational acceleration", null=9.81, low=0.1, default=9.81)
    cart_damping: Scalar = parameter("N s/m", "viscous damping of the cart, R_tr", low=0.0, default=0.0)
    swing_damping: Scalar = parameter("N m s", "viscous damping of the swing, R_psi", low=0.0, default=0.0)
    hoist_damping: Scalar = parameter("N s/m", "viscous damping of the winch, R_trl", low=0.0, default=0.0)
    cart_gain: Scalar = parameter("N/{u_x}", "force of the cart's motor, K_x", null=1.0, default=1.0)
    hoist_gain: Scalar = parameter("N/{u_l}", "force of the winch along the rope, K_l", null=1.0, default=1.0)

    def mass_matrix(self, q: Axes, swing: tuple[Scalar, Scalar] | None = None) -> Symmetric:
        """`M(q)` [kg, kg m, kg m^2].

        Args:
            q: positions.
            swing: sine and cosine of `q.psi`, where they are known already.
        """
        sine, cosine = sincos(q.psi) if swing is None else swing
        m2 = self.load_mass
        return Symmetric(
            self.cart_mass + m2,
            m2 * q.l * cosine,
            m2 * sine,
            m2 * q.l * q.l,
            jnp.zeros_like(sine),
            m2 + self.winch_mass,
        )

    def bias(self, q: Axes, v: Axes, swing: tuple[Scalar, Scalar] | None = None) -> Axes:
        """Centrifugal, Coriolis and gravity terms on the left-hand side [N, N m, N]; `swing` as above."""
        sine, cosine = sincos(q.psi) if swing is None else swing
        m2 = self.load_mass
        coriolis = 2.0 * m2 * v.l * v.psi
        centrifugal = m2 * q.l * v.psi * v.psi
        return Axes(
            coriolis * cosine - centrifugal * sine,
            q.l * coriolis + m2 * self.gravity * q.l * sine,
            -centrifugal - m2 * self.gravity * cosine,
        )

    def viscous(self, v: Axes) -> Axes:
        """Viscous damping forces [N, N m, N]."""
        return Axes(-self.cart_damping * v.x, -self.swing_damping * v.psi, -self.hoist_damping * v.l)

    def energy(self, q: Axes, v: Axes) -> Scalar:
        """Kinetic plus potential energy [J], zero with the load at rest at the rail; equation (4)."""
        sine, cosine = sincos(q.psi)
        across = v.x + v.l * sine + q.l * v.psi * cosine
        down = v.l * cosine - q.l * v.psi * sine
        kinetic = (
            self.cart_mass * v.x * v.x + self.load_mass * (across * across + down * down) + self.winch_mass * v.l * v.l
        )
        return 0.5 * kinetic - self.load_mass * self.gravity * q.l * cosine


def inverse(m: Symmetric, active: Axes) -> Symmetric:
    """Inverse of an arrow-shaped mass matrix, with locked axes held.

    Args:
        m: mass matrix with `pl == 0`.
        active: 1 for an axis that moves, 0 for one that is locked or absent; rows and columns of the latter are 0.
    """
    # Two divisions by a diagonal entry that are shared: they cost as much as twenty multiplications.
    pp, ll = active.psi / m.pp, active.l / m.ll
    to_psi, to_l = pp * m.xp, ll * m.xl
    xx = active.x / (m.xx - to_psi * m.xp - to_l * m.xl)
    return Symmetric(
        xx,
        -xx * to_psi,
        -xx * to_l,
        pp + xx * to_psi * to_psi,
        xx * to_psi * to_l,
        ll + xx * to_l * to_l,
    )
