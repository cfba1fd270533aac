"""MATLAB's `.fis` files, read.

A file is text: sections in brackets in any order, one `key=value` a line, rules as numbers of sets. Nothing in it is
executed. Names stand in single quotes, in which an apostrophe is written twice; a comment begins with `%` or `#`.
Source: MathWorks, Fuzzy Logic Toolbox User's Guide, `readfis`, `writeFIS` and "Membership Functions".
"""

import codecs
import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np

from ..._toml import nearest
from ...errors import InputError, quoted
from ..defuzzify import DEFUZZIFIERS
from ..inference import POINTS, AbstractSystem, Mamdani
from ..membership import MEMBERSHIPS, AbstractMembership, as_number, membership
from ..norms import NORMS, AbstractNorm
from ..rules import Clause, Rule, Variable
from ..sugeno import Conclusions, Linear, Sugeno

_SECTION = re.compile(r"\[\s*(\w+)\s*\]")
_ENTRY = re.compile(r"(\w+)\s*=\s*(.*)")
_COMMENT = r"\s*(?:[%#].*)?"
_QUOTED = r"'((?:[^']|'')*)'"
_NAME = re.compile(_QUOTED + _COMMENT)
_SET = re.compile(_QUOTED + r"\s*:\s*'([^']*)'\s*,\s*\[([^\]]*)\]" + _COMMENT)
# MATLAB itself writes the apostrophes of a name as they are.
_PLAIN_NAME = re.compile(r"(['\"])(.*)\1")
_PLAIN_SET = re.compile(r"'(.*?)'\s*:\s*'([^']*)'\s*,\s*\[([^\]]*)\]" + _COMMENT)
_RULE = re.compile(r"([-\d\s.]+),([-\d\s.]+)\(([^)]*)\)\s*:\s*([0-9]+)")
_VARIABLE = re.compile(r"(?:input|output)[0-9]+")
_SYSTEM = (
    "name", "type", "version", "numinputs", "numoutputs", "numrules", "andmethod", "ormethod", "impmethod", "aggmethod",
    "defuzzmethod",
)  # fmt: skip
AND, OR = ("min", "prod"), ("max", "probor")
IMPLICATION, AGGREGATION = ("min", "prod"), ("max", "sum", "probor")
"""Norms that a `.fis` file can name."""


def decoded(raw: bytes) -> str:
    """The text of a file in UTF-8 or UTF-16, with or without a byte order mark, in GBK, or in Latin-1.

    In GBK the signs beyond ASCII are pairs of bytes beyond it; in Latin-1 they are single ones, mostly inside a word.
    """
    for mark, coding in (
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
    ):
        if raw.startswith(mark):
            return raw[len(mark) :].decode(coding, errors="replace")
    if raw[1:2] == b"\0" or raw[:1] == b"\0":
        return raw.decode("utf-16-le" if raw[1:2] == b"\0" else "utf-16-be", errors="replace")
    pairs = all(len(run[0]) % 2 == 0 for run in re.finditer(rb"[\x80-\xff]+", raw))
    pairs = pairs and not re.search(rb"[A-Za-z][\x80-\xff]+[A-Za-z]", raw)
    for coding in ("utf-8", *(("gbk",) if pairs else ())):
        try:
            return raw.decode(coding)
        except UnicodeDecodeError:
            continue
    return raw.decode("latin-1")


class _Section(dict[str, tuple[int, str]]):
    """Entries of one section: line number and text by lower-case key."""


class _Reader:
    """One file, with what is needed to complain about a line of it."""

    def __init__(self, path: Path):
        self.path = path
        try:
            text = decoded(path.read_bytes())
        except FileNotFoundError:
            raise InputError(f"{path}: there is no such file") from None
        except OSError as problem:
            raise InputError(f"{path}: cannot be read ({problem.strerror}); name a .fis file") from None
        self.sections: dict[str, _Section] = {}
        self.rules: list[tuple[int, str]] = []
        current = None
        # Only these end a line: a name may contain what Unicode counts as another line's beginning.
        lines = re.split(r"\r\n|\r|\n", text)
        self.lines = len(lines)
        for number, line in enumerate(lines, start=1):
            line = line.strip()
            if not line or line.startswith(("%", "#")):
                continue
            section, entry = _SECTION.fullmatch(_bare(line)), _ENTRY.fullmatch(line)
            if section:
                current = section[1].lower()
                self.sections.setdefault(current, _Section())
            elif current == "rules":
                self.rules.append((number, _bare(line)))
            elif current is not None and entry:
                self.sections[current][entry[1].lower()] = (number, entry[2].strip())
            else:
                self.complain(number, f"{quoted(line)} is neither a [section] nor key=value")
        if "system" not in self.sections:
            raise InputError(f"{path}: there is no [System] section; this is not a .fis file")
        self.check_keys()
        self.inputs, self.outputs = self.count("numinputs", "input"), self.count("numoutputs", "output")
        if "numrules" in self.sections["system"]:
            line, wanted = self.whole("system", "numrules")
            if wanted != len(self.rules):
                self.complain(line, f"NumRules is {wanted}, but [Rules] has {len(self.rules)} rules; correct either")

    def check_keys(self) -> None:
        """Those of [System] have defaults, which would take the place of a misspelt one; all others are missed."""
        for key, (line, _) in self.sections["system"].items():
            if key not in _SYSTEM:
                self.complain(line, f"unknown key {quoted(key)}; {nearest(key, _SYSTEM)}")

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
        named, plain = _NAME.fullmatch(text), _PLAIN_NAME.fullmatch(text)
        if named:
            return line, named[1].replace("''", "'")
        return line, plain[2] if plain else _bare(text)

    def whole(self, section: str, key: str) -> tuple[int, int]:
        """A number of things; there cannot be more than the file has lines, which bounds what a file can ask for."""
        line, text = self.entry(section, key)
        if not re.fullmatch("[0-9]{1,9}", _bare(text)) or int(_bare(text)) > self.lines:
            self.complain(line, f"{key} is {quoted(text)}, where the number of those in the file belongs")
        return line, int(_bare(text))

    def count(self, key: str, role: str) -> int:
        """How many inputs or outputs there are: what [System] says, and as many sections."""
        line, wanted = self.whole("system", key)
        # By name: the number in a name may be longer than an integer that Python reads, and `[Input01]` is not read.
        known = {f"{role}{number}" for number in range(1, wanted + 1)}
        for name in self.sections:
            if _VARIABLE.fullmatch(name) and name.startswith(role) and name not in known:
                self.complain(line, f"{key} is {wanted}, but there is a section [{name.capitalize()}]; correct either")
        return wanted

    def numbers(self, line: int, text: str) -> list[float]:
        words = _bare(text).strip("[]").replace(",", " ").split()
        try:
            if any("_" in word for word in words):  # Python reads 1_0 as 10
                raise ValueError
            return [_number(word) for word in words]
        except (ValueError, ZeroDivisionError):
            self.complain(line, f"{quoted(text)} is not a list of numbers")

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
        ends = self.numbers(line, text)
        if len(ends) != 2 or not ends[0] <= ends[1] or not np.isfinite(ends).all():
            self.complain(line, f"a range has a lower and a higher end, not {quoted(text)}")
        line, wanted = self.whole(section, "nummfs")
        if f"mf{wanted + 1}" in self.sections[section]:
            self.complain(line, f"NumMFs is {wanted}, but there is an MF{wanted + 1}; correct either")
        members = []
        for number in range(1, wanted + 1):
            line, text = self.entry(section, f"mf{number}")
            full, plain = _SET.fullmatch(text), _PLAIN_SET.fullmatch(text)
            found = full or plain
            if not found:
                self.complain(line, f"{quoted(text)} is not of the form 'label':'kind',[numbers]")
            label = found[1].replace("''", "'") if full else found[1]
            members.append((line, label, found[2].strip(), self.numbers(line, found[3])))
        return name, ends[0], ends[1], members

    def sets(self, section: str) -> Variable:
        name, low, high, members = self.variable(section)
        if low == high:
            self.complain(self.entry(section, "range")[0], f"both ends of the range are {low:g}; widen it")
        made = tuple(self._membership(*member) for member in members)
        return Variable(name, as_number(low), as_number(high), tuple(label for _, label, _, _ in members), made)

    def functions(self, section: str, inputs: int) -> Conclusions:
        name, low, high, members = self.variable(section)
        made = []
        for line, _, written, numbers in members:
            kind = written.lower()
            wanted = {"constant": 1, "linear": inputs + 1}.get(kind)
            if wanted is None:
                self.complain(line, f"a Sugeno conclusion is constant or linear, not {quoted(written)}")
            numbers = _unpadded(numbers, wanted)
            if len(numbers) != wanted:
                self.complain(line, f"{kind} needs {wanted} numbers, not {len(numbers)}: {numbers}")
            if not np.isfinite(numbers).all():
                self.complain(line, f"{kind} has a number that is not finite: {numbers}")
            made.append(Linear(as_number(numbers[:-1] or [0.0] * inputs), as_number(numbers[-1])))
        labels = tuple(label for _, label, _, _ in members)
        return Conclusions(name, as_number(low), as_number(high), labels, tuple(made))

    def _membership(self, line: int, label: str, kind: str, numbers: list[float]) -> AbstractMembership:
        if kind.lower() not in MEMBERSHIPS:
            self.complain(line, f"{quoted(label)} is a {quoted(kind)}; jbridge knows {', '.join(MEMBERSHIPS)}")
        wanted = len(dataclasses.fields(MEMBERSHIPS[kind.lower()]))
        try:
            return membership(kind.lower(), _unpadded(numbers, wanted))
        except ValueError as problem:
            self.complain(line, f"{quoted(label)} {problem}")

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
        for clause in after:
            if clause.negated and isinstance(outputs[clause.variable], Conclusions):
                self.complain(line, "a Sugeno rule concludes in a function, which cannot be negated; drop the minus")
        return Rule(before, after, as_number(weight[0]), found[4] == "2" and len(before) > 1)

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


def _number(word: str) -> float:
    """A number, or a product or quotient of numbers and `pi`, as MATLAB's own demos write angles: `-pi/4`."""
    first, *rest = re.split("([*/])", word)
    value = _factor(first)
    for sign, part in zip(rest[::2], rest[1::2], strict=True):
        value = value * _factor(part) if sign == "*" else value / _factor(part)
    return value


def _factor(word: str) -> float:
    return {"pi": math.pi, "+pi": math.pi, "-pi": -math.pi}.get(word.lower()) or float(word)


def _bare(text: str) -> str:
    """A text without the comment that follows it."""
    return re.split("[%#]", text, maxsplit=1)[0].strip()


def _unpadded(numbers: list[float], wanted: int) -> list[float]:
    """As many numbers as are wanted, if what follows them are the zeros with which files fill up a row."""
    return numbers[:wanted] if not any(numbers[wanted:]) else numbers


def load_fis(path: str | Path, *, matlab: bool = False) -> AbstractSystem:
    """Reads a fuzzy system of type Mamdani or Sugeno.

    Args:
        path: of the file.
        matlab: whether it infers as MATLAB does where that differs; see `Mamdani.matlab`.

    Raises:
        InputError: the file is missing or damaged, or uses what jbridge does not know; names file and line.
    """
    reader = _Reader(Path(path))
    kind = reader.choice("type", "mamdani", ("mamdani", "sugeno"))
    many = reader.inputs
    inputs = tuple(reader.sets(f"input{i + 1}") for i in range(many))
    conjunction = reader.norm("andmethod", "min", AND)
    disjunction = reader.norm("ormethod", "max", OR)
    names = [f"output{i + 1}" for i in range(reader.outputs)]
    if not inputs or not names:
        raise InputError(f"{path}: a fuzzy system needs an input and an output")
    if kind == "sugeno":
        summed = reader.choice("defuzzmethod", "wtaver", ("wtaver", "wtsum")) == "wtsum"
        functions = tuple(reader.functions(name, many) for name in names)
        rules = tuple(reader.rule(line, text, inputs, functions) for line, text in reader.rules)
        return Sugeno(inputs, functions, _some(path, rules), conjunction, disjunction, summed, matlab)
    outputs = tuple(reader.sets(name) for name in names)
    rules = tuple(reader.rule(line, text, inputs, outputs) for line, text in reader.rules)
    return Mamdani(
        inputs,
        outputs,
        _some(path, rules),
        conjunction,
        disjunction,
        reader.norm("impmethod", "min", IMPLICATION),
        reader.norm("aggmethod", "max", AGGREGATION),
        DEFUZZIFIERS[reader.choice("defuzzmethod", "centroid", tuple(DEFUZZIFIERS))](),
        POINTS,
        matlab,
    )


def _some(path: str | Path, rules: tuple[Rule, ...]) -> tuple[Rule, ...]:
    if not rules:
        raise InputError(f"{path}: there are no rules; add a [Rules] section")
    return rules
