"""What goes wrong between a rig and a file: each slip is refused with the line that mends it, or read right."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import inspect_recordings, load_recording
from jbridge.report.check import shared_problems

RECORDED = Path(__file__).parent / "whole_bridge.csv"
Columns = dict[str, np.ndarray]
MENDS = re.compile(r"declare (?:the hoist's input, )?([a-z_]+ = \{.*?\})")


def truth() -> Columns:
    """Returns 14 s of a whole bridge, simulated by another engine, at 100 rows a second."""
    names, *rows = RECORDED.read_text().splitlines()
    values = np.array([row.split(",") for row in rows], float).T
    return dict(zip(names.split(","), values, strict=True))


TRUTH = truth()


def table(columns: Columns, separator: str = ",", comma: bool = False) -> str:
    """Returns the text of a file, as a logger or a spreadsheet writes it."""
    rows = (separator.join(map(repr, row)) for row in zip(*(c.tolist() for c in columns.values()), strict=True))
    body = "\n".join(rows)
    return separator.join(columns) + "\n" + (body.replace(".", ",") if comma else body) + "\n"


def scaled(**factors: float) -> Columns:
    return {name: values * factors.get(name, 1.0) for name, values in TRUTH.items()}


def renamed(**names: str) -> Columns:
    return {names.get(name, name): values for name, values in TRUTH.items()}


def only(names: str, columns: Columns | None = None) -> Columns:
    return {name: (columns or TRUTH)[name] for name in names.split()}


MENDED = {
    "x in mm": scaled(x=1e3),
    "x in cm": scaled(x=1e2),
    "x in mm from the middle": scaled(x=1e3) | {"x": np.round(1e3 * (TRUTH["x"] - TRUTH["x"].mean()))},
    "x in um": scaled() | {"x": 1e6 * (TRUTH["x"] - 0.7)},
    "l in mm": scaled(l=1e3),
    "l in cm": scaled(l=1e2),
    "x and l in mm": scaled(x=1e3, l=1e3),
    "x and l in cm": scaled(x=1e2, l=1e2),
    "t in ms": scaled(t=1e3),
    "t in us": scaled(t=1e6) | {"t": 1e6 * TRUTH["t"] / 100, "x": TRUTH["x"]},
    "t in ms, rows of 40 ms": {name: values[::4] for name, values in scaled(t=1e3).items()},
    "t in days, as spreadsheets count": scaled() | {"t": 45000.4321 + TRUTH["t"] / 86400.0},
    "psi in degrees": scaled(psi=180 / np.pi),
    "t in ns": scaled(t=1e9),
    "Time [min]": {("Time [min]" if n == "t" else n): v for n, v in scaled(t=1 / 60).items()},
    "psi in milliradians": scaled(psi=1e3),
    "psi turned": scaled(psi=-1.0),
    "u_x turned": scaled(u_x=-1.0),
    "u_l turned": scaled(u_l=-1.0),
    "x turned": scaled(x=-1.0),
    "x turned about the rail's end": scaled() | {"x": 1.5 - TRUTH["x"]},
    "both inputs turned": scaled(u_x=-1.0, u_l=-1.0),
    "psi and u_x turned": scaled(psi=-1.0, u_x=-1.0),
    "psi in degrees and turned": scaled(psi=-180 / np.pi),
    "x in mm and turned": scaled(x=-1e3),
    "everything scaled": scaled(t=1e3, x=1e3, l=1e2, psi=180 / np.pi),
    "time": renamed(t="time"),
    "Time [ms]": {("Time [ms]" if n == "t" else n): v for n, v in scaled(t=1e3).items()},
    "theta": renamed(psi="theta"),
    "Angle (deg)": {("Angle (deg)" if n == "psi" else n): v for n, v in scaled(psi=180 / np.pi).items()},
    "phi": renamed(psi="phi"),
    "Psi": renamed(psi="Psi"),
    "swing_angle": renamed(psi="swing_angle"),
    "pos": renamed(x="pos"),
    "cart_position_mm": {("cart_position_mm" if n == "x" else n): v for n, v in scaled(x=1e3).items()},
    "X": renamed(x="X"),
    "voltage": renamed(u_x="voltage"),
    "rope_length": renamed(l="rope_length"),
    "lenght": renamed(l="lenght"),
    "U_L": renamed(u_l="U_L"),
    "every name a capital": {name.upper(): values for name, values in TRUTH.items()},
    "every name in words": renamed(t="Time", x="Position", psi="Angle", l="Length", u_x="Voltage", u_l="hoist voltage"),
}
"""Tables that a few declarations make right."""


@pytest.mark.parametrize("columns", MENDED.values(), ids=MENDED)
def test_the_line_in_the_refusal_mends_it(tmp_path, columns):
    """As an owner does: copy the line, try again, until nothing is said any more. Then all is as in the truth."""
    path, sidecar = tmp_path / "run.csv", {}
    path.write_text(table(columns), encoding="utf-8")
    for _ in range(8):
        try:
            recording = load_recording(path)
            break
        except InputError as error:
            message = str(error)
            line = MENDS.search(message)
            assert line, message
            assert message.isprintable() and "run.csv" in message
            channel = line[1].partition(" ")[0]
            assert sidecar.get(channel) != line[1], message
            sidecar[channel] = line[1]
            (tmp_path / "run.toml").write_text("[columns]\n" + "\n".join(sidecar.values()) + "\n", encoding="utf-8")
    else:
        pytest.fail(f"no end of refusals: {sidecar}")
    assert sidecar
    check(recording)
    assert load_recording(path, force=True).times.size == recording.times.size


@pytest.mark.parametrize("turn", [1024, 4096])
def test_an_angle_in_no_unit_is_offered_in_counts(tmp_path, turn):
    """The line contradicts neither gravity nor the cart."""
    path = tmp_path / "run.csv"
    path.write_text(table(TRUTH | {"psi": np.round(TRUTH["psi"] * turn / (2 * np.pi))}))
    with pytest.raises(InputError) as caught:
        load_recording(path)
    line = re.search(r'declare (psi = \{column = "psi", unit = "count", scale = (\S+)\})', str(caught.value))
    assert line and float(line[2]) == pytest.approx(2 * np.pi / turn, rel=0.05), str(caught.value)
    path.with_suffix(".toml").write_text(f"[columns]\n{line[1]}\n")
    (inspected,) = inspect_recordings([path])
    assert inspected.problems == ()


def check(recording) -> None:
    """The recording is the truth or its mirror image, but for the zero of a position and the digits of a unit."""
    rows = slice(None, None, round(len(TRUTH["t"]) / recording.times.size))
    way = np.sign(np.dot(recording.psi, TRUTH["psi"][rows]))
    for name in ("x", "psi", "l", "u_x", "u_l"):
        found, wanted = getattr(recording, name), TRUTH[name][rows] * (1.0 if name in ("l", "u_l") else way)
        shift = np.median(found - wanted) if name == "x" else 0.0
        np.testing.assert_allclose(found - shift, wanted, atol=6e-4, err_msg=name)
    assert recording.has_cart and recording.has_swing and recording.has_hoist


def edited(edit: Callable[[list[str]], list[str]]) -> Callable[[], str]:
    return lambda: "\n".join(edit(table(TRUTH).splitlines())) + "\n"


def with_clock(clock: Callable[[float], str]) -> str:
    """Returns a file whose time is a clock's, hours, minutes and seconds."""
    header, *rows = table(TRUTH).splitlines()
    timed = [f"{clock(t)},{row.partition(',')[2]}" for t, row in zip(TRUTH["t"].tolist(), rows, strict=True)]
    return "\n".join([header, *timed]) + "\n"


SI = {"t": "s", "u_x": "V", "u_l": "V", "x": "m", "psi": "rad", "l": "m"}
READ = {
    "semicolons": lambda: table(TRUTH, ";"),
    "semicolons and decimal commas": lambda: table(TRUTH, ";", comma=True),
    "tabs": lambda: table(TRUTH, "\t"),
    "tabs and decimal commas": lambda: table(TRUTH, "\t", comma=True),
    "quoted decimal commas": lambda: re.sub(r"(-?\d+,\d+(?:e-?\d+)?)", r'"\1"', table(TRUTH, ";", comma=True)).replace(
        ";", ","
    ),
    "a byte-order mark": lambda: "\ufeff" + table(TRUTH),
    "a spreadsheet's separator line": lambda: "sep=;\r\n" + table(TRUTH, ";", comma=True).replace("\n", "\r\n"),
    "a spreadsheet's export": lambda: "\ufeff" + table(TRUTH, ";", comma=True).replace("\n", "\r\n") + "\r\n\r\n",
    "blanks about the cells": lambda: table(TRUTH).replace(",", " , "),
    "quoted cells": lambda: re.sub(r"[^,\n]+", r'"\g<0>"', table(TRUTH)),
    "a quoted name": lambda: table(TRUTH).replace("psi", '"psi"'),
    "line ends of old systems": lambda: table(TRUTH).replace("\n", "\r"),
    "line ends of Windows": lambda: table(TRUTH).replace("\n", "\r\n"),
    "doubled line ends": lambda: table(TRUTH).replace("\n", "\r\r\n"),
    "blank lines at the end": lambda: table(TRUTH) + "\n\n  \n",
    "no line end at the end": lambda: table(TRUTH).rstrip(),
    "columns in another order": lambda: table(only("l psi x u_l u_x t")),
    "further columns": lambda: table({**TRUTH, "x_ref": TRUTH["x"], "theta_dot": TRUTH["psi"], "battery": TRUTH["t"]}),
    "time from elsewhere": lambda: table({**TRUTH, "t": TRUTH["t"] + 5000.0}),
    "UTF-16, as spreadsheets write Unicode text": lambda: table(TRUTH, "\t").encode("utf-16"),
    "blanks as separators": lambda: table(TRUTH, " "),
    "several blanks as separators": lambda: table(TRUTH, "   "),
    "bars as separators": lambda: table(TRUTH, "|"),
    "units in brackets": lambda: table({f"{n} [{SI[n]}]": v for n, v in TRUTH.items()}),
    "units in parentheses": lambda: table({f"{n} ({SI[n]})": v for n, v in TRUTH.items()}),
    "units behind a stroke": lambda: table({f"{n}/{SI[n]}": v for n, v in TRUTH.items()}),
    "other units in brackets": lambda: table(
        {"t [ms]": 1e3 * TRUTH["t"], "x [mm]": 1e3 * TRUTH["x"], "psi [°]": np.rad2deg(TRUTH["psi"])}
        | {"l [cm]": 1e2 * TRUTH["l"], "u_x [mV]": 1e3 * TRUTH["u_x"], "u_l [V]": TRUTH["u_l"]}
    ),
    "a row of units": edited(lambda n: [n[0], ",".join(SI.values()), *n[1:]]),
    "comments above": edited(lambda n: ["# rig 3, in May", "% 100 Hz", *n]),
    "comments after semicolons": edited(lambda n: [";; rig 3; in May", "; " + n[0], *n[1:9], "; ok, fine", *n[9:]]),
    "semicolons and row numbers": lambda: "\n".join(
        [";" + table(TRUTH, ";").splitlines()[0]]
        + [f"{k};{row}" for k, row in enumerate(table(TRUTH, ";").splitlines()[1:])]
    ),
    "a title above": edited(lambda n: ["STEP 1: 11 V, no container, hook up", *(row + "," for row in n)]),
    "lines of text above": edited(lambda n: ["rig 3", "start_time,1015.361712", "omega,1.0,2.0", "", *n]),
    "a title above units": edited(lambda n: ["monday, rig 3", n[0], ",".join(SI.values()), *n[1:]]),
    "a title above semicolons": lambda: "Versuch 3, Montag\n2024-03-05\n" + table(TRUTH, ";", comma=True),
    "a comment between": edited(lambda n: [*n[:80], "# the button, twice", *n[80:]]),
    "a header in a comment": edited(lambda n: ["# rig 3", "# " + n[0], *n[1:]]),
    "a separator at the end of each row": edited(lambda n: [row + "," for row in n]),
    "a separator at the end of each row of numbers": edited(lambda n: [n[0], *(row + "," for row in n[1:])]),
    "a last column that is empty": edited(lambda n: [n[0] + ",note,fit", *(row + ',"a, b, c",' for row in n[1:])]),
    "the row numbers of a data frame": edited(lambda n: ["," + n[0], *(f"{i},{row}" for i, row in enumerate(n[1:]))]),
    "the times of a serial monitor": edited(lambda n: [f"14:03:{i / 100:06.3f} -> {n[i]}" for i in range(len(n))]),
    "times of day over midnight": lambda: with_clock(
        lambda t: f"{'23:59' if t < 5 else '0:00'}:{(55 + t) % 60:09.6f}"
    ),
    "dates with times": lambda: with_clock(lambda t: f"2024-03-05 14:03:{t:09.6f}"),
    "minutes and seconds": lambda: with_clock(lambda t: f"03:{t:09.6f}"),
    "rows that come irregularly": lambda: table({n: v[np.r_[0:200, 201:350, 352:1400]] for n, v in TRUTH.items()}),
}  # fmt: skip


@pytest.mark.parametrize("text", READ.values(), ids=READ)
def test_read_right(tmp_path, text):
    path = tmp_path / "run.csv"
    content = text()
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    recording = load_recording(path)
    rows = np.searchsorted(TRUTH["t"], recording.times - recording.start - 1e-6)
    for name in ("x", "psi", "l", "u_x", "u_l"):
        np.testing.assert_allclose(getattr(recording, name), TRUTH[name][rows], rtol=1e-12, atol=1e-15)


def test_text_above_the_header_is_told(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("rig 3\nomega,2.0\n" + table(TRUTH))
    assert "2 lines of text above the header, 'rig 3' the first, are left out." in load_recording(path).notes


@pytest.mark.parametrize("row", ["button pressed", "on,off,on,off,on,off", "t,u_x,u_l,x,psi,l"])
def test_text_among_the_numbers_is_refused(tmp_path, row):
    """Also where as many words as columns stand right below the header."""
    path = tmp_path / "run.csv"
    header, *rows = table(TRUTH).splitlines()
    for place in (0, 1, 300):
        path.write_text("\n".join([header, *rows[:place], row, *rows[place:]]))
        with pytest.raises(InputError, match=f"row {place + 2}[:,].* is text"):
            load_recording(path)


@pytest.mark.parametrize(("column", "value"), [("u_x", "60000.0"), ("u_l", "400.0")])
def test_a_single_wild_input_is_refused(tmp_path, column, value):
    lines = [line.split(",") for line in table(TRUTH).splitlines()]
    lines[60][lines[0].index(column)] = value
    path = tmp_path / "run.csv"
    path.write_text("\n".join(map(",".join, lines)))
    with pytest.raises(InputError, match=rf"row 61, column {column}: .* far beyond all others.*delete the row"):
        load_recording(path)


def test_all_problems_are_found_at_once(tmp_path):
    path = tmp_path / "run.csv"
    columns = scaled(x=1e3, psi=180 / np.pi) | {"l": 1e2 * TRUTH["l"]}
    path.write_text(table(columns))
    (inspected,) = inspect_recordings([path])
    assert [re.search(r"column (\w+):", problem)[1] for problem in inspected.problems] == ["x", "l", "psi"]
    path.write_text(table(scaled(u_x=-1.0, u_l=-1.0, psi=-1.0)))
    (inspected,) = inspect_recordings([path])
    assert len(inspected.problems) == 2  # x, which mends u_x and psi, and u_l


LACKING = {
    "no time": (renamed(t="seconds_of_day"), ["no column t"]),
    "time, positions and angle": (
        only("time u_x position theta", renamed(t="time", x="position", psi="theta")),
        ["declare t =", "declare x =", "declare psi =", "unknown length"],
    ),
    "time and inputs": (
        only("time volts x psi", renamed(t="time", u_x="volts")),
        ["declare t =", "x but no u_x", "unknown length"],
    ),
    "a time that nothing tells": (
        only("a u_x b psi", renamed(t="a", x="b")),
        ["no column t", "unknown length"],
    ),
    "time and measurements": (
        only("time u_x b c", renamed(t="time", x="b", psi="c")),
        ["declare t =", "u_x varies, but there is no x"],
    ),
    "inputs and angle": (only("t volts x theta", renamed(u_x="volts", psi="theta")), ["psi =", "x but no u_x", "unk"]),
    "nothing measured": (only("t u_l"), ["nothing measured", "u_l but no l"]),
}


@pytest.mark.parametrize(("columns", "needles"), LACKING.values(), ids=LACKING)
def test_what_is_missing_is_told_at_once(tmp_path, columns, needles):
    """One line each, of which other commands refuse the file with the first; with --force, too, there is a reason."""
    path = tmp_path / "run.csv"
    path.write_text(table(columns))
    (inspected,) = inspect_recordings([path])
    assert len(inspected.problems) == len(needles), inspected.problems
    for needle, problem in zip(needles, inspected.problems, strict=True):
        assert needle in problem and problem.isprintable()
    with pytest.raises(InputError) as caught:
        load_recording(path)
    assert str(caught.value) == inspected.problems[0]
    with pytest.raises(InputError) as caught:
        load_recording(path, force=True)
    assert str(caught.value) == inspected.refusal


def test_lines_for_all_that_is_missing_mend_it(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(table(only("time volts position theta", renamed(t="time", u_x="volts", x="position", psi="theta"))))
    (inspected,) = inspect_recordings([path])
    lines = [line[1] for problem in inspected.problems if (line := MENDS.search(problem))]
    assert len(lines) == 4 and len(inspected.problems) == 5
    (tmp_path / "run.toml").write_text("[columns]\n" + "\n".join(lines) + "\n[locked]\nl = 0.7\n")
    recording = load_recording(path, force=True)
    np.testing.assert_array_equal(recording.psi, TRUTH["psi"])


@pytest.mark.parametrize("names", [("a-1.csv",), ("a-1.csv", "a-2.csv")])
def test_the_line_belongs_into_the_table_that_declares_the_channel(tmp_path, names):
    """Another pattern that fits must not say the same, and the line in the place that is named mends it."""
    folder = tmp_path / "recordings.toml"
    tables = '["*.csv".columns]\nt = "t"\n\n["a-*.csv".columns]\nx = {column = "way", unit = "m"}\n'
    folder.write_text(tables)
    paths = [tmp_path / name for name in names]
    for path in paths:
        path.write_text(table(renamed(x="way") | {"way": 1e3 * TRUTH["x"]}))
    said = shared_problems(inspect_recordings(paths))
    assert len(said) == 1
    line, place = re.search(r'declare (x = \{.*?\}) under (\[.*?"\.columns\]) in recordings.toml', said[0]).groups()
    assert place == '["a-*.csv".columns]'
    folder.write_text(tables.replace('x = {column = "way", unit = "m"}', line))
    for path in paths:
        check(load_recording(path))


def test_a_line_contradicts_no_table_of_other_recordings(tmp_path):
    """`["*.csv".columns]` would say again what `["b.csv".columns]` or a pattern says."""
    folder, paths = tmp_path / "recordings.toml", [tmp_path / "a-1.csv", tmp_path / "b-1.csv"]
    folder.write_text('["*.csv".override]\ngravity = 9.8\n\n["b*.csv".columns]\nx = "pos"\n')
    for path in paths:
        path.write_text(table(renamed(x="pos")))
    said = shared_problems(inspect_recordings(paths))
    assert len(said) == 1
    line, place = re.search(r'declare (x = \{.*?\}) under (\[.*?"\.columns\]) in recordings.toml', said[0]).groups()
    folder.write_text(f"{folder.read_text()}\n{place}\n{line}\n")
    for path in paths:
        check(load_recording(path))


def test_each_file_is_read_once(tmp_path, monkeypatch):
    """Also where recordings are compared with each other: a file may be large, or a pipe."""
    paths = [tmp_path / name for name in ("a.csv", "b.csv")]
    for path in paths:
        path.write_text(table(TRUTH))
    opened, read = [], Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: opened.append(path) or read(path))
    assert all(not each.problems for each in inspect_recordings(paths))
    assert [path for path in opened if path.suffix == ".csv"] == paths


def test_right_signs_are_confirmed(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(table(TRUTH))
    (inspected,) = inspect_recordings([path])
    assert inspected.problems == ()
    assert inspected.signs == {"psi": True, "u_x": True, "u_l": True}


@pytest.mark.parametrize(("one", "other"), [("x", "psi"), ("u_x", "u_l"), ("x", "l")])
def test_exchanged_columns(tmp_path, one, other):
    path = tmp_path / "run.csv"
    path.write_text(table(renamed(**{one: other, other: one})))
    with pytest.raises(InputError, match="exchanged") as caught:
        load_recording(path)
    first, second = re.search(r"declare (\w+ = \{.*?\}) and (\w+ = \{.*?\}) under", str(caught.value)).groups()
    (tmp_path / "run.toml").write_text(f"[columns]\n{first}\n{second}\n")
    check(load_recording(path))
