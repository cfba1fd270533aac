"""Mamdani systems as tables of a TOML file: sets by name, rules in words.

```toml
[cart]
conjunction = "min"
rules = ["if error is NB then voltage is NB"]
[cart.input.error]
range = [-1.0, 1.0]
[cart.input.error.sets]
NB = {trapmf = [-1.0, -1.0, -0.08, -0.004]}
```
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..._toml import Where, as_key, as_value, shown, word
from ..defuzzify import DEFUZZIFIERS
from ..inference import POINTS, Mamdani
from ..membership import MEMBERSHIPS, AbstractMembership, as_number, membership
from ..norms import NORMS
from ..rules import Rule, Variable, in_words, rule

_METHODS = {
    "conjunction": ("min", "prod"),
    "disjunction": ("max", "probor"),
    "implication": ("min", "prod"),
    "aggregation": ("max", "sum", "probor"),
}
MOST_POINTS = 100_000
"""Points that a universe may be sampled at; a picture's width has a hundred times fewer."""
_KEYS = (*_METHODS, "defuzzifier", "points", "matlab", "rules", "weights", "input", "output")


def read_system(where: Where, table: Mapping[str, Any]) -> Mamdani:
    """A system from its table.

    Args:
        where: of the table, for messages.
        table: as `tomllib` reads it.

    Raises:
        InputError: a key is unknown, missing or wrong; names it and says what to do.
    """
    where.check_keys(table, _KEYS, "key")
    norms: dict[str, Any] = {}
    for key, choices in _METHODS.items():
        norms[key] = NORMS[word(where, key, table.get(key, choices[0]), choices)]()
    defuzzifier = DEFUZZIFIERS[word(where, "defuzzifier", table.get("defuzzifier", "centroid"), DEFUZZIFIERS)]()
    points = table.get("points", POINTS)
    if isinstance(points, bool) or not isinstance(points, int) or not 3 <= points <= MOST_POINTS:
        where.refuse(f"points = {shown(points)} is not a number of points; write it as points = {POINTS}")
    matlab = table.get("matlab", False)
    if not isinstance(matlab, bool):
        where.refuse(f"matlab = {shown(matlab)} is neither true nor false")
    inputs, outputs = (_read_variables(where, table, role) for role in ("input", "output"))
    rules = _read_rules(where, table, inputs, outputs)
    return Mamdani(inputs, outputs, rules, **norms, defuzzifier=defuzzifier, points=points, matlab=matlab)


def _read_rules(
    where: Where, table: Mapping[str, Any], inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]
) -> tuple[Rule, ...]:
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
    return tuple(rules)


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
    if len(ends) != 2 or not -np.inf < ends[0] < ends[1] < np.inf:
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
    word(where, f"set of {label}", kind, MEMBERSHIPS)
    try:
        return membership(kind, _numbers(where, f"{label}.{kind}", given))
    except ValueError as problem:
        where.refuse(f"{label}.{kind} {problem}")


def _numbers(where: Where, key: str, value: Any) -> list[float]:
    if not isinstance(value, list) or any(
        isinstance(entry, bool) or not isinstance(entry, int | float) or entry != entry for entry in value
    ):
        where.refuse(f"{key} = {shown(value)} is not a list of numbers")
    return [float(entry) for entry in value]


def has_place_in_tables(system: Mamdani) -> bool:
    """Whether tables can hold a system: in each variable every label, and among the variables every name, is unique."""
    return all(
        len({variable.name for variable in variables}) == len(variables)
        and all(len(set(variable.labels)) == len(variable.labels) for variable in variables)
        for variables in (system.inputs, system.outputs)
    )


def system_lines(place: str, system: Mamdani) -> list[str]:
    """The lines of a system's tables, which `read_system` reads as the same system.

    Args:
        place: name of the table.
        system: one that `has_place_in_tables`.

    Raises:
        ValueError: a number is not one that `read_system` takes. The text names the system's part.
    """
    for key, choices in _METHODS.items():
        if getattr(system, key).name not in choices:
            raise ValueError(f"{key} = {getattr(system, key).name}; choose among {', '.join(choices)}")
    lines = ["", f"[{place}]"]
    lines += [f"{key} = {as_value(getattr(system, key).name)}" for key in (*_METHODS, "defuzzifier")]
    lines += [f"points = {system.points}"]
    if system.matlab:
        lines.append("matlab = true")
    weights = [float(found.weight) for found in system.rules]
    for number, weight in enumerate(weights, start=1):
        if not 0.0 <= weight <= 1.0:
            raise ValueError(f"rule {number} has the weight {weight:g}, which does not lie between 0 and 1")
    lines += ["rules = ["]
    lines += [f"    {as_value(in_words(found, system.inputs, system.outputs))}," for found in system.rules]
    lines += ["]", f"weights = {as_value(weights)}"]
    for role, variables in (("input", system.inputs), ("output", system.outputs)):
        for variable in variables:
            lines += _variable_lines(f"{place}.{role}.{as_key(variable.name)}", variable)
    return lines


def _variable_lines(place: str, variable: Variable) -> list[str]:
    ends = [float(variable.low), float(variable.high)]
    if not -np.inf < ends[0] < ends[1] < np.inf:
        raise ValueError(f"{variable.name} reaches from {ends[0]:g} to {ends[1]:g}, which is no range")
    lines = ["", f"[{place}]", f"range = {as_value(ends)}", f"[{place}.sets]"]
    for label, member in zip(variable.labels, variable.sets, strict=True):
        numbers = [float(number) for number in member.parameters()]
        try:
            membership(member.kind, numbers)
        except ValueError as problem:
            raise ValueError(f"{label!r} of {variable.name} {problem}") from None
        lines.append(f"{as_key(label)} = {as_value({member.kind: numbers})}")
    return lines
