"""A plant's numbers as one vector, with names, units and bounds.

Fits, sweeps and reports all speak of parameters through this table. A bridge's number is named as in the model file
(`cart_gain`); an effect's is `kind@site.key`, with `[i]` behind it for an entry of a vector.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .bridge import Bridge
from .effects.base import AbstractEffect, unit_at
from .fields import ParameterInfo, parameters_of
from .plant import Plant


@dataclasses.dataclass(frozen=True)
class Entry:
    """One number of a plant."""

    name: str
    group: str
    """The name without an index."""
    owner: int
    """Index of the effect, -1 for the bridge."""
    key: str
    index: int
    """Place within a vector parameter, 0 for a scalar."""
    info: ParameterInfo
    unit: str

    @property
    def is_force(self) -> bool:
        """Whether a force or a mass is in its unit, so that it grows with the scale of all forces."""
        return bool({"N", "kg"} & set(self.unit.replace("/", " ").split()))


class ParameterTable:
    """Names, units and bounds of every number of a plant, in the order of its leaves."""

    def __init__(self, plant: Plant, inputs: Mapping[str, str] | None = None):
        """Args:
        plant: gives the structure; its values are not kept.
        inputs: unit of `u_x` and `u_l`, volts where not told.
        """
        plant = jax.tree.map(jnp.asarray, plant)
        leaves, self.treedef = jax.tree.flatten(plant)
        self._shapes = [np.shape(leaf) for leaf in leaves]
        self._sizes = [int(np.prod(shape)) for shape in self._shapes]
        self.size = sum(self._sizes)
        self.entries: list[Entry] = []
        self._positions: dict[str, list[int]] = {}
        self._options: dict[str, int] = {}
        self._owners: list[int] = []
        command = {"u_x": "V", "u_l": "V"} | dict(inputs or {})
        offset = 0
        for owner, part in enumerate((plant.bridge, *plant.effects), start=-1):
            by_field = {info.name: info for info in parameters_of(type(part)).values()}
            for field in dataclasses.fields(part):
                if field.metadata.get("static"):
                    continue
                size = int(np.prod(np.shape(getattr(part, field.name))))
                info = by_field.get(field.name)
                if info is not None:
                    self._describe(part, owner, info, offset, size, command)
                else:
                    assert isinstance(part, AbstractEffect)
                    self._options[f"{part.kind}@{part.site}.{field.name}"] = offset
                offset += size
                self._owners += [owner] * size

    def __hash__(self) -> int:
        return hash((self.treedef, tuple(self._shapes)))

    def __eq__(self, other: object) -> bool:
        """Tables of the same structure are interchangeable, so that programs compiled for one serve the other."""
        if not isinstance(other, ParameterTable):
            return NotImplemented
        return (self.treedef, self._shapes) == (other.treedef, other._shapes)

    def __repr__(self) -> str:
        return f"ParameterTable({self.treedef}, {self._shapes})"

    def _describe(
        self, part: Any, owner: int, info: ParameterInfo, offset: int, size: int, command: Mapping[str, str]
    ) -> None:
        if isinstance(part, AbstractEffect):
            group = f"{part.kind}@{part.site}.{info.key}"
            unit = unit_at(info.unit, part.site, command)
            taken = 1
            while group in self._positions:
                taken += 1
                group = f"{part.kind}@{part.site}#{taken}.{info.key}"
        else:
            # A bridge's units have inputs below the line alone.
            below = {name: f"({own})" if " " in own else own for name, own in command.items()}
            group, unit = info.key, info.unit.format(**below)
        for i in range(size):
            name = f"{group}[{i}]" if info.vector else group
            self.entries.append(Entry(name, group, owner, info.key, i, info, unit))
            self._positions.setdefault(group, []).append(offset + i)
            self._positions[name] = [offset + i]
        self._by_position = {p: e for e in self.entries for p in self._positions[e.name]}
        fitted = (p in self._by_position and self._by_position[p].info.fitted for p in range(sum(self._sizes)))
        self._fitted = tuple(fitted)

    def entry(self, position: int | np.integer) -> Entry:
        """What is known of the number at a place of the vector."""
        return self._by_position[int(position)]

    def owners(self) -> NDArray[np.int64]:
        """Index of the effect that each place of the vector belongs to, -1 for the bridge."""
        return np.array(self._owners, np.int64)

    def names(self) -> tuple[str, ...]:
        return tuple(entry.name for entry in self.entries)

    def positions(self, name: str) -> list[int]:
        """Places in the vector of a parameter, an entry of it, or (`kind.key`) of a parameter named without its site.

        Raises:
            KeyError: nothing or more than one thing has that name.
        """
        if name in self._positions:
            return self._positions[name]
        found = {group for group in self._positions if "@" in group and without_site(group) == name}
        if len(found) == 1:
            return self._positions[found.pop()]
        raise KeyError(name)

    def of_site(self, site: str) -> dict[str, list[int]]:
        """Places in the vector of all parameters of effects at a site, by name."""
        return {
            name: places
            for name, places in self._positions.items()
            if "@" in name and "[" not in name and name.split("@")[1].split(".")[0].split("#")[0] == site
        }

    def vectors(self, free: NDArray[np.int64]) -> list[list[int]]:
        """Indices into `free` of the entries of each vector parameter, such as the levels of a map, in its order."""
        found: dict[str, list[int]] = {}
        for j, place in enumerate(free):
            entry = self.entry(place)
            if entry.info.vector:
                found.setdefault(entry.group, []).append(j)
        return list(found.values())

    def option_place(self, group: str) -> int:
        """Place of an option's index, such as `end_stop@cart.end`."""
        return self._options[group]

    def options(self) -> dict[str, int]:
        """Places of all options' indices."""
        return dict(self._options)

    def part(self, keep: Callable[[AbstractEffect], bool]) -> "Part":
        """The plant with some of its effects only."""
        places = self.unravel(np.arange(self.size, dtype=float))
        some = Plant(places.bridge, tuple(effect for effect in places.effects if keep(effect)))
        table = ParameterTable(some)
        return Part(table, np.asarray(table.ravel(some)).astype(np.int64))

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper bounds; options and references have none."""
        low, high = np.full(self.size, -math.inf), np.full(self.size, math.inf)
        for position, entry in self._by_position.items():
            low[position], high[position] = entry.info.low, entry.info.high
        return low, high

    def fitted(self) -> NDArray[np.bool_]:
        """Which numbers may be estimated at all."""
        out = np.zeros(self.size, bool)
        for position, entry in self._by_position.items():
            out[position] = entry.info.fitted
        return out

    def ravel(self, plant: Plant) -> Float[Array, " parameter"]:
        leaves = jax.tree.leaves(plant)
        if not any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            # Copied as they are: every operation of JAX would be compiled for every structure.
            return jax.device_put(np.concatenate([np.ravel(np.asarray(leaf, dtype=float)) for leaf in leaves]))
        return jnp.concatenate([jnp.ravel(jnp.asarray(leaf, dtype=jnp.result_type(float))) for leaf in leaves])

    def unravel(
        self, vector: Float[Array, " parameter"] | Float[np.ndarray, " parameter"], *, fitted: bool = False
    ) -> Plant:
        """The plant with a vector's numbers.

        Args:
            vector: all numbers.
            fitted: whether derivatives are wanted by those numbers alone that are ever estimated. Tangents of all
                others (knots, lengths of reference) then are no work.
        """
        traced = isinstance(vector, jax.core.Tracer)
        values = vector if traced else np.asarray(vector)
        leaves, offset = [], 0
        for shape, size in zip(self._shapes, self._sizes, strict=True):
            leaf = values[offset : offset + size].reshape(shape)
            held = traced and fitted and not any(self._fitted[offset : offset + size])
            leaves.append(jax.lax.stop_gradient(leaf) if held else leaf)
            offset += size
        return jax.tree.unflatten(self.treedef, leaves if traced else jax.device_put(leaves))


class Part(NamedTuple):
    """A plant with some of another one's effects."""

    table: ParameterTable
    places: NDArray[np.int64]
    """Where its numbers stand in the other one's vector."""


def without_site(group: str) -> str:
    """`kind@site.key` without its site."""
    kind, rest = group.split("@", 1)
    return f"{kind}.{rest.split('.', 1)[1]}"


def bridge_keys() -> tuple[str, ...]:
    """Names of the bridge's numbers."""
    return tuple(parameters_of(Bridge))


def with_values(plant: Plant, values: Mapping[str, Array | float]) -> Plant:
    """A plant with some of its numbers replaced; the new ones may be traced.

    Args:
        plant: as it is.
        values: by name, as in model files and reports (`load_mass`, `coulomb_friction@cart.level`); a list's name takes
            one value for all of it.

    Raises:
        KeyError: the plant has no such number.
    """
    table = ParameterTable(plant)
    vector = jnp.asarray(table.ravel(plant))
    kinds = [jnp.asarray(value).dtype for value in values.values()]
    vector = vector.astype(jnp.result_type(*kinds)) if kinds else vector
    for name, value in values.items():
        vector = vector.at[np.asarray(table.positions(name))].set(jnp.asarray(value, vector.dtype))
    return table.unravel(vector)
