"""Kalman filter and smoother of unknown forces and signals beside a linear motion.

An unknown is a Gaussian process in time with a Matern covariance of smoothness 3/2, which a linear system of two
states plays exactly (Hartikainen and Sarkka, Kalman filtering and smoothing solutions to temporal Gaussian process
regression models, MLSP 2010).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._programs import kept

_Numbers = Array | np.ndarray


class Steps(NamedTuple):
    """Linearised motion of lanes between the readings that are used, and those readings."""

    a: Float[_Numbers, "*lane step state state"]
    b: Float[_Numbers, "*lane step state 3"]
    """To forces held over the step."""
    c: Float[_Numbers, "*lane step 3 state"]
    span: Float[_Numbers, "*lane step"]
    """Length of each step [s]; 0 behind the lane's end."""
    error: Float[_Numbers, "*lane step 3"]
    """Measured less simulated at the step's end [m, rad, m]."""
    weight: Float[_Numbers, "*lane step 3"]
    """One over the noise, 0 where nothing was measured."""
    force: Float[_Numbers, "*lane step 3"]
    """Forces that the simulation contains already [N, N m, N]."""
    spread: Float[_Numbers, "*lane state state"]
    """Covariance of the initial state about its first guess."""
    start: Float[_Numbers, "*lane state"]
    """That guess less the simulation's initial state."""


class Prior(NamedTuple):
    """Unknown forces and signals before anything was measured."""

    drive: Float[_Numbers, "*row latent 3"]
    """1 for the axis that it drives."""
    signal: Float[_Numbers, "*row latent 3"]
    """1 for the channel that it adds to."""
    size: Float[_Numbers, "*row latent"]
    """Standard deviation [N, N m or m, rad]."""
    length: Float[_Numbers, "*row latent"]
    """Correlation length [s]."""


class _Moved(NamedTuple):
    mean: Array
    cov: Array
    f: Array


def _predicted(prior: Prior, mean: Array, cov: Array, now: Steps) -> _Moved:
    """Mean and covariance at a step's end, before its readings."""
    states, count = now.a.shape[0], prior.size.shape[0]
    rate = jnp.sqrt(3.0) / prior.length
    decay = jnp.exp(-rate * now.span)
    whole = jnp.zeros((states + 2 * count,) * 2)
    at, dot = slice(states, states + count), slice(states + count, states + 2 * count)
    whole = whole.at[:states, :states].set(now.a).at[:states, at].set(now.b @ prior.drive.T)
    whole = whole.at[at, at].set(jnp.diag(decay * (1.0 + rate * now.span)))
    whole = whole.at[at, dot].set(jnp.diag(decay * now.span))
    whole = whole.at[dot, at].set(jnp.diag(-decay * rate**2 * now.span))
    whole = whole.at[dot, dot].set(jnp.diag(decay * (1.0 - rate * now.span)))
    still = _stationary(prior, states)
    own = whole.at[:states].set(0.0)
    noise = still - own @ still @ own.T
    mean = whole @ mean - jnp.concatenate([now.b @ now.force, jnp.zeros(2 * count)])
    return _Moved(mean, whole @ cov @ whole.T + noise, whole)


def _stationary(prior: Prior, states: int) -> Array:
    size = jnp.asarray(prior.size)
    return jnp.diag(jnp.concatenate([jnp.zeros(states), size**2, 3.0 * (size / prior.length) ** 2]))


def _rows(prior: Prior, now: Steps) -> Array:
    """How each weighted reading depends on the state."""
    signal = jnp.concatenate([prior.signal.T, jnp.zeros_like(prior.signal.T)], axis=1)
    return jnp.asarray(now.weight)[:, None] * jnp.concatenate([now.c, signal], axis=1)


def _updated(rows: Array, now: Steps, mean: Array, cov: Array) -> tuple[Array, Array, Array, list]:
    """Mean and covariance with a step's readings, one channel at a time, and the log probability of these."""
    told, gains = jnp.zeros(()), []
    for k in range(3):
        row = rows[k]
        seen = cov @ row
        size = row @ seen + 1.0
        surprise = jnp.where(now.weight[k] > 0, now.weight[k] * now.error[k] - row @ mean, 0.0)
        told -= jnp.where(now.weight[k] > 0, 0.5 * (surprise**2 / size + jnp.log(size)), 0.0)
        gain = seen / size
        mean, cov = mean + gain * surprise, cov - jnp.outer(gain, seen)
        gains.append((row, gain, size, surprise))
    return mean, cov, told, gains


def _begin(prior: Prior, steps: Steps) -> tuple[Array, Array]:
    states = steps.spread.shape[0]
    size = states + 2 * prior.size.shape[0]
    mean = jnp.zeros(size).at[:states].set(steps.start)
    return mean, _stationary(prior, states).at[:states, :states].set(steps.spread)


def _each(steps: Steps) -> Steps:
    """The same with an axis of steps everywhere, for a loop over them."""
    nothing = jnp.zeros(steps.span.shape)
    return steps._replace(spread=nothing, start=nothing)


def evidence(prior: Prior, steps: Steps) -> Array:
    """Log probability of a lane's readings, up to what no prior changes."""

    def step(carry: tuple[Array, Array, Array], now: Steps) -> tuple[tuple[Array, Array, Array], None]:
        mean, cov, total = carry
        moved = _predicted(prior, mean, cov, now)
        mean, cov, told, _ = _updated(_rows(prior, now), now, moved.mean, moved.cov)
        return (mean, cov, total + told), None

    each = _each(steps)
    return jax.lax.scan(step, (*_begin(prior, steps), jnp.zeros(())), each)[0][2]


def smoothed(prior: Prior, steps: Steps) -> tuple[Array, Array, Array, Array]:
    """Mean and standard deviation of every force and signal at the steps' ends, their mean before the first step, and
    the mean initial state.

    The smoother is Bryson's and Frazier's, which inverts no covariance: those of a sticking cart are singular.
    """
    states, count = steps.spread.shape[0], prior.size.shape[0]
    each = _each(steps)

    def forward(carry: tuple[Array, Array], now: Steps) -> tuple[tuple[Array, Array], _Moved]:
        moved = _predicted(prior, *carry, now)
        mean, cov, _, _ = _updated(_rows(prior, now), now, moved.mean, moved.cov)
        return (mean, cov), moved

    def backward(carry: tuple[Array, Array], now: tuple[Steps, _Moved]) -> tuple[tuple[Array, Array], tuple]:
        slope, curve = carry
        step, moved = now
        _, _, _, gains = _updated(_rows(prior, step), step, moved.mean, moved.cov)
        for row, gain, size, surprise in reversed(gains):
            left = jnp.eye(row.shape[0]) - jnp.outer(gain, row)
            slope = left.T @ slope - row * surprise / size
            curve = left.T @ curve @ left + jnp.outer(row, row) / size
        mean = moved.mean - moved.cov @ slope
        cov = moved.cov - moved.cov @ curve @ moved.cov
        at = slice(states, states + count)
        told = mean[at], jnp.sqrt(jnp.maximum(jnp.diag(cov)[at], 0.0))
        return (moved.f.T @ slope, moved.f.T @ curve @ moved.f), told

    begin = _begin(prior, steps)
    _, moved = jax.lax.scan(forward, begin, each)
    none = jax.tree.map(jnp.zeros_like, begin)
    (slope, _), (mean, std) = jax.lax.scan(backward, none, (each, moved), reverse=True)
    first = begin[0] - begin[1] @ slope
    return mean, std, first[states : states + count], first[:states]


@kept()
def weigh(priors: Prior, steps: Steps) -> Float[Array, "row lane"]:
    """Log probability of every lane's readings under every prior, up to what no prior changes."""
    return jax.vmap(lambda prior: jax.vmap(lambda lane: evidence(prior, lane))(steps))(priors)


@kept()
def smooth(prior: Prior, steps: Steps) -> tuple[Array, Array, Array, Array]:
    """What `smoothed` says of every lane."""
    return jax.vmap(lambda lane: smoothed(prior, lane))(steps)
