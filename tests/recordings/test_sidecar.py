"""What a sidecar declares takes effect, and what it cannot mean is refused by its key."""

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import load_recording, load_recordings
from jbridge.recordings.tables.columns import Column


def renamed(columns: dict, **names: str) -> dict:
    """Returns the columns under other names, in their order."""
    return {names.get(name, name): values for name, values in columns.items()}


def test_columns_are_mapped_with_unit_sign_and_offset(write, columns):
    """The file holds what the rig's sensors say; the channel is `sign * (raw - offset)` in SI."""
    raw = {
        "time_ms": columns["t"] * 1e3,
        "pwm": columns["u_x"] * 100,
        "hoist_mA": columns["u_l"],
        "cart": 250.0 + columns["x"] * 1e3,
        "theta": 180.0 - np.rad2deg(columns["psi"]),
        "winch": np.round(columns["l"] / 5.5e-5),
    }
    sidecar = """
        [columns]
        t = {column = "time_ms", unit = "ms"}
        u_x = {column = "pwm", unit = "count", sign = -1}
        u_l = {column = "hoist_mA", unit = "mA"}
        x = {column = "cart", unit = "mm", offset = 250}
        psi = {column = "theta", unit = "deg", sign = -1, offset = 180}
        l = {column = "winch", unit = "count", scale = 5.5e-5}
    """
    recording = load_recording(write(raw, sidecar))
    np.testing.assert_allclose(recording.times, columns["t"], rtol=1e-12)
    np.testing.assert_allclose(recording.x, columns["x"], atol=1e-12)
    np.testing.assert_allclose(recording.psi, columns["psi"], atol=1e-12)
    np.testing.assert_allclose(recording.l, columns["l"], atol=2.8e-5)
    np.testing.assert_allclose(recording.u_x, -100 * columns["u_x"])
    np.testing.assert_allclose(recording.u_l, columns["u_l"] / 1000)
    assert recording.units == {"u_x": "count", "u_l": "A"}
    assert recording.extras == {}
    assert any("run.toml" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("channel", "unit", "size"),
    [
        ("t", "ms", 1e-3),
        ("t", "us", 1e-6),
        ("t", "ns", 1e-9),
        ("t", "min", 60.0),
        ("t", "h", 3600.0),
        ("x", "m", 1.0),
        ("x", "cm", 1e-2),
        ("x", "mm", 1e-3),
        ("l", "um", 1e-6),
        ("psi", "mrad", 1e-3),
        ("psi", "deg", 0.017453292519943295),
        ("u_x", "mV", 1e-3),
        ("u_x", "A", 1.0),
        ("u_x", "%", 1.0),
    ],
)
def test_units(write, columns, channel, unit, size):
    columns[channel] = columns[channel] / size
    recording = load_recording(write(columns, f'[columns]\n{channel} = {{unit = "{unit}"}}\n'))
    values = recording.times if channel == "t" else getattr(recording, channel)
    np.testing.assert_allclose(values, columns[channel] * size, rtol=1e-14)


def test_a_name_alone_maps_a_column(write, columns):
    raw = renamed(columns, x="cart", t="time")
    recording = load_recording(write(raw, '[columns]\nx = "cart"\nt = "time"\n'))
    np.testing.assert_array_equal(recording.x, columns["x"])


def test_a_mapped_channel_leaves_its_namesake_as_an_extra(write, columns):
    path = write({**columns, "x_mm": columns["x"] * 1e3}, '[columns]\nx = {column = "x_mm", unit = "mm"}\n')
    recording = load_recording(path)
    assert recording.extras.keys() == {"x"}


def test_a_column_can_be_left_out(write, columns):
    columns["l"][:] = 0.7
    recording = load_recording(write(columns, "[columns]\nu_l = false\n"))
    assert (recording.u_l, recording.has_hoist, recording.locked_length) == (None, False, 0.7)
    assert recording.extras == {}


@pytest.mark.parametrize("late", [1, 3, -2])
def test_an_input_that_is_logged_late_is_moved_to_the_row_from_which_on_it_acts(write, columns, late):
    """What is logged `late` rows below its own stands in its own, and no other channel is moved."""
    u = np.sin(7 * columns["t"])
    logged = np.interp(np.arange(u.size) - late, np.arange(u.size), u)  # at an end, the value of the end
    recording = load_recording(write(columns | {"u_x": logged}, f"[columns]\nu_x = {{late = {late}}}\n"))
    acts = u.copy()
    acts[-late:] = u[-1 - late] if late > 0 else acts[-late:]
    acts[:-late] = u[-late] if late < 0 else acts[:-late]
    np.testing.assert_array_equal(recording.u_x, acts)
    np.testing.assert_array_equal(recording.u_l, columns["u_l"])
    np.testing.assert_array_equal(recording.x, columns["x"])


def test_a_late_input_is_moved_before_rows_are_left_out(write, columns):
    """Rows count as the file has them: those that are trimmed off, and one of two that have the same time, too."""
    columns["u_x"], columns["t"][121] = np.arange(400.0), columns["t"][120]
    path = write(columns, "[columns]\nu_x = {late = 1}\n[trim]\nstart = 0.5\nstop = 1.5\n")
    recording = load_recording(path)
    kept = np.delete(np.arange(100, 301), 21)
    np.testing.assert_array_equal(recording.u_x, kept + 1)
    np.testing.assert_array_equal(recording.earlier.u_x, np.arange(100) + 1)


def test_a_wrong_number_of_a_late_input_is_named_by_its_row(write, columns, refusal):
    columns["u_x"][200] = np.inf
    assert "row 202, column u_x: the value is infinite" in refusal(write(columns, "[columns]\nu_x = {late = 1}\n"))


def test_a_line_that_mends_a_late_input_says_so():
    line = Column("motor", "V", sign=-1.0, late=1).line("u_x")
    assert line == 'u_x = {column = "motor", unit = "V", sign = -1, late = 1}'


def test_all_that_is_declared_arrives(write, columns):
    sidecar = """
        [override]
        load_mass = 0.25
        gravity = 9.82
        [initial]
        psi = 0.05
        [resolution]
        x = 1e-4
        psi = 1.5e-3
    """
    recording = load_recording(write(columns, sidecar))
    assert recording.override == {"load_mass": 0.25, "gravity": 9.82}
    assert recording.initial == {"psi": 0.05}
    assert recording.resolution == {"x": 1e-4, "psi": 1.5e-3, "l": 0.0}


def test_trim_keeps_the_declared_times(write, columns):
    recording = load_recording(write(columns, "[trim]\nstart = 0.5\nstop = 1.25\n"))
    assert (recording.start, recording.times[-1], recording.times.size) == (0.5, 1.25, 151)
    np.testing.assert_array_equal(recording.x, columns["x"][100:251])
    assert any("151" in note for note in recording.notes)


def test_trimmed_rows_may_be_bad_and_the_others_keep_their_numbers(write, columns):
    columns["x"][20] = np.nan
    assert load_recording(write(columns, "[trim]\nstart = 0.5\n")).times.size == 300
    columns["x"][200] = np.inf
    with pytest.raises(InputError, match=r"row 202, column x: .*infinite"):
        load_recording(write(columns, "[trim]\nstart = 0.5\n"))


def test_the_file_named_by_the_owner_is_in_the_message(write, columns):
    raw = renamed(columns, x="cart_mm")
    raw["cart_mm"][77] = np.nan
    with pytest.raises(InputError, match=r"row 79, column cart_mm: "):
        load_recording(write(raw, '[columns]\nx = {column = "cart_mm", unit = "mm"}\n'))


FOLDER = """
["run.csv".columns]
x = "cart"
["other.csv".override]
load_mass = 0.3
["third*.csv".override]
load_mass = 0.4
"""


def test_a_folder_has_one_file_with_a_table_per_recording(write, columns):
    raw = renamed(columns, x="cart")
    run = write(raw, FOLDER, sidecar_name="recordings.toml")
    assert load_recording(run).has_cart
    assert load_recording(run).override == {}
    assert load_recording(write(columns, name="other.csv")).override == {"load_mass": 0.3}
    assert load_recording(write(columns, name="third-1.csv")).override == {"load_mass": 0.4}
    assert load_recording(write(columns, name="fourth.csv")).override == {}


def test_a_recordings_own_sidecar_comes_first(write, columns):
    write(columns, FOLDER, name="other.csv", sidecar_name="recordings.toml")
    path = write(columns, "[override]\nload_mass = 0.9\n", name="other.csv", sidecar_name="other.toml")
    assert load_recording(path).override == {"load_mass": 0.9}


def test_a_recordings_own_table_comes_before_a_pattern(write, columns):
    folder = '["*.csv".override]\nload_mass = 0.1\n["run.csv".override]\nload_mass = 0.2\n'
    path = write(columns, folder, sidecar_name="recordings.toml")
    assert load_recording(path).override == {"load_mass": 0.2}


def test_what_fits_a_recording_is_put_together_and_the_nearer_counts(write, columns):
    folder = """
["*.csv".columns]
x = "cart"
["r*.csv".override]
load_mass = 0.1
cart_mass = 5.0
["run.csv".override]
load_mass = 0.2
["run.csv".trim]
start = 0.5
"""
    write(columns, folder, sidecar_name="recordings.toml")
    path = write(renamed(columns, x="cart"), "[override]\ncart_mass = 6.0\n[trim]\nstop = 1.5\n")
    recording = load_recording(path)
    assert recording.has_cart
    assert recording.override == {"load_mass": 0.2, "cart_mass": 6.0}
    assert (recording.times[0], recording.times[-1]) == pytest.approx((0.5, 1.5))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_a_narrower_pattern_comes_before_a_wider_one(write, columns, order):
    """In whatever order they stand; what the narrower one does not say, the wider one does."""
    tables = [
        '["*.csv".override]\nload_mass = 0.1\ncart_mass = 5.0\ngravity = 9.8\n',
        '["r*.csv".override]\nload_mass = 0.2\ncart_mass = 6.0\n',
        '["r[t-v]n*.csv".override]\nload_mass = 0.3\n',
    ]
    write(columns, "\n".join(tables[k] for k in order), sidecar_name="recordings.toml")
    assert load_recording(write(columns)).override == {"load_mass": 0.3, "cart_mass": 6.0, "gravity": 9.8}


@pytest.mark.parametrize("form", ["[override]\nload_mass = 0.2\n", '["run.csv".override]\nload_mass = 0.2\n'])
def test_a_sidecar_can_lie_elsewhere(write, columns, tmp_path, form):
    elsewhere = tmp_path / "mine"
    elsewhere.mkdir()
    (elsewhere / "declared.toml").write_text(form)
    path = write(columns, "[override]\nload_mass = 0.9\n")
    assert load_recording(path, sidecar=elsewhere / "declared.toml").override == {"load_mass": 0.2}
    (recording,) = load_recordings([path], sidecar=elsewhere / "declared.toml")
    assert recording.override == {"load_mass": 0.2}


def test_a_missing_sidecar_elsewhere_is_refused(write, columns, tmp_path):
    with pytest.raises(InputError, match=r"absent\.toml: no such file"):
        load_recording(write(columns), sidecar=tmp_path / "absent.toml")


REFUSED = {
    "not TOML": ("x = = 1", ["not TOML", "line 1"]),
    "a number too long": ("[override]\nload_mass = 1" + 5000 * "0", ["not TOML"]),
    "too deep": ("x = " + 5000 * "[", ["nested more than 20 deep"]),
    "tables too deep": ("[" + "a." * 5000 + "b]\nc = 1", ["nested more than 20 deep"]),
    "a key twice": ("[trim]\nstart = 1\nstart = 2", ["not TOML", "overwrite"]),
    "unknown section": ("[colums]\nx = 'cart'", ["unknown key 'colums'", "columns"]),
    "a model": ("[bridge]\ncart_mass = 5", ["unknown key 'bridge'", "known are columns, hold"]),
    "section is no table": ("hold = true", ["hold must be a table", "[hold]"]),
    "unknown channel": ("[columns]\nphi = 'theta'", ["[columns]", "unknown key 'phi'", "did you mean psi?"]),
    "unknown key of a column": ("[columns]\nx = {name = 'cart'}", ["[columns], x", "unknown key 'name'"]),
    "column is a number": ("[columns]\nx = 3", ["[columns]", "x must be", "'3'"]),
    "column name is a number": ("[columns]\nx = {column = 3}", ["[columns], x", "column must be", "'3'"]),
    "no such column": ("[columns]\nx = 'cart'", ["row 1", "no column cart", "run.toml", "'t', 'u_x', 'u_l'"]),
    "time left out": ("[columns]\nt = false", ["[columns]", "t must be"]),
    "unknown unit": ("[columns]\nx = {unit = 'inch'}", ["[columns], x", "unknown unit 'inch'", "mm, um"]),
    "unit of another quantity": ("[columns]\npsi = {unit = 'mm'}", ["unknown unit 'mm'", "rad, deg"]),
    "unit is no text": ("[columns]\nx = {unit = 3}", ["unknown unit '3'"]),
    "counts without scale": ("[columns]\nx = {unit = 'count'}", ["[columns], x", "scale = 5.5e-5"]),
    "scale and unit": ("[columns]\nx = {unit = 'mm', scale = 2}", ["scale", 'unit = "count"']),
    "scale of an input": ("[columns]\nu_x = {unit = 'count', scale = 2}", ["u_x", "takes no scale"]),
    "radius of volts": ("[columns]\nu_x = {radius = 0.03}", ["u_x", "radius", 'unit = "N m"']),
    "radius of zero": ("[columns]\nu_x = {unit = 'N m', radius = 0}", ["radius must be above 0"]),
    "late angle": ("[columns]\npsi = {late = 1}", ["[columns], psi", "late is for inputs (u_x, u_l) only"]),
    "late by half a row": ("[columns]\nu_x = {late = 0.5}", ["u_x", "late must be a whole number of rows, not 0.5"]),
    "late at all": ("[columns]\nu_x = {late = true}", ["u_x", "late must be a number"]),
    "scale of zero": ("[columns]\nx = {scale = 0}", ["scale must be above 0"]),
    "sign of two": ("[columns]\nx = {sign = 2}", ["sign must be 1 or -1", "2"]),
    "offset is text": ("[columns]\nx = {offset = '1'}", ["offset must be a number", "'1'"]),
    "offset is true": ("[columns]\nx = {offset = true}", ["offset must be a number"]),
    "offset is NaN": ("[columns]\nx = {offset = nan}", ["offset must be finite"]),
    "hold is a number": ("[hold]\npsi = 1", ["[hold]", "psi must be true or false"]),
    "hold of an input": ("[hold]\nu_x = true", ["[hold]", "unknown key 'u_x'", "x, psi, l"]),
    "resolution of zero": ("[resolution]\nx = 0", ["[resolution]", "x must be above 0"]),
    "resolution of text": ("[resolution]\nx = 'fine'", ["[resolution]", "x must be a number"]),
    "unknown parameter": ("[override]\nload_mas = 1", ["[override]", "'load_mas'", "load_mass"]),
    "infinite parameter": ("[override]\nload_mass = inf", ["[override]", "load_mass must be finite"]),
    "mass of nothing": ("[override]\nload_mass = 0", ["[override]", "load_mass must be above 0"]),
    "falling upwards": ("[override]\ngravity = -9.81", ["[override]", "gravity must be above 0"]),
    "driving damping": ("[override]\ncart_damping = -5.0", ["[override]", "cart_damping must not be negative"]),
    "parameter beyond floats": ("[override]\nload_mass = 1" + 400 * "0", ["override.load_mass'", "64 bits"]),
    "unknown trim": ("[trim]\nend = 1", ["[trim]", "unknown key 'end'", "start, stop"]),
    "trim to nothing": ("[trim]\nstart = 1\nstop = 1", ["[trim]", "start = 1", "stop = 1"]),
    "trim leaves too little": ("[trim]\nstart = 1.8", ["40 samples", "[trim]", "0 to 1.995 s"]),
    "unknown initial": ("[initial]\nu_x = 1", ["[initial]", "unknown key 'u_x'"]),
    "initial length": ("[initial]\nl = 0", ["[initial]", "l must be above 0"]),
    "locked length": ("[locked]\nl = -0.7", ["[locked]", "l must be above 0"]),
    "locked at all": ("[locked]\nl = true", ["[locked]", "l must be a number"]),
    "locked cart": ("[locked]\nx = 0.2", ["[locked]", "unknown key 'x'"]),
}


@pytest.mark.parametrize(("sidecar", "needles"), REFUSED.values(), ids=REFUSED)
def test_refused(write, columns, sidecar, needles):
    with pytest.raises(InputError) as caught:
        load_recording(write(columns, sidecar))
    message = str(caught.value)
    assert message.splitlines() == [message]
    assert [needle for needle in ["run.toml", *needles] if needle not in message] == []


def test_an_input_is_not_later_than_the_file_is_long(write, columns, refusal):
    message = refusal(write(columns, "[columns]\nu_x = {late = -400}\n"))
    assert "column u_x: late = -400 rows, of 400 that the file has" in message


SECTIONS = {name: case for name, case in REFUSED.items() if case[0].startswith("[") and "not TOML" not in case[1]}


@pytest.mark.parametrize(("sidecar", "needles"), SECTIONS.values(), ids=SECTIONS)
def test_refused_in_a_folders_file(write, columns, sidecar, needles):
    """The same declarations are refused in the same words, in the file of the folder."""
    section, rest = sidecar.split("\n", 1)
    folder = f'["run.csv".{section[1:-1]}]\n{rest}'
    with pytest.raises(InputError) as caught:
        load_recording(write(columns, folder, sidecar_name="recordings.toml"))
    needles = [needle for needle in needles if needle != "run.toml"]
    assert [needle for needle in ["recordings.toml", *needles] if needle not in str(caught.value)] == []


@pytest.mark.parametrize(
    ("folder", "needles"),
    [
        ("[columns]\nx = 'cart'", ["[columns] stands outside", '["run.csv".columns]', '["*.csv".columns]']),
        ("[run.csv.columns]\nx = 'cart'", ["quotes", '["run.csv"]']),
        ('["run.csv"]\ncolums = 1', ['table "run.csv"', "'colums'", "columns"]),
        ('"run.csv" = 1', ["run.csv must be a table"]),
        (
            '["r*.csv".trim]\nstart = 1\n["*n.csv".trim]\nstart = 2',
            ["'r*.csv', '*n.csv'", "trim.start", '["run.csv".trim]'],
        ),
        (
            '["*.csv".trim]\nstart = 1\n["*n.csv".trim]\nstop = 2\n["r*[m-o].csv".trim]\nstop = 1.5',
            ["'*n.csv', 'r*[m-o].csv'", "trim.stop", '["run.csv".trim]'],
        ),
    ],
)
def test_a_folders_file_is_refused(write, columns, folder, needles):
    path = write(columns, folder, sidecar_name="recordings.toml")
    with pytest.raises(InputError) as caught:
        load_recording(path)
    assert [needle for needle in ["recordings.toml", *needles] if needle not in str(caught.value)] == []


def test_a_sidecar_in_another_encoding_is_refused(write, columns, tmp_path):
    (tmp_path / "run.toml").write_bytes("# Höhe\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"run\.toml: not text in UTF-8"):
        load_recording(write(columns))


def test_a_byte_order_mark_is_accepted(write, columns, tmp_path):
    (tmp_path / "run.toml").write_bytes(b"\xef\xbb\xbf[override]\r\nload_mass = 0.2\r\n")
    assert load_recording(write(columns)).override == {"load_mass": 0.2}
