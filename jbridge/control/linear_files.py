"""PID controllers and state feedback, with or without an observer, as tables of a TOML file.

```toml
kind = "pid"
cart = {p = 10.0, i = 1.0, d = 1.0}    # V/m, V/(m s), V s/m
hoist = {p = 30.0, i = 3.0, d = 1.0}
```

```toml
kind = "state_feedback"                # u = -K (state - reference); x, psi, l [m, rad, m] and their rates
cart = [20.0, -5.0, 0.0, 4.0, -1.0, 0.0]
hoist = [0.0, 0.0, 40.0, 0.0, 0.0, 3.0]
```

`kind = "observer_feedback"` has the same gains, and for `filter` the observer's matrices as lists of rows: `transition`
(6 by 6), `drive` (6 by 2) and `correction` (6 by 3).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._toml import Where, as_value, number, positive, shown
from ..errors import InputError
from ..fuzzy.membership import as_number
from .base import Differences
from .compensation import Compensation, compensation_lines, read_compensation
from .linear import ObserverFeedback, Pid, StateFeedback

_AXES = ("cart", "hoist")
PID_KEYS = (*_AXES, "filter", "integral_share", "compensation")
FEEDBACK_KEYS = (*_AXES, "filter", "compensation")
_MATRICES = {"transition": 6, "drive": 2, "correction": 3}
"""Columns of an observer's matrices, which have six rows each."""
OBSERVER_KEYS = (*_AXES, *_MATRICES, "compensation")


def read_pid(file: Where, document: Mapping[str, Any], path: Path) -> Pid:
    """The law of a file whose `kind` is `pid`.

    Raises:
        InputError: naming the key and what to do.
    """
    gains: dict[str, Any] = {}
    for axis in _AXES:
        table = document.get(axis)
        if not isinstance(table, dict):
            file.refuse(f"no gains of the {axis}; add {axis} = {{p = 10.0, i = 1.0, d = 1.0}}")
        where = file.within(f"[{axis}]")
        where.check_keys(table, ("p", "i", "d"), "key")
        gains |= {f"{axis}_{term}": as_number(number(where, table, term, 0.0)) for term in "pid"}
    return Pid(
        **gains,
        differences=_differences(file, document),
        compensation=read_compensation(file, document.get("compensation")) or Compensation(),
        most=as_number(positive(file, document, "integral_share", 1.0)),
    )


def pid_lines(path: Path, law: Pid) -> tuple[list[str], list[str]]:
    """Keys and tables of a law; `read_pid` reads the same law from them.

    Raises:
        InputError: a number is not one that can be read.
    """
    lines = [
        f"filter = {as_value(_positive(path, 'filter', law.differences.time_constant))}",
        f"integral_share = {as_value(_positive(path, 'integral_share', law.most))}",
    ]
    for axis in _AXES:
        gains = {term: _finite(path, f"{axis}.{term}", getattr(law, f"{axis}_{term}")) for term in "pid"}
        lines.append(f"{axis} = {as_value(gains)}")
    return lines, compensation_lines(path, law.compensation)


def read_feedback(file: Where, document: Mapping[str, Any], path: Path) -> StateFeedback:
    """The law of a file whose `kind` is `state_feedback`.

    Raises:
        InputError: naming the key and what to do.
    """
    return StateFeedback(
        _read_gains(file, document),
        _differences(file, document),
        read_compensation(file, document.get("compensation")) or Compensation(),
    )


def feedback_lines(path: Path, law: StateFeedback) -> tuple[list[str], list[str]]:
    """Keys and tables of a law; `read_feedback` reads the same law from them.

    Raises:
        InputError: a number is not one that can be read.
    """
    lines = [f"filter = {as_value(_positive(path, 'filter', law.differences.time_constant))}"]
    return lines + _gain_lines(path, law.gains), compensation_lines(path, law.compensation)


def read_observer(file: Where, document: Mapping[str, Any], path: Path) -> ObserverFeedback:
    """The law of a file whose `kind` is `observer_feedback`.

    Raises:
        InputError: naming the key and what to do.
    """
    matrices = {}
    for key, columns in _MATRICES.items():
        rows = document.get(key)
        if not isinstance(rows, list) or [isinstance(row, list) and len(row) for row in rows] != [columns] * 6:
            file.refuse(f"{key} = {shown(rows)} is not a list of six rows of {columns} numbers each; give one")
        matrices[key] = jnp.asarray([_row(file, f"{key}[{k}]", row) for k, row in enumerate(rows)])
    compensation = read_compensation(file, document.get("compensation")) or Compensation()
    return ObserverFeedback(gains=_read_gains(file, document), compensation=compensation, **matrices)


def observer_lines(path: Path, law: ObserverFeedback) -> tuple[list[str], list[str]]:
    """Keys and tables of a law; `read_observer` reads the same law from them.

    Raises:
        InputError: a number is not one that can be read.
    """
    lines = _gain_lines(path, law.gains)
    for key in _MATRICES:
        rows = [
            [_finite(path, f"{key}[{k}][{j}]", value) for j, value in enumerate(row)]
            for k, row in enumerate(np.asarray(getattr(law, key)))
        ]
        lines += [f"{key} = [", *(f"    {as_value(row)}," for row in rows), "]"]
    return lines, compensation_lines(path, law.compensation)


def _read_gains(file: Where, document: Mapping[str, Any]) -> Array:
    rows = []
    for axis in _AXES:
        row = document.get(axis)
        if not isinstance(row, list) or len(row) != 6:
            file.refuse(f"{axis} = {shown(row)} is not a list of six gains; give those of x, psi, l and of their rates")
        rows.append(_row(file, axis, row))
    return jnp.asarray(rows)


def _row(file: Where, key: str, row: list[Any]) -> list[float]:
    return [number(file, {f"{key}[{k}]": value}, f"{key}[{k}]", 0.0) for k, value in enumerate(row)]


def _gain_lines(path: Path, gains: Array) -> list[str]:
    return [
        f"{axis} = {as_value([_finite(path, f'{axis}[{k}]', gain) for k, gain in enumerate(row)])}"
        for axis, row in zip(_AXES, np.asarray(gains), strict=True)
    ]


def _differences(file: Where, document: Mapping[str, Any]) -> Differences:
    return Differences(as_number(positive(file, document, "filter", 0.02)))


def _finite(path: Path, key: str, value: Any) -> float:
    if not np.isfinite(float(value)):
        raise InputError(f"{path}: {key} is {float(value):g}; correct it before it is written")
    return float(value)


def _positive(path: Path, key: str, value: Any) -> float:
    if not _finite(path, key, value) > 0.0:
        raise InputError(f"{path}: {key} is {float(value):g}, which is not a positive number")
    return float(value)
