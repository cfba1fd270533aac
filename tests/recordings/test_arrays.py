"""Arrays and data frames give the recording that a file with the same columns gives, and the same refusals."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from jbridge import InputError, Recording, diagnose, fit
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model, load_model
from jbridge.recordings import as_recordings, load_recording
from tests.problems import make_plant


class Frame:
    """What a pandas frame offers that is used."""

    def __init__(self, columns, index=None):
        self._columns, self.columns, self.index = columns, list(columns), index

    def __getitem__(self, name):
        return self._columns[name]


def same(one, other):
    for field in dataclasses.fields(Recording):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name in ("name", "notes"):
            continue
        if field.name in ("fresh", "extras"):
            assert a.keys() == b.keys()
            assert all(np.array_equal(a[key], b[key]) for key in a), field.name
        elif isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        elif field.name == "earlier" and a is not None:
            np.testing.assert_array_equal(a.times, b.times)
        else:
            assert a == b, field.name


SIDECAR = """
[columns]
psi = {column = "psi", unit = "deg", sign = -1, offset = 3.0}
u_x = {unit = "A", late = 1}
[resolution]
x = 1e-4
[hold]
psi = true
[override]
load_mass = 0.25
[trim]
start = 0.2
"""
DECLARED = {
    "columns": {"psi": {"unit": "deg", "sign": -1, "offset": 3.0}, "u_x": {"unit": "A", "late": np.int64(1)}},
    "resolution": {"x": 1e-4},
    "hold": {"psi": True},
    "override": {"load_mass": np.float64(0.25)},
    "trim": {"start": 0.2},
}


def test_arrays_are_a_file(columns, write):
    same(Recording.from_arrays(**columns), load_recording(write(columns)))


def test_what_a_sidecar_says_is_an_argument(columns, write):
    found = Recording.from_arrays(**columns, sidecar=DECLARED)
    same(found, load_recording(write(columns, SIDECAR)))
    assert (found.units["u_x"], found.override, found.resolution["x"]) == ("A", {"load_mass": 0.25}, 1e-4)


def test_a_locked_rope_is_declared(chosen):
    found = Recording.from_arrays(**chosen("t u_x x psi"), sidecar={"locked": {"l": 0.7}})
    assert found.locked_length == 0.7 and found.has_swing and not found.has_hoist


@pytest.mark.parametrize("wrap", [dict, Frame])
def test_a_frame_is_a_file(columns, write, wrap):
    renamed = {{"psi": "theta", "x": "cart_mm"}.get(name, name): values for name, values in columns.items()}
    renamed["cart_mm"] = 1000.0 * renamed["cart_mm"]
    renamed["x_ref"] = columns["x"] + 0.01
    mapped = {"psi": "theta", "x": {"column": "cart_mm", "unit": "mm"}}
    toml = '[columns]\npsi = "theta"\nx = {column = "cart_mm", unit = "mm"}\n'
    found = Recording.from_dataframe(wrap(renamed), columns=mapped, name="run")
    same(found, load_recording(write(renamed, toml)))
    assert found.name == "run" and list(found.extras) == ["x_ref"]


def test_a_named_index_is_a_column(columns):
    times = columns.pop("t")
    index = type("Index", (), {"name": "t", "__array__": lambda self, dtype=None, copy=None: times})()
    np.testing.assert_array_equal(Recording.from_dataframe(Frame(columns, index)).times, times)
    assert Recording.from_dataframe({"t": times, **columns}).name == "recording"
    with pytest.raises(InputError, match="no column t"):
        Recording.from_dataframe(Frame(columns, SimpleNamespace(name=None)))


def test_pandas_frames(columns):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(columns)
    same(Recording.from_dataframe(frame), Recording.from_arrays(**columns))
    same(Recording.from_dataframe(frame.set_index("t")), Recording.from_arrays(**columns))


def test_the_arrays_stay_the_callers(columns):
    found = Recording.from_arrays(**columns)
    columns["x"][0] = 7.0
    assert found.x[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        found.x[0] = 1.0


def spoilt(name, place, value):
    def edit(columns):
        columns[name][place] = value

    return edit


def changed(**new):
    return lambda columns: columns.update(new)


REFUSED = {
    "NaN": (spoilt("x", 11, np.nan), r"^tuesday, row 11, column x: the value is NaN; delete the row"),
    "masked": (changed(x=np.ma.masked_equal(np.arange(400), 11)), r"^tuesday, row 11, column x: the value is NaN"),
    "infinite": (spoilt("u_x", 0, np.inf), r"^tuesday, row 0, column u_x: the value is infinite"),
    "time falls": (spoilt("t", 5, 0.01), r"^tuesday, row 5, column t: time must increase"),
    "millimetres": (changed(x=np.full(400, 2e6)), r"^tuesday, row 0, column x: .*declare its unit"),
    "lengths": (changed(x=np.zeros(399)), r"^tuesday, column x: 399 values, but t has 400"),
    "a matrix": (changed(x=np.zeros((400, 2))), r"^tuesday, column x: an array of shape \(400, 2\), where a vector"),
    "a number": (changed(u_l=np.zeros(())), r"^tuesday, column u_l: an array of shape \(\), where a vector"),
    "text": (changed(x=["far"] * 400), r"^tuesday, column x: text, where a vector"),
    "objects": (changed(x=[None, *[0.0] * 398, "a"]), r"^tuesday, column x: not only numbers"),
    "dates": (changed(t=np.arange(400).astype("datetime64[s]")), r"^tuesday, column t: dates or durations"),
    "no input": (changed(u_x=None), r"^tuesday: a column x but no u_x"),
    "few": (lambda columns: columns.update({k: v[:20] for k, v in columns.items()}), r"^tuesday: 20 samples"),
    "unknown unit": (
        changed(sidecar={"columns": {"x": {"unit": "ft"}}}),
        r"^tuesday, sidecar, \[columns\], x: unknown",
    ),
    "unknown key": (changed(sidecar={"lock": 0.7}), r"^tuesday, sidecar: unknown key 'lock'; did you mean locked"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_the_recording(columns, case):
    edit, message = REFUSED[case]
    edit(columns)
    with pytest.raises(InputError, match=message):
        Recording.from_arrays(**columns, name="tuesday")


def test_inputs_alone_are_for_a_simulation(chosen):
    inputs = chosen("t u_x")
    with pytest.raises(InputError, match="nothing measured"):
        Recording.from_arrays(**inputs)
    found = Recording.from_arrays(**inputs, sidecar={"initial": {"x": 0.3}}, inputs_only=True)
    assert found.initial == {"x": 0.3} and found.x is None


def test_two_units_of_one_input_are_refused(chosen, tmp_path):
    (tmp_path / "model.toml").write_text("[bridge]\ncart_mass = 5.5\ncart_damping = 45.0\ncart_gain = 16.0\n")
    run = chosen("t u_x x")
    other = Recording.from_arrays(**run, name="b", sidecar={"columns": {"u_x": {"unit": "A"}}})
    with pytest.raises(InputError, match="b, column u_x: in A, but in V in a"):
        make_setting(load_model(tmp_path / "model.toml"), [Recording.from_arrays(**run, name="a"), other], [])


def test_a_recording_shows_itself_in_a_line():
    t = 0.01 * np.arange(200)
    recording = Recording.from_arrays(t=t, u_x=np.sin(t), x=0.5 + 0.1 * np.sin(t))
    assert repr(recording) == f"<Recording {recording.name}: 200 rows, 1.99 s, u_x, x>"


@pytest.mark.parametrize(("unsigned", "way", "noted"), [(True, 0.1, True), (False, 0.1, False), (True, 1e-3, False)])
def test_an_input_without_its_sign_is_noted(unsigned, way, noted):
    t = 0.01 * np.arange(400)
    u = np.sin(3.0 * t)
    recording = Recording.from_arrays(t=t, u_x=np.abs(u) if unsigned else u, x=0.5 - way * np.cos(3.0 * t))
    assert any("u_x is never negative" in note for note in recording.notes) == noted


@pytest.mark.parametrize(
    "slip",
    [
        lambda t, x, psi: (t[:-40], np.delete(x, range(60, 100)), np.delete(psi, range(60, 100))),
        lambda t, x, psi: (t, x, np.where(np.arange(t.size) == 50, 0.9, psi)),
        lambda t, x, psi: (t, x + 0.06 * (t > 0.5), psi),
    ],
    ids=["rows that are missing", "a row", "a homing"],
)
@pytest.mark.parametrize("count", [120, 400])
def test_leaps_are_noted(slip, count):
    t, key = 0.01 * np.arange(count), np.random.default_rng(0)
    x = 0.5 - 0.2 * np.cos(3.0 * t) + 1e-4 * key.standard_normal(t.size)
    psi = 0.2 * np.sin(4.0 * t) + 1e-3 * key.standard_normal(t.size)
    for times, place, angle, noted in ((t, x, psi, False), (*slip(t, x, psi), True)):
        rows = {"t": times, "u_x": np.sin(3.0 * times), "x": place, "psi": angle}
        recording = Recording.from_arrays(**rows, sidecar={"locked": {"l": 0.6}})
        assert any("leaps by" in note for note in recording.notes) == noted


@pytest.mark.parametrize(("filler", "noted"), [(0.0, True), (None, False)])
def test_rows_without_a_reading_are_noted(filler, noted):
    """Every fiftieth row of the angle is 0, as a log writes it that had no answer; noise alone is no such row."""
    t, key = 0.01 * np.arange(1000), np.random.default_rng(0)
    psi = 0.3 * np.sin(4.0 * t) + 1e-3 * key.standard_normal(t.size)
    psi = np.round(psi, 3) if filler is None else np.where(np.arange(t.size) % 50 == 20, filler, psi)
    recording = Recording.from_arrays(t=t, psi=psi, sidecar={"locked": {"l": 0.6}})
    found = [note for note in recording.notes if "single rows" in note]
    assert len(found) == noted
    assert all(re.search(r"^psi is 0 rad in 1\d single rows, first in row 20 \(0.2 s\)", note) for note in found)
    assert not any("leaps by" in note for note in recording.notes)


def test_what_is_to_be_declared_is_an_argument():
    t = np.arange(200) * 0.01
    with pytest.raises(InputError, match=r"under \[locked\] of the argument sidecar"):
        Recording.from_arrays(name="monday.mat", t=t, psi=0.1 * np.sin(4 * t))
    with pytest.raises(InputError, match="force=True takes it as it is"):
        Recording.from_arrays(t=t, x=1000 * t, u_x=np.sin(t))


def test_one_recording_may_be_given_alone_and_none_is_refused(columns):
    one = Recording.from_arrays(**columns)
    assert as_recordings(one) == as_recordings([one]) == as_recordings(iter([one])) == (one,)
    model = Model(make_plant(), frozenset(), frozenset(), {}, "")
    for call in (fit, diagnose):
        with pytest.raises(InputError, match="no recordings: give at least one"):
            call(model, [])


@pytest.mark.parametrize("name", ["a.csv", ["a.csv"]])
def test_a_file_where_a_recording_belongs_is_refused(name):
    with pytest.raises(InputError, match=r"^'a\.csv' where a recording belongs; read files with load_recording"):
        as_recordings(name)
