"""Variables with their fuzzy sets, and the rules that connect them."""

import dataclasses
import re
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._math import on_processor
from .._types import Scalar
from .membership import AbstractMembership, Gathered, as_number
from .merged_grid import known
from .norms import AbstractNorm, Softness, between


def check_labels(name: str, labels: Sequence[str], things: Sequence[object]) -> None:
    """Raises `ValueError` unless every thing of a variable has a label; several may share one, as in `.fis` files."""
    if len(labels) != len(things):
        raise ValueError(f"{name}: {len(labels)} labels for {len(things)} sets")


@runtime_checkable
class Labelled(Protocol):
    """What a rule's words refer to: a name with labels."""

    @property
    def name(self) -> str: ...

    @property
    def labels(self) -> tuple[str, ...]: ...


def universe(low: Scalar, high: Scalar, points: int) -> Float[Array, " point"]:
    """Equally spaced points from one end to the other, both included."""
    return low + (high - low) * jnp.linspace(0.0, 1.0, points)


class Variable(eqx.Module):
    """An input or output: its universe and the sets that divide it."""

    name: str = eqx.field(static=True)
    low: Scalar = eqx.field(converter=as_number)
    high: Scalar = eqx.field(converter=as_number)
    labels: tuple[str, ...] = eqx.field(static=True)
    sets: tuple[AbstractMembership, ...]
    gathered: Gathered | None = None
    """The sets, as a loop has them (`ready`)."""

    def __check_init__(self) -> None:
        check_labels(self.name, self.labels, self.sets)

    @property
    def middle(self) -> Scalar:
        """Middle of the universe."""
        return 0.5 * (self.low + self.high)

    def clip(self, value: Array) -> Array:
        """The nearest value of the universe: what lies beyond an end counts as that end."""
        return between(value, self.low, self.high)

    def grid(self, points: int) -> Float[Array, " point"]:
        """Equally spaced points of the universe, both ends included."""
        return universe(self.low, self.high, points)

    def degrees(self, value: Array, softness: Softness = None) -> list[Array]:
        """Degree of membership of a value in each set, also beyond the universe."""
        if self.gathered is not None:
            return self.gathered.degrees(value, softness)
        return [member.degree(value, softness) for member in self.sets]

    def ready(self) -> "Variable":
        """The same variable for use in a loop."""
        if known(self.sets) or not on_processor():
            return self
        return dataclasses.replace(self, gathered=Gathered.of(self.sets))


class Clause(eqx.Module):
    """`variable is label`, or `variable is not label`, by position."""

    variable: int = eqx.field(static=True)
    label: int = eqx.field(static=True)
    negated: bool = eqx.field(static=True, default=False)


class Rule(eqx.Module):
    """`if` some clauses on inputs (all of them, or any) `then` some clauses on outputs."""

    antecedent: tuple[Clause, ...]
    consequent: tuple[Clause, ...]
    weight: Scalar = eqx.field(converter=as_number, default=1.0)
    any_of: bool = eqx.field(static=True, default=False)
    """Whether one clause is enough ("or"), if there are several."""

    def __check_init__(self) -> None:
        if not self.antecedent or not self.consequent:
            raise ValueError("a rule needs at least one clause before and one after `then`")

    def strength(
        self,
        degrees: Sequence[Sequence[Array]],
        conjunction: AbstractNorm,
        disjunction: AbstractNorm,
        softness: Softness = None,
    ) -> Array:
        """Firing strength for the degrees of every input's sets."""
        parts = []
        for clause in self.antecedent:
            degree = degrees[clause.variable][clause.label]
            parts.append(1.0 - degree if clause.negated else degree)
        return self.weight * (disjunction if self.any_of else conjunction).all(parts, softness)


_PLAIN = re.compile(r"[^\s'()]*[^\s'().]")
_WORD = re.compile(r"'(?:[^']|'')*'|[^\s()]+")
_KEYWORDS = ("if", "is", "not", "and", "or", "then")


def rule(text: str, inputs: Sequence[Labelled], outputs: Sequence[Labelled], *, weight: float = 1.0) -> Rule:
    """A rule from words, such as `if error is NS and velocity is not PB then voltage is NS`.

    Names of variables and sets are compared as they are and, where that finds none, without regard to case. A name that
    is not a plain word, such as one with a space, stands in single quotes, in which an apostrophe is written twice.

    Raises:
        ValueError: the words are not a rule, or name a variable or set that is not there, or several.
    """
    words = _WORD.findall(text.rstrip(". \n"))
    lower = [word.lower() for word in words]
    if not words or lower[0] != "if" or lower.count("then") != 1:
        raise ValueError(f"{text!r} is not of the form `if ... is ... then ... is ...`")
    at = lower.index("then")
    joined = {word for word in lower[1:at] if word in ("and", "or")}
    if len(joined) > 1:
        raise ValueError(f"{text!r} mixes `and` with `or`; write two rules")
    return Rule(
        _clauses(text, words[1:at], inputs),
        _clauses(text, words[at + 1 :], outputs),
        as_number(weight),
        "or" in joined,
    )


def _clauses(text: str, words: Sequence[str], variables: Sequence[Labelled]) -> tuple[Clause, ...]:
    found: list[Clause] = []
    rest = list(words)
    while rest:
        if found:
            if rest[0].lower() not in ("and", "or"):
                raise ValueError(f"{text!r}: expected `and` or `or` before {rest[0]!r}")
            rest = rest[1:]
        negated = len(rest) > 3 and rest[2].lower() == "not"
        needed = 4 if negated else 3
        if len(rest) < needed or rest[1].lower() != "is":
            raise ValueError(f"{text!r}: expected `<variable> is <set>` at {' '.join(rest[:3])!r}")
        number = _place(text, rest[0], [variable.name for variable in variables])
        label = _place(text, rest[needed - 1], variables[number].labels)
        found.append(Clause(number, label, negated))
        rest = rest[needed:]
    if not found:
        raise ValueError(f"{text!r}: nothing stands beside `then`")
    return tuple(found)


def _place(text: str, word: str, names: Sequence[str]) -> int:
    wanted = word[1:-1].replace("''", "'") if word[:1] == "'" == word[-1:] and len(word) > 1 else word
    same = [number for number, name in enumerate(names) if name == wanted]
    found = same or [number for number, name in enumerate(names) if name.lower() == wanted.lower()]
    if not found:
        raise ValueError(f"{text!r}: {wanted!r} is none of {', '.join(names)}")
    if len(found) > 1:
        raise ValueError(f"{text!r}: {wanted!r} may be any of {', '.join(names[number] for number in found)}")
    return found[0]


def _as_word(name: str) -> str:
    """A name as it stands in a sentence: in quotes unless it is a plain word."""
    if _PLAIN.fullmatch(name) and name.lower() not in _KEYWORDS:
        return name
    return "'" + name.replace("'", "''") + "'"


def in_words(found: Rule, inputs: Sequence[Labelled], outputs: Sequence[Labelled]) -> str:
    """A rule as a sentence, the inverse of `rule`."""

    def clauses(parts: Sequence[Clause], variables: Sequence[Labelled], joint: str) -> str:
        return joint.join(
            f"{_as_word(variables[c.variable].name)} is {'not ' if c.negated else ''}"
            f"{_as_word(variables[c.variable].labels[c.label])}"
            for c in parts
        )

    before = clauses(found.antecedent, inputs, " or " if found.any_of else " and ")
    return f"if {before} then {clauses(found.consequent, outputs, ' and ')}"
