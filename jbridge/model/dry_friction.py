"""Coulomb friction with stiction, averaged over an integration step.

Over a step friction is the mean of what Coulomb's law gives while the axis slides from the step's first velocity, and
of what holds it (or breaks away) from the instant at which it comes to rest. For a steady drive that mean is exact, so
a stop or a reversal costs no order of accuracy; stuck is stuck, sliding is exactly Coulomb, and the share of the step
that slides carries the gradient of the instant of the event. The axes feel each other's friction through the inverse
mass matrix, so they are swept twice, Gauss-Seidel.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._math import materialise
from .._types import Scalar

_SWEEPS = 2
_TINY = 1e-30
"""Keeps finite the friction of a locked axis, whose inverse mass is 0, and that of a step of no length."""


class Rows(NamedTuple):
    """The axes on which dry friction may act: the sides of the drives of cart, swing and hoist."""

    rest: Sequence[Scalar]
    """Accelerations without dry friction."""
    w: Sequence[Sequence[Scalar]]
    """What unit forces on the axes do to them: the inverse mass matrix."""
    moving: Sequence[Scalar]
    """Velocities at the step's beginning."""
    up: Sequence[Scalar]
    """Levels against positive,"""
    down: Sequence[Scalar]
    """and against negative motion."""


def friction(rows: Rows, rubbing: Sequence[bool], h: Scalar, go: Array) -> list[Scalar]:
    """Each row's friction, as its mean over a step.

    Args:
        rows: where it acts.
        rubbing: whether any friction acts on a row.
        h: length of the step [s].
        go: true, for `materialise`.
    """
    f = [jnp.zeros_like(rows.rest[0])] * 3
    for _ in range(_SWEEPS):
        for i in range(3):
            if not rubbing[i]:
                continue
            a_free = rows.rest[i]
            for j in range(3):
                if j != i and rubbing[j]:
                    a_free = a_free + rows.w[i][j] * f[j]
            f[i] = materialise(mean_friction(rows.moving[i], a_free, rows.w[i][i], rows.up[i], rows.down[i], h), go)
    return f


def mean_friction(v: Scalar, a_free: Scalar, w: Scalar, up: Scalar, down: Scalar, h: Scalar) -> Scalar:
    """Coulomb's friction averaged over a step.

    Args:
        v: velocity at the step's beginning.
        a_free: the axis' acceleration without its own friction.
        w: its inverse effective mass, 0 if it is locked.
        up, down: levels against positive and against negative motion.
        h: length of the step [s].
    """
    # The force under which the axis, once at rest, would stay there.
    needed = -a_free / (w + _TINY)
    # Written out, because a clip between equal bounds has no gradient towards them.
    holding = jnp.where(needed < -up, -up, jnp.where(needed > down, down, needed))
    # At rest nothing of the step slides, and `holding` alone counts, at its limit where the axis breaks away.
    sliding = jnp.where(v > 0, -up, down)
    a_sliding = a_free + w * sliding
    # Only what is slowed down can come to rest within the step; what speeds up slides through all of it.
    slows = v * a_sliding < 0
    slowed_by = jnp.where(slows, a_sliding, 1.0) * (h + _TINY)
    # The instant of rest, as a share of the step. Where nothing slows, it is divided by 1, and no gradient is NaN.
    share = jnp.where(slows, jnp.minimum(-v / slowed_by, 1.0), jnp.where(v == 0, 0.0, 1.0))
    return holding + share * (sliding - holding)
