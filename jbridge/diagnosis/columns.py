"""What each candidate would change in the readings, to first order, along the base trajectory.

An absent effect is evaluated where the base simulation goes: its force, its friction level, its change of the input,
its change of the reading. `identify.respond` carries that to the readings. Effects that are singular where they are
absent enter with what they would do at a finite seed, as one column whose amplitude is free.
"""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._types import AXES
from ..identify.lanes import Batch, Lanes
from ..identify.respond import PORTS, Along, respond
from ..model.bridge import Bridge
from ..model.effects.base import (
    AXIS_OF_SITE,
    AbstractDamping,
    AbstractDrive,
    AbstractEffect,
    AbstractForce,
    AbstractFriction,
    AbstractSensor,
    parameters_of,
)
from ..model.effects.catalogue import KINDS, make_effect
from ..model.effects.drives import ActuatorLag, DrumRadiusChange, InputDelay
from ..model.effects.sensors import SensorDelay
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from ..rollout import drive_inputs, readings
from .candidates import Candidate

_NO_BRIDGE = Bridge()
"""Stands in where a table is made for an effect alone."""
_GROUP = 40
"""Columns that are carried to the readings together; more would only take memory."""


def candidate_columns(
    table: ParameterTable,
    vector: NDArray[np.float64],
    batch: Batch,
    along: Along,
    found: Sequence[Candidate],
) -> list[NDArray[np.float64]]:
    """Weighted tangents of the readings for every candidate: lane, column, sample and channel (flat)."""
    out: list[NDArray[np.float64] | None] = [None] * len(found)
    groups: list[list[int]] = [[]]
    size = 0
    for i, candidate in enumerate(found):
        count = _count(candidate)
        if size + count > _GROUP and groups[-1]:
            groups.append([])
            size = 0
        groups[-1].append(i)
        size += count
    for group in groups:
        kinds, points, directions = [], [], []
        for i in group:
            effect, own, directed = _directions(found[i])
            kinds.append((own, found[i].finite))
            points.append(np.array(own.ravel(Plant(_NO_BRIDGE, (effect,)))))
            directions.append(directed)
        change = _changes(
            table,
            tuple(kinds),
            jnp.asarray(vector),
            [jnp.asarray(p) for p in points],
            [jnp.asarray(d) for d in directions],
            batch.lanes,
            along,
        )
        scaled = np.array(change * batch.lanes.weight[:, None])
        scaled = scaled.reshape(*scaled.shape[:2], -1)
        start = 0
        for i, directed in zip(group, directions, strict=True):
            out[i] = scaled[:, start : start + len(directed)]
            start += len(directed)
    return [part for part in out if part is not None]


def _count(candidate: Candidate) -> int:
    return 1 if candidate.finite else len(_directions(candidate)[2])


def _directions(candidate: Candidate) -> tuple[AbstractEffect, ParameterTable, NDArray[np.float64]]:
    """The effect at its seed, the table of its numbers, and the unit directions of its free ones."""
    kind, site = candidate.kind, candidate.site
    if kind == ActuatorLag.kind:
        # To first order a lag is a delay, and a delay needs no state.
        kind = InputDelay.kind
        values = {"delay": candidate.values["time_constant"]}
    else:
        values = {
            key: v for key, v in candidate.values.items() if key in parameters_of(KINDS[kind]) or isinstance(v, str)
        }
    effect = make_effect(kind, site, values)
    own = ParameterTable(Plant(_NO_BRIDGE, (effect,)))
    if candidate.finite:
        return effect, own, np.zeros((1, own.size))
    places = [p for key in candidate.free for p in own.positions(f"{kind}@{site}.{key}")]
    return effect, own, np.eye(own.size)[places]


@functools.partial(jax.jit, static_argnums=(0, 1))
def _changes(
    table: ParameterTable,
    kinds: tuple[tuple[ParameterTable, bool], ...],
    vector: Array,
    points: list[Array],
    directions: list[Array],
    lanes: Lanes,
    along: Along,
) -> Float[Array, "lane column sample 3"]:
    through, direct = [], []
    for (own, finite), point, directed in zip(kinds, points, directions, strict=True):

        def at(numbers: Array, own: ParameterTable = own) -> tuple[Array, Array]:
            effect = own.unravel(numbers).effects[0]
            return jax.vmap(lambda lane, path: _acts(table, vector, lane, path, effect))(lanes, along)

        if finite:
            ports, reads = at(point)
            ports, reads = ports[..., None], reads[..., None]
        else:
            ports, reads = jax.vmap(lambda d, p=point, f=at: jax.jvp(f, (p,), (d,))[1], out_axes=-1)(directed)
        through.append(ports)
        direct.append(reads)
    ports = jnp.concatenate(through, axis=-1)
    answered = respond(table, vector, lanes, along, ports)
    return answered + jnp.moveaxis(jnp.concatenate(direct, axis=-1), -1, 1)


def _acts(
    table: ParameterTable, vector: Array, lanes: Lanes, along: Along, effect: AbstractEffect
) -> tuple[Float[Array, "time 11"], Float[Array, "sample 3"]]:
    """What an effect adds at the ports of every interval and directly to the readings, for one lane."""
    plant = table.unravel(jnp.where(lanes.override_at > 0, lanes.override_to, vector))
    lane, motions = lanes.lane, along.motions
    middle = jax.tree.map(lambda leaf: 0.5 * (leaf[1:] + leaf[:-1]), motions)
    q, v = middle.q, middle.v
    t = lane.start + jnp.cumsum(lane.dt) - 0.5 * lane.dt
    count = t.shape[0]
    ports = jnp.zeros((count, PORTS))
    reads = jnp.zeros((count + 1, 3))
    k = AXES.index(AXIS_OF_SITE[effect.site])
    if isinstance(effect, AbstractForce):
        force = jax.vmap(effect.force)(t, q.at_load(), v.at_load())
        ports = ports.at[:, 2:5].set(jnp.stack(force, axis=1))
    elif isinstance(effect, AbstractDamping):
        resistance = jax.vmap(effect.resistance)(q.at_drives(), v.at_drives())
        ports = ports.at[:, 2 + k].set(resistance)
    elif isinstance(effect, AbstractFriction):
        up, down = jax.vmap(effect.levels)(t, q.at_drives()[k], v.at_drives()[k])
        ports = ports.at[:, 5 + k].set(up).at[:, 8 + k].set(down)
    elif isinstance(effect, DrumRadiusChange):
        base, _ = drive_inputs(plant, lane)
        ports = ports.at[:, 1].set(base[:, 1] * effect.slope * (q.l - effect.length))
    elif isinstance(effect, AbstractDrive | InputDelay):
        base, _ = drive_inputs(plant, lane)
        changed, _ = drive_inputs(Plant(plant.bridge, (*plant.effects, effect)), lane)
        ports = ports.at[:, 0:2].set(changed - base)
    elif isinstance(effect, AbstractSensor | SensorDelay):
        with_it = readings(Plant(plant.bridge, (*plant.effects, effect)), lane, motions)
        reads = with_it - readings(plant, lane, motions)
    return ports, reads
