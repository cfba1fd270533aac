"""Which equation or sensor fails: one smooth unknown force or signal at each place in turn, and the evidence for each.

An unknown force on an axis is a Gaussian process in time with a Matern covariance of smoothness 3/2, which a linear
system of two states plays exactly (Hartikainen and Sarkka, Kalman filtering and smoothing solutions to temporal
Gaussian process regression models, MLSP 2010; for mechanics: Alvarez, Luengo and Lawrence, Latent force models, 2009).
Beside the bridge's own linearised motion a Kalman filter gives the probability of the recordings with it, and a
smoother the force, also where the axis reverses. A sensor's unknown signal adds to its reading and moves nothing.

The bridge is linearised along the motion that was measured: smoothed forces on all axes, put into the simulation, keep
it there, however far it would run away by itself.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._programs import kept, returned
from .._types import AXES
from ..model.effects.base import CART, HOIST, L_SENSOR, PSI_SENSOR, SWING, X_SENSOR
from ..model.parameters import ParameterTable
from ..rollout import Motions, readings
from .lanes import Batch, Lanes, refined
from .respond import FORCES, Along, linearise

_ROUNDS = 4
"""Times that the bridge is linearised along the motion with the forces found so far."""
_PERIOD = 0.0095
"""Least time between readings that the filter takes in [s]: forces are slower, and filters of every reading cost more
than they tell."""
_SPANS = (0.05, 0.3, 2.0, 20.0)
"""Times within which a force or signal changes [s]; the last is as good as never."""
_FORCES = (1.0, 1 / 4, 1 / 16, 1 / 64)
"""Standard deviations of a force, over that of the force balance, which noise makes too large."""
_SIGNALS = (64.0, 16.0, 4.0)
"""Standard deviations of a sensor's signal, over its noise."""
_QUICK = 0.15
"""Time within which the forces change that keep the simulation on its track [s]."""
_NOTHING = 1e-9
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
    spread: Float[_Numbers, "*lane state"]
    """Standard deviation of the initial state about its first guess."""
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


@returned
class Seen(NamedTuple):
    """Readings of a linearised trajectory, and how they change with its state."""

    predicted: Float[Array, "lane sample 3"]
    to_state: Float[Array, "lane sample 3 state"]


@kept(static=(0,))
def _seen(table: ParameterTable, vector: Float[Array, " parameter"], lanes: Lanes, along: Along) -> Seen:
    def one(lanes: Lanes, along: Along) -> Seen:
        plant = table.unravel(jnp.where(lanes.override_at > 0, lanes.override_to, vector))
        _, restore = ravel_pytree(jax.tree.map(lambda leaf: leaf[0], along.motions))
        count = along.to_state.shape[-1]

        def read(motions: Motions) -> Array:
            return readings(plant, lanes.lane, motions)

        def push(direction: Array) -> tuple[Array, Array]:
            tangent = jax.tree.map(lambda leaf, value: jnp.full_like(leaf, value), along.motions, restore(direction))
            return jax.jvp(read, (along.motions,), (tangent,))

        predicted, tangents = jax.vmap(push, out_axes=(None, 2))(jnp.eye(count))
        return Seen(predicted, tangents)

    return jax.vmap(one)(lanes, along)


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
    return mean, _stationary(prior, states).at[:states, :states].set(jnp.diag(steps.spread**2))


def _each(steps: Steps) -> Steps:
    """The same with an axis of steps everywhere, for a loop over them."""
    nothing = jnp.zeros(steps.span.shape)
    return steps._replace(spread=nothing, start=nothing)


def _evidence(prior: Prior, steps: Steps) -> Array:
    """Log probability of a lane's readings, up to what no prior changes."""

    def step(carry: tuple[Array, Array, Array], now: Steps) -> tuple[tuple[Array, Array, Array], None]:
        mean, cov, total = carry
        moved = _predicted(prior, mean, cov, now)
        mean, cov, told, _ = _updated(_rows(prior, now), now, moved.mean, moved.cov)
        return (mean, cov, total + told), None

    each = _each(steps)
    return jax.lax.scan(step, (*_begin(prior, steps), jnp.zeros(())), each)[0][2]


def _smoothed(prior: Prior, steps: Steps) -> tuple[Array, Array, Array]:
    """Mean and standard deviation of every force and signal at the steps' ends, and the mean initial state.

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
    return mean, std, (begin[0] - begin[1] @ slope)[:states]


@kept()
def _weigh(priors: Prior, steps: Steps) -> Float[Array, "row lane"]:
    return jax.vmap(lambda prior: jax.vmap(lambda lane: _evidence(prior, lane))(steps))(priors)


@kept()
def _smooth(prior: Prior, steps: Steps) -> tuple[Float[Array, "lane step latent"], ...]:
    return jax.vmap(lambda lane: _smoothed(prior, lane))(steps)


@dataclasses.dataclass(frozen=True)
class Force:
    """Smoothed unknown forces on all axes along one recording."""

    times: NDArray[np.float64]
    """From the recording's start [s], `(time,)`."""
    mean: NDArray[np.float64]
    """On `x, psi, l` [N, N m, N], `(time, 3)`."""
    std: NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Latent:
    """What recordings say of unknown forces and signals beside a model."""

    evidence: dict[str, float]
    """Log probability of the recordings with one at each site, over that with none."""
    forces: tuple[Force, ...]
    """By recording."""


def unknown_forces(
    table: ParameterTable,
    vector: NDArray[np.float64],
    batch: Batch,
    initial: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> Latent:
    """Evidence for an unknown force or signal at each site, and the forces.

    Args:
        table: of the model's parameters.
        vector: their values.
        batch: whole recordings.
        initial: initial states of the lanes.
        scale: plausible size of a force on each axis [N, N m, N]; 0 where nothing moves.
    """
    fine = refined(batch.lanes, batch.substeps)
    lane = batch.lanes.lane
    period = float(np.median(np.asarray(lane.dt)[0]))
    stride = max(1, round(_PERIOD / period))
    moving = np.stack([np.asarray(getattr(lane.active, axis)) for axis in AXES], axis=1)
    every = _on_every_axis(np.where(moving.any(axis=0), scale, 0.0), np.full(3, _QUICK))
    force = np.zeros((*np.asarray(fine.lane.dt).shape, 3))
    start = initial.copy()
    sites, priors = _candidates(scale, batch, moving)
    told = np.full(len(sites) + 1, -np.inf)
    for i in range(_ROUNDS):
        along = linearise(table, vector, start, fine, force)
        steps = _steps(table, vector, batch, along, force, start, stride)
        if i in (0, _ROUNDS - 1):
            # Along the model's own motion it is exact that nothing is missing, along the measured one what is.
            weighed = np.asarray(_weigh(priors, steps)).sum(axis=1)
            told = np.fmax(told, np.where(np.isfinite(weighed), weighed, -np.inf))
        if i == _ROUNDS - 1:
            break
        mean, _, first = (np.asarray(part) for part in _smooth(every, steps))
        coordinates = len(jax.tree.leaves(along.motions.q))
        start[:, :3] += first[:, :3]
        start[:, 3:6] += first[:, coordinates : coordinates + 3]
        held = np.repeat(mean, stride * batch.substeps, axis=1)[:, : force.shape[1]]
        force = np.zeros_like(force)
        force[:, : held.shape[1]] = held * moving[:, None]
    sane = told[np.isfinite(told)]
    # Beside a simulation that runs away nothing is worst, if it can be weighed at all.
    nothing = float(told[-1]) if np.isfinite(told[-1]) else float(sane.min(initial=0.0))
    evidence: dict[str, float] = {}
    best = {}
    for i, site in enumerate(sites):
        if np.isfinite(told[i]) and float(told[i]) - nothing > evidence.get(site, -np.inf):
            evidence[site], best[site] = float(told[i]) - nothing, i
    rows = [best.get(site) for site in _FORCE_SITES]
    size = np.array([0.0 if i is None else float(priors.size[i, 0]) for i in rows])
    length = np.array([_QUICK if i is None else float(priors.length[i, 0]) for i in rows])
    mean, std, _ = (np.asarray(part) for part in _smooth(_on_every_axis(size, length), steps))
    span = np.asarray(steps.span)
    counts = [int(np.count_nonzero(span[i])) for i in range(len(batch.grids))]
    times = np.cumsum(span, axis=1)
    return Latent(evidence, tuple(Force(times[i, :n], mean[i, :n], std[i, :n]) for i, n in enumerate(counts)))


_FORCE_SITES = (CART, SWING, HOIST)
_SIGNAL_SITES = (X_SENSOR, PSI_SENSOR, L_SENSOR)


def _on_every_axis(size: NDArray[np.float64], length: NDArray[np.float64]) -> Prior:
    return Prior(np.eye(3), np.zeros((3, 3)), np.maximum(size, _NOTHING), length)


def _candidates(scale: NDArray[np.float64], batch: Batch, moving: NDArray[np.float64]) -> tuple[list[str], Prior]:
    """Sites in turn with all sizes and spans, and as the last row nothing at all."""
    sites: list[str] = []
    rows: list[tuple] = []
    weight = np.asarray(batch.lanes.weight)
    for k in range(3):
        here, none = np.eye(3)[[k]], np.zeros((1, 3))
        sharpest = float(weight[:, :, k].max())
        if moving[:, k].any() and scale[k] > 0:
            sites += [_FORCE_SITES[k]] * (len(_FORCES) * len(_SPANS))
            rows += [(here, none, [share * scale[k]], [span]) for share in _FORCES for span in _SPANS]
        if sharpest > 0:
            sites += [_SIGNAL_SITES[k]] * (len(_SIGNALS) * len(_SPANS))
            rows += [(none, here, [times / sharpest], [span]) for times in _SIGNALS for span in _SPANS]
    rows.append((np.zeros((1, 3)), np.zeros((1, 3)), [_NOTHING], [1.0]))
    return sites, Prior(*(np.array([row[i] for row in rows], float) for i in range(4)))


def _steps(
    table: ParameterTable,
    vector: NDArray[np.float64],
    batch: Batch,
    along: Along,
    force: NDArray[np.float64],
    start: NDArray[np.float64],
    stride: int,
) -> Steps:
    """Integration steps gathered between the readings that are used."""
    sampled = jax.tree.map(lambda leaf: np.asarray(leaf)[:, :: batch.substeps], along.motions)
    seen = _seen(table, vector, batch.lanes, along._replace(motions=sampled))
    dt = np.asarray(batch.lanes.lane.dt)
    lanes, count = dt.shape[0], dt.shape[1] // stride
    group = stride * batch.substeps

    def gathered(values: _Numbers) -> NDArray[np.float64]:
        return np.asarray(values)[:, : count * group].reshape(lanes, count, group, *values.shape[2:])

    each_a, each_b = gathered(along.to_state), gathered(np.asarray(along.to_ports)[..., FORCES])
    a, b = each_a[:, :, 0], each_b[:, :, 0]
    for i in range(1, group):
        a, b = each_a[:, :, i] @ a, each_a[:, :, i] @ b + each_b[:, :, i]
    at = slice(stride, count * stride + 1, stride)
    coordinates = len(jax.tree.leaves(along.motions.q))
    spread, guess = np.zeros((lanes, a.shape[-1])), np.zeros((lanes, a.shape[-1]))
    tight, away = np.where(batch.prior > 0, batch.prior, np.inf), batch.initial - start
    for part in (slice(0, 3), slice(3, 6)):
        place = part if part.start == 0 else slice(coordinates, coordinates + 3)
        spread[:, place], guess[:, place] = 1.0 / tight[:, part], away[:, part]
    return Steps(
        a,
        b,
        np.asarray(seen.to_state)[:, at],
        dt[:, : count * stride].reshape(lanes, count, stride).sum(axis=2),
        (np.asarray(batch.lanes.y) - np.asarray(seen.predicted))[:, at],
        np.asarray(batch.lanes.weight)[:, at],
        gathered(force).mean(axis=2),
        spread,
        guess,
    )
