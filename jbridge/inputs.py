"""Inputs on their way to the motors: held, late, clipped and scaled, for every integration step of a lane.

What has no memory, or is linear in time, is computed for a whole lane at once, before the time loop.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._types import Axes, Scalar
from .model.effects.base import AXIS_OF_SITE, AbstractDrive
from .model.effects.drives import InputDelay
from .model.plant import Plant

INSTANT = 1e-9
"""Time constant of a lag that is as good as none [s]."""


class Lane(eqx.Module):
    """A stretch of recording as the engine wants it. Times count from the recording's start, by its own clock."""

    start: Float[Array, ""]
    """Time of the first sample [s]."""
    dt: Float[Array, " time"]
    """Length of each interval [s]; 0 in padding."""
    u: Float[Array, "history 2"]
    """Held inputs of cart and hoist (input unit), of the intervals before the lane and then of the lane's."""
    before: Float[Array, " before"]
    """Lengths of the intervals before the lane [s], whose inputs a delay or lag still feels."""
    active: Axes
    """1 for an axis that moves, 0 for one that is locked or absent."""


class Drives(NamedTuple):
    """Inputs behind saturation, dead zone, gains and delay, for every step of every interval."""

    mean: Float[Array, "time step 2"]
    """Mean over the step: exact for the impulse."""
    early: Float[Array, "time step 2"]
    """Mean weighted by the time left to the step's end: exact for what the impulse does to the position."""
    lags: Float[Array, " 2"]
    """Initial values of the lags."""


def in_true_time(plant: Plant, lane: Lane) -> Lane:
    """The lane by true time, where the plant's recordings have a clock of their own."""
    scale = plant.time_scale()
    if isinstance(scale, float):
        return lane
    return Lane(lane.start * scale, lane.dt * scale, lane.u, lane.before * scale, lane.active)


def interval_edges(lane: Lane) -> Float[Array, " edge"]:
    """Beginnings of all intervals, those before the lane included, and the last end [s]."""
    spans = jnp.concatenate([lane.before, lane.dt])
    return jnp.concatenate([jnp.zeros(1, spans.dtype), jnp.cumsum(spans)]) + (lane.start - jnp.sum(lane.before))


def step_edges(plant: Plant, lane: Lane, substeps: int, *, cut: bool = True) -> Float[Array, "history edge"]:
    """Beginning of every step of every interval, those before the lane included, and the interval's end [s].

    A late input changes within intervals, and friction answers a change at once, not to its mean: so intervals are
    cut where the late input changes, and every part has its steps. (Where sampling is so uneven that an input changes
    twice in an interval, the second change counts by its moments.)

    Args:
        plant: what moves.
        lane: intervals.
        substeps: steps of an interval, or of every part of it.
        cut: whether intervals are cut; otherwise all changes count by their moments, in a third of the steps.
    """
    edges = interval_edges(lane)
    begin, end = edges[:-1], edges[1:]
    cuts = []
    for effect in plant.all(InputDelay) if cut else ():
        j = jnp.minimum(jnp.searchsorted(edges, begin - effect.delay, side="left"), edges.shape[0] - 1)
        late = edges[j] + effect.delay
        # Rounding may put a delay of whole intervals a hair before the interval.
        cuts.append(jnp.where(late < end, jnp.where(late < begin, begin, late), end))
    between = jnp.sort(jnp.stack(cuts, axis=1), axis=1) if len(cuts) > 1 else jnp.stack(cuts, axis=1) if cuts else None
    parts = [begin[:, None], end[:, None]] if between is None else [begin[:, None], between, end[:, None]]
    at = jnp.concatenate(parts, axis=1)
    inner = at[:, :-1, None] + jnp.diff(at, axis=1)[:, :, None] * (jnp.arange(substeps) / substeps)[None, None]
    return jnp.concatenate([inner.reshape(begin.shape[0], -1), end[:, None]], axis=1)


def drive_inputs(plant: Plant, lane: Lane, steps: Float[Array, "history edge"] | None = None) -> Drives:
    """What the drives are given over the lane, for cart and hoist.

    Args:
        plant: what moves.
        lane: held inputs.
        steps: see `step_edges`; by default every interval is one step.
    """
    edges = interval_edges(lane)
    n = lane.before.shape[0]
    if steps is None:
        steps = jnp.stack([edges[:-1], edges[1:]], axis=1)
    count, many = steps.shape[0], steps.shape[1] - 1
    means, earlies, lags = [], [], []
    constants = plant.time_constants()
    for column, axis in enumerate(("x", "l")):
        w = lane.u[:, column]
        chain = [effect for effect in plant.all(AbstractDrive) if AXIS_OF_SITE[effect.site] == axis]
        chain.sort(key=lambda effect: effect.order)
        for effect in chain:
            if not effect.in_time:
                w = plant.after(functools.partial(effect.apply, edges[:-1]), w, effect)
        # What has no memory and no clock may stand before the delay as well as behind it.
        late = [effect for effect in plant.all(InputDelay) if AXIS_OF_SITE[effect.site] == axis]
        mean = early = jnp.broadcast_to(w[:, None], (count, many))
        if late:
            delay = sum((effect.delay for effect in late[1:]), late[0].delay)

            def delayed(_: tuple[Array, Array], w: Array = w, delay: Scalar = delay) -> tuple[Array, Array]:
                return _delayed(edges, w, steps[:, :-1], steps[:, 1:], delay)

            mean, early = plant.after(delayed, (mean, early), *late)
        middle = 0.5 * (steps[:, :-1] + steps[:, 1:])
        for effect in chain:
            if effect.in_time:
                law = functools.partial(effect.apply, middle)
                mean, early = plant.after(law, mean, effect), plant.after(law, early, effect)
        constant = jnp.maximum(getattr(constants, axis), INSTANT)
        # Outside the time loop the library's exponential costs nothing.
        fading = jnp.exp(-(lane.start - steps[:n]) / constant)
        lags.append(jnp.sum(mean[:n] * jnp.diff(fading, axis=1)))
        means.append(mean[n:])
        earlies.append(early[n:])
    return Drives(jnp.stack(means, axis=2), jnp.stack(earlies, axis=2), jnp.stack(lags))


def _delayed(edges: Array, w: Array, begin: Array, end: Array, delay: Scalar) -> tuple[Array, Array]:
    """A held input late by `delay` over spans of time: its mean, and its mean weighted by the time left."""
    held = jnp.diff(edges)
    once = jnp.concatenate([jnp.zeros(1, w.dtype), jnp.cumsum(w * held)])
    twice = jnp.concatenate([jnp.zeros(1, w.dtype), jnp.cumsum((once[:-1] + 0.5 * w * held) * held)])

    def integrals(t: Array) -> tuple[Array, Array]:
        k = jnp.clip(jnp.searchsorted(edges, t, side="right") - 1, 0, w.shape[0] - 1)
        since = jnp.maximum(t - edges[k], 0.0)
        return once[k] + w[k] * since, twice[k] + (once[k] + 0.5 * w[k] * since) * since

    (first, first_twice), (last, last_twice) = integrals(begin - delay), integrals(end - delay)
    span = jnp.where(end > begin, end - begin, 1.0)
    # The integral of (end - t) w(t) over a span is what the integral of w gains over it.
    gained = last_twice - first_twice - (end - begin) * first
    return (last - first) / span, 2.0 * gained / (span * span)
