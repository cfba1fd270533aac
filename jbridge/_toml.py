"""Files in TOML, read key by key and written whole: what models and controllers have in common.

A file is data; nothing in it is executed. Whatever is wrong with it becomes one line that names file, table and key.
"""

import datetime
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path, PureWindowsPath
from typing import Any, NoReturn

import numpy as np

from .errors import InputError, listed, quoted

_DEEPEST = 20
"""Most tables and lists within each other; files of jbridge need seven, and what walks a document is safe so."""
_TOO_DEEP = f"tables or lists nested more than {_DEEPEST} deep; delete what does not belong into the file"
_WHOLE = range(-(2**63), 2**63)
"""Integers that TOML promises to carry."""


@dataclass(frozen=True)
class Where:
    """A place in a file, to which a refusal points."""

    place: str

    def within(self, table: str) -> "Where":
        return Where(f"{self.place}, {table}")

    def refuse(self, problem: str) -> NoReturn:
        raise InputError(f"{self.place}: {problem}")

    def check_keys(self, table: Mapping[str, Any], allowed: Iterable[str], noun: str) -> None:
        for key in table:
            if key not in allowed:
                self.refuse(f"unknown {noun} {quoted(key)}; {nearest(key, allowed)}")

    def beside(self, file: Path, key: str, name: str) -> Path:
        """The path of a file that `file` names under a key: in the same folder or below, nowhere else."""
        given, on_windows = Path(name), PureWindowsPath(name)
        leaves = given.is_absolute() or on_windows.anchor or ".." in (*given.parts, *on_windows.parts)
        if not name.isprintable() or leaves or not given.name:
            self.refuse(
                f"{key} = {shown(name)} does not lie beside this file or in a folder below; put the file there and"
                f' write {key} = "NAME"'
            )
        return file.parent / given


def nearest(word: str, choices: Iterable[str]) -> str:
    """What to write instead of an unknown word."""
    every = list(choices)
    near = get_close_matches(word, every, 1)
    return f"did you mean {quoted(near[0], 80)}?" if near else f"choose among {listed(every, len(every))}"


def word(where: Where, key: str, value: Any, choices: Iterable[str]) -> str:
    every = list(choices)
    if value is None:
        where.refuse(f"no {key}; add {key} = {' or '.join(map(json.dumps, every[:3]))}{', ...' if every[3:] else ''}")
    if not isinstance(value, str):
        where.refuse(f"{key} = {shown(value)} is not a word in quotes; choose among {listed(every, len(every))}")
    if value not in every:
        where.refuse(f"unknown {key} {quoted(value)}; {nearest(value, every)}")
    return value


def positive(where: Where, table: Mapping[str, Any], key: str, default: float) -> float:
    """A positive number, or the default where a table has none."""
    value = number(where, table, key, default)
    if not value > 0.0:
        where.refuse(f"{key} = {shown(table[key])} is not a positive number; write it as {key} = {default}")
    return value


def number(where: Where, table: Mapping[str, Any], key: str, default: float) -> float:
    """A finite number, or the default where a table has none."""
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(float(value)):
        where.refuse(f"{key} = {shown(value)} is not a number; write it as {key} = {default}")
    return float(value)


def flag(where: Where, table: Mapping[str, Any], key: str) -> bool:
    """True or false; false where a table has neither."""
    value = table.get(key, False)
    if not isinstance(value, bool):
        where.refuse(f"{key} = {shown(value)} is neither true nor false")
    return bool(value)


def shown(value: Any) -> str:
    """A value as it may stand in a message."""
    text = quoted(value) if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= 43 else text[:40] + "..."


def read_toml(path: Path, noun: str, first: str) -> dict[str, Any]:
    """The tables of a file.

    Args:
        path: of the file.
        noun: what it is, such as "model".
        first: what an empty file should begin with.

    Raises:
        InputError: there is no such file, or it is not TOML.
    """
    document = read_tables(path, noun)
    if not document:
        raise InputError(f"{path}: the file is empty; write {first}")
    return document


def read_tables(path: Path, noun: str) -> dict[str, Any]:
    """The tables of a file, which may be empty.

    They are nested at most 20 deep, and their integers have 64 bits.

    Args:
        path: of the file.
        noun: what it is, such as "model".

    Raises:
        InputError: there is no such file, it is not TOML, or it holds what nothing here reads.
    """
    if path.suffix.lower() == ".fis" and path.exists():
        raise InputError(
            f"{path}: a MATLAB fuzzy system, where a {noun} TOML belongs; a controller's TOML beside it names it:"
            f' kind = "fuzzy" and cart = "{path.name}"'
        )
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give the path of a {noun} TOML") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not text in UTF-8; give a {noun} TOML, saved as UTF-8") from None
    except (OSError, ValueError) as error:  # a path may hold a null byte
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason}); give the path of a {noun} TOML") from None
    try:
        document = tomllib.loads(text)
    except ValueError as error:  # besides syntax: a number too long
        raise InputError(f"{path}: not TOML ({error}); correct that line") from None
    except RecursionError:
        raise InputError(f"{path}: {_TOO_DEEP}") from None
    for key, value, depth in _entries(document):
        if depth > _DEEPEST:
            raise InputError(f"{path}, {quoted(key)}: {_TOO_DEEP}")
        if isinstance(value, int) and value not in _WHOLE:
            raise InputError(f"{path}, {quoted(key)}: an integer of more than 64 bits; write it with a decimal point")
    return document


def _entries(document: dict[str, Any]) -> Iterator[tuple[str, Any, int]]:
    """Key, value and depth of all that a document holds; without recursion, which a deep one would exhaust."""
    left: list[tuple[str, Any, int]] = [("", document, 0)]
    while left:
        key, value, depth = left.pop()
        yield key, value, depth
        if isinstance(value, dict):
            left += [(f"{key}.{name}" if key else name, entry, depth + 1) for name, entry in value.items()]
        elif isinstance(value, list):
            left += [(key, entry, depth + 1) for entry in value]


def as_key(name: str) -> str:
    """A key in TOML's notation, in quotes only where it must be."""
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else as_value(name)


def as_value(value: Any) -> str:
    """A value in TOML's notation; a float has the fewest digits that give it back."""
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for one character that TOML wants escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{as_key(key)} = {as_value(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple) or np.ndim(value):
        return "[" + ", ".join(as_value(entry) for entry in value) + "]"
    return repr(float(value))
