"""What stands between motor and cart, decided over a whole step beside dry friction: a play, or a belt that gives.

Both pass on a thrust that changes within a step: an impact is over at once, and a belt may ring several times. What
changes early in a step moves the position more than what changes late, and the velocity by as much. So the thrust has
two means over the step, a plain one and one weighted by the time left, which a method's stages take as they take an
input that changes (`runge_kutta.Method.leads`). Two masses under steady forces, without a damping of their own, then
move exactly as they should, in steps of any length. That they touch and part again within one step is not seen.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._math import decay, sincos
from .._types import Scalar
from .dry_friction import Rows, friction

_SLOW = 1e-8
"""Squared angle of a vibration in one step below which its series are exact."""


class Sides(NamedTuple):
    """Motor and cart at a step's beginning, as they near each other."""

    apart: Scalar
    """How far the motor is ahead of the cart [m],"""
    rate: Scalar
    """how fast that grows [m/s],"""
    rest: Scalar
    """and that speed's rate of change without friction and thrust [m/s^2]."""
    u: Sequence[Scalar]
    """What a unit of thrust does to each row of the friction problem; with the other sign, a force there to `rest`."""
    w: Scalar
    """What a unit of thrust does against `rest`."""

    def turned(self, side: Scalar) -> "Sides":
        """The same, counted positive to one side (1) or to the other (-1)."""
        return Sides(side * self.apart, side * self.rate, side * self.rest, tuple(side * u for u in self.u), self.w)

    def pulled(self, f: Sequence[Scalar]) -> Scalar:
        """`rest` under friction [m/s^2]."""
        return self.rest - sum(a * b for a, b in zip(self.u, f, strict=True))

    def coupled(self, rows: Rows, thrust: Scalar, per_rest: Scalar) -> Rows:
        """The friction problem where a thrust follows what pulls the sides apart: `thrust + per_rest * pulled(f)`."""
        pushed = thrust + per_rest * self.rest
        rest = [a + u * pushed for a, u in zip(rows.rest, self.u, strict=True)]
        w = [[rows.w[i][j] - per_rest * self.u[i] * self.u[j] for j in range(3)] for i in range(3)]
        return rows._replace(rest=rest, w=w)


def through_play(
    rows: Rows, sides: Sides, gap: Scalar, rubbing: Sequence[bool], h: Scalar, lead: Scalar | float, go: Array
) -> tuple[list[Scalar], Scalar]:
    """Friction beside a play whose sides meet inelastically.

    Where they meet within the step, friction is that of the axes before and after. From then on the sides move as one:
    a motor that friction holds carries any thrust, which sweeps between friction and thrust would approach but slowly.

    Args:
        rows, rubbing, h, go: see `friction`.
        sides: motor and cart.
        gap: total play [m].
        lead: see `runge_kutta.Method`.

    Returns:
        Friction of each row, and the thrust of the motor on the cart [N].
    """
    opened = friction(rows, rubbing, h, go)
    ends = sides.apart + h * sides.rate + 0.5 * h * h * sides.pulled(opened)
    side = jnp.where(ends < 0, -1.0, 1.0)
    sides = sides.turned(side)
    left, u, w = 0.5 * gap - sides.apart, sides.u, sides.w
    a_open = sides.pulled(opened)
    meets = sides.rate * h + 0.5 * h * h * a_open > left
    # Until they meet, from a distance with a speed.
    ahead = jnp.where(meets & (left > 0), left, 0.0)
    squared = sides.rate * sides.rate + 2.0 * a_open * ahead
    root = jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)
    speed = sides.rate + root
    nearing = jnp.where(speed > 0, 2.0 * ahead / jnp.where(speed > 0, speed, 1.0), 0.0)
    # Sides that part, and that are driven together again.
    back = meets & (sides.rate < 0) & (a_open > 0)
    before = jnp.minimum(jnp.where(back, (root - sides.rate) / jnp.where(back, a_open, 1.0), nearing), h)
    after = h - before
    alone = friction(rows, rubbing, before, go)
    # What speed is left is taken off by an impulse.
    impulse = jnp.maximum(sides.rate + before * sides.pulled(alone), 0.0) / w
    moving = []
    for i in range(3):
        a = rows.rest[i] + sum(rows.w[i][j] * alone[j] for j in range(3))
        moving.append(rows.moving[i] + before * a + impulse * u[i])
    one = friction(sides.coupled(rows._replace(moving=moving), jnp.zeros_like(w), 1.0 / w), rubbing, after, go)
    a_one = sides.pulled(one)
    step = jnp.where(h > 0, h, 1.0)
    share = after / step
    f = [jnp.where(meets, share * c + (1.0 - share) * b, a) for a, b, c in zip(opened, alone, one, strict=True)]
    plain = impulse / step + share * jnp.maximum(a_one, 0.0) / w
    # At the step's end they touch, or are as far apart as what pulls them apart has brought them since.
    parted = jnp.maximum(0.5 * jnp.minimum(a_one, 0.0) * after * after, -gap)
    early = 2.0 * (sides.rate / step + 0.5 * sides.pulled(f) - (left + parted) / (step * step)) / w
    return f, side * jnp.where(meets, plain + lead * (early - plain), 0.0)


class Belt(NamedTuple):
    """What holds the sides together."""

    stiffness: Scalar
    """[N/m]"""
    damping: Scalar
    """[N s/m]"""
    loss: Scalar
    """What the motor's own damping takes of its speed [1/s], 0 where that is in its row already,"""
    beyond: Scalar
    """and the speed beyond the cart's [m/s] with which `Sides.rest` has it: as the sides vibrate, it changes."""


def through_belt(
    rows: Rows, sides: Sides, belt: Belt, rubbing: Sequence[bool], h: Scalar, lead: Scalar | float, go: Array
) -> tuple[list[Scalar], Scalar]:
    """Friction beside a belt: under steady forces its sides vibrate about each other as in closed form.

    Args:
        rows, rubbing, h, go: see `friction`.
        sides: motor and cart.
        belt: between them.
        lead: see `runge_kutta.Method`.

    Returns:
        Friction of each row, and the thrust of the motor on the cart [N].
    """
    apart, rate, w = sides.apart, sides.rate, sides.w
    stiffness, damping, loss, beyond = belt
    square, a = w * stiffness, 0.5 * (w * damping + loss)
    step = jnp.where(h > 0, h, 1.0)
    one_less_c, s = _vibration(a * h, (square - a * a) * h * h)
    c = 1.0 - one_less_c
    # By the end of the step the speed has become `rate - slowed + h s (pulled + loss beyond)`: that tells the mean.
    slowed = rate * one_less_c + h * s * (square * apart + a * rate)
    thrust, per_rest = (slowed / step - s * loss * beyond) / w, (1.0 - s) / w
    f = friction(sides.coupled(rows, thrust, per_rest), rubbing, h, go)
    pulled = sides.pulled(f)
    plain = thrust + per_rest * pulled
    centre = (pulled + loss * beyond) / square
    off = apart - centre
    end = centre + c * off + h * s * (rate + a * off)
    early = (pulled - 2.0 * (end - apart - h * rate) / (step * step)) / w
    return f, plain + lead * (early - plain)


def _vibration(fading: Scalar, squared: Scalar) -> tuple[Scalar, Scalar]:
    """`1 - exp(-fading) cos b` and `exp(-fading) sin(b)/b`, with `b = sqrt(squared)`.

    Where `squared` is negative nothing rings, and these are the hyperbolic functions.
    """
    left = decay(fading)
    few = jnp.abs(squared) < _SLOW
    half = 0.5 * jnp.sqrt(jnp.where(few, 1.0, jnp.abs(squared)))
    sine, cosine = sincos(half)
    ringing = (2.0 * left * sine * sine, left * sine * cosine / half)
    slower, faster = decay(jnp.maximum(0.5 * fading - half, 0.0)), decay(0.5 * fading + half)  # to a half each
    spread = slower - faster
    creeping = (-0.5 * spread * spread, 0.25 * spread * (slower + faster) / half)
    series = (0.5 * left * squared, left * (1.0 - squared / 6.0))
    turned, s = (
        jnp.where(few, c, jnp.where(squared > 0, a, b)) for a, b, c in zip(ringing, creeping, series, strict=True)
    )
    return turned - jnp.expm1(-fading), s
