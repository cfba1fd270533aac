"""Model files: one TOML with the bridge, its effects, what is known of them, and how well.

A file is data, checked key by key against the catalogue; nothing in it is executed. What `save_model` writes,
`load_model` reads back to the last bit.
"""

import itertools
import math
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .._files import replace_text
from .._toml import Where, as_key, as_value, nearest, read_toml, shown, word
from ..errors import listed, quoted
from ..recordings.tables.columns import BASE_UNITS, INPUT_UNITS
from .bridge import Bridge
from .effects.base import AbstractEffect, unit_at
from .effects.catalogue import KINDS, make_effect
from .effects.flexible import Backlash, BeltCompliance, DoublePendulum, HoistBacklash
from .fields import ParameterInfo, options_of, parameters_of
from .parameters import ParameterTable, bridge_keys, without_site
from .plant import Plant

_SECTIONS = ("bridge", "effect", "uncertainty", "recorded")
_RECORDED, _INPUTS = ("x", "l"), ("u_x", "u_l")
_UNITS = tuple(dict.fromkeys(BASE_UNITS.get(unit, unit) for unit in INPUT_UNITS))
"""Of inputs, as recordings have them."""
_RANGES = {f"{name}_range": name for name in _INPUTS}
"""Keys under which a file has the range of an input, whose own name has its unit."""
_SETTLED = ("winch_mass", "gravity")
"""Numbers of the bridge that are taken as known where a file leaves them out."""
HOIST = ("winch_mass", "hoist_damping", "hoist_gain")
"""The bridge's numbers that a locked rope does not have."""
_NEEDS = (
    ({"x"}, "a cart", ("cart_mass", "cart_gain")),
    ({"psi", "l"}, "a load", ("load_mass",)),
    ({"l"}, "a driven hoist", ("winch_mass", "hoist_gain")),
)
"""What has no default that could be right for every rig, by the part that needs it."""


@dataclass(frozen=True)
class Model:
    """A plant, and what its owner says of its numbers."""

    plant: Plant
    known: frozenset[str]
    """Parameters that are not estimated, named as in `ParameterTable` (`cart_mass`, `coulomb_friction@cart.level`)."""
    given: frozenset[str]
    """The bridge's numbers that the file has; those of absent parts may be missing."""
    uncertainty: Mapping[str, Mapping[str, Any]]
    """By parameter, the entries `std`, `low`, `high` of an earlier fit, as read; lists for vectors."""
    source: str = field(default="", compare=False)
    """The file that it was read from, for messages."""
    recorded: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Least and largest place of the cart (`x` [m]), rope length (`l` [m]) and inputs (`u_x`, `u_l`) in the recordings
    of an earlier fit."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of each input (`u_x`, `u_l`) in those recordings, volts where not told; gains and dead zones have it."""

    @property
    def has_hoist(self) -> bool:
        """Whether the file gives a number of the hoist; without any the rope is locked."""
        return not self.given.isdisjoint(("winch_mass", "hoist_gain"))

    @property
    def axes(self) -> tuple[str, ...]:
        """What a controller moves."""
        return ("x", "psi", "l") if self.has_hoist else ("x", "psi")


def load_model(path: str | os.PathLike[str]) -> Model:
    """Reads a model file.

    A damping that is left out is 0; gravity is 9.81 m/s^2. A mass or a gain that is left out is only missed where its
    part exists: see `requires`.

    Raises:
        InputError: naming the file, the key and what to do.
    """
    document = read_toml(Path(path), "model", "a [bridge] table with cart_mass, load_mass, ...")
    file = Where(str(path))
    file.check_keys(document, _SECTIONS, "section")
    if "bridge" not in document:
        file.refuse("no [bridge] table; add one with cart_mass, load_mass, cart_gain, ...")
    bridge, given, known = _read_bridge(file.within("[bridge]"), document["bridge"])
    plant = Plant(bridge, _read_effects(file, document.get("effect", [])))
    _check_plant(file, plant, given)
    names = _known_names(file.within("[bridge]"), known, ParameterTable(plant))
    left_out = {key for key in _SETTLED if key not in given}
    uncertainty = _read_uncertainty(file, document.get("uncertainty", {}))
    recorded, units = _read_recorded(file, document.get("recorded", {}))
    return Model(plant, frozenset(names | left_out), frozenset(given), uncertainty, str(path), recorded, units)


def save_model(path: str | os.PathLike[str], model: Model) -> None:
    """Writes a model file; it appears whole or not at all, and an existing file is replaced.

    Raises:
        InputError: if the file cannot be written.
    """
    replace_text(Path(path), _as_toml(model))


def present(model: Model) -> frozenset[str]:
    """The axes of `x`, `psi`, `l` for which the file gives all masses and gains that they need."""
    lacking = {axis for needing, _, keys in _NEEDS for axis in needing if not set(keys) <= model.given}
    return frozenset({"x", "psi", "l"} - lacking)


def requires(model: Model, axes: Collection[str]) -> None:
    """Checks that the file gives every mass and gain of the parts that exist.

    Args:
        model: as read.
        axes: those of `x`, `psi`, `l` that exist in the recordings.

    Raises:
        InputError: naming what to add.
    """
    for needing, part, keys in _NEEDS:
        missing = [key for key in keys if key not in model.given]
        if missing and needing & set(axes):
            Where(model.source or "the model").within("[bridge]").refuse(
                f"no {' and no '.join(missing)}, but there is {part} to move;"
                f" add {' and '.join(f'{key} = ...' for key in missing)} (a guess will do unless it is named in known)"
            )


def _read_bridge(where: Where, table: Any) -> tuple[Bridge, set[str], Any]:
    """The bridge, the keys that are given, and what stands under `known`."""
    if not isinstance(table, dict):
        where.refuse("bridge is not a table; write [bridge] on a line of its own and the numbers below it")
    infos = parameters_of(Bridge)
    where.check_keys(table, (*infos, "known"), "key")
    values: dict[str, Any] = {
        key: _number(where, key, table[key], info, info.unit.format(u_x="V", u_l="V"))
        for key, info in infos.items()
        if key in table
    }
    return Bridge(**values), set(values), table.get("known", [])


def _read_effects(file: Where, tables: Any) -> tuple[AbstractEffect, ...]:
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        file.refuse("effect is not a list of tables; begin every effect with a line [[effect]]")
    return tuple(_read_effect(file, number, table) for number, table in enumerate(tables, start=1))


def _read_effect(file: Where, number: int, table: dict[str, Any]) -> AbstractEffect:
    where = file.within(f"[[effect]] {number}")
    kind = word(where, "kind", table.get("kind"), KINDS)
    where = file.within(f"[[effect]] {number} ({kind})")
    cls = KINDS[kind]
    site = word(where, "site", table.get("site"), cls.sites)
    infos, options = parameters_of(cls), options_of(cls)
    where.check_keys(table, ("kind", "site", *infos, *options), "key")
    values: dict[str, Any] = {}
    for key, info in infos.items():
        unit = unit_at(info.unit, site)
        if key in table:
            read = _vector if info.vector else _number
            values[key] = read(where, key, table[key], info, unit)
        elif not info.optional:
            where.refuse(f"no {key}; add {key} = {'[...]' if info.vector else '...'} ({info.doc}, in {unit})")
    for key, choices in options.items():
        if key in table:
            values[key] = word(where, key, table[key], choices)
    _check_vectors(where, values, infos)
    return make_effect(kind, site, values)


def _number(where: Where, key: str, value: Any, info: ParameterInfo, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        where.refuse(f"{key} = {shown(value)} is not a number; write it as {key} = 1.5 ({unit})")
    number = float(value)
    if not math.isfinite(number):
        where.refuse(f"{key} = {shown(value)} is not a finite number; write it as {key} = 1.5 ({unit})")
    if not info.low <= number <= info.high:
        where.refuse(f"{key} = {number!r} {_complaint(number, info)} ({info.doc}, in {unit}); correct it")
    return number


def _complaint(number: float, info: ParameterInfo) -> str:
    """What is wrong with a number beyond its bounds."""
    if number < 0.0 <= info.low:
        return "is negative"
    return f"is below {info.low:g}" if number < info.low else f"is above {info.high:g}"


def _vector(where: Where, key: str, value: Any, info: ParameterInfo, unit: str) -> list[float]:
    if not isinstance(value, list):
        where.refuse(f"{key} = {shown(value)} is not a list; write it as {key} = [0.2, 0.8] ({unit})")
    if not value:
        where.refuse(f"{key} is empty; write it as {key} = [0.2, 0.8] ({unit})")
    return [_number(where, f"{key}[{i}]", entry, info, unit) for i, entry in enumerate(value)]


def _check_vectors(where: Where, values: Mapping[str, Any], infos: Mapping[str, ParameterInfo]) -> None:
    """Places must increase, and each vector of estimated numbers has one for each of the places before it."""
    places = ""
    for key in (key for key, info in infos.items() if info.vector):
        if not infos[key].fitted:
            places = key
            if any(b <= a for a, b in itertools.pairwise(values[key])):
                where.refuse(f"{key} do not increase; sort them, and keep one of each")
        elif len(values[key]) != len(values[places]):
            count, wanted = len(values[key]), len(values[places])
            where.refuse(f"{key} has {count} numbers for {wanted} {places}; give one for each of the {places}")


def _check_plant(file: Where, plant: Plant, given: Collection[str]) -> None:
    """Refuses effects that cannot stand together, and parts heavier than their sum."""
    try:
        plant.check()
    except ValueError as error:
        file.refuse(f"{error}; delete the other [[effect]]")
    parts: list[tuple[type[AbstractEffect], str, str]] = [
        (DoublePendulum, "hook_mass", "load_mass"),
        (BeltCompliance, "motor_mass", "cart_mass"),
        (Backlash, "motor_mass", "cart_mass"),
        (HoistBacklash, "motor_mass", "winch_mass"),
    ]
    for cls, part, whole in parts:
        effect = plant.only(cls)
        if effect is None or whole not in given:
            continue
        mass, total = float(getattr(effect, part)), float(getattr(plant.bridge, whole))
        if mass >= total:
            file.refuse(
                f"{part} = {mass!r} of {effect.kind} is not below {whole} = {total!r}, which includes it; correct one"
            )


def check_lengths(model: Model) -> None:
    """Checks that the file gives every reference length, which recordings of a measured rope tell otherwise.

    Raises:
        InputError: naming what to add.
    """
    for effect in model.plant.effects:
        if np.isnan(np.asarray(getattr(effect, "length", 0.0), float)):
            Where(model.source or "the model").within(f"[[effect]] {effect.kind}").refuse(
                "no length; add length = 0.5, the rope length [m] at which its slope changes nothing"
            )


def _known_names(where: Where, known: Any, table: ParameterTable) -> set[str]:
    """The parameters that `known` names, with their sites."""
    if not isinstance(known, list) or not all(isinstance(name, str) for name in known):
        where.refuse('known is not a list of names; write known = ["cart_mass", "gravity"]')
    groups = dict.fromkeys(entry.group for entry in table.entries)
    names: set[str] = set()
    for name in known:
        try:
            found = {table.entry(position).group for position in table.positions(name)}
        except KeyError:
            said = f"known names {quoted(name, 80)}, which is"
            same = [group for group in groups if "@" in group and without_site(group) == name]
            if same:
                where.refuse(f"{said} {listed(same)}; name one of them, or each")
            # The kind may have been left out, or the site.
            whole = [group for group in groups if group.endswith(f".{name}")]
            likely = whole[0] if whole else name
            short = [] if "@" in likely else [without_site(group) for group in groups if "@" in group]
            hint = nearest(likely, [*groups, *short])
            where.refuse(f"{said} no parameter of this model; {hint}")
        names |= {name} if name.endswith("]") else found
    return names


def _read_uncertainty(file: Where, table: Any) -> Mapping[str, Mapping[str, Any]]:
    if not isinstance(table, dict) or not all(isinstance(entry, dict) for entry in table.values()):
        file.refuse("uncertainty does not hold tables; write [uncertainty.cart_mass] with std = 0.1, or delete it")
    return table


def _read_recorded(file: Where, table: Any) -> tuple[dict[str, tuple[float, float]], dict[str, str]]:
    if not isinstance(table, dict):
        file.refuse("recorded is not a table; write [recorded] with x = [0.0, 1.2], or delete it")
    where = file.within("[recorded]")
    where.check_keys(table, (*_RECORDED, *_INPUTS, *_RANGES), "key")
    found: dict[str, tuple[float, float]] = {}
    units: dict[str, str] = {}
    for key in [key for key in _INPUTS if key in table]:
        if table[key] not in _UNITS:
            where.refuse(f"{key} = {shown(table[key])} is no unit of an input; write one of {', '.join(_UNITS)}")
        units[key] = table[key]
    for key, ends in ((key, ends) for key, ends in table.items() if key not in _INPUTS):
        sound = isinstance(ends, list) and len(ends) == 2 and all(type(end) in (int, float) for end in ends)
        if not (sound and -math.inf < ends[0] <= ends[1] < math.inf):
            where.refuse(f"{key} = {shown(ends)} does not go from least to most; write it as {key} = [0.0, 1.2]")
        found[_RANGES[key] if key in _RANGES else key] = (float(ends[0]), float(ends[1]))
    return found, units


def _as_toml(model: Model) -> str:
    table = ParameterTable(model.plant)
    lines = ["[bridge]"]
    left_out = Bridge()
    for key in bridge_keys():
        value = float(getattr(model.plant.bridge, key))
        # A number that a fit has moved is written, even if the file did not give it.
        if key in model.given or value != float(getattr(left_out, key)):
            lines.append(f"{key} = {as_value(value)}")
    known = sorted(model.known, key=lambda name: table.positions(name)[0])
    lines.append(f"known = {as_value(known)}")
    for effect in model.plant.effects:
        lines += ["", "[[effect]]", f"kind = {as_value(effect.kind)}", f"site = {as_value(effect.site)}"]
        for key, info in parameters_of(type(effect)).items():
            number = np.asarray(getattr(effect, info.name), dtype=np.float64)
            if not (info.optional and np.isnan(number).any()):
                lines.append(f"{key} = {as_value(number.tolist())}")
        for key, choices in options_of(type(effect)).items():
            lines.append(f"{key} = {as_value(choices[round(float(getattr(effect, key)))])}")
    for name, entries in model.uncertainty.items():
        lines += ["", f"[uncertainty.{as_key(name)}]"]
        lines += [f"{as_key(key)} = {as_value(value)}" for key, value in entries.items() if value is not None]
    keys = {name: key for key, name in _RANGES.items()}
    recorded = [f"{keys.get(name, name)} = {as_value(list(ends))}" for name, ends in model.recorded.items()]
    recorded += [f"{key} = {as_value(unit)}" for key, unit in model.units.items() if unit != "V"]
    lines += ["", "[recorded]", *recorded] if recorded else []
    return "\n".join(lines) + "\n"
