"""Fuzzy controllers as tables of a TOML file, their systems inside or in MATLAB's `.fis` files beside it.

What connects a system's inputs are their names, in any order: `error`, `velocity` and, for the cart, `angle`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._toml import Where, as_value, flag, positive, shown, word
from ..errors import InputError, listed
from ..fuzzy.files.fis_reader import load_fis
from ..fuzzy.files.fis_writer import save_fis
from ..fuzzy.files.tables import has_place_in_tables, read_system, system_lines
from ..fuzzy.inference import AbstractSystem, Mamdani
from ..fuzzy.membership import MEMBERSHIPS, as_number
from ..fuzzy.rules import Clause, Variable
from ..fuzzy.sugeno import Linear, Sugeno
from .base import Differences
from .compensation import compensation_lines, read_compensation
from .fuzzy import INPUTS, FuzzyController

KEYS = (
    "cart", "hoist", "cart_scale", "hoist_scale", "filter", "relative_speed", "angle_unit", "compensation",
)  # fmt: skip
_ANGLES = {"deg": 1.0, "rad": 180.0 / np.pi}
"""Degrees, in which systems are asked, in one unit of the file."""


def read_fuzzy(file: Where, document: Mapping[str, Any], path: Path) -> FuzzyController:
    """The law of a file.

    Args:
        file: for messages.
        document: what the file holds.
        path: the file, beside which `.fis` files lie.

    Raises:
        InputError: naming the key and what to do.
    """
    systems = {axis: _read_axis(file, document.get(axis), axis, path) for axis in INPUTS}
    if any(variable.name == "angle" for variable in systems["cart"].inputs):
        unit = document.get("angle_unit")
        if unit is None:
            file.refuse('no angle_unit, in which the sets of the angle are; add angle_unit = "deg" or "rad"')
        systems["cart"] = _in_degrees(systems["cart"], _ANGLES[word(file, "angle_unit", unit, _ANGLES)])
    return FuzzyController(
        systems["cart"],
        systems["hoist"],
        as_number(positive(file, document, "cart_scale", 1.0)),
        as_number(positive(file, document, "hoist_scale", 1.0)),
        Differences(as_number(positive(file, document, "filter", 0.02))),
        compensation=read_compensation(file, document.get("compensation")),
        relative_speed=flag(file, document, "relative_speed"),
    )


def fis_named(document: Mapping[str, Any], path: Path) -> tuple[str, ...]:
    """The `.fis` files that a controller's file names."""
    given = [document.get(axis) for axis in INPUTS]
    names = [each.get("fis") if isinstance(each, dict) else each for each in given]
    return tuple(str(path.parent / name) for name in names if isinstance(name, str))


def fuzzy_lines(path: Path, law: FuzzyController) -> tuple[list[str], list[str]]:
    """Keys and tables of a law; `read_fuzzy` reads the same law from them.

    A system that tables cannot hold (Sugeno's, or one with a label used twice) is written to a `.fis` file beside,
    `NAME-cart.fis` or `NAME-hoist.fis`.

    Raises:
        InputError: the law has what a file cannot hold, or a file cannot be written.
    """
    if law.softness is not None:
        raise InputError(f"{path}: a smooth controller is for tuning only; write it with softness=None")
    keys = {
        "cart_scale": float(law.cart_scale),
        "hoist_scale": float(law.hoist_scale),
        "filter": float(law.differences.time_constant),
    }
    for key, value in keys.items():
        if not 0.0 < value < np.inf:
            raise InputError(f"{path}: {key} is {value:g}, which is not a positive number")
    lines = [f"{key} = {as_value(value)}" for key, value in keys.items()]
    lines.append(f"relative_speed = {as_value(law.relative_speed)}")
    if any(variable.name == "angle" for variable in law.cart.inputs):
        lines.append('angle_unit = "deg"')
    tables = compensation_lines(path, law.compensation)
    for axis in INPUTS:
        system = getattr(law, axis)
        if isinstance(system, Mamdani) and has_place_in_tables(system):
            try:
                tables += system_lines(axis, system)
            except ValueError as problem:
                raise InputError(f"{path}: [{axis}]: {problem}; correct it before it is written") from None
            continue
        beside = path.with_name(f"{path.stem}-{axis}.fis")
        save_fis(beside, system)
        given: Any = {"fis": beside.name, "matlab": True} if system.matlab else beside.name
        lines.insert(0, f"{axis} = {as_value(given)}")
    return lines, tables


def _read_axis(file: Where, given: Any, axis: str, path: Path) -> AbstractSystem:
    where, names = file.within(f"[{axis}]"), INPUTS[axis]
    named, key = where, "fis"
    if isinstance(given, str):
        given, named, key = {"fis": given}, file, axis
    if not isinstance(given, dict):
        file.refuse(f'no [{axis}]; add {axis} = "{axis}.fis", or the table itself')
    if "fis" in given:
        where.check_keys(given, ("fis", "inputs", "matlab"), "key")
        if not isinstance(given["fis"], str):
            where.refuse(f"fis = {shown(given['fis'])} is not the name of a file in quotes")
        system = load_fis(named.beside(path, key, given["fis"]), matlab=flag(where, given, "matlab"))
        system = _renamed(where, system, given.get("inputs"))
    else:
        system = read_system(where, given)
    if len(system.outputs) != 1:
        where.refuse(f"{len(system.outputs)} outputs; it needs one voltage")
    found = [variable.name for variable in system.inputs]
    wrong = [name for name in found if name not in names or found.count(name) > 1]
    if wrong:
        mend = "name each once" if wrong[0] in names else f"choose among {listed(names, len(names))}"
        if "fis" in given:
            mend += (
                f', or say which they are: {axis} = {{fis = "{given["fis"]}", inputs = [{as_value(names[0])}, ...]}}'
            )
        where.refuse(f"the input {shown(wrong[0])} is none that a controller knows; {mend}")
    return _ordered(system, [found.index(name) for name in names if name in found])


def _renamed(where: Where, system: AbstractSystem, names: Any) -> AbstractSystem:
    """A system with other names for its inputs, in their order."""
    if names is None:
        return system
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        where.refuse(f'inputs = {shown(names)} is not a list of names; write it as inputs = ["error", "velocity"]')
    if len(names) != len(system.inputs):
        where.refuse(f"inputs has {len(names)} names for the {len(system.inputs)} inputs of the file; name each")
    renamed = (dataclasses.replace(each, name=name) for each, name in zip(system.inputs, names, strict=True))
    return dataclasses.replace(system, inputs=tuple(renamed))


def _ordered(system: AbstractSystem, order: Sequence[int]) -> AbstractSystem:
    """The same system with its inputs in another order: of every new place, the old one."""
    places = {old: new for new, old in enumerate(order)}

    def moved(clause: Clause) -> Clause:
        return dataclasses.replace(clause, variable=places[clause.variable])

    rules = tuple(dataclasses.replace(r, antecedent=tuple(map(moved, r.antecedent))) for r in system.rules)
    outputs = system.outputs
    if isinstance(system, Sugeno):
        outputs = tuple(
            dataclasses.replace(
                output, functions=tuple(Linear(f.slopes[np.array(order)], f.offset) for f in output.functions)
            )
            for output in system.outputs
        )
    inputs = tuple(system.inputs[old] for old in order)
    return dataclasses.replace(system, inputs=inputs, outputs=outputs, rules=rules)


def _in_degrees(system: AbstractSystem, factor: float) -> AbstractSystem:
    """A system whose `angle` is in units of so many degrees, with that angle in degrees."""
    if factor == 1.0:
        return system
    place = next(number for number, variable in enumerate(system.inputs) if variable.name == "angle")
    old: Variable = system.inputs[place]
    sets = tuple(
        MEMBERSHIPS[member.kind](
            *(n * factor**unit.power for n, unit in zip(member.parameters(), member.units(), strict=True))
        )
        for member in old.sets
    )
    new = dataclasses.replace(old, low=old.low * factor, high=old.high * factor, sets=sets)
    inputs = (*system.inputs[:place], new, *system.inputs[place + 1 :])
    if not isinstance(system, Sugeno):
        return dataclasses.replace(system, inputs=inputs)
    outputs = tuple(
        dataclasses.replace(
            output,
            functions=tuple(Linear(f.slopes.at[place].divide(factor), f.offset) for f in output.functions),
        )
        for output in system.outputs
    )
    return dataclasses.replace(system, inputs=inputs, outputs=outputs)
