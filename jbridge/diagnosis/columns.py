"""What each candidate would change in the readings, to first order, along the base trajectory.

An absent effect is evaluated where the base simulation goes: its force, its friction level, its change of the input,
its change of the reading. `identify.respond` carries that to the readings. Effects that are singular where they are
absent enter with what they would do at a finite seed, as one column whose amplitude is free.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._programs import kept
from .._types import AXES
from ..identify.lanes import Batch, Lanes, refined
from ..identify.respond import PORTS, Along, linearise, respond
from ..identify.stages import is_drive, of_part, parts_of
from ..inputs import Drives, drive_inputs
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
from ..rollout import Motions, readings
from .candidates import Candidate

_NO_BRIDGE = Bridge()
"""Stands in where a table is made for an effect alone."""
_GROUP = 40
"""Columns that are carried to the readings together; more would only take memory."""


def candidate_columns(
    table: ParameterTable,
    vector: NDArray[np.float64],
    batch: Batch,
    initial: NDArray[np.float64],
    found: Sequence[Candidate],
    along: Along | None = None,
) -> list[NDArray[np.float64]]:
    """Weighted tangents of the readings for every candidate: lane, column, sample and channel (flat).

    Args:
        table: of the base model.
        vector: its parameters.
        batch: lanes.
        initial: initial states of the lanes.
        found: candidates without a hidden state.
        along: the linearised trajectories of the lanes, where they are known already.
    """
    lanes = refined(batch.lanes, batch.substeps)
    if along is None:
        along = linearise(table, vector, initial, lanes)
    weight = np.asarray(batch.lanes.weight)
    asked = _asked(table, vector, lanes)
    read = asked[_SENSORS]
    out: list[NDArray[np.float64] | None] = [None] * len(found)

    def acts_of(families: list[_Family]) -> NDArray[np.float64]:
        part = asked[families[0].asks]
        ports, reads = _ports(
            None if families[0].asks == _NOTHING else part.table,
            tuple((family.table, family.finite) for family in families),
            part.vector,
            [np.array(family.points) for family in families],
            [family.directions for family in families],
            part.lanes,
            along.motions,
        )
        return np.asarray(reads if families[0].asks == _SENSORS else ports)

    def carry(group: list[_Family]) -> None:
        acts = [acts_of(list(same)) for _, same in itertools.groupby(group, key=lambda family: family.kind)]
        if group[0].asks == _SENSORS:
            change = np.concatenate([np.moveaxis(reads, -1, 1)[:, :, :: batch.substeps] for reads in acts], axis=1)
            change *= weight[:, None]
        else:
            # Always as many columns, so that one program carries all groups.
            change = np.array(_carried(read.table, batch.substeps, read.vector, read.lanes, along, _filled(acts)))
        change = change.reshape(*change.shape[:2], -1)
        # What the linear model cannot carry through explains nothing.
        change[:, ~np.isfinite(change).all(axis=(0, 2))] = 0.0
        start = 0
        for family in group:
            for i in family.members:
                out[i] = change[:, start : start + family.width]
                start += family.width

    with ThreadPoolExecutor(2) as pool:  # the compiler and the programs release the interpreter
        list(pool.map(carry, _groups(found)))
    return [part for part in out if part is not None]


def _filled(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Columns side by side, filled up to a whole group."""
    missing = max(_GROUP - sum(part.shape[-1] for part in parts), 0)
    return np.concatenate([*parts, np.zeros((*parts[0].shape[:-1], missing))], axis=-1)


_NOTHING, _DRIVES, _SENSORS = _ASKED = ("nothing", "drives", "sensors")
"""What of the model, beside its motion, decides what an absent effect does."""


class _Asked(NamedTuple):
    """A part of the model, and the lanes with what the recordings override of it."""

    table: ParameterTable
    vector: NDArray[np.float64]
    lanes: Lanes


def _asked(table: ParameterTable, vector: NDArray[np.float64], lanes: Lanes) -> dict[str, _Asked]:
    """What effects of each sort ask for, and nothing more, so that one program serves all models with the same."""
    parts = (table.part(lambda effect: False), table.part(is_drive), parts_of(table).encoders)
    return {
        sort: _Asked(part.table, np.asarray(vector)[part.places], of_part(part, lanes))
        for sort, part in zip(_ASKED, parts, strict=True)
    }


@dataclasses.dataclass
class _Family:
    """Seeds of one effect that differ in their numbers alone: traced once."""

    table: ParameterTable
    """Of the effect's numbers."""
    finite: bool
    directions: NDArray[np.float64]
    """Unit directions of the free numbers."""
    members: list[int]
    """Which candidates they are."""
    points: list[NDArray[np.float64]]
    """The effect's numbers at each seed."""
    asks: str
    """Of `_ASKED`. Families that ask for the same may share a group."""
    kind: str
    """Of the effect. Families of one kind share a program, which then serves whatever else the group holds."""

    @property
    def width(self) -> int:
        """Columns of each seed."""
        return len(self.directions)


def _groups(found: Sequence[Candidate]) -> list[list[_Family]]:
    """Families of seeds, collected into groups of about as many columns as are carried to the readings together."""
    families: dict[tuple, _Family] = {}
    for i, candidate in enumerate(found):
        effect, own, directions = _directions(candidate)
        point = np.array(own.ravel(Plant(_NO_BRIDGE, (effect,))))
        part = 0
        while True:
            key = (own, candidate.finite, directions.tobytes(), part)
            asks = _NOTHING if isinstance(effect, AbstractForce | AbstractDamping | AbstractFriction) else _DRIVES
            if isinstance(effect, AbstractSensor | SensorDelay):
                asks = _SENSORS
            family = families.setdefault(key, _Family(own, candidate.finite, directions, [], [], asks, effect.kind))
            if not family.members or (len(family.members) + 1) * family.width <= _GROUP:
                break
            part += 1
        family.members.append(i)
        family.points.append(point)
    groups: list[list[_Family]] = [[]]
    size = 0
    for unit in _units(sorted(families.values(), key=lambda family: _ASKED.index(family.asks))):
        columns = sum(len(family.members) * family.width for family in unit)
        if groups[-1] and (size + columns > _GROUP or unit[0].asks != groups[-1][0].asks):
            groups.append([])
            size = 0
        groups[-1] += unit
        size += columns
    return groups


def _units(families: Sequence[_Family]) -> list[list[_Family]]:
    """Families of one kind together, as far as a group has room for them."""
    units = []
    for _, members in itertools.groupby(families, key=lambda family: family.kind):
        same = list(members)
        fits = sum(len(family.members) * family.width for family in same) <= _GROUP
        units += [same] if fits else [[family] for family in same]
    return units


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
    if candidate.harmonic:
        values["amplitude"] = 1.0  # at which the phase's tangent is the cosine
    effect = make_effect(kind, site, values)
    own = ParameterTable(Plant(_NO_BRIDGE, (effect,)))
    if candidate.finite:
        return effect, own, np.zeros((1, own.size))
    places = [p for key in candidate.linear for p in own.positions(f"{kind}@{site}.{key}")]
    return effect, own, np.eye(own.size)[places]


class _Given(NamedTuple):
    """The model of a lane, what its drives are given, and what its encoders read."""

    plant: Plant
    drives: Drives
    readings: Float[Array, "sample 3"]


@kept(static=(0, 1), once=True)
def _ports(
    table: ParameterTable | None,
    families: tuple[tuple[ParameterTable, bool], ...],
    vector: Array,
    points: list[Float[Array, "_ _"]],
    directions: list[Float[Array, "_ _"]],
    lanes: Lanes,
    motions: Motions,
) -> tuple[Float[Array, "lane time 13 column"], Float[Array, "lane sample 3 column"]]:
    """What all seeds add at the ports and directly to the readings."""

    def given_of(lane: Lanes, path: Motions) -> _Given | None:
        if table is None:
            return None
        plant = table.unravel(lane.own(vector))
        return _Given(plant, drive_inputs(plant, lane.lane), readings(plant, lane.lane, path))

    given = jax.vmap(given_of)(lanes, motions)
    through, direct = [], []
    for (own, finite), seeds, directed in zip(families, points, directions, strict=True):

        def at(numbers: Array, own: ParameterTable = own) -> tuple[Array, Array]:
            effect = own.unravel(numbers).effects[0]
            return jax.vmap(lambda *lane: _acts(effect, *lane))(lanes, motions, given)

        if finite:
            ports, reads = jax.vmap(at, out_axes=-1)(seeds)
        else:

            def towards(point: Array, directed: Array = directed, at: Callable = at) -> tuple[Array, Array]:
                return jax.vmap(lambda d: jax.jvp(at, (point,), (d,))[1], out_axes=-1)(directed)

            ports, reads = (part.reshape(*part.shape[:-2], -1) for part in jax.vmap(towards, out_axes=-2)(seeds))
        through.append(ports)
        direct.append(reads)
    return jnp.concatenate(through, axis=-1), jnp.concatenate(direct, axis=-1)


@kept(static=(0, 1))
def _carried(
    table: ParameterTable, substeps: int, vector: Array, lanes: Lanes, along: Along, ports: Array
) -> Float[Array, "lane column sample 3"]:
    """The weighted change of the readings: one program for all groups."""
    change = respond(table, vector, lanes, along, ports)
    return change[:, :, ::substeps] * lanes.weight[:, None]


def _acts(
    effect: AbstractEffect, lanes: Lanes, motions: Motions, given: _Given | None
) -> tuple[Float[Array, "time 13"], Float[Array, "sample 3"]]:
    """What an effect adds at the ports of every interval and directly to the readings, for one lane."""
    lane = lanes.lane
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
    elif given is None:
        raise TypeError(f"what a {type(effect).__name__} does depends on the model beside the motion")
    elif isinstance(effect, DrumRadiusChange):
        ports = ports.at[:, 1].set(given.drives.mean[:, 0, 1] * effect.slope * (q.l - effect.length))
    elif isinstance(effect, AbstractDrive | InputDelay):
        base, changed = given.drives, drive_inputs(given.plant.adding(effect), lane)
        mean, early = changed.mean[:, 0] - base.mean[:, 0], changed.early[:, 0] - base.early[:, 0]
        # The two moments of the change, as a change that is held and an impulse at the beginning.
        ports = ports.at[:, 0:2].set(2.0 * mean - early)
        ports = ports.at[:, 11:13].set((early - mean) * lane.dt[:, None])
    elif isinstance(effect, AbstractSensor | SensorDelay):
        reads = readings(given.plant.adding(effect), lane, motions) - given.readings
    return ports, reads
