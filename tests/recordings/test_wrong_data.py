"""Files whose numbers could be read as others than they are: each is refused, or read as what it says."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import inspect_recordings, load_recording
from jbridge.recordings.tables.clock import clock_seconds
from jbridge.recordings.tables.columns import near_column
from jbridge.recordings.tables.csv_lines import drop_comments
from jbridge.recordings.tables.csv_table import read_csv
from tests.recordings.conftest import as_text


def read(tmp_path, text):
    return read_csv(tmp_path / "run.csv", text.encode())


def problem(tmp_path, text):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    return str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "t;x\n0;998\n1;1,600\n2;1,612\n",
        't,x\n0,998\n1,"1,600"\n2,"1,612"\n',
        "t;x\n0;-1,600\n1;12,600\n",
        "t\tx\n0\t900\n1\t1,600\n",
    ],
)
def test_commas_that_may_separate_thousands_are_refused(tmp_path, text):
    message = problem(tmp_path, text)
    assert "column x" in message and "export without separators of thousands" in message


@pytest.mark.parametrize(
    ("text", "x"),
    [
        ("t;x\n0;0,600\n1;1,600\n", [0.6, 1.6]),
        ("t;x\n0,5;1,612\n1,5;1,600\n", [1.612, 1.6]),
        ('t,x\n0,"1,60"\n1,"1,612"\n', [1.6, 1.612]),
        ("t;x\n14:03:59,123;1,600\n14:03:59,223;1,612\n", [1.6, 1.612]),
    ],
)
def test_commas_that_are_decimal_are_read(tmp_path, text, x):
    np.testing.assert_array_equal(read(tmp_path, text).columns["x"], x)


@pytest.mark.parametrize("cell", ["#ZAHL!", "#N/A", "#BEZUG!", "#VALUE!"])
def test_an_error_of_a_spreadsheet_is_no_comment(tmp_path, cell):
    for separator in ",;\t":
        table = read(tmp_path, f"t,x\n0,1\n{cell},2\n2,3\n".replace(",", separator))
        assert "row 3, column t" in str(table.faulty["t"])


def test_comments_of_other_widths_are_left_out(tmp_path):
    table = read(tmp_path, "# rig 3, May\nt,x\n0,1\n# stop\n1,2\n% a, b, c\n")
    np.testing.assert_array_equal(table.columns["x"], [1, 2])
    np.testing.assert_array_equal(table.row_numbers, [3, 5])


@pytest.mark.parametrize(
    ("text", "notes"),
    [
        ("t,x\n0,1\n1,2\n", []),
        ("14:03:59.1 -> t,x\n14:03:59.2 -> 0,1\n", ["serial monitor's time of day before each line is left out"]),
        ("t,x\n# one\n0,1\n", ["1 line of comment, row 2 the first"]),
        ("# one\nt,x\n0,1\n# two\n", ["2 lines of comment, row 1 the first"]),
        ("t;x\n0,5;1\n1,5;2\n", ["separated by semicolons", "have decimal commas"]),
        ("t x\n0 1\n1 2\n", ["separated by blanks"]),
        ("t\n0\n1\n", []),
        ("t,x,\n0,1,\n1,2,\n", ["ends with a separator, which is left out"]),
        ("t,x\ns,mm\n0,1\n", ["Row 2 is read as the units"]),
        ("t,psi\nS,Deg\n0,1\n", ["Row 2 is read as the units"]),
    ],
    ids=[
        "nothing",
        "stamps",
        "a comment",
        "comments",
        "semicolons",
        "blanks",
        "one column",
        "empty column",
        "units",
        "units in capitals",
    ],  # fmt: skip
)
def test_what_was_rewritten_is_said(tmp_path, text, notes):
    said = read(tmp_path, text).notes
    assert len(said) == len(notes) and all(note in each for note, each in zip(notes, said, strict=True)), said


def test_many_comments_take_no_longer_each(tmp_path):
    def seconds(count):
        lines = ["# a"] * count + ["t,x", "0,1"]
        start = time.process_time()
        drop_comments(lines)
        return time.process_time() - start

    assert seconds(40_000) < 40 * max(seconds(4_000), 0.002)


RECORDED = Path(__file__).parent / "whole_bridge.csv"
ROWS = [f"{t / 100:.2f},{np.sin(t / 30):.6f}" for t in range(400)]


def recording_of(tmp_path, header, cells, sidecar="[columns]\nx = false\n"):
    """Returns the recording of a pendulum with a further column."""
    path = tmp_path / "run.csv"
    rows = [f"{row},0.7,{cell}" for row, cell in zip(ROWS, cells, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    path.with_suffix(".toml").write_text(sidecar)
    return load_recording(path)


def test_a_time_of_day_is_no_angle(tmp_path):
    clock = [f"0:00:{t / 100:.2f}" for t in range(400)]
    with pytest.raises(InputError, match=r"row 2, column psi: '0:00:0.00' .*not a number"):
        recording_of(tmp_path, "t,u,l,psi", clock, "[columns]\nx = false\n")
    recording = recording_of(tmp_path, "t,psi,l,clock", clock)
    assert "clock" not in recording.extras
    assert any("'clock'" in note and "left out" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("cells", "row"),
    [
        (["99:99:99.0", "99:99:99.5"], 2),
        (["24:00:00.0", "24:00:00.5"], 2),
        (["14:00:01.0", "14:60:00.5"], 3),
        (["14:00:01.0", "2.0", "14:00:03.0"], 3),
        (["2024-03-05 14:00:00", "14:00:01.0"], 3),
        (["2024-03-05 14:00:00", "2024-03-05 14:00:00+01:00"], 3),
    ],
)
def test_what_is_no_time_of_day_is_refused(tmp_path, cells, row):
    table = read(tmp_path, "t,x\n" + "".join(f"{cell},1\n" for cell in cells))
    assert "t" not in table.columns
    assert f"row {row}, column t" in str(table.faulty["t"])


@pytest.mark.parametrize(("later", "hours"), [("07:00:00", 11.0), ("10:00:00", -10.0)])
def test_a_clock_that_falls_by_more_than_half_a_day_has_passed_midnight(later, hours):
    """One that falls by less was set back, and the column is refused as times that fall."""
    assert clock_seconds(["20:00:00", later]) == [0.0, 3600.0 * hours]


def test_dates_with_offsets_are_compared_in_utc(tmp_path):
    cells = ["2024-03-31T01:59:59+01:00", "2024-03-31T03:00:00+02:00", "2024-03-31T01:00:01Z"]
    table = read(tmp_path, "t,x\n" + "".join(f"{cell},1\n" for cell in cells))
    np.testing.assert_array_equal(table.columns["t"], [0, 1, 2])


def test_times_of_day_are_in_seconds(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [ms],psi,l\n" + "".join(f"0:00:{t / 50:.2f},0.1,0.7\n" for t in range(200)))
    with pytest.raises(InputError, match=r'declare t = \{column = "t \[ms\]", unit = "s"\} under') as caught:
        load_recording(path)
    line = re.search(r"t = \{.*?\}", str(caught.value))[0]
    path.with_suffix(".toml").write_text(f"[columns]\n{line}\n")
    assert load_recording(path).times[-1] == pytest.approx(3.98)


@pytest.mark.parametrize("header", ["t,psi [rad],l,psi [deg]", "t [s],psi,l,t [ms]", "t,psi,l,psi [rad]"])
def test_two_columns_of_one_channel_are_refused(tmp_path, header):
    with pytest.raises(InputError, match=r"columns '.*' and '.*' are both (psi|t); delete or rename one"):
        recording_of(tmp_path, header, range(400))


def test_a_declared_column_wins_over_others_of_its_channel(tmp_path):
    sidecar = '[columns]\nx = false\npsi = {column = "psi [rad]", unit = "rad"}\n'
    recording = recording_of(tmp_path, "t,psi [rad],l,psi [deg]", range(400), sidecar)
    assert np.abs(recording.psi).max() <= 1


@pytest.mark.parametrize("cells", [["RUN"] * 400, [""] * 400, ["1"] * 399 + ["STOP"], ["nan"] * 400])
def test_a_column_of_text_that_is_no_channel_is_left_out(tmp_path, cells):
    recording = recording_of(tmp_path, "t,psi,l,state", cells)
    assert recording.extras == {}
    (note,) = (note for note in recording.notes if "'state'" in note)
    assert "left out" in note


@pytest.mark.parametrize("name", ["psi_meas", "ψ", "Pendelwinkel [rad]", "theta_actual", "ÁNGULO"])
def test_a_column_that_may_be_the_angle_is_asked_for(tmp_path, name):
    with pytest.raises(InputError, match=r"not used, and there is no psi; declare psi = \{column = "):
        recording_of(tmp_path, f"t,x,l,{name}", range(400), "")


@pytest.mark.parametrize(
    ("channel", "size", "unit"),
    [
        ("x", 0.98, "m"),
        ("x", 98.0, "cm"),
        ("x", 980.0, "mm"),
        ("l", 420.0, "mm"),
        ("psi", 2.9, "rad"),
        ("psi", 28.0, "deg"),
    ],
)
def test_a_column_is_offered_in_the_unit_of_its_size(channel, size, unit):
    name = {"x": "pos", "psi": "phi", "l": "rope"}[channel]
    found = near_column(channel, [name], sizes={name: size})
    assert found is not None and found.unit == unit


@pytest.mark.parametrize(("bits", "unit"), [(32, "us"), (16, "ms"), (32, "ms")])
def test_a_counter_that_starts_again_is_counted_on(write, columns, bits, unit):
    tick = {"us": 1e-6, "ms": 1e-3}[unit]
    counts = np.round(columns["t"] / tick) + 2.0**bits - 1.0 / tick
    declared = f't = {{column = "t", unit = "{unit}"}}'
    read, plain = (
        load_recording(write(columns | {"t": times}, f"[columns]\n{declared}\n"))
        for times in (counts % 2**bits, np.round(columns["t"] / tick))
    )
    assert read.times[0] == 0.0
    np.testing.assert_allclose(read.times, plain.times - plain.times[0], atol=1e-6)
    assert any("it is counted on" in note for note in read.notes)


def test_a_motors_encoder_is_no_input():
    assert near_column("u_x", ["t", "motor_encoder"]) is None
    found = near_column("u_x", ["motor_encoder", "motor_voltage"])
    assert found is not None and found.name == "motor_voltage"


@pytest.mark.parametrize(
    ("channel", "names", "told", "line"),
    [
        ("x", ["positionn", "position_raw", "position_meas", "position"], {}, 'column = "position", unit = "m"'),
        ("psi", ["angle_raw", "angle_deg"], {}, 'column = "angle_deg", unit = "deg"'),
        ("psi", ["angle_raw"], {}, 'column = "angle_raw", unit = "count", scale = ...'),
        ("x", ["raw position [mm]"], {}, 'column = "raw position [mm]", unit = "mm"'),
        ("x", ["position"], {"position": "mm"}, 'column = "position", unit = "mm"'),
        ("psi", ["angle"], {"angle": "degrees"}, 'column = "angle", unit = "deg"'),
        ("psi", ["angle"], {"angle": "mm"}, 'column = "angle", unit = "rad"'),
        ("u_x", ["target_current", "current", "XVOLT"], {}, 'column = "XVOLT", unit = "V"'),
        ("u_x", ["target_current", "current"], {}, 'column = "current", unit = "A"'),
        ("u_x", ["current_meas", "voltge"], {}, 'column = "voltge", unit = "V"'),
        ("u_x", ["motor_pwm"], {}, 'column = "motor_pwm", unit = "count"'),
        ("u_x", ["pwm_trolley"], {}, 'column = "pwm_trolley", unit = "count"'),
        ("u_x", ["cart_duty_cycle"], {}, 'column = "cart_duty_cycle", unit = "count"'),
        ("u_x", ["pwm_hoist", "duty [%]"], {}, 'column = "duty [%]", unit = "%"'),
        ("u_l", ["pwm_trolley", "hoistPWM"], {}, 'column = "hoistPWM", unit = "count"'),
        ("u_l", ["current", "hoist_current_mA"], {}, 'column = "hoist_current_mA", unit = "mA"'),
    ],
)
def test_the_best_of_several_columns_is_offered(channel, names, told, line):
    found = near_column(channel, names, told)
    assert found is not None
    assert found.line(channel) == f"{channel} = {{{line}}}"


def test_a_comment_says_the_unit_that_is_offered(write, columns):
    columns["position"], columns["position_raw"] = 1e3 * columns["x"], np.round(1e4 * columns["x"])
    columns["angle"] = np.rad2deg(columns["psi"])
    del columns["x"], columns["psi"]
    comments = "# rig 3: fine\n# position_raw\n# position: mm\n// angle [deg]\n# t = s\n"
    (inspected,) = inspect_recordings([write(comments + as_text(columns))])
    assert 'declare x = {column = "position", unit = "mm"}' in inspected.problems[0]
    assert 'declare psi = {column = "angle", unit = "deg"}' in inspected.problems[1]


@pytest.mark.parametrize(
    ("name", "angle", "unit"), [("Winkel", 180.0, "deg"), ("Winkel [rad]", 180.0, "rad"), ("Winkel", 6.0, "rad")]
)
def test_a_large_angle_is_offered_in_degrees_where_the_file_gives_no_unit(tmp_path, name, angle, unit):
    with pytest.raises(InputError, match=rf'declare psi = \{{column = "{re.escape(name)}", unit = "{unit}"\}}'):
        recording_of(tmp_path, f"t,x,l,{name}", np.linspace(0.9 * angle, angle, 400), "")


def test_the_only_column_that_rises_is_offered_as_the_time(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("row,stamp,x,u_x\n" + "".join(f"{k},{10 * k},{k},{k % 3}\n" for k in range(200)))
    with pytest.raises(InputError, match=r'declare t = \{column = "stamp", unit = "ms"\}'):
        load_recording(path)


def test_a_column_of_text_that_may_be_a_channel_is_asked_for(tmp_path):
    with pytest.raises(InputError, match=r"column theta: not used, and there is no psi"):
        recording_of(tmp_path, "t,x,l,theta", ["1"] * 399 + ["#N/A"], "")


def test_names_are_cut_and_control_characters_refused(tmp_path):
    assert "control characters" in problem(tmp_path, "t,x,\x1b[31mred\n0,1,2\n")
    recording = recording_of(tmp_path, "t,psi,l," + "y" * 5000, range(400))
    (note,) = (note for note in recording.notes if "kept but not used" in note)
    assert len(note) < 120 and "'yyy" in note


@pytest.mark.parametrize(
    ("name", "said", "unit"),
    [
        ("t", "t [ms]", "s"),
        ("t", "t [us]", "s"),
        ("x", "x [mm]", "m"),
        ("x", "x [cm]", "m"),
        ("x", "x [um]", "m"),
        ("psi", "psi [mrad]", "rad"),
        ("psi", "psi (deg)", "rad"),
    ],
)
def test_a_unit_of_the_header_that_is_too_small_is_refused(tmp_path, name, said, unit):
    """SI numbers under another unit's name; with the line in the refusal they are read as what they are."""
    path = tmp_path / "run.csv"
    rows = RECORDED.read_text().splitlines()
    path.write_text("\n".join([",".join(said if n == name else n for n in rows[0].split(",")), *rows[1:]]) + "\n")
    with pytest.raises(InputError) as caught:
        load_recording(path)
    line = re.search(rf"declare ({name} = \{{.*?\}})", str(caught.value))
    assert line, str(caught.value)
    assert f'unit = "{unit}"' in line[1]
    path.with_suffix(".toml").write_text(f"[columns]\n{line[1]}\n")
    recording = load_recording(path)
    np.testing.assert_array_equal(recording.psi, load_recording(RECORDED).psi)
    np.testing.assert_array_equal(recording.x, load_recording(RECORDED).x)


def test_times_that_no_unit_mends_are_doubted(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,psi,l\n" + "".join(f"{t * 1e-5:.5f},{np.sin(t / 30):.4f},0.7\n" for t in range(400)))
    with pytest.raises(InputError, match="column t: a row every 1e-05 s is more often"):
        load_recording(path)
    assert load_recording(path, force=True).times.size == 400


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns"), (1.0 / 86400, "day")])
def test_a_time_is_offered_in_the_unit_that_its_steps_tell(write, columns, factor, unit):
    columns["time"] = columns.pop("t") * factor
    (inspected,) = inspect_recordings([write(columns)])
    assert f'declare t = {{column = "time", unit = "{unit}"}}' in inspected.problems[0]


@pytest.mark.parametrize("name", ["stamp [min]", "stamp_min", "Time (minutes)"])
def test_a_time_is_offered_in_the_unit_of_its_header(write, columns, name):
    columns[name] = columns.pop("t") / 60
    (inspected,) = inspect_recordings([write(columns)])
    assert f'declare t = {{column = "{name}", unit = "min"}}' in inspected.problems[0]


def test_nothing_measured_names_what_is_there(write, columns):
    (inspected,) = inspect_recordings([write({"t": columns["t"], "y": columns["x"], "w": columns["u_x"]})])
    assert (
        "nothing measured; add a column x (with u_x), psi, or l (with u_l); columns not used are 'y', 'w'"
        in (inspected.problems[0])
    )
