"""Inputs on their way to the motors: held, late, clipped and scaled, for every integration step of a lane.

What has no memory, or is linear in time, is computed for a whole lane at once, before the time loop.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._types import Axes, Scalar
from ..model.effects.base import AXIS_OF_SITE, AbstractDrive
from ..model.effects.drives import AbstractDelay, InputDelay, StartDelay
from ..model.plant import E, Plant

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


class Held(NamedTuple):
    """An axis' held inputs behind what has no memory and no clock, and their integrals where they may come late."""

    inputs: Float[Array, " history"]
    acts: Float[Array, " history"]
    """From when in its interval an input acts [s]: from the interval's beginning, but for a drive that starts late."""
    once: Float[Array, " edge"] | None
    twice: Float[Array, " edge"] | None


class Supply(NamedTuple):
    """What is known of a lane's inputs as a whole, see `arriving`."""

    edges: Float[Array, " edge"]
    """See `interval_edges`."""
    x: Held
    l: Held


def supply(plant: Plant, lane: Lane) -> Supply:
    """The held inputs of a lane behind saturation, dead zone and gains."""
    edges = interval_edges(lane)
    begin, spans = edges[:-1], jnp.diff(edges)

    def applied(effect: AbstractDrive, w: Array) -> Array:
        return effect.apply(begin, w)

    found = []
    for column, axis in enumerate(("x", "l")):
        w = lane.u[:, column]
        w = plant.after_each(applied, w, (effect for effect in _chain(plant, axis) if not effect.in_time))

        def started(effect: StartDelay, acts: Array, w: Array = w) -> Array:
            return jnp.maximum(acts, jnp.minimum(_run_begins(edges, w) + effect.delay, edges[1:]))

        acts = plant.after_each(started, begin, _on(plant, axis, StartDelay))
        once = twice = None
        late = _on(plant, axis, AbstractDelay)
        if late:
            none = jnp.zeros_like(edges)

            def integrals(_: tuple[Array, Array], w: Array = w, acts: Array = acts) -> tuple[Array, Array]:
                acting = edges[1:] - acts
                once = jnp.concatenate([jnp.zeros(1, w.dtype), jnp.cumsum(w * acting)])
                gained = once[:-1] * spans + 0.5 * w * acting * acting
                return once, jnp.concatenate([jnp.zeros(1, w.dtype), jnp.cumsum(gained)])

            once, twice = plant.after(integrals, (none, none), *late)
        found.append(Held(w, acts, once, twice))
    return Supply(edges, *found)


def _run_begins(edges: Array, w: Array) -> Array:
    """When the run of inputs other than zero began that an interval belongs to; if its input is 0, when it ends."""
    none = jnp.where(w == 0.0, jnp.arange(w.shape[0]) + 1, 0)
    return edges[jnp.minimum(jax.lax.cummax(none), w.shape[0] - 1)]


def _chain(plant: Plant, axis: str) -> list[AbstractDrive]:
    return sorted(_on(plant, axis, AbstractDrive), key=lambda effect: effect.order)


def _on(plant: Plant, axis: str, cls: type[E]) -> list[E]:
    """Effects of a class at an axis' drive."""
    return [effect for effect in plant.all(cls) if AXIS_OF_SITE[effect.site] == axis]


def _dead_time(plant: Plant, axis: str) -> Scalar | float:
    """What delays every change of an axis' input [s]."""
    return sum((effect.delay for effect in _on(plant, axis, InputDelay)), 0.0)


def _interval_at(edges: Array, t: Array) -> Array:
    return jnp.clip(jnp.searchsorted(edges, t, side="right") - 1, 0, edges.shape[0] - 2)


def step_edges(plant: Plant, given: Supply, substeps: int) -> Float[Array, "history edge"]:
    """Beginning of every step of every interval, those before the lane included, and the interval's end [s].

    A late input changes within intervals, and friction answers a change at once, not to its mean: so intervals are
    cut where the late input changes, and every part has its steps. (Where sampling is so uneven that an input changes
    twice in an interval, the second change counts by its moments.)

    Args:
        plant: what moves.
        given: the lane's held inputs.
        substeps: steps of an interval, or of every part of it.
    """
    begin, end = given.edges[:-1], given.edges[1:]
    cuts = [_change(plant, given, late, begin, end) for late in plant.all(AbstractDelay)]
    hair, parts = _hair(given.edges, begin, end), [begin]
    for change in jnp.sort(jnp.stack(cuts), axis=0) if len(cuts) > 1 else cuts:
        parts.append(jnp.where(change < parts[-1] + hair, parts[-1], jnp.where(change > end - hair, end, change)))
    return _divided(jnp.stack([*parts, end], axis=1), substeps)


def fixed_steps(
    plant: Plant, given: Supply, edges: Float[Array, " edge"], substeps: int
) -> Float[Array, "interval step"]:
    """The same of some intervals with a fixed number of steps, a third as many: edges within an interval lie evenly,
    but for the one nearest to where a late input changes, which is moved there. Where there is no edge to be moved, or
    another change has moved it, a change counts by its moments.

    Args:
        plant: what moves.
        given: the lane's held inputs.
        edges: of the intervals [s].
        substeps: steps of an interval.
    """
    begin, end = edges[:-1], edges[1:]
    steps = _divided(jnp.stack([begin, end], axis=1), substeps)
    if substeps < 2:
        return steps
    hair, number = _hair(given.edges, begin, end), jnp.arange(substeps + 1.0, dtype=steps.dtype)

    def moved(late: AbstractDelay, steps: Array) -> Array:
        change = _change(plant, given, late, begin, end)
        share = (change - begin) / jnp.where(end > begin, end - begin, 1.0)
        nearest = jnp.clip(jnp.round(substeps * share), 1, substeps - 1)
        within = (change > begin + hair) & (change < end - hair)
        return jnp.where(within[:, None] & (number[None] == nearest[:, None]), change[:, None], steps)

    return plant.after_each(moved, steps, plant.all(AbstractDelay))


def _hair(edges: Array, begin: Array, end: Array) -> Array:
    """By how much rounding may put a change beside an edge or another one [s]: no force is judged between the two."""
    return 1e-9 * (end - begin) + 4.0 * jnp.finfo(edges.dtype).eps * jnp.max(jnp.abs(edges))


def _change(plant: Plant, given: Supply, late: AbstractDelay, begin: Array, end: Array) -> Array:
    """When a late input changes in some intervals [s], at an end of those in which it does not."""
    edges, hair, axis = given.edges, _hair(given.edges, begin, end), AXIS_OF_SITE[late.site]
    delay, held = _dead_time(plant, axis), given.x if axis == "x" else given.l
    if isinstance(late, InputDelay):
        j = jnp.minimum(jnp.searchsorted(edges, begin - delay + hair, side="left"), edges.shape[0] - 1)
        return jnp.clip(edges[j] + delay, begin, end)
    # A span of time that is late by a part of an interval begins in one and ends in the next.
    k = _interval_at(edges, begin - delay + hair)
    first, second = held.acts[k] + delay, held.acts[jnp.minimum(k + 1, held.acts.shape[0] - 1)] + delay
    none = (held.inputs[k] == 0.0) | (first < begin + hair)
    return jnp.clip(jnp.where(none, second, first), begin, end)


def _divided(parts: Float[Array, "interval part"], substeps: int) -> Float[Array, "interval step"]:
    inner = parts[:, :-1, None] + jnp.diff(parts, axis=1)[:, :, None] * (jnp.arange(substeps) / substeps)[None, None]
    return jnp.concatenate([inner.reshape(parts.shape[0], -1), parts[:, -1:]], axis=1)


def arriving(
    plant: Plant, given: Supply, steps: Float[Array, "interval edge"], first: Int[Array, ""] | int
) -> tuple[Float[Array, "interval step 2"], Float[Array, "interval step 2"]]:
    """Inputs at the drives in every step of some intervals: see `Drives`.

    Args:
        plant: what moves.
        given: the lane's held inputs.
        steps: beginnings of the intervals' steps, and the intervals' ends [s].
        first: number of the first of these intervals, from the first of those before the lane.
    """
    begin, end = steps[:, :-1], steps[:, 1:]
    middle = 0.5 * (begin + end)

    def applied(effect: AbstractDrive, inputs: tuple[Array, Array]) -> tuple[Array, Array]:
        return effect.apply(middle, inputs[0]), effect.apply(middle, inputs[1])

    means, earlies = [], []
    for axis, held in (("x", given.x), ("l", given.l)):
        own = jax.lax.dynamic_slice_in_dim(held.inputs, first, steps.shape[0])
        # What has no memory and no clock may stand before the delay as well as behind it.
        mean = early = jnp.broadcast_to(own[:, None], begin.shape)
        late = _on(plant, axis, AbstractDelay)
        if late:

            def delayed(_: tuple[Array, Array], held: Held = held, axis: str = axis) -> tuple[Array, Array]:
                return _delayed(given.edges, held, begin, end, _dead_time(plant, axis))

            mean, early = plant.after(delayed, (mean, early), *late)
        mean, early = plant.after_each(applied, (mean, early), (e for e in _chain(plant, axis) if e.in_time))
        means.append(mean)
        earlies.append(early)
    return jnp.stack(means, axis=2), jnp.stack(earlies, axis=2)


def lags_at_start(
    plant: Plant, lane: Lane, steps: Float[Array, "before edge"], mean: Float[Array, "before step 2"]
) -> Float[Array, " 2"]:
    """States of both drives' lags at a lane's beginning, from the steps before it and the inputs' means there."""
    constants = plant.time_constants()
    found = []
    for column, constant in enumerate((constants.x, constants.l)):
        # Outside the time loop the library's exponential costs nothing.
        fading = jnp.exp(-(lane.start - steps) / jnp.maximum(constant, INSTANT))
        found.append(jnp.sum(mean[:, :, column] * jnp.diff(fading, axis=1)))
    return jnp.stack(found)


def drive_inputs(
    plant: Plant, lane: Lane, given: Supply | None = None, steps: Float[Array, "history edge"] | None = None
) -> Drives:
    """What the drives are given over the lane, for cart and hoist.

    Args:
        plant: what moves.
        lane: held inputs.
        given: its `supply`, where that is known already.
        steps: see `step_edges`; by default every interval is one step.
    """
    n = lane.before.shape[0]
    if given is None:
        given = supply(plant, lane)
    if steps is None:
        steps = fixed_steps(plant, given, given.edges, 1)
    mean, early = arriving(plant, given, steps, 0)
    return Drives(mean[n:], early[n:], lags_at_start(plant, lane, steps[:n], mean[:n]))


def _delayed(edges: Array, held: Held, begin: Array, end: Array, delay: Scalar | float) -> tuple[Array, Array]:
    """A held input late by `delay` over spans of time: its mean, and its mean weighted by the time left."""
    w, acts, once, twice = held
    assert once is not None and twice is not None

    def integrals(t: Array) -> tuple[Array, Array]:
        k = _interval_at(edges, t)
        acting = jnp.maximum(t - acts[k], 0.0)
        return once[k] + w[k] * acting, twice[k] + once[k] * jnp.maximum(t - edges[k], 0.0) + 0.5 * w[k] * acting**2

    (first, first_twice), (last, last_twice) = integrals(begin - delay), integrals(end - delay)
    span = jnp.where(end > begin, end - begin, 1.0)
    # The integral of (end - t) w(t) over a span is what the integral of w gains over it.
    gained = last_twice - first_twice - (end - begin) * first
    return (last - first) / span, 2.0 * gained / (span * span)
