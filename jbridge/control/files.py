"""Controllers in TOML."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from .._files import replace_text
from .._toml import Where, as_value, positive, read_toml, shown, word
from ..errors import InputError
from ..trajectory import Path as SignalPath
from .base import AbstractController
from .fuzzy import FuzzyController
from .fuzzy_files import KEYS, fis_named, fuzzy_lines, read_fuzzy
from .linear import ObserverFeedback, Pid, StateFeedback
from .linear_files import (
    FEEDBACK_KEYS,
    OBSERVER_KEYS,
    PID_KEYS,
    feedback_lines,
    observer_lines,
    pid_lines,
    read_feedback,
    read_observer,
    read_pid,
)
from .shaping import Shaping, read_shaping, shaping_lines

PERIOD = 0.02
"""Sampling period where a file gives none [s], the paper's."""
SHORTEST_PERIOD = 1e-4
"""No drive of a bridge follows a command that changes faster [s]; it bounds how long a run is computed."""
LONGEST_PERIOD = 1.0
"""A swing of the shortest rope has ended by then [s]."""


@dataclass(frozen=True)
class Controller:
    """A law and how often it is asked."""

    law: AbstractController
    period: float = PERIOD
    """Of sampling [s]."""
    source: str = field(default="", compare=False)
    """The file that it was read from, for messages."""
    shaping: Shaping | None = None
    """What is done to a reference before it is followed."""
    files: tuple[str, ...] = field(default=(), compare=False)
    """What it was read from: its own file and the `.fis` files that this names."""

    def follows(self, path: SignalPath) -> SignalPath:
        """The reference that the law is given for a wanted one."""
        return path if self.shaping is None else self.shaping(path)


class _Format(NamedTuple):
    """How laws of one kind are read and written."""

    law: type[AbstractController]
    keys: Sequence[str]
    read: Callable[[Where, Mapping[str, Any], Path], AbstractController]
    lines: Callable[[Path, Any], tuple[list[str], list[str]]]


_FORMATS = {
    "fuzzy": _Format(FuzzyController, KEYS, read_fuzzy, fuzzy_lines),
    "pid": _Format(Pid, PID_KEYS, read_pid, pid_lines),
    "state_feedback": _Format(StateFeedback, FEEDBACK_KEYS, read_feedback, feedback_lines),
    "observer_feedback": _Format(ObserverFeedback, OBSERVER_KEYS, read_observer, observer_lines),
}


def has_file(law: AbstractController) -> bool:
    """Whether `save_controller` can write a law."""
    return any(isinstance(law, kind.law) for kind in _FORMATS.values())


def load_controller(path: str | os.PathLike[str]) -> Controller:
    """Reads a controller.

    Raises:
        InputError: naming the file, the key and what to do.
    """
    document = read_toml(Path(path), "controller", 'kind = "fuzzy" and the tables [cart] and [hoist]')
    file = Where(str(path))
    kind = _FORMATS[word(file, "kind", document.get("kind"), _FORMATS)]
    file.check_keys(document, ("kind", "period", "shaping", *kind.keys), "key")
    law = kind.read(file, document, Path(path))
    period, shaping = positive(file, document, "period", PERIOD), read_shaping(file, document.get("shaping"))
    if not SHORTEST_PERIOD <= period <= LONGEST_PERIOD:
        file.refuse(
            f"period = {shown(period)} s is not from {SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g};"
            f" write it as period = {PERIOD}"
        )
    return Controller(law, period, str(path), shaping, (str(path), *fis_named(document, Path(path))))


def save_controller(path: str | os.PathLike[str], controller: Controller) -> None:
    """Writes a controller; reading the file gives the same controller.

    A fuzzy system that TOML cannot hold lies in a `.fis` file beside it, `NAME-cart.fis` or `NAME-hoist.fis`.

    Raises:
        InputError: if the file cannot be written, or cannot hold the controller.
        TypeError: the law is of a kind that has no file.
    """
    path, law = Path(path), controller.law
    names = [name for name, kind in _FORMATS.items() if isinstance(law, kind.law)]
    if not names:
        raise TypeError(f"a {type(law).__name__} has no file; only {', '.join(_FORMATS)} have")
    if not SHORTEST_PERIOD <= controller.period <= LONGEST_PERIOD:
        raise InputError(
            f"{path}: the period is {controller.period:g} s,"
            f" which is not from {SHORTEST_PERIOD:g} to {LONGEST_PERIOD:g}"
        )
    lines, tables = _FORMATS[names[0]].lines(path, law)
    head = [f"kind = {as_value(names[0])}", f"period = {as_value(controller.period)}"]
    replace_text(path, "\n".join([*head, *lines, *shaping_lines(controller.shaping), *tables]) + "\n")
