"""MATLAB's `.fis` files, written; see `fis_reader` for the format."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..._files import replace_text
from ...errors import InputError
from ..inference import POINTS, AbstractSystem, Mamdani
from ..membership import AbstractMembership, membership
from ..rules import Clause, Variable
from ..sugeno import Conclusions, Linear, Sugeno
from .fis_reader import AGGREGATION, AND, IMPLICATION, OR


def save_fis(path: str | Path, system: AbstractSystem, name: str = "") -> None:
    """Writes a fuzzy system; reading the file, with the same `matlab`, gives the same system.

    The clauses of a rule are then in the order of the variables.

    Raises:
        InputError: the file cannot be written, or the system has what a `.fis` file cannot hold: several clauses about
            one variable in a rule, other norms or weights than MATLAB's, a grid of other than 101 points, a name of two
            lines, a number that is NaN.
        TypeError: the system is neither a Mamdani nor a Sugeno system.
    """
    path = Path(path)
    outputs: list[tuple[Variable | Conclusions, list[str]]]
    if isinstance(system, Sugeno):
        kind, methods = "sugeno", ("prod", "sum", "wtsum" if system.summed else "wtaver")
        outputs = [
            (output, [_function(path, *pair) for pair in zip(output.labels, output.functions, strict=True)])
            for output in system.outputs
        ]
    elif isinstance(system, Mamdani):
        kind = "mamdani"
        methods = (system.implication.name, system.aggregation.name, system.defuzzifier.name)
        outputs = [(output, _sets(path, output)) for output in system.outputs]
        if methods[0] not in IMPLICATION or methods[1] not in AGGREGATION:
            raise InputError(f"{path}: a .fis file has no {' or '.join(methods[:2])}; choose other norms")
        if system.points != POINTS:
            raise InputError(f"{path}: a .fis file has {POINTS} points, not {system.points}; write it as TOML")
    else:
        raise TypeError(f"a .fis file holds a Mamdani or a Sugeno system, not a {type(system).__name__}")
    if system.conjunction.name not in AND or system.disjunction.name not in OR:
        raise InputError(f"{path}: a .fis file has `and` as {' or '.join(AND)}, `or` as {' or '.join(OR)}")
    lines = [
        "[System]",
        f"Name={_quoted(name or path.stem)}",
        f"Type='{kind}'",
        "Version=2.0",
        f"NumInputs={len(system.inputs)}",
        f"NumOutputs={len(system.outputs)}",
        f"NumRules={len(system.rules)}",
        f"AndMethod='{system.conjunction.name}'",
        f"OrMethod='{system.disjunction.name}'",
        f"ImpMethod='{methods[0]}'",
        f"AggMethod='{methods[1]}'",
        f"DefuzzMethod='{methods[2]}'",
    ]
    for number, variable in enumerate(system.inputs, start=1):
        lines += _section(path, f"Input{number}", variable, _sets(path, variable))
    for number, (output, members) in enumerate(outputs, start=1):
        lines += _section(path, f"Output{number}", output, members)
    lines += ["", "[Rules]"]
    for number, rule in enumerate(system.rules, start=1):
        sides = (rule.antecedent, len(system.inputs)), (rule.consequent, len(system.outputs))
        if any(len({clause.variable for clause in clauses}) < len(clauses) for clauses, _ in sides):
            raise InputError(f"{path}: rule {number} has two clauses about one variable; write the system as TOML")
        if not 0.0 <= float(rule.weight) <= 1.0:
            raise InputError(f"{path}: rule {number} has the weight {float(rule.weight):g}; 0 to 1 can be written")
        before, after = (_numbers(clauses, count) for clauses, count in sides)
        lines.append(
            f"{before}, {after} ({float(rule.weight)!r}) : {2 if rule.any_of and len(rule.antecedent) > 1 else 1}"
        )
    for line in lines:
        if "\n" in line or "\r" in line:
            raise InputError(f"{path}: {line!r} has a name of two lines, which a .fis file cannot hold; rename it")
    replace_text(path, "\n".join(lines) + "\n")


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"


def _section(path: Path, title: str, variable: Variable | Conclusions, members: Sequence[str]) -> list[str]:
    low, high = float(variable.low), float(variable.high)
    if not -np.inf < low <= high < np.inf or (low == high and isinstance(variable, Variable)):
        raise InputError(f"{path}: {variable.name!r} reaches from {low:g} to {high:g}, which is no range; correct it")
    head = ["", f"[{title}]", f"Name={_quoted(variable.name)}"]
    head += [f"Range=[{low!r} {high!r}]", f"NumMFs={len(members)}"]
    pairs = zip(variable.labels, members, strict=True)
    return head + [f"MF{number}={_quoted(label)}:{text}" for number, (label, text) in enumerate(pairs, start=1)]


def _set(path: Path, label: str, member: AbstractMembership) -> str:
    numbers = [float(number) for number in member.parameters()]
    try:
        membership(member.kind, numbers)
    except ValueError as problem:
        raise InputError(f"{path}: {label!r} {problem}") from None
    return f"'{member.kind}',[{' '.join(map(repr, numbers)).replace('inf', 'Inf')}]"


def _sets(path: Path, variable: Variable) -> list[str]:
    return [_set(path, *pair) for pair in zip(variable.labels, variable.sets, strict=True)]


def _function(path: Path, label: str, function: Linear) -> str:
    slopes, offset = np.asarray(function.slopes), float(function.offset)
    if not np.isfinite([*slopes, offset]).all():
        raise InputError(f"{path}: {label!r} has a number that is not finite; correct it before it is written")
    if not slopes.any():
        return f"'constant',[{offset!r}]"
    return f"'linear',[{' '.join(repr(float(value)) for value in (*slopes, offset))}]"


def _numbers(clauses: Sequence[Clause], count: int) -> str:
    places = [0] * count
    for clause in clauses:
        places[clause.variable] = -(clause.label + 1) if clause.negated else clause.label + 1
    return " ".join(str(place) for place in places)
