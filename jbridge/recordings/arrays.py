"""Recordings from memory: arrays and data frames go the way that the columns of a file go."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jbridge.errors import InputError
from jbridge.recordings.load import ignore, make_reading, refuse
from jbridge.recordings.recording import Recording
from jbridge.recordings.sidecar import Sidecar, parse_sidecar
from jbridge.recordings.tables.declarations import Where
from jbridge.recordings.tables.table import Table


def recording_from(
    name: str, columns: Mapping[str, Any], sidecar: Mapping[str, Any], inputs_only: bool = False, force: bool = False
) -> Recording:
    """Returns the recording in columns of numbers.

    Args:
        name: What messages call it, in place of a file.
        columns: Arrays of shape `(time,)` by name, copied.
        sidecar: The tables of a sidecar.
        inputs_only: Whether measured channels may be absent.
        force: Whether to take what is plainly in another unit, of another sign or called otherwise.

    Raises:
        InputError: As for a file; rows are counted from 0, like entries of arrays.
    """
    usable, unusable = {}, {}
    for key, values in columns.items():
        try:
            usable[key] = numbers(values)
        except ValueError as error:
            unusable[key] = str(error)
    longest = max((values.size for values in usable.values()), default=0)
    table = Table(name, name, usable, np.arange(longest), unusable)
    declared = parse_sidecar(Where(f"{name}, sidecar"), plain(sidecar)) if sidecar else Sidecar()
    try:
        return make_reading(Path(name), table, declared, inputs_only, ignore if force else refuse).recording
    except InputError as error:
        # What the owner of a file writes beside it, and on the command line, are arguments here.
        beside = f" in {Path(name).with_suffix('.toml').name}"
        said = str(error).replace(beside, " of the argument sidecar").replace("--force takes", "force=True takes")
        raise InputError(said) from None


def columns_of(name: str, frame: Any) -> dict[str, Any]:
    """Returns the columns of a data frame, or of a mapping, by name; a named index is one of them."""
    names = list(getattr(frame, "columns", frame))
    for place, key in enumerate(names):
        if key in names[:place]:
            raise InputError(f"{name}, column {key}: the name is there twice; rename or delete one")
    columns = {str(key): frame[key] for key in names}
    index: Any = getattr(frame, "index", None)
    if getattr(index, "name", None) is not None:
        columns.setdefault(str(index.name), index)
    return columns


def numbers(values: Any) -> np.ndarray:
    """Returns a copy as real numbers of shape `(time,)`; raises a ValueError that says what else it is."""
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "biuf":
        values = np.ma.filled(values.astype(np.float64), np.nan)  # what is masked is no number
    array = np.asarray(values)
    if array.dtype == object:
        try:
            array = array.astype(np.float64)
        except (TypeError, ValueError):
            raise ValueError("not only numbers") from None
    if array.dtype.kind in "mM":
        raise ValueError("dates or durations")
    if array.dtype.kind not in "biuf":
        raise ValueError("complex numbers" if array.dtype.kind == "c" else "text")
    if array.ndim != 1:
        raise ValueError(f"an array of shape {array.shape}")
    return np.array(array, dtype=np.float64)


def plain(value: Any) -> Any:
    """Returns a mapping with NumPy's scalars as Python's own, which a sidecar has."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    return value.item() if isinstance(value, np.generic) else value
