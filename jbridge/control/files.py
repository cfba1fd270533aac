"""Controllers in TOML."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._toml import Where, as_value, positive, read_toml, replace_text, word
from ..errors import InputError
from .base import AbstractController
from .fuzzy import FuzzyController
from .fuzzy_files import KEYS, fuzzy_lines, read_fuzzy

PERIOD = 0.02
"""Sampling period where a file gives none [s], the paper's."""


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
    word(file, "kind", document.get("kind"), ("fuzzy",))
    file.check_keys(document, ("kind", "period", *KEYS), "key")
    law = read_fuzzy(file, document, Path(path).parent)
    return Controller(law, positive(file, document, "period", PERIOD), str(path))


def save_controller(path: str | os.PathLike[str], controller: Controller) -> None:
    """Writes a controller; reading the file gives the same controller.

    A fuzzy system that TOML cannot hold lies in a `.fis` file beside it, `NAME-cart.fis` or `NAME-hoist.fis`.

    Raises:
        InputError: if the file cannot be written, or cannot hold the controller.
        TypeError: the law is of another kind.
    """
    path, law = Path(path), controller.law
    if not isinstance(law, FuzzyController):
        raise TypeError(f"only fuzzy controllers are written, not a {type(law).__name__}")
    if not 0.0 < controller.period < np.inf:
        raise InputError(f"{path}: the period is {controller.period:g}, which is not a positive number")
    lines, tables = fuzzy_lines(path, law)
    head = ['kind = "fuzzy"', f"period = {as_value(controller.period)}"]
    replace_text(path, "\n".join([*head, *lines, *tables]) + "\n")
