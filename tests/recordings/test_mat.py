"""MATLAB files give what the same columns in a CSV give; what is no vector is refused with a way out."""

import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from jbridge.errors import InputError
from jbridge.recordings import load_recording
from jbridge.recordings.tables import mat_format


@pytest.fixture
def save(tmp_path):
    """Writes variables as `run.mat` and returns its path."""

    def to_file(variables: dict, **options: object):
        path = tmp_path / "run.mat"
        savemat(path, variables, **options)
        return path

    return to_file


def same(recording, columns):
    for name in ("u_x", "u_l", "x", "psi", "l"):
        np.testing.assert_array_equal(getattr(recording, name), columns[name])
    np.testing.assert_array_equal(recording.times, columns["t"])
    return True


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"do_compression": True},
        {"oned_as": "column"},
        {"format": "4"},
    ],
    ids=["rows", "compressed", "columns", "v4"],
)
def test_vectors(save, columns, options):
    recording = load_recording(save(columns, **options))
    assert same(recording, columns)
    assert recording.name == "run.mat"


def test_a_struct_of_vectors(save, columns):
    assert same(load_recording(save({"rec": columns})), columns)


def test_vectors_beside_a_struct(save, columns):
    t = columns.pop("t")
    assert same(load_recording(save({"t": t, "rec": columns})), {**columns, "t": t})


def test_integers_and_flags_are_numbers(save, columns):
    columns["u_x"] = (columns["u_x"] > 0).astype(np.uint8)
    columns["on"] = columns["u_l"] > 0
    recording = load_recording(save(columns))
    np.testing.assert_array_equal(recording.u_x, columns["u_x"])
    assert recording.extras["on"].dtype == np.float64


def structure_with_time(columns: dict, labels: dict | None = None) -> dict:
    """Returns what Simulink's To Workspace block saves as "Structure With Time"."""
    kind = [("values", object), ("dimensions", object), ("label", object)]
    signals = np.zeros((1, len(columns) - 1), dtype=kind)
    for place, name in enumerate(name for name in columns if name != "t"):
        label = (labels or {}).get(name, name)
        signals[0, place] = (columns[name].reshape(-1, 1), 1.0, label)
    return {"time": columns["t"].reshape(-1, 1), "signals": signals, "blockName": "rig/To Workspace"}


def test_structure_with_time(save, columns):
    assert same(load_recording(save({"simout": structure_with_time(columns)})), columns)


def test_a_signal_needs_a_label(save, columns):
    path = save({"simout": structure_with_time(columns, {"x": ""})})
    with pytest.raises(InputError, match=r"run\.mat, simout\.signals\(3\): .* no label.*label = 'x'"):
        load_recording(path)


@pytest.mark.parametrize(
    "label",
    [3.0, np.array(["a", 1.0], dtype=object), {"name": "x"}, np.zeros((2, 0))],
    ids=["number", "cell", "struct", "empty"],
)
def test_a_label_that_is_no_text_is_none(save, columns, label):
    path = save({"simout": structure_with_time(columns, {"x": label})})
    with pytest.raises(InputError, match=r"run\.mat, simout\.signals\(3\): .* no label.*label = 'x'"):
        load_recording(path)


@pytest.mark.parametrize("signals", [3.0, "x", {"label": "x"}, np.array([1, "a"], dtype=object)], ids=str)
def test_signals_that_are_no_struct_are_refused(save, columns, signals):
    path = save({"simout": {"time": columns["t"], "signals": signals}})
    with pytest.raises(InputError, match=r"run\.mat, simout\.signals: no struct with values and label.*'-v7'"):
        load_recording(path)


def control_desk(columns: dict, names: dict | None = None) -> dict:
    """A measurement as dSPACE ControlDesk exports it: times in `X`, signals in `Y`."""
    own = [("u_x", "inputs"), ("u_l", "inputs"), ("x", "cart"), ("psi", "load"), ("l", "rope")]
    kinds = [("Name", object), ("Path", object), ("Data", object), ("XIndex", object)]
    rows = [((names or {}).get(name, name), path, columns[name][None], 2.0) for name, path in own]
    # As long as the others, at times of its own.
    rows.append(("other", "slow", columns["x"][None], 1.0))
    times = [(2.0 * columns["t"][None], "slow"), (columns["t"][None], "fast")]
    x = np.array(times, dtype=[("Data", object), ("Raster", object)])[None]
    return {"mess1": {"X": x, "Y": np.array(rows, dtype=kinds)[None], "Description": {"General": "a run"}}}


def test_a_measurement_of_control_desk(save, columns, tmp_path):
    assert same(load_recording(save(control_desk(columns))), columns)
    (tmp_path / "run.toml").write_text('[columns]\nx = {column = "other"}\n')
    with pytest.raises(InputError, match="measured at other times"):
        load_recording(save(control_desk(columns)))
    (tmp_path / "run.toml").write_text('[columns]\nx = {column = "cart/Out1"}\npsi = {column = "load/Out1"}\n')
    assert same(load_recording(save(control_desk(columns, {"x": "Out1", "psi": "Out1"}))), columns)


@pytest.mark.parametrize(("name", "what"), [("t", "has the name of another, t"), ("", "has no name")])
def test_a_signal_of_control_desk_needs_a_name_of_its_own(save, columns, name, what):
    with pytest.raises(InputError, match=rf"mess1\.Y\(3\): the signal {what}; rename it"):
        load_recording(save(control_desk(columns, {"x": name})))


def test_a_sidecar_maps_variables(save, columns, tmp_path):
    columns["cart_mm"] = columns.pop("x") * 1e3
    (tmp_path / "run.toml").write_text('[columns]\nx = {column = "cart_mm", unit = "mm"}\n')
    np.testing.assert_allclose(load_recording(save(columns)).x * 1e3, columns["cart_mm"])


def test_what_is_no_signal_is_left_aside(save, columns):
    clutter = {
        "Ts": 0.005,
        "comment": "after lunch",
        "K": np.eye(3),
        "cells": np.array([1, "a"], dtype=object),
        "coarse": np.arange(7.0),
    }
    recording = load_recording(save({**columns, **clutter}))
    assert same(recording, columns)
    assert recording.extras == {}
    assert any("coarse" in note for note in recording.notes)


def test_structs_within_structs_and_one_for_each_signal(save, columns):
    """Logs of several blocks have the time in each of them."""
    t, others = columns["t"], {name: values for name, values in columns.items() if name != "t"}
    assert same(load_recording(save({"out": {"log": columns}})), columns)
    assert same(load_recording(save({name: {"Time": t, "Data": values} for name, values in others.items()})), columns)
    signals = {name: {"values": values, "label": "", "dimensions": 1.0} for name, values in others.items()}
    assert same(load_recording(save({name: {"time": t, "signals": s} for name, s in signals.items()})), columns)
    other = {name: {"Time": t + (name == "x"), "Data": values} for name, values in others.items()}
    with pytest.raises(InputError, match="column t: the name is there twice"):
        load_recording(save(other))


def with_bad(columns, name, sample, value):
    columns[name][sample] = value
    return columns


REFUSED = {
    "no t": (lambda c: {"time": c["t"], "x": c["x"]}, ["no column t", "'time', 'x'", "run.toml"]),
    "nothing": (lambda c: {"note": "hello"}, ["no column t", "note is no array of numbers", "'-v7'"]),
    "x without u_x": (lambda c: {"t": c["t"], "x": c["x"]}, ["no u_x", "zeros"]),
    "nan": (lambda c: with_bad(c, "x", 11, np.nan), ["row 12", "column x", "NaN", "delete the row"]),
    "time": (lambda c: with_bad(c, "t", 11, 0.0), ["row 12", "column t", "increase"]),
    "lengths": (lambda c: {**c, "x": c["x"][:-1]}, ["column x", "399 values", "t has 400"]),
    "a number": (lambda c: {**c, "l": 0.7}, ["column l", "a single number", "vector"]),
    "a matrix": (lambda c: {**c, "x": c["x"].reshape(2, -1)}, ["column x", "2 x 200", "vector"]),
    "complex": (lambda c: {**c, "x": c["x"] * 1j}, ["column x", "complex"]),
    "text": (lambda c: {**c, "x": "much"}, ["column x", "no array of numbers"]),
    "struct array": (
        lambda c: {**c, "x": np.zeros((1, 2), dtype=[("a", object)])},
        ["column x", "an array of 2 structs"],
    ),
    "twice": (lambda c: {**c, "rec": {"x": 2 * c["x"]}}, ["column x", "twice", "rec"]),
    "a matrix of all signals": (
        lambda c: {"ans": np.stack(list(c.values()))},
        ["ans is a matrix of", "t = data(1, :)"],
    ),
    "few": (lambda c: {name: values[:49] for name, values in c.items()}, ["49 samples", "at least 50"]),
}


@pytest.mark.parametrize(("change", "needles"), REFUSED.values(), ids=REFUSED)
def test_refused(save, columns, change, needles):
    with pytest.raises(InputError) as caught:
        load_recording(save(change(columns)))
    message = str(caught.value)
    assert message.splitlines() == [message]
    assert [needle for needle in ["run.mat", *needles] if needle not in message] == []


HDF5 = b"\x89HDF\r\n\x1a\n"


@pytest.mark.parametrize(
    "content",
    [
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1".ljust(512) + HDF5 + bytes(64),
        bytes(512) + HDF5 + bytes(64),
        HDF5 + bytes(64),
    ],
    ids=["matlab", "user-block", "plain"],
)
def test_v73_is_refused_with_the_line_that_converts(write, content):
    with pytest.raises(InputError) as caught:
        load_recording(write(content, name="run.mat"))
    assert "v7.3" in str(caught.value)
    assert "s = load('run.mat'); save('run_v7.mat', '-struct', 's', '-v7')" in str(caught.value)


def opaque_object(name: str, kind: str) -> bytes:
    """Returns a v5 file with a MATLAB object, as MATLAB writes one for a timeseries or a table.

    The format's description leaves these out; this is what its reader expects: array flags with class 17, the
    variable's name, the type system's and the class', and a matrix of references.
    """

    def element(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + bytes(-len(content) % 8)

    flags = element(6, struct.pack("<II", 17, 0))
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", kind))
    references = element(
        14,
        element(6, struct.pack("<II", 13, 0))
        + element(5, struct.pack("<ii", 1, 1))
        + element(1, b"")
        + element(6, struct.pack("<I", 7)),
    )
    header = b"MATLAB 5.0 MAT-file, written for a test".ljust(116) + bytes(8) + struct.pack("<HH", 0x0100, 0x4D49)
    return header + element(14, flags + texts + references)


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("timeseries", "t = log.Time; x = log.Data; save('run_v7.mat', 't', 'x', '-v7')"),
        ("table", "s = table2struct(log, 'ToScalar', true); save('run_v7.mat', '-struct', 's', '-v7')"),
        ("timetable", "s.t = seconds(s.Time)"),
        ("Simulink.SimulationData.Dataset", "e = log.get('x').Values; t = e.Time; x = e.Data;"),
        ("Simulink.SimulationOutput", "log.logsout.get('x')"),
    ],
)
def test_objects_are_refused_with_the_line_that_converts(write, kind, line):
    with pytest.raises(InputError) as caught:
        load_recording(write(opaque_object("log", kind), name="run.mat"))
    message = str(caught.value)
    assert message.splitlines() == [message]
    assert f"run.mat: log is a MATLAB object ({kind})" in message
    assert line in message


@pytest.mark.parametrize("content", [b"t,x\n0,1\n", b"<html>", bytes(300), b"MATLAB 5.0 MAT-file".ljust(200)])
def test_what_is_no_mat_is_refused(write, content):
    with pytest.raises(InputError, match=r"run\.mat: (not a MATLAB file|.*no column t)"):
        load_recording(write(content, name="run.mat"))


def test_an_empty_file_is_refused(write):
    with pytest.raises(InputError, match=r"run\.mat: the file is empty"):
        load_recording(write(b"", name="run.mat"))


DAMAGED = {
    "type of the flags": (136, 201, "type 201 at byte 8"),
    "unknown class": (144, 99, "unknown class 99"),
    "a cell": (144, 1, "no whole array at byte 48"),
    "a struct": (144, 2, "where 5 belongs"),
    "size of the dimensions": (156, 400, "no 2 to 32 integers"),
    "more rows": (160, 2**28, "numbers at byte"),
    "no rows": (160, 0, "no 0 numbers"),
    "negative rows": (160, 2**32 - 1, "a dimension below 0"),
    "size of the name": (168, 30 << 16 | 1, "30 bytes in a tag of 4"),
    "type of the name": (168, 1 << 16 | 9, "type 9"),
    "type of the numbers": (176, 14, "no 400 numbers"),
    "size of the numbers": (180, 2**31, "cut short"),
    "fewer numbers": (180, 8, "no 400 numbers"),
}
"""Place of a word in the first variable, what stands there instead, what is said. Some of these end SciPy's reader."""


@pytest.mark.parametrize(("place", "word", "needle"), DAMAGED.values(), ids=DAMAGED)
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "compressed"])
def test_damaged_structure_is_refused(save, columns, place, word, needle, packed):
    path = save(columns)
    content = bytearray(path.read_bytes())
    content[place : place + 4] = struct.pack("<I", word)
    if packed:
        first = 136 + struct.unpack_from("<I", content, 132)[0]
        body = zlib.compress(content[128:first])
        content[128:first] = struct.pack("<II", 15, len(body)) + body
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"run\.mat: not a MATLAB file, or a damaged one") as caught:
        load_recording(path)
    assert needle in str(caught.value)


def test_deep_cells_are_refused(save, columns):
    deep = np.zeros(1)
    for _ in range(40):
        cell = np.empty(1, dtype=object)
        cell[0] = deep
        deep = cell
    with pytest.raises(InputError, match=r"run\.mat: .*more than 32 cells or structs within each other"):
        load_recording(save({**columns, "deep": deep}))


def test_a_small_file_that_unpacks_to_a_large_one_is_refused(save, columns, monkeypatch):
    monkeypatch.setattr(mat_format, "LARGEST", 10_000)
    with pytest.raises(InputError, match=r"run\.mat: .*more than 10000 bytes once decompressed"):
        load_recording(save({**columns, "zeros": np.zeros(100_000)}, do_compression=True))


def test_the_other_byte_order_is_read(write, columns):
    def element(code: int, content: bytes) -> bytes:
        return struct.pack(">II", code, len(content)) + content + bytes(-len(content) % 8)

    content = b"MATLAB 5.0 MAT-file, written for a test".ljust(124) + b"\x01\x00MI"
    for name, values in columns.items():
        flags, shape = struct.pack(">II", 6, 0), struct.pack(">ii", 1, values.size)
        parts = (6, flags), (5, shape), (1, name.encode()), (9, values.astype(">f8").tobytes())
        content += element(14, b"".join(element(*part) for part in parts))
    assert same(load_recording(write(content, name="run.mat")), columns)


def test_damaged_files_are_refused(save, columns):
    """Whatever a damaged byte makes the parser raise, it comes out as one line."""
    path = save(columns, do_compression=True)
    content = path.read_bytes()
    random = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(content[: random.integers(100, len(content))])
        damaged[random.integers(len(damaged))] ^= 0xFF
        path.write_bytes(damaged)
        with pytest.raises(InputError) as caught:
            load_recording(path)
        assert len(str(caught.value).splitlines()) == 1
