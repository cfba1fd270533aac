"""Controllers in TOML, with their fuzzy systems inside or in MATLAB's `.fis` files beside them."""

import dataclasses
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .._files import replace_text
from .._toml import Where, as_key, as_value, read_toml, shown, word
from ..fuzzy.defuzzify import DEFUZZIFIERS
from ..fuzzy.fis import load_fis, save_fis
from ..fuzzy.inference import POINTS, AbstractSystem, Mamdani
from ..fuzzy.membership import MEMBERSHIPS, AbstractMembership, as_number
from ..fuzzy.norms import NORMS
from ..fuzzy.rules import Variable, in_words, rule
from .base import AbstractController, Differences
from .compensation import Compensation
from .fuzzy import FuzzyController

PERIOD = 0.02
"""Sampling period where a file gives none [s], the paper's."""
SHORTEST_PERIOD = 1e-4
"""No drive of a bridge follows a command that changes faster [s]; it bounds how long a run is computed."""
MOST_POINTS = 100_000
"""Points that a universe may be sampled at; a picture's width has a hundred times fewer."""
_METHODS = {
    "conjunction": ("min", "prod"),
    "disjunction": ("max", "probor"),
    "implication": ("min", "prod"),
    "aggregation": ("max", "sum", "probor"),
}
_KEYS = ("kind", "period", "cart_scale", "hoist_scale", "filter", "relative_speed", "compensation", "cart", "hoist")
_INPUTS = {"cart": ("error", "velocity", "angle"), "hoist": ("error", "velocity")}
"""What each axis' system is asked with, in this order."""


@dataclass(frozen=True)
class Controller:
    """A law and how often it is asked."""

    law: AbstractController
    period: float = PERIOD
    """Of sampling [s]."""
    source: str = field(default="", compare=False)
    """The file that it was read from, for messages."""


def load_controller(path: str | os.PathLike[str]) -> Controller:
    """Reads a controller.

    Raises:
        InputError: naming the file, the key and what to do.
    """
    document = read_toml(Path(path), "controller", 'kind = "fuzzy" and the tables [cart] and [hoist]')
    file = Where(str(path))
    file.check_keys(document, _KEYS, "key")
    word(file, "kind", document.get("kind"), ("fuzzy",))
    systems = {}
    for axis, names in _INPUTS.items():
        given = document.get(axis)
        if isinstance(given, str):
            systems[axis] = load_fis(file.beside(Path(path), axis, given))
        elif isinstance(given, dict):
            systems[axis] = _read_system(file.within(f"[{axis}]"), given)
        else:
            file.refuse(f'no [{axis}]; add {axis} = "{axis}.fis", or the table itself')
        found = len(systems[axis].inputs)
        if found != len(names) or len(systems[axis].outputs) != 1:
            file.within(f"[{axis}]").refuse(
                f"{found} inputs and {len(systems[axis].outputs)} outputs; it needs {', '.join(names)} and one voltage"
            )
    law = FuzzyController(
        systems["cart"],
        systems["hoist"],
        as_number(_positive(file, document, "cart_scale", 1.0)),
        as_number(_positive(file, document, "hoist_scale", 1.0)),
        Differences(as_number(_positive(file, document, "filter", 0.02))),
        compensation=_read_compensation(file, document.get("compensation")),
        relative_speed=_flag(file, document, "relative_speed"),
    )
    period = _positive(file, document, "period", PERIOD)
    if not SHORTEST_PERIOD <= period <= 1.0:
        file.refuse(f"period = {shown(period)} s is not from {SHORTEST_PERIOD:g} to 1; write it as period = {PERIOD}")
    return Controller(law, period, str(path))


def save_controller(path: str | os.PathLike[str], controller: Controller) -> None:
    """Writes a fuzzy controller; reading the file gives the same controller.

    A Sugeno system lies in a `.fis` file beside it, `NAME-cart.fis` or `NAME-hoist.fis`.

    Raises:
        InputError: if the file cannot be written.
        TypeError: the law is of another kind.
    """
    law = controller.law
    if not isinstance(law, FuzzyController):
        raise TypeError(f"only fuzzy controllers are written, not a {type(law).__name__}")
    lines = ['kind = "fuzzy"']
    for key, value in (
        ("period", controller.period),
        ("cart_scale", float(law.cart_scale)),
        ("hoist_scale", float(law.hoist_scale)),
        ("filter", float(law.differences.time_constant)),
    ):
        lines.append(f"{key} = {as_value(value)}")
    lines.append(f"relative_speed = {as_value(law.relative_speed)}")
    if law.compensation is not None:
        numbers = {f.name: float(getattr(law.compensation, f.name)) for f in dataclasses.fields(law.compensation)}
        lines += ["", "[compensation]", *(f"{key} = {as_value(value)}" for key, value in numbers.items())]
    inside: list[str] = []
    for axis, system in (("cart", law.cart), ("hoist", law.hoist)):
        if isinstance(system, Mamdani):
            inside += _system_lines(axis, system)
            continue
        beside = Path(path).with_name(f"{Path(path).stem}-{axis}.fis")
        save_fis(beside, system)
        lines.insert(1, f"{axis} = {as_value(beside.name)}")
    replace_text(Path(path), "\n".join(lines + inside) + "\n")


def _positive(where: Where, table: Mapping[str, Any], key: str, default: float) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < np.inf:
        where.refuse(f"{key} = {shown(value)} is not a positive number; write it as {key} = {default}")
    return float(value)


def _flag(where: Where, table: Mapping[str, Any], key: str) -> bool:
    value = table.get(key, False)
    if not isinstance(value, bool):
        where.refuse(f"{key} = {shown(value)} is neither true nor false")
    return bool(value)


def _read_compensation(file: Where, table: Any) -> Compensation | None:
    if table is None:
        return None
    names = [f.name for f in dataclasses.fields(Compensation)]
    if not isinstance(table, dict):
        file.refuse(f"compensation = {shown(table)} is not a table; write [compensation] with {', '.join(names)}")
    where = file.within("[compensation]")
    where.check_keys(table, names, "key")
    for key, value in table.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            where.refuse(f"{key} = {shown(value)} is not a number; write it as {key} = 0.0")
    if "blur" in table:
        _positive(where, table, "blur", float(Compensation().blur))
    return Compensation(**{key: as_number(float(value)) for key, value in table.items()})


def _read_system(where: Where, table: Mapping[str, Any]) -> Mamdani:
    where.check_keys(table, (*_METHODS, "defuzzifier", "points", "rules", "weights", "input", "output"), "key")
    norms = {}
    for key, choices in _METHODS.items():
        norms[key] = NORMS[word(where, key, table.get(key, choices[0]), choices)]()
    defuzzifier = DEFUZZIFIERS[word(where, "defuzzifier", table.get("defuzzifier", "centroid"), DEFUZZIFIERS)]()
    points = table.get("points", POINTS)
    if isinstance(points, bool) or not isinstance(points, int) or not 3 <= points <= MOST_POINTS:
        where.refuse(f"points = {shown(points)} is not a number of points; write it as points = {POINTS}")
    inputs, outputs = (_read_variables(where, table, role) for role in ("input", "output"))
    texts, weights = table.get("rules"), table.get("weights")
    if not isinstance(texts, list) or not texts or not all(isinstance(text, str) for text in texts):
        where.refuse('no rules; add rules = ["if error is NB then voltage is NB", ...]')
    if weights is None:
        weights = [1.0] * len(texts)
    if not isinstance(weights, list) or len(weights) != len(texts):
        where.refuse(f"weights does not give one number for each of the {len(texts)} rules; correct or delete it")
    rules = []
    for number, (text, weight) in enumerate(zip(texts, weights, strict=True)):
        if isinstance(weight, bool) or not isinstance(weight, int | float) or not 0.0 <= weight <= 1.0:
            where.refuse(f"weights[{number}] = {shown(weight)} does not lie between 0 and 1; correct it")
        try:
            rules.append(rule(text, inputs, outputs, weight=float(weight)))
        except ValueError as problem:
            where.refuse(f"rules[{number}]: {problem}")
    return Mamdani(inputs, outputs, tuple(rules), **norms, defuzzifier=defuzzifier, points=points)


def _read_variables(where: Where, table: Mapping[str, Any], role: str) -> tuple[Variable, ...]:
    tables = table.get(role)
    if not isinstance(tables, dict) or not tables or not all(isinstance(entry, dict) for entry in tables.values()):
        where.refuse(
            f"no [{where.place.rpartition('[')[2].rstrip(']')}.{role}.NAME] table with range and sets; add one"
        )
    return tuple(_read_variable(where.within(f"{role}.{name}"), name, entry) for name, entry in tables.items())


def _read_variable(where: Where, name: str, table: Mapping[str, Any]) -> Variable:
    where.check_keys(table, ("range", "sets"), "key")
    ends = _numbers(where, "range", table.get("range"))
    if len(ends) != 2 or not ends[0] < ends[1]:
        where.refuse("range does not go from a lower to a higher end; write it as range = [-3.0, 3.0]")
    sets = table.get("sets")
    if not isinstance(sets, dict) or not sets:
        where.refuse("no sets; add a table of them, such as NB = {trapmf = [-3.0, -3.0, -2.0, -1.0]}")
    members = tuple(_read_set(where, label, entry) for label, entry in sets.items())
    return Variable(name, as_number(ends[0]), as_number(ends[1]), tuple(sets), members)


def _read_set(where: Where, label: str, entry: Any) -> AbstractMembership:
    if not isinstance(entry, dict) or len(entry) != 1:
        where.refuse(f"{label} = {shown(entry)} is not a set; write it as {label} = {{trimf = [-1.0, 0.0, 1.0]}}")
    ((kind, given),) = entry.items()
    cls = MEMBERSHIPS[word(where, f"set of {label}", kind, MEMBERSHIPS)]
    numbers = _numbers(where, f"{label}.{kind}", given)
    wanted = [f.name for f in dataclasses.fields(cls)]
    if len(numbers) != len(wanted):
        where.refuse(f"{label}.{kind} has {len(numbers)} numbers; it needs {', '.join(wanted)}")
    if kind in ("trimf", "trapmf") and any(b < a for a, b in zip(numbers, numbers[1:], strict=False)):
        where.refuse(f"the corners of {label} do not ascend; sort them")
    return cls(*map(as_number, numbers))


def _numbers(where: Where, key: str, value: Any) -> list[float]:
    if not isinstance(value, list) or any(
        isinstance(entry, bool) or not isinstance(entry, int | float) or not np.isfinite(entry) for entry in value
    ):
        where.refuse(f"{key} = {shown(value)} is not a list of numbers")
    return [float(entry) for entry in value]


def _system_lines(axis: str, system: AbstractSystem) -> list[str]:
    assert isinstance(system, Mamdani)
    lines = ["", f"[{axis}]"]
    lines += [f"{key} = {as_value(getattr(system, key).name)}" for key in (*_METHODS, "defuzzifier")]
    lines += [f"points = {system.points}", "rules = ["]
    lines += [f"    {as_value(in_words(found, system.inputs, system.outputs))}," for found in system.rules]
    lines += ["]", f"weights = {as_value([float(found.weight) for found in system.rules])}"]
    for role, variables in (("input", system.inputs), ("output", system.outputs)):
        for variable in variables:
            lines += ["", f"[{axis}.{role}.{as_key(variable.name)}]"]
            lines += [f"range = {as_value([float(variable.low), float(variable.high)])}"]
            lines += [f"[{axis}.{role}.{as_key(variable.name)}.sets]"]
            for label, member in zip(variable.labels, variable.sets, strict=True):
                numbers = [float(getattr(member, f.name)) for f in dataclasses.fields(member)]
                lines.append(f"{as_key(label)} = {as_value({member.kind: numbers})}")
    return lines
