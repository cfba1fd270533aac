"""What is decided over a whole step: dry friction that sticks, and the contact of a play.

Over a step friction is the mean of what Coulomb's law gives while the axis slides from the step's first velocity, and
of what holds it (or breaks away) from the instant at which it comes to rest. For a steady drive that mean is exact, so
a stop or a reversal costs no order of accuracy; stuck is stuck, sliding is exactly Coulomb, and the share of the step
that slides carries the gradient of the instant of the event. The axes feel each other's friction through the inverse
mass matrix, so they are swept twice, Gauss-Seidel.

A contact's impulse moves the velocity by as much wherever in the step it comes, and the position the more the earlier:
so a contact has two means over the step, a plain one and one weighted by the time left.
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


class Play(NamedTuple):
    """A play between motor and cart, at the step's beginning."""

    side: Scalar
    """The side to which it is going: 1 where the motor is ahead of the cart, -1 where it is behind."""
    left: Scalar
    """How far that side is away [m],"""
    rate: Scalar
    """how fast it comes nearer [m/s],"""
    rest: Scalar
    """and that speed's rate of change without friction and contact [m/s^2]."""
    u: Sequence[Scalar]
    """What a unit of thrust does to each of the rows; and, with the other sign, a force there to the approach."""
    w: Scalar
    """What a unit of thrust does against the approach."""


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


def friction_with_play(
    rows: Rows, play: Play, rubbing: Sequence[bool], h: Scalar, lead: Scalar | float, go: Array
) -> tuple[list[Scalar], Scalar]:
    """The same beside a play whose sides meet inelastically.

    Where they meet within the step, friction is that of the axes before and after. From then on the sides move as one:
    a motor that friction holds carries any thrust, which sweeps between friction and thrust would approach but slowly.

    Args:
        rows, rubbing, h, go: see `friction`.
        play: the play.
        lead: see `rollout.Method`.

    Returns:
        Friction of each row, and the contact's thrust.
    """
    u, w = play.u, play.w
    opened = friction(rows, rubbing, h, go)
    a_open = _approach(play, opened)
    meets = play.rate * h + 0.5 * h * h * a_open > play.left
    # Until they meet, from a distance with a speed.
    ahead = jnp.where(meets & (play.left > 0), play.left, 0.0)
    squared = play.rate * play.rate + 2.0 * a_open * ahead
    speed = play.rate + jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)
    before = jnp.minimum(jnp.where(speed > 0, 2.0 * ahead / jnp.where(speed > 0, speed, 1.0), 0.0), h)
    after = h - before
    alone = friction(rows, rubbing, before, go)
    a_alone = _approach(play, alone)
    # What speed is left is taken off by an impulse.
    impulse = jnp.maximum(play.rate + before * a_alone, 0.0) / w
    moving = []
    for i in range(3):
        a = rows.rest[i] + sum(rows.w[i][j] * alone[j] for j in range(3))
        moving.append(rows.moving[i] + before * a + impulse * u[i])
    rest = [a + b * play.rest / w for a, b in zip(rows.rest, u, strict=True)]
    coupled = [[rows.w[i][j] - u[i] * u[j] / w for j in range(3)] for i in range(3)]
    one = friction(rows._replace(rest=rest, w=coupled, moving=moving), rubbing, after, go)
    a_one = _approach(play, one)
    step = jnp.where(h > 0, h, 1.0)
    share = after / step
    f = [jnp.where(meets, share * c + (1.0 - share) * b, a) for a, b, c in zip(opened, alone, one, strict=True)]
    plain = impulse / step + share * jnp.maximum(a_one, 0.0) / w
    # At the step's end they touch, or are as far apart as what pulls them apart has brought them since.
    apart = 0.5 * jnp.minimum(a_one, 0.0) * after * after
    early = 2.0 * (play.rate / step + 0.5 * _approach(play, f) - (play.left + apart) / (step * step)) / w
    return f, jnp.where(meets, plain + lead * (early - plain), 0.0)


def _approach(play: Play, f: Sequence[Scalar]) -> Scalar:
    """Acceleration of the play's sides towards each other under friction, without thrust."""
    return play.rest - sum(a * b for a, b in zip(play.u, f, strict=True))


def mean_friction(v: Scalar, a_free: Scalar, w: Scalar, up: Scalar, down: Scalar, h: Scalar) -> Scalar:
    """Coulomb's friction averaged over a step.

    Args:
        v: velocity at the step's beginning.
        a_free: the axis' acceleration without its own friction.
        w: its inverse effective mass, 0 if it is locked.
        up, down: levels against positive and against negative motion.
        h: length of the step [s].
    """
    needed = -a_free / (w + _TINY)
    # Written out, because a clip between equal bounds has no gradient towards them.
    holding = jnp.where(needed < -up, -up, jnp.where(needed > down, down, needed))
    sliding = jnp.where(v > 0, -up, down)
    a_sliding = a_free + w * sliding
    slows = v * a_sliding < 0
    slowed_by = jnp.where(slows, a_sliding, 1.0) * (h + _TINY)
    share = jnp.where(slows, jnp.minimum(-v / slowed_by, 1.0), jnp.where(v == 0, 0.0, 1.0))
    return holding + share * (sliding - holding)
