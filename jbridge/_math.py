"""Elementary functions that vectorise.

XLA's CPU back end calls a scalar library routine for every float64 sine, cosine and exponential, and in a rollout
that is most of the time. Range reduction and a polynomial are a few fused multiply-adds that vectorise over lanes.
Accuracy is held by a test in units in the last place.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

# pi/2 in three pieces, each exact in its leading bits (Cody and Waite 1980), so that `x - k * pi/2` loses nothing for
# the angles that a load can reach.
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_SIN = (
    1.58962301576546568060e-10,
    -2.50507477628578072866e-8,
    2.75573136213857245213e-6,
    -1.98412698295895385996e-4,
    8.33333333332211858878e-3,
    -1.66666666666666307295e-1,
)
_COS = (
    -1.13585365213876817300e-11,
    2.08757008419747316778e-9,
    -2.75573141792967388112e-7,
    2.48015872888517045348e-5,
    -1.38888888888730564116e-3,
    4.16666666666665929218e-2,
)
_LN2 = (6.93145751953125e-1, 1.42860682030941723212e-6)


def materialise(tree: Any, go: Array) -> Any:
    """The same values, computed once.

    XLA's CPU back end copies a cheap producer into every consumer that it fuses, which makes code and time grow
    without bound along a chain of stages. It does not fuse across a conditional (an `optimization_barrier` is removed
    before fusion).

    Args:
        tree: arrays.
        go: true, unknown when compiling, and the same for a whole batch.
    """
    return jax.lax.cond(go, lambda t: t, lambda t: jax.tree.map(jnp.zeros_like, t), tree)


def _horner(coefficients: tuple[float, ...], z: Array) -> Array:
    total = jnp.full_like(z, coefficients[0])
    for coefficient in coefficients[1:]:
        total = total * z + coefficient
    return total


@jax.custom_jvp
def sincos(angle: Array) -> tuple[Array, Array]:
    """Sine and cosine together.

    Args:
        angle: any shape [rad], magnitude below 1e5.

    Returns:
        `(sin(angle), cos(angle))`, within 2 units in the last place in float64 (polynomials of Cephes, Moshier 1992).
    """
    quadrant = jnp.round(angle * (2 / jnp.pi))
    r = ((angle - quadrant * _HALF_PI[0]) - quadrant * _HALF_PI[1]) - quadrant * _HALF_PI[2]
    z = r * r
    sine = r + r * z * _horner(_SIN, z)
    cosine = 1.0 - 0.5 * z + z * z * _horner(_COS, z)
    # The quadrant modulo 4 in floating point: integer conversions do not vectorise on every machine.
    turn = quadrant - 4.0 * jnp.floor(quadrant * 0.25)
    swap = (turn == 1.0) | (turn == 3.0)
    sine, cosine = jnp.where(swap, cosine, sine), jnp.where(swap, sine, cosine)
    sine = jnp.where(turn >= 2.0, -sine, sine)
    cosine = jnp.where((turn == 1.0) | (turn == 2.0), -cosine, cosine)
    return sine, cosine


@sincos.defjvp
def _sincos_jvp(primals: Any, tangents: Any) -> Any:
    sine, cosine = sincos(primals[0])
    return (sine, cosine), (cosine * tangents[0], -sine * tangents[0])


@jax.custom_jvp
def decay(x: Array) -> Array:
    """`exp(-x)` for `x >= 0`; negative arguments are taken as 0, and the result is 0 beyond 700.

    Args:
        x: any shape, dimensionless.

    Returns:
        `exp(-x)`, within 4 units in the last place in float64 down to 1e-300.
    """
    limited = jnp.clip(x, 0.0, 700.0)
    k = jnp.round(limited * 1.4426950408889634)
    r = -((limited - k * _LN2[0]) - k * _LN2[1])
    series = jnp.ones_like(r)
    for n in range(13, 0, -1):
        series = 1.0 + series * r / n
    # 2**-k without a library call: k <= 1010 is split into ten binary powers.
    power = jnp.ones_like(r)
    rest = k
    for bit in range(9, -1, -1):
        value = float(2**bit)
        taken = rest >= value
        power = jnp.where(taken, power * 2.0**-value, power)
        rest = jnp.where(taken, rest - value, rest)
    return jnp.where(x > 700.0, 0.0, series * power)


@decay.defjvp
def _decay_jvp(primals: Any, tangents: Any) -> Any:
    value = decay(primals[0])
    return value, -value * tangents[0]
