"""Tangents of free runs, in three programs: what is before the loop over time, the loop, and the encoders.

Most of the compiler's time goes into the loop. An effect of a drive or an encoder changes nothing there (but for a
delay, which cuts intervals), so that a diagnosis, which tries dozens of effects, finds the loop's program again. Each
program is given the part of the plant that it depends on and nothing more; what that part's parameters do to the stages
behind it comes as tangents.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._programs import kept, returned
from .._types import Axes
from ..inputs import Lane
from ..model.effects.base import (
    AXIS_OF_SITE,
    L_SENSOR,
    AbstractDamping,
    AbstractDrive,
    AbstractEffect,
    AbstractForce,
    AbstractFriction,
    AbstractSensor,
)
from ..model.effects.drives import ActuatorLag, DrumRadiusChange, InputDelay
from ..model.effects.flexible import Backlash, BeltCompliance
from ..model.effects.friction import PreslidingFriction
from ..model.effects.sensors import SensorDelay
from ..model.parameters import ParameterTable, Part
from ..model.plant import Motion, Plant
from ..rollout import MIDPOINT, Interval, Motions, moved_on, prepare, read, sample_times
from .lanes import Lanes, overridden


class Overrides(NamedTuple):
    """Parameters that recordings set themselves, of one part of the plant."""

    at: Float[Array, "lane parameter"]
    to: Float[Array, "lane parameter"]


class Parts(NamedTuple):
    """What each of the three programs asks for, and what the first two do together."""

    before: Part
    loop: Part
    encoders: Part
    motion: Part


def is_drive(effect: AbstractEffect) -> bool:
    """Whether an effect changes what the motors are given, and needs no state for it."""
    return isinstance(effect, AbstractDrive | InputDelay)


def is_encoder(effect: AbstractEffect) -> bool:
    """Whether readings of a motion depend on an effect: on a sensor's, and on where the cart's encoder sits."""
    return isinstance(effect, AbstractSensor | SensorDelay | BeltCompliance | Backlash)


@functools.lru_cache(maxsize=256)
def parts_of(table: ParameterTable) -> Parts:
    """The parts of a plant of this structure."""

    def motion(effect: AbstractEffect) -> bool:
        if isinstance(effect, AbstractSensor):  # a locked rope is as long as its sensor says
            return effect.site == L_SENSOR
        return not isinstance(effect, SensorDelay)

    def before(effect: AbstractEffect) -> bool:
        idle = AbstractForce | AbstractDamping | AbstractFriction | DrumRadiusChange
        return motion(effect) and (isinstance(effect, PreslidingFriction) or not isinstance(effect, idle))

    def loop(effect: AbstractEffect) -> bool:
        return motion(effect) and not (is_drive(effect) or isinstance(effect, AbstractSensor))

    return Parts(*map(table.part, (before, loop, is_encoder, motion)))


def of_part(part: Part, lanes: Lanes) -> Lanes:
    """The lanes with what the recordings override of one part."""
    own = tuple(np.asarray(leaf)[:, part.places] for leaf in (lanes.override_at, lanes.override_to))
    return eqx.tree_at(lambda lanes: (lanes.override_at, lanes.override_to), lanes, own)


def tangents(
    table: ParameterTable,
    vectors: NDArray[np.float64],
    free: NDArray[np.int64],
    initial: NDArray[np.float64],
    lanes: Lanes,
    substeps: int,
) -> tuple[Array, Array, Array]:
    """Readings of all lanes for every row, and what free parameters and initial states do to them.

    Args:
        table: of the plant.
        vectors: parameters: `(row, parameter)`.
        free: places of the free ones, -1 where a row has fewer: `(row, column)`.
        initial: initial states: `(row, lane, state)`.
        lanes: the lanes.
        substeps: integration steps in each interval.

    Returns:
        Weighted tangents `(row, lane, column and state, sample and channel)`, weighted residuals `(row, lane, sample
        and channel)`, and readings `(row, lane, sample, channel)`.
    """
    parts = parts_of(table)
    states = initial.shape[2]
    towards = (np.arange(vectors.shape[1]) == free[:, :, None]).astype(float)
    towards = np.concatenate([towards, np.zeros((len(free), states, vectors.shape[1]))], axis=1)

    def given(part: Part) -> tuple:
        own = of_part(part, lanes)
        overrides = Overrides(own.override_at, own.override_to)
        return part.table, vectors[:, part.places], towards[:, :, part.places], overrides

    begun, still = _before(*given(parts.before), initial, lanes.lane, substeps)
    moved = _loop(*given(parts.loop), begun, still, lanes.lane.active)
    return _encoders(*given(parts.encoders), moved, lanes.lane.start, lanes.lane.dt, lanes.y, lanes.weight)


@returned
class Pushed(NamedTuple):
    """Values, and their tangents along every direction."""

    value: tuple
    along: tuple
    """With one more axis, of columns, behind those of rows and lanes."""


def _push(f: Callable, values: tuple, directions: tuple, **how: bool) -> tuple:
    """Values once, tangents for all directions, and what `f` returns besides."""

    def push(direction: tuple) -> tuple:
        return jax.jvp(f, values, direction, **how)

    return jax.vmap(push, out_axes=(None, 0, None) if how else (None, 0))(directions)


def _each(one: Callable, by_row: tuple, by_lane: tuple, by_both: tuple) -> Any:
    """`one(*by_row, *by_lane, *by_both)` for every row and lane."""
    a, b, c = len(by_row), len(by_lane), len(by_both)
    lanes = jax.vmap(one, in_axes=(*(None,) * a, *(0,) * b, *(0,) * c))
    return jax.vmap(lanes, in_axes=(*(0,) * a, *(None,) * b, *(0,) * c))(*by_row, *by_lane, *by_both)


@kept(static=(0, 6))
def _before(
    table: ParameterTable,
    vectors: Float[Array, "row parameter"],
    towards: Float[Array, "row column parameter"],
    overrides: Overrides,
    initial: Float[Array, "row lane state"],
    lane: Lane,
    substeps: int,
) -> tuple[Pushed, Interval]:
    """First motions and intervals: those fields that a parameter may change with tangents, the others without."""

    def one(vector: Array, towards: Array, overrides: Overrides, lane: Lane, start: Array) -> tuple[Pushed, Interval]:
        def begun(vector: Array, start: Array) -> tuple[tuple[Motions, Interval], Interval]:
            plant = table.unravel(overridden(vector, *overrides))
            first, told = prepare(plant, start, lane, substeps)
            changing, still = eqx.partition(told, _changing(plant))
            return (first, changing), still

        basis = jnp.zeros((towards.shape[0], start.shape[0])).at[-start.shape[0] :].set(jnp.eye(start.shape[0]))
        value, along, still = _push(begun, (vector, start), (towards, basis), has_aux=True)
        return Pushed(value, along), still

    return _each(one, (vectors, towards), (overrides, lane), (initial,))


def _changing(plant: Plant) -> Interval:
    """Which fields of the intervals a parameter may change: those of a lag only where there is one."""
    late = next(plant.all(InputDelay), None) is not None
    lagging = {AXIS_OF_SITE[effect.site] for effect in plant.all(ActuatorLag)}
    driven, left = (Axes._make(axis in has for axis in Axes._fields) for has in ({"x", "l"}, lagging))
    return Interval._make((False, late, late, driven, driven, left, left, left))


@kept(static=(0,))
def _loop(
    table: ParameterTable,
    vectors: Float[Array, "row parameter"],
    towards: Float[Array, "row column parameter"],
    overrides: Overrides,
    begun: Pushed,
    still: Interval,
    active: Axes,
) -> Pushed:
    """Positions and velocities at all samples."""
    # The same for all rows and lanes, which `materialise` needs.
    number = still.number[0, 0]

    def one(
        vector: Array, towards: Array, overrides: Overrides, active: Axes, begun: Pushed, still: Interval
    ) -> Pushed:
        def moved(vector: Array, first: Motions, changing: Interval) -> tuple[Motion, Motion]:
            plant = table.unravel(overridden(vector, *overrides))
            told = eqx.combine(changing, still)._replace(number=number)
            motions = moved_on(plant, first, told, active, method=MIDPOINT)
            return motions.q, motions.v

        return Pushed(*_push(moved, (vector, *begun.value), (towards, *begun.along)))

    return _each(one, (vectors, towards), (overrides, active), (begun, still))


@kept(static=(0,))
def _encoders(
    table: ParameterTable,
    vectors: Float[Array, "row parameter"],
    towards: Float[Array, "row column parameter"],
    overrides: Overrides,
    moved: Pushed,
    start: Float[Array, " lane"],
    dt: Float[Array, "lane time"],
    y: Float[Array, "lane sample 3"],
    weight: Float[Array, "lane sample 3"],
) -> tuple[Array, Array, Array]:
    """Weighted tangents and residuals, and readings."""

    def one(
        vector: Array,
        towards: Array,
        own: Overrides,
        start: Array,
        dt: Array,
        y: Array,
        weight: Array,
        moved: Pushed,
    ) -> tuple[Array, Array, Array]:
        def predict(vector: Array, q: Motion, v: Motion) -> Array:
            return read(table.unravel(overridden(vector, *own)), sample_times(start, dt), q, v)

        predicted, along = _push(predict, (vector, *moved.value), (towards, *moved.along))
        residual = (predicted - y) * weight
        return (along * weight[None]).reshape(towards.shape[0], -1), residual.reshape(-1), predicted

    return _each(one, (vectors, towards), (overrides, start, dt, y, weight), (moved,))
