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
# The sine's series on [-pi/2, pi/2], minimax (SLEEF, Shibata and Petrogalli 2020).
_SIN = (
    -7.97255955009037868891952e-18,
    2.81009972710863200091251e-15,
    -7.64712219118158833288484e-13,
    1.60590430605664501629054e-10,
    -2.50521083763502045810755e-08,
    2.75573192239198747630416e-06,
    -0.000198412698412696162806809,
    0.00833333333333332974823815,
    -0.166666666666666657414808,
)
_LN2 = (6.93145751953125e-1, 1.42860682030941723212e-6)


def on_processor() -> bool:
    """Whether programs run on a processor, where short loops are cheap and what a kernel writes to memory is not."""
    return jax.default_backend() == "cpu"


def materialise(tree: Any, go: Array) -> Any:
    """The same values, computed once.

    XLA's CPU back end copies a cheap producer into every consumer that it fuses, which makes code and time grow
    without bound along a chain of stages. It does not fuse across a conditional (an `optimization_barrier` is removed
    before fusion). On a graphics processor a step in one kernel, whatever it computes twice, is fourteen times faster
    than one with conditionals.

    Args:
        tree: arrays.
        go: true, unknown when compiling, and the same for a whole batch.
    """
    if not on_processor():
        return tree
    return jax.lax.cond(go, lambda t: t, lambda t: jax.tree.map(jnp.zeros_like, t), tree)


def _horner(coefficients: tuple[float, ...], z: Array) -> Array:
    total = jnp.full_like(z, coefficients[0])
    for coefficient in coefficients[1:]:
        total = total * z + coefficient
    return total


def _sine(angle: Array, half_turns: Array, shift: float) -> Array:
    """Sine of an angle less the nearest multiples of pi, and less `shift` quarter turns."""
    quarters = 2.0 * half_turns + shift
    r = ((angle - quarters * _HALF_PI[0]) - quarters * _HALF_PI[1]) - quarters * _HALF_PI[2]
    z = r * r
    sine = r + r * (z * _horner(_SIN, z))
    # Odd or even in floating point: integer conversions do not vectorise on every machine.
    odd = half_turns - 2.0 * jnp.floor(half_turns * 0.5)
    return jnp.where(odd == shift, sine, -sine)


@jax.custom_jvp
def sincos(angle: Array) -> tuple[Array, Array]:
    """Sine and cosine together.

    Two polynomials without a choice between them: a compiler that computes sine and cosine apart computes nothing
    twice.

    Args:
        angle: any shape [rad], magnitude below 1e5.

    Returns:
        `(sin(angle), cos(angle))`, within 2 units in the last place in float64.
    """
    turns = angle * (1 / jnp.pi)
    return _sine(angle, jnp.round(turns), 0.0), _sine(angle, jnp.round(turns - 0.5), 1.0)


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
