"""What a good recording gives, alone and among others."""

import re

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import Recording, constant_inputs, load_recording, load_recordings


def test_a_whole_bridge(write, columns):
    recording = load_recording(write(columns))
    assert recording.name == "run.csv"
    for name in ("u_x", "u_l", "x", "psi", "l"):
        np.testing.assert_array_equal(getattr(recording, name), columns[name])
    np.testing.assert_array_equal(recording.times, columns["t"])
    assert recording.units == {"u_x": "V", "u_l": "V"}
    assert (recording.has_cart, recording.has_swing, recording.has_hoist) == (True, True, True)
    assert recording.locked_length is None
    assert all(fresh.all() for fresh in recording.fresh.values())
    assert recording.fresh.keys() == recording.resolution.keys() == {"x", "psi", "l"}
    assert recording.resolution == {"x": 0.0, "psi": 0.0, "l": 0.0}
    assert (recording.override, recording.initial, recording.extras, recording.notes) == ({}, {}, {}, ())


def test_times_stay_as_in_the_file(write, columns):
    columns["t"] = columns["t"] + 17.5
    columns["t"][100:] += 0.5  # a gap
    recording = load_recording(write(columns))
    assert recording.start == 17.5
    assert recording.duration == pytest.approx(399 * 0.005 + 0.5)
    assert recording.period == pytest.approx(0.005)
    assert any("longest gap between rows is 0.505 s, at 17.995 s" in note for note in recording.notes)


def test_arrays_cannot_be_changed(write, columns):
    recording = load_recording(write({**columns, "x_ref": columns["x"]}))
    for values in (recording.times, recording.x, recording.extras["x_ref"], recording.fresh["x"]):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1


def test_extra_columns_are_kept(write, columns):
    recording = load_recording(write({**columns, "x_ref": 2 * columns["x"], "current": 0 * columns["x"]}))
    assert recording.extras.keys() == {"x_ref", "current"}
    np.testing.assert_array_equal(recording.extras["x_ref"], 2 * columns["x"])
    assert any("'x_ref', 'current'" in note for note in recording.notes)


def test_recordings_come_in_order(write, columns, chosen):
    paths = [write(columns, name="b.csv"), write(chosen("t u_x x"), name="a.csv")]
    recordings = load_recordings(paths)
    assert [recording.name for recording in recordings] == ["b.csv", "a.csv"]
    assert [recording.has_hoist for recording in recordings] == [True, False]
    assert all(isinstance(recording, Recording) for recording in recordings)


def test_a_recording_counts_once(write, columns):
    path = write(columns)
    with pytest.raises(InputError, match=r"run\.csv: the recording is named twice"):
        load_recordings([path, path.parent / "." / path.name])


def test_an_input_has_one_unit(write, columns):
    one = write(columns, name="one.csv")
    other = write(columns, '[columns]\nu_x = {unit = "A"}\n', name="other.csv", sidecar_name="other.toml")
    with pytest.raises(InputError, match=r"other\.csv, column u_x: in A, but in V in .*one\.csv"):
        load_recordings([one, other])


def test_inputs_that_never_change_are_named(write, columns, chosen):
    constant = {**columns, "u_x": np.full(400, 3.0), "u_l": np.zeros(400)}
    still = load_recording(write(constant))
    other = load_recording(write({**constant, "u_x": np.full(400, -1.0)}))
    cart = load_recording(write(chosen("t u_x x")))
    assert constant_inputs([still, other]) == {"u_x", "u_l"}
    assert constant_inputs([still, cart]) == {"u_l"}
    assert constant_inputs([cart]) == set()


@pytest.mark.parametrize("quote", ["", '"'])
def test_clean_files_are_not_read_cell_by_cell(write, columns, monkeypatch, quote):
    """Cell by cell takes several times as long, which shows in files of a few hundred thousand rows."""

    def slow(*_: object) -> None:
        raise AssertionError("a clean file was read cell by cell")

    monkeypatch.setattr("jbridge.recordings.tables.csv_table.parse_carefully", slow)
    path = write(columns)
    path.write_text(re.sub(r"[^,\n]+", rf"{quote}\g<0>{quote}", path.read_text()))
    np.testing.assert_array_equal(load_recording(path).x, columns["x"])


def test_the_first_of_two_rows_of_one_time_is_kept(write, columns):
    """A clock of milliseconds beside a quicker logger: the rows differ in all but the time."""
    coarse = {name: values.copy() for name, values in columns.items()}
    for row in (80, 200, 201):
        coarse["t"][row] = coarse["t"][row - 1]
    recording = load_recording(write(coarse))
    kept = np.delete(np.arange(400), [80, 200, 201])
    for name in ("x", "psi", "l", "u_x"):
        np.testing.assert_array_equal(getattr(recording, name), columns[name][kept])
    assert "3 rows have the time of the row above, row 82 the first, left out." in recording.notes


def test_a_refusal_behind_such_rows_names_the_row_of_the_file(write, columns, refusal):
    columns["t"], columns["x"] = columns["t"].copy(), columns["x"].copy()
    columns["t"][80] = columns["t"][79]
    columns["x"][100] = np.nan
    assert "row 102, column x" in refusal(write(columns))


@pytest.mark.parametrize("outside", [np.nan, 0.3, 0.302, -5.0, 1e9])
def test_times_outside_the_trim_refuse_nothing(write, columns, outside):
    """The clock may stand still, start again or miss there; inputs are known back to there."""
    columns["t"] = columns["t"].copy()
    columns["t"][61:64] = outside
    columns["t"][390:] = outside
    recording = load_recording(write(columns, "[trim]\nstart = 0.4975\nstop = 1.9025\n"))
    np.testing.assert_array_equal(recording.times, columns["t"][100:381])
    assert recording.earlier is not None
    assert np.all(np.diff(recording.earlier.times) > 0)
    assert recording.earlier.times[-1] == columns["t"][99]


def test_a_clock_that_starts_again_within_the_trim_is_refused(write, columns, refusal):
    columns["t"] = columns["t"].copy()
    columns["t"][200:] -= 0.8
    assert "comes before" in refusal(write(columns, "[trim]\nstart = 0.3\nstop = 1.1\n"))


@pytest.mark.parametrize("zero", [0.0, 0.02, 3.1, -3.13])
@pytest.mark.parametrize("start", [0, 130, 260])
def test_the_load_hangs_at_one_angle_in_all_recordings(write, columns, zero, start):
    """A sensor that starts again at each turn, wherever its zero is, and wherever the recording begins."""
    read = (columns["psi"] * 4 + zero + np.pi) % (2 * np.pi) - np.pi
    cut = {name: values[start:] for name, values in (columns | {"psi": read}).items()}
    recording = load_recording(write(cut, f"[columns]\npsi = {{offset = {zero}}}\n"), force=True)
    np.testing.assert_allclose(recording.psi, 4 * columns["psi"][start:], atol=1e-12)


def test_turns_of_a_load_that_goes_over_the_top_stay(write, columns):
    columns["psi"] = 4 * np.pi + np.linspace(0, 1, 400) ** 8 * 9.0
    recording = load_recording(write(columns), force=True)
    np.testing.assert_allclose(recording.psi, columns["psi"] - 4 * np.pi, atol=1e-12)
