"""Every explanation that was tried, as a table; its columns are what the trials tell."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...model.names import spaced
from ..text.quantities import UNKNOWN, digits
from ..text.tables import Table
from ..text.words import effect_name


def trial_table(trials: Sequence[Mapping[str, object]]) -> Table:
    """One row for each; none where nothing was tried."""
    columns = [key for key in dict.fromkeys(key for trial in trials for key in trial) if key not in ("kind", "site")]
    numbers = [i for i, key in enumerate(columns, start=1) if any(_is_number(trial.get(key)) for trial in trials)]
    rows = [(_name(trial), *(_cell(trial.get(key)) for key in columns)) for trial in trials]
    return Table(("explanation", *map(spaced, columns)), rows, numbers)


def _name(trial: Mapping[str, object]) -> str:
    kind, site = trial.get("kind"), trial.get("site")
    if kind is None:
        return UNKNOWN
    return effect_name(str(kind), str(site)) if site is not None else spaced(str(kind))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _cell(value: object) -> str:
    if value is None:
        return UNKNOWN
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return digits(float(value))
    if isinstance(value, list | tuple):
        return ", ".join(map(_cell, value))
    return str(value)
