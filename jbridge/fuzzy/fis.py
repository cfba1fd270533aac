"""MATLAB's `.fis` files, read and written.

A file is text: sections in brackets, one `key=value` a line, rules as numbers of sets. Nothing in it is executed.
"""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from .._files import replace_text
from ..errors import InputError, quoted
from .defuzzify import DEFUZZIFIERS
from .inference import POINTS, AbstractSystem, Mamdani
from .membership import MEMBERSHIPS, AbstractMembership, as_number
from .norms import NORMS, AbstractNorm
from .rules import Clause, Rule, Variable, check_labels
from .sugeno import Conclusions, Linear, Sugeno

_SECTION = re.compile(r"\[\s*(\w+)\s*\]")
_ENTRY = re.compile(r"(\w+)\s*=\s*(.*)")
_SET = re.compile(r"'([^']*)'\s*:\s*'([^']*)'\s*,\s*\[([^\]]*)\]")
_RULE = re.compile(r"([-\d\s.]+),([-\d\s.]+)\(([^)]*)\)\s*:\s*(\d+)")


class _Section(dict[str, tuple[int, str]]):
    """Entries of one section: line number and text by lower-case key."""


class _Reader:
    """One file, with what is needed to complain about a line of it."""

    def __init__(self, path: Path):
        self.path = path
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise InputError(f"{path}: there is no such file") from None
        except OSError as problem:
            raise InputError(f"{path}: cannot be read ({problem.strerror}); name a .fis file") from None
        except UnicodeDecodeError:
            raise InputError(f"{path}: this is not a text file; save the fuzzy system as .fis") from None
        self.sections: dict[str, _Section] = {}
        self.rules: list[tuple[int, str]] = []
        current = None
        lines = text.splitlines()
        self.lines = len(lines)
        for number, line in enumerate(lines, start=1):
            line = line.strip()
            if not line or line.startswith(("%", "#")):
                continue
            section, entry = _SECTION.fullmatch(line), _ENTRY.fullmatch(line)
            if section:
                current = section[1].lower()
                self.sections.setdefault(current, _Section())
            elif current == "rules":
                self.rules.append((number, line))
            elif current is not None and entry:
                self.sections[current][entry[1].lower()] = (number, entry[2].strip())
            else:
                self.complain(number, f"{quoted(line)} is neither a [section] nor key=value")
        if "system" not in self.sections:
            raise InputError(f"{path}: there is no [System] section; this is not a .fis file")

    def complain(self, line: int, problem: str) -> NoReturn:
        raise InputError(f"{self.path}: line {line}: {problem}")

    def entry(self, section: str, key: str, default: str | None = None) -> tuple[int, str]:
        found = self.sections.get(section, _Section()).get(key)
        if found is None:
            if default is None:
                raise InputError(f"{self.path}: [{section.capitalize()}] has no {key}; add it")
            return 0, default
        return found

    def word(self, section: str, key: str, default: str | None = None) -> tuple[int, str]:
        line, text = self.entry(section, key, default)
        return line, text.strip("'\"")

    def count(self, section: str, key: str) -> int:
        """A number of things; there cannot be more than the file has lines, which bounds what a file can ask for."""
        line, text = self.entry(section, key)
        if not re.fullmatch("[0-9]{1,9}", text) or int(text) > self.lines:
            self.complain(line, f"{key} is {quoted(text)}, where the number of those in the file belongs")
        return int(text)

    def numbers(self, line: int, text: str) -> list[float]:
        try:
            values = [float(word) for word in text.replace(",", " ").split()]
        except ValueError:
            self.complain(line, f"{quoted(text)} is not a list of numbers")
        if any(np.isnan(values)):
            self.complain(line, "NaN is no place for a corner")
        return values

    def choice(self, key: str, default: str, known: Sequence[str]) -> str:
        line, word = self.word("system", key, default)
        if word.lower() not in known:
            self.complain(line, f"{key} {quoted(word)} is not supported; choose one of {', '.join(known)}")
        return word.lower()

    def norm(self, key: str, default: str, known: Sequence[str]) -> AbstractNorm:
        return NORMS[self.choice(key, default, known)]()

    def variable(self, section: str) -> tuple[str, float, float, list[tuple[int, str, str, list[float]]]]:
        """Name, range, and each set's line, label, kind and numbers."""
        _, name = self.word(section, "name")
        line, text = self.entry(section, "range")
        ends = self.numbers(line, text.strip("[]"))
        if len(ends) != 2 or not ends[0] < ends[1] or not np.isfinite(ends).all():
            self.complain(line, f"a range has a lower and a higher end, not {quoted(text)}")
        members = []
        for number in range(1, self.count(section, "nummfs") + 1):
            line, text = self.entry(section, f"mf{number}")
            found = _SET.fullmatch(text)
            if not found:
                self.complain(line, f"{quoted(text)} is not of the form 'label':'kind',[numbers]")
            members.append((line, found[1], found[2], self.numbers(line, found[3])))
        return name, ends[0], ends[1], members

    def sets(self, section: str) -> Variable:
        name, low, high, members = self.variable(section)
        made = tuple(self._membership(*member) for member in members)
        labels = self._labels(section, name, [label for _, label, _, _ in members])
        return Variable(name, as_number(low), as_number(high), labels, made)

    def functions(self, section: str, inputs: int) -> Conclusions:
        name, low, high, members = self.variable(section)
        made = []
        for line, _, kind, numbers in members:
            wanted = {"constant": 1, "linear": inputs + 1}.get(kind)
            if wanted is None:
                self.complain(line, f"a Sugeno conclusion is constant or linear, not {quoted(kind)}")
            if len(numbers) != wanted:
                self.complain(line, f"{kind} needs {wanted} numbers, not {len(numbers)}")
            made.append(Linear(as_number(numbers[:-1] or [0.0] * inputs), as_number(numbers[-1])))
        labels = self._labels(section, name, [label for _, label, _, _ in members])
        return Conclusions(name, as_number(low), as_number(high), labels, tuple(made))

    def _labels(self, section: str, name: str, labels: list[str]) -> tuple[str, ...]:
        try:
            check_labels(name, labels, labels)
        except ValueError as problem:
            self.complain(self.entry(section, "name")[0], str(problem))
        return tuple(labels)

    def _membership(self, line: int, label: str, kind: str, numbers: list[float]) -> AbstractMembership:
        cls = MEMBERSHIPS.get(kind.lower())
        if cls is None:
            self.complain(line, f"{quoted(label)} is a {quoted(kind)}; jbridge knows {', '.join(MEMBERSHIPS)}")
        wanted = len(dataclasses.fields(cls))
        if len(numbers) != wanted:
            self.complain(line, f"{kind} needs {wanted} numbers, not {len(numbers)}")
        corners = kind.lower() in ("trimf", "trapmf")
        if corners and any(b < a for a, b in zip(numbers, numbers[1:], strict=False)):
            self.complain(line, f"the corners of {quoted(label)} are not in ascending order")
        if not corners and not np.isfinite(numbers).all():
            self.complain(line, f"{quoted(label)} has an infinite parameter")
        # An open shoulder: a flank so far away that it never shows.
        return cls(*np.clip(numbers, -1e12, 1e12))

    def rule(self, line: int, text: str, inputs: Sequence[Variable], outputs: Sequence[Variable | Conclusions]) -> Rule:
        found = _RULE.fullmatch(text)
        if not found:
            self.complain(line, f"{quoted(text)} is not of the form `1 2, 1 (1) : 1`")
        weight = self.numbers(line, found[3])
        if len(weight) != 1 or not 0.0 <= weight[0] <= 1.0:
            self.complain(line, f"a weight lies between 0 and 1, not at {quoted(found[3])}")
        if found[4] not in ("1", "2"):
            self.complain(line, f"a rule ends in 1 (and) or 2 (or), not in {quoted(found[4])}")
        before, after = (
            self._clauses(line, self.numbers(line, part), variables)
            for part, variables in ((found[1], inputs), (found[2], outputs))
        )
        if not before or not after:
            self.complain(line, "the rule names no input or no output")
        return Rule(before, after, as_number(weight[0]), found[4] == "2")

    def _clauses(
        self, line: int, numbers: Sequence[float], variables: Sequence[Variable | Conclusions]
    ) -> tuple[Clause, ...]:
        if len(numbers) != len(variables):
            self.complain(line, f"{len(numbers)} set numbers for {len(variables)} variables")
        clauses = []
        for place, (number, variable) in enumerate(zip(numbers, variables, strict=True)):
            if not (abs(number) <= len(variable.labels) and number == int(number)):
                self.complain(line, f"{variable.name} has no set {number:g}; it has {len(variable.labels)}")
            if number:
                clauses.append(Clause(place, int(abs(number)) - 1, number < 0))
        return tuple(clauses)


def load_fis(path: str | Path) -> AbstractSystem:
    """Reads a fuzzy system of type Mamdani or Sugeno.

    Raises:
        InputError: the file is missing or damaged, or uses what jbridge does not know; names file and line.
    """
    reader = _Reader(Path(path))
    kind = reader.choice("type", "mamdani", ("mamdani", "sugeno"))
    many = reader.count("system", "numinputs")
    inputs = tuple(reader.sets(f"input{i + 1}") for i in range(many))
    conjunction = reader.norm("andmethod", "min", ("min", "prod"))
    disjunction = reader.norm("ormethod", "max", ("max", "probor"))
    names = [f"output{i + 1}" for i in range(reader.count("system", "numoutputs"))]
    if not inputs or not names:
        raise InputError(f"{path}: a fuzzy system needs an input and an output")
    if kind == "sugeno":
        summed = reader.choice("defuzzmethod", "wtaver", ("wtaver", "wtsum")) == "wtsum"
        functions = tuple(reader.functions(name, many) for name in names)
        rules = tuple(reader.rule(line, text, inputs, functions) for line, text in reader.rules)
        return Sugeno(inputs, functions, _some(path, rules), conjunction, disjunction, summed)
    outputs = tuple(reader.sets(name) for name in names)
    rules = tuple(reader.rule(line, text, inputs, outputs) for line, text in reader.rules)
    return Mamdani(
        inputs,
        outputs,
        _some(path, rules),
        conjunction,
        disjunction,
        reader.norm("impmethod", "min", ("min", "prod")),
        reader.norm("aggmethod", "max", ("max", "sum", "probor")),
        DEFUZZIFIERS[reader.choice("defuzzmethod", "centroid", tuple(DEFUZZIFIERS))](),
        POINTS,
    )


def _some(path: str | Path, rules: tuple[Rule, ...]) -> tuple[Rule, ...]:
    if not rules:
        raise InputError(f"{path}: there are no rules; add a [Rules] section")
    return rules


def save_fis(path: str | Path, system: AbstractSystem, name: str = "") -> None:
    """Writes a fuzzy system; reading the file gives the same system, with MATLAB's number of points (101).

    A rule with several clauses about one variable is not MATLAB's; the last of them is written.
    """
    path = Path(path)
    outputs: list[tuple[Variable | Conclusions, list[str]]]
    if isinstance(system, Sugeno):
        kind, methods = "sugeno", ("prod", "sum", "wtsum" if system.summed else "wtaver")
        outputs = [(output, [_function(function) for function in output.functions]) for output in system.outputs]
    elif isinstance(system, Mamdani):
        kind = "mamdani"
        methods = (system.implication.name, system.aggregation.name, system.defuzzifier.name)
        outputs = [(output, [_set(member) for member in output.sets]) for output in system.outputs]
    else:
        raise TypeError(f"a .fis file holds a Mamdani or a Sugeno system, not a {type(system).__name__}")
    lines = [
        "[System]",
        f"Name='{name or path.stem}'",
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
        lines += _section(f"Input{number}", variable, [_set(member) for member in variable.sets])
    for number, (output, members) in enumerate(outputs, start=1):
        lines += _section(f"Output{number}", output, members)
    lines += ["", "[Rules]"]
    for rule in system.rules:
        before = _numbers(rule.antecedent, len(system.inputs))
        after = _numbers(rule.consequent, len(system.outputs))
        lines.append(f"{before}, {after} ({float(rule.weight)!r}) : {2 if rule.any_of else 1}")
    replace_text(path, "\n".join(lines) + "\n")


def _section(title: str, variable: Variable | Conclusions, members: Sequence[str]) -> list[str]:
    head = ["", f"[{title}]", f"Name='{variable.name}'"]
    head += [f"Range=[{float(variable.low)!r} {float(variable.high)!r}]", f"NumMFs={len(members)}"]
    pairs = zip(variable.labels, members, strict=True)
    return head + [f"MF{number}='{label}':{text}" for number, (label, text) in enumerate(pairs, start=1)]


def _set(member: AbstractMembership) -> str:
    numbers = " ".join(repr(float(getattr(member, field.name))) for field in dataclasses.fields(member))
    return f"'{member.kind}',[{numbers}]"


def _function(function: Linear) -> str:
    slopes, offset = np.asarray(function.slopes), float(function.offset)
    if not slopes.any():
        return f"'constant',[{offset!r}]"
    return f"'linear',[{' '.join(repr(float(value)) for value in (*slopes, offset))}]"


def _numbers(clauses: Sequence[Clause], count: int) -> str:
    places = [0] * count
    for clause in clauses:
        places[clause.variable] = -(clause.label + 1) if clause.negated else clause.label + 1
    return " ".join(str(place) for place in places)
