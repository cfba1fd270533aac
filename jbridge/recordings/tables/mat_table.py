"""Reads MATLAB files, v4 to v7: vectors, structs of vectors, Simulink's "structure with time", and ControlDesk's.

Only numbers are taken from the file; nothing in it is executed.
"""

import warnings
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque, MatReadError, MatReadWarning

from jbridge.errors import InputError, cut
from jbridge.recordings.tables.columns import CHANNELS
from jbridge.recordings.tables.mat_format import checked
from jbridge.recordings.tables.table import Table

HDF5 = b"\x89HDF\r\n\x1a\n"
CONVERSIONS = {
    "table": "s = table2struct({v}, 'ToScalar', true); save('{new}', '-struct', 's', '-v7')",
    "timetable": (
        "s = table2struct(timetable2table({v}), 'ToScalar', true); s.t = seconds(s.Time);"
        " s = rmfield(s, 'Time'); save('{new}', '-struct', 's', '-v7')"
    ),
    "timeseries": "t = {v}.Time; x = {v}.Data; save('{new}', 't', 'x', '-v7')",
    "Simulink.SimulationData.Dataset": (
        "e = {v}.get('x').Values; t = e.Time; x = e.Data; save('{new}', 't', 'x', '-v7')"
    ),
    "Simulink.SimulationOutput": (
        "e = {v}.logsout.get('x').Values; t = e.Time; x = e.Data; save('{new}', 't', 'x', '-v7')"
    ),
}
"""The MATLAB line that turns an object of a class into vectors."""


def read_mat(path: Path, content: bytes) -> Table:
    """Returns the vectors of a MATLAB file, those in structs included, by their own names.

    Raises:
        InputError: naming the file and, for v7.3 and for objects, the MATLAB line that converts them.
    """
    if not content:
        raise InputError(f"{path}: the file is empty; save the run again")
    converted = f"{path.stem}_v7.mat"
    if content.startswith((b"MATLAB 7.3", HDF5)) or content[512:520] == HDF5:
        raise InputError(
            f"{path}: a MATLAB v7.3 file; convert it in MATLAB with"
            f" s = load('{path.name}'); save('{converted}', '-struct', 's', '-v7')"
        )
    columns: dict[str, np.ndarray] = {}
    unusable: dict[str, str] = {}
    for name, value in load(path, content).items():
        if isinstance(value, MatlabOpaque | MatlabObject | MatlabFunction):
            raise InputError(object_message(path, converted, name, value))
        if name.startswith("__"):
            continue
        for inner, vector in fields(path, name, value).items():
            if inner in columns and is_same(columns[inner], vector):
                continue  # each of several structs has the time
            if inner in columns or inner in unusable:
                raise InputError(
                    f"{path}, column {cut(inner)}: the name is there twice, also in {cut(name)}; keep one of them"
                )
            what = why_unusable(vector)
            if what:
                unusable[inner] = what
            else:
                columns[inner] = np.asarray(vector, dtype=np.float64).reshape(-1)
    longest = max((len(column) for column in columns.values()), default=0)
    return Table(str(path), str(path), columns, np.arange(1, longest + 1), unusable)


def load(path: Path, content: bytes) -> dict[str, object]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", MatReadWarning)
            return dict(loadmat(BytesIO(checked(content)), appendmat=False))
    except NotImplementedError as error:
        raise InputError(f"{path}: cannot be read ({error}); save it in MATLAB with '-v7'") from None
    except (
        MatReadError,
        MatReadWarning,
        OSError,
        ArithmeticError,
        LookupError,
        TypeError,
        ValueError,
    ) as error:
        raise InputError(f"{path}: not a MATLAB file, or a damaged one ({error}); save it again") from None
    except Exception as error:  # a damaged file can raise anything in the decompressor and the parser
        kind = type(error).__name__
        raise InputError(f"{path}: not a MATLAB file, or a damaged one ({kind}); save it again") from None


def is_same(column: np.ndarray, value: object) -> bool:
    return isinstance(value, np.ndarray) and value.size == column.size and np.array_equal(value.reshape(-1), column)


def fields(path: Path, name: str, value: object, depth: int = 0) -> dict[str, object]:
    """Returns the vectors that a variable holds: itself, or the fields of a struct and of structs within it.

    A struct of `Time` and `Data`, or of time and one signal without label, is the signal called like the variable.
    """
    names = value.dtype.names if isinstance(value, np.ndarray) else None
    if names is None or depth > 8:
        return {name: value}
    assert isinstance(value, np.ndarray)
    if value.size != 1:
        return {name: f"an array of {value.size} structs"}
    struct = value.reshape(-1)[0]
    if {"time", "signals"} <= set(names):
        return structure_with_time(path, name, struct)
    if {"Time", "Data"} <= set(names):
        return {"t": struct["Time"], name: struct["Data"]}
    if {"X", "Y"} <= set(names) and (found := control_desk(path, name, struct["X"], struct["Y"])):
        return found
    found = {}
    for inner in names:
        for label, vector in fields(path, inner, struct[inner], depth + 1).items():
            if label in found and not (isinstance(before := found[label], np.ndarray) and is_same(before, vector)):
                raise InputError(
                    f"{path}, column {cut(label)}: the name is there twice in {cut(name)}; keep one of them"
                )
            found.setdefault(label, vector)
    return found


def structure_with_time(path: Path, name: str, struct: np.void) -> dict[str, object]:
    """Returns `t` and the signals of Simulink's "structure with time", each under its label."""
    vectors: dict[str, object] = {"t": struct["time"]}
    signals = struct["signals"]
    if not isinstance(signals, np.ndarray) or "values" not in (signals.dtype.names or ()):
        raise InputError(
            f"{path}, {cut(name)}.signals: no struct with values and label, as Simulink's structure with time has; save"
            " vectors of numbers with '-v7'"
        )
    for place, signal in enumerate(signals.reshape(-1)):
        label = text(signal["label"]) if "label" in signals.dtype.names else ""
        label = label or (name if signals.size == 1 and name in CHANNELS else "")
        if not label:
            raise InputError(
                f"{path}, {cut(name)}.signals({place + 1}): the signal has no label; in MATLAB set"
                f" {name}.signals({place + 1}).label = 'x' (or u_x, psi, ...) and save with '-v7'"
            )
        if label in vectors:
            raise InputError(f"{path}, column {cut(label)}: two signals of {cut(name)} have this label; rename one")
        vectors[label] = signal["values"]
    return vectors


def control_desk(path: Path, name: str, times: object, signals: object) -> dict[str, object]:
    """Returns `t` and the signals of a measurement of dSPACE ControlDesk, each under its name, or under its path and
    name where another one has the same; nothing where the two structs are none.

    Of several times that is taken which most signals have, and of signals at other times it is said that they are.
    """
    if not all(isinstance(each, np.ndarray) and "Data" in (each.dtype.names or ()) for each in (times, signals)):
        return {}
    assert isinstance(times, np.ndarray) and isinstance(signals, np.ndarray)
    if "Name" not in signals.dtype.names or not times.size or not signals.size:
        return {}
    rasters, every = [each["Data"] for each in times.reshape(-1)], list(signals.reshape(-1))
    own = [raster_of(each, rasters) for each in every]
    chosen = max(range(len(rasters)), key=own.count)
    names = [text(each["Name"]) for each in every]
    vectors: dict[str, object] = {"t": rasters[chosen]}
    for place, (label, signal) in enumerate(zip(names, every, strict=True)):
        if names.count(label) > 1 and "Path" in signals.dtype.names:
            label = f"{text(signal['Path'])}/{label}"
        if not label or label in vectors:
            what = f"has the name of another, {cut(label)}" if label else "has no name"
            raise InputError(f"{path}, {cut(name)}.Y({place + 1}): the signal {what}; rename it in ControlDesk")
        vectors[label] = signal["Data"] if own[place] == chosen else "measured at other times"
    return vectors


def raster_of(signal: np.void, rasters: list[np.ndarray]) -> int:
    """Returns which of several times a signal of ControlDesk has: as it says, or else the first as long as it; -1 for
    none."""
    index = signal["XIndex"] if "XIndex" in (signal.dtype.names or ()) else None
    if index is not None and np.size(index) == 1:
        return int(np.asarray(index).reshape(-1)[0]) - 1
    return next((k for k, raster in enumerate(rasters) if np.size(raster) == np.size(signal["Data"])), -1)


def text(value: object) -> str:
    """Returns what an array of characters spells; nothing where it is no such array."""
    return "".join(value.reshape(-1)) if isinstance(value, np.ndarray) and value.dtype.kind == "U" else ""


def why_unusable(value: object) -> str:
    """Returns what a value is if it is no vector of real numbers, else nothing."""
    if isinstance(value, str):
        return value
    if not isinstance(value, np.ndarray):
        return "no array of numbers"
    if value.dtype.kind not in "fiub":
        return "complex" if value.dtype.kind == "c" else "no array of numbers"
    if value.size == 1:
        return "a single number"
    if value.size == 0:
        return "empty"
    if value.size != max(value.shape):
        return f"a matrix of {' x '.join(map(str, value.shape))}, not a vector"
    return ""


def object_message(path: Path, converted: str, name: str, value: np.ndarray) -> str:
    """Returns the refusal of a MATLAB object, with the line that turns objects of its class into vectors."""
    kind, remedy = "function or old-style object", "save vectors of numbers instead"
    if isinstance(value, MatlabOpaque) and value.size:
        item = value.reshape(-1)[0]
        texts = [item[key] for key in ("s0", "s1", "s2")]
        name, _, kind = (text.decode("utf-8", "replace") if isinstance(text, bytes) else text for text in texts)
        line = CONVERSIONS.get(kind, CONVERSIONS["timeseries"]).format(v=name, new=converted)
        remedy = f"convert it in MATLAB with {line}"
    return f"{path}: {cut(name)} is a MATLAB object ({cut(kind)}), not a vector; {remedy}"
