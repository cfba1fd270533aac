"""Velocity-controlled drives (an inner speed loop, or stiff viscous damping), solved in closed form over a step.

A loop that pulls with `rate (speed - v)` makes the velocity of an axis with inverse mass `w` approach its end as
`exp(-w rate t)`. Over a step of length `h`, under steady other forces and a setpoint that moves evenly, the mean
acceleration is `phi_1(z)` times that of the step's beginning and `phi_2(z)` times what the setpoint adds to it until
the step's end, with `z = w rate h` and `phi_1(z) = (1 - exp(-z))/z`, `phi_k(z) = (1/(k-1)! - phi_k-1(z))/z`. In the
mean that tells the way, weighted by the time left, `2 phi_2` and `2 phi_3` take their places (exponential integrators:
Hochbruck and Ostermann, Acta Numerica 2010, equation 2.11). So a loop of any stiffness keeps the rigid bridge's steps,
and in the limit the axis takes its speed within one of them. Friction on the axis is weighed against the loop's pull
in the same closed form.

A force limit is decided by the mean: a loop that would need more pulls with its limit over the whole step. So a step in
which the drive goes from one limit to the other errs in speed by up to `2 w limit h`: of order 1 in the step, where
without a limit the error is of order 2.
"""

import functools
import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from .._math import decay
from .._types import Scalar
from .dry_friction import Rows, friction

_TINY = 1e-30
"""Keeps finite the pull on a locked axis, whose inverse mass is 0."""
_FEW = 0.2
"""Argument below which the functions are taken from their series, since rounding would spoil their differences."""
_TERMS = 10
"""Terms of these series; the next one is below 1e-14."""


class Loop(NamedTuple):
    """The speed loop of one axis at a stage."""

    pull: Scalar
    """Force of the drive at the step's beginning, without its limit [N]."""
    gained: Scalar
    """What the setpoint adds to it until the step's end [N]."""
    rate: Scalar
    """Force per speed [N s/m]."""
    limit: Scalar | None
    """Largest force [N], None without one."""


class _Held(NamedTuple):
    """A loop as it acts over the step."""

    pull: Scalar
    gained: Scalar
    mean: tuple[Scalar, Scalar]
    """Shares of the acceleration at the beginning, and of what is gained, in the mean over the step."""
    early: tuple[Scalar, Scalar]
    """The same in the mean that tells the way."""


def held(
    rows: Rows, loops: Mapping[int, Loop], rubbing: list[bool], h: Scalar, lead: Scalar | float, go: Array
) -> tuple[list[Scalar], dict[int, Scalar]]:
    """Dry friction of every row beside speed loops, and the drives' forces, as means over a step [N, N m].

    Args:
        rows: the axes without their loops.
        loops: by row.
        rubbing: whether any friction acts on a row.
        h: length of the step [s].
        lead: see `runge_kutta.Method`.
        go: true, for `materialise`.
    """
    free = {}
    for i, loop in loops.items():
        first, second, third = shares(rows.w[i][i] * loop.rate * h)
        free[i] = _Held(loop.pull, loop.gained, (first, second), (2.0 * second, 2.0 * third))
    limits = {i: loop.limit for i, loop in loops.items() if loop.limit is not None}
    if not limits:
        return _pulled(rows, free, rubbing, h, lead, go)
    _, forces = _pulled(rows, free, rubbing, h, 0.0, go)
    limited = dict(free)
    for i, limit in limits.items():
        clipped = jnp.abs(forces[i]) > limit
        steady = jnp.clip(forces[i], -limit, limit)
        one, none = jnp.ones_like(steady), jnp.zeros_like(steady)
        always = _Held(steady, none, (one, none), (one, none))
        limited[i] = jax.tree.map(functools.partial(jnp.where, clipped), always, free[i])
    f, forces = _pulled(rows, limited, rubbing, h, lead, go)
    return f, forces | {i: jnp.clip(forces[i], -limit, limit) for i, limit in limits.items()}


def _pulled(
    rows: Rows, loops: Mapping[int, _Held], rubbing: list[bool], h: Scalar, lead: Scalar | float, go: Array
) -> tuple[list[Scalar], dict[int, Scalar]]:
    """Friction beside loops without a limit, and their forces."""
    before = []
    for i, loop in loops.items():
        w, rest = rows.w, rows.rest
        begun = [rest[j] + w[j][i] * loop.pull for j in range(3)]
        # Whatever else accelerates the axis, the loop takes back this share of it.
        back = (1.0 - loop.mean[0]) / (w[i][i] + _TINY)
        gained = loop.mean[1] * loop.gained
        before.append((i, loop, begun, w))
        rows = rows._replace(
            rest=[begun[j] + w[j][i] * (gained - back * begun[i]) for j in range(3)],
            w=[[w[j][k] - w[j][i] * back * w[i][k] for k in range(3)] for j in range(3)],
        )
    f = friction(rows, rubbing, h, go)
    forces: dict[int, Scalar] = {}
    for i, loop, begun, w in reversed(before):
        a = begun[i] + sum(w[i][k] * f[k] for k in range(3)) + sum(w[i][k] * force for k, force in forces.items())
        first, second = (mean + lead * (early - mean) for mean, early in zip(loop.mean, loop.early, strict=True))
        forces[i] = loop.pull + second * loop.gained - (1.0 - first) / (w[i][i] + _TINY) * a
    return f, forces


def shares(z: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """`phi_1`, `phi_2` and `phi_3` at `-z`, for `z >= 0`."""
    few = z < _FEW
    some, little = jnp.where(few, 1.0, z), jnp.where(few, z, 0.0)
    first = (1.0 - decay(some)) / some
    second = (1.0 - first) / some
    third = (0.5 - second) / some
    return (
        jnp.where(few, _series(1, little), first),
        jnp.where(few, _series(2, little), second),
        jnp.where(few, _series(3, little), third),
    )


def _series(k: int, z: Scalar) -> Scalar:
    value = jnp.zeros_like(z)
    for n in reversed(range(_TERMS)):
        value = 1.0 / math.factorial(n + k) - z * value
    return value
