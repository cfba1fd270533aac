"""Whatever cannot be a recording is refused with one line that says where and what to do."""

import pytest

from jbridge.recordings import inspect_recordings, load_recording


def replaced(row: int, old: int, new: str):
    """Returns an edit that puts `new` into cell `old` of a row of the file."""

    def edit(lines: list[str]) -> str:
        cells = lines[row - 1].split(",")
        cells[old] = new
        return "\n".join([*lines[: row - 1], ",".join(cells), *lines[row:]])

    return edit


def line_replaced(row: int, edit):
    return lambda lines: "\n".join([*lines[: row - 1], edit(lines[row - 1]), *lines[row:]])


def every_row(edit):
    """Returns an edit of all rows below the header."""
    return lambda lines: "\n".join([lines[0], *map(edit, lines[1:])])


def inserted(row: int, *new: str):
    """Returns an edit that puts further rows before a row of the file."""
    return lambda lines: "\n".join([*lines[: row - 1], *new, *lines[row - 1 :]])


def columns_of(lines: list[str]) -> dict[str, list[str]]:
    names, *rows = (line.split(",") for line in lines)
    return dict(zip(names, zip(*rows, strict=True), strict=True))


def header(change):
    """Returns an edit of the names of the columns."""
    return line_replaced(1, lambda line: ",".join(map(change, line.split(","))))


def exchanged(one: str, other: str):
    return header(lambda name: {one: other, other: one}.get(name, name))


def without(*names: str):
    """Returns an edit that leaves columns out."""

    def edit(lines: list[str]) -> str:
        kept = {name: cells for name, cells in columns_of(lines).items() if name not in names}
        return "\n".join([",".join(kept), *map(",".join, zip(*kept.values(), strict=True))])

    return edit


def german(lines: list[str], separator: str) -> str:
    return "\n".join(line.replace(",", separator).replace(".", ",") for line in lines)


REFUSED = {
    "empty": (lambda lines: "", ["empty", "export the run again"]),
    "blank": (lambda lines: " \n\n", ["empty"]),
    "header only": (lambda lines: lines[0], ["row 1", "only a header", "record the run again"]),
    "no header": (lambda lines: "\n".join(lines[1:]), ["row 1", "names of the columns", "t,u_x"]),
    "png": (lambda lines: b"\x89PNG\r\n\x1a\n\x00\x00", ["binary", "comma-separated text"]),
    "zip": (lambda lines: b"PK\x03\x04" + bytes(100), ["binary", "comma-separated text"]),
    "mat inside": (lambda lines: b"MATLAB 5.0 MAT-file, written", ["MATLAB", ".mat"]),
    "html": (lambda lines: "\n<!DOCTYPE html><html></html>", ["web page", "download the file itself"]),
    "damaged utf-16": (lambda lines: b"\xff\xfe\x00\xd8\x00", ["UTF-16", "CSV UTF-8"]),
    "only comments": (lambda lines: "# one\n# two\n", ["nothing but comments"]),
    "latin-1": (
        lambda lines: "\n".join([lines[0] + ",Höhe", *(line + ",1" for line in lines[1:])]).encode("latin-1"),
        ["row 1", "0xf6", "CSV UTF-8"],
    ),
    "latin-1 later": (
        lambda lines: "\n".join([*lines[:30], lines[30] + "°", *lines[31:]]).encode("latin-1"),
        ["row 31", "0xb0", "UTF-8"],
    ),
    "points and decimal commas": (
        lambda lines: german(lines, ";").replace("0,005", "0.005"),
        ["row 2", "decimal commas among numbers with points", "decimal points alone"],
    ),
    "decimal commas without quotes": (
        lambda lines: "\n".join([lines[0], *(line.replace(".", ",") for line in lines[1:])]),
        ["row 2", "12 cells for 6 columns", "decimal points", "and so in "],
    ),
    "a quoted decimal comma": (replaced(9, 3, '"0,25"'), ["row 9", "column x", "0,25", "decimal points"]),
    "no t": (
        line_replaced(1, lambda line: line.replace("t,", "time,", 1)),
        ["row 1", "no column t", "'time', 'u_x'", "run.toml", "[columns]"],
    ),
    "x without u_x": (
        line_replaced(1, lambda line: line.replace("u_x", "voltage")),
        ["row 1", "no u_x", "run.toml", "zeros"],
    ),
    "u_l without l": (
        line_replaced(1, lambda line: line[:-1] + "length"),
        ["row 1", "u_l but no l", "run.toml", "l = 0.7, under [locked]"],
    ),
    "duplicate column": (
        line_replaced(1, lambda line: line.replace("psi", "x")),
        ["row 1", "column x", "column 4 and 5", "rename"],
    ),
    "unnamed column": (
        line_replaced(1, lambda line: line.replace("psi", " ")),
        ["row 1", "column 5", "no name", "delete"],
    ),
    "short row": (
        line_replaced(17, lambda line: line.rsplit(",", 1)[0]),
        ["row 17", "5 cells for 6 columns", "delete the row"],
    ),
    "long row": (line_replaced(17, lambda line: line + ",1"), ["row 17", "7 cells for 6 columns"]),
    "every row long": (
        lambda lines: "\n".join([lines[0], *(line + ",1" for line in lines[1:])]),
        ["row 2", "7 cells for 6 columns"],
    ),
    "text": (replaced(40, 4, "off"), ["row 40", "column psi", "'off' is text", "correct or delete"]),
    "long text": (replaced(40, 4, "a" * 5000), ["row 40", "column psi", "aaa..."]),
    "escape in text": (replaced(40, 4, "\x1b[31mred"), ["row 40", "column psi"]),
    "line separator in text": (replaced(40, 4, "a\u2028b"), ["row 40", "column psi"]),
    "underscore": (replaced(40, 4, "1_0"), ["row 40", "column psi", "'1_0' is text"]),
    "empty cell": (replaced(41, 4, ""), ["row 41", "column psi", "empty", "a gap is a missing row"]),
    "empty last cell": (replaced(401, 5, ""), ["row 401", "column l", "empty"]),
    "nan": (replaced(42, 3, "NaN"), ["row 42", "column x", "NaN", "delete the row"]),
    "nan in time": (replaced(42, 0, "nan"), ["row 42", "column t", "NaN", "delete the row"]),
    "infinite": (replaced(43, 1, "-inf"), ["row 43", "column u_x", "infinite", "delete the row"]),
    "overflow": (replaced(43, 1, "1e999"), ["row 43", "column u_x", "infinite"]),
    "beyond 1e6": (replaced(44, 3, "-1.5e6"), ["row 44", "column x", "-1.5e+06", "beyond 1e6", "unit"]),
    "unix time": (
        lambda lines: "\n".join([lines[0], *("1700000" + line for line in lines[1:])]),
        ["row 2", "column t", "beyond 1e6", 't = {column = "t", unit = "s", offset = 17000000'],
    ),
    "falling times": (replaced(50, 0, "0.1"), ["row 50", "column t", "0.1", "before", "one run in a file"]),
    "49 samples": (lambda lines: "\n".join(lines[:50]), ["49 samples", "at least 50", "longer"]),
    "zero length": (replaced(60, 5, "0"), ["row 60", "column l", "length of 0 m", "pivot"]),
    "negative length": (replaced(60, 5, "-0.7"), ["row 60", "column l", "-0.7 m", "sign"]),
    "blank rows keep the numbering": (
        lambda lines: "\n".join([lines[0], "", "", *lines[1:10], "", lines[10] + "x", *lines[11:]]),
        ["row 14", "column l", "is text"],
    ),
    "a monitor's banner and no header": (
        lambda lines: "\n".join(["Booting v1.2", "ready", *lines[1:]]),
        ["row 1", "Booting", "delete the rows"],
    ),
    "a monitor's text between": (inserted(51, "motor on"), ["row 51", "delete the row"]),
    "a cut last line": (line_replaced(401, lambda line: line[:9]), ["row 401", "correct or delete the row"]),
    "a repeated header": (inserted(51, "t,u_x,u_l,x,psi,l"), ["row 51", "column t", "'t' is text"]),
    "a cell with its unit": (line_replaced(51, lambda line: line + " m"), ["row 51", "column l", "is text"]),
    "every cell with its unit": (
        every_row(lambda line: line + " m"),
        ["row 2", "in 400 of 400 rows", "export plain numbers"],
    ),
    "dates that are not ISO": (
        every_row(lambda line: f"05.03.2024 14:03:0{line}"),
        ["row 2, column t", "date", "2024-03-05 14:03:59"],
    ),
    "times of too few digits": (every_row(lambda line: f"{float(line.split(',')[0]):.1f}," + line.split(",", 1)[1]),
        ["95 % of the rows", "more digits"],
    ),
    "rows in reverse": (lambda lines: "\n".join([lines[0], *lines[:0:-1]]), ["falls from row to row", "sort"]),
    "a position that slips": (replaced(61, 3, "9"), ["row 61", "column x", "away from the row above"]),
    "an unknown name for the position": (
        header(lambda name: "y" if name == "x" else name),
        ["u_x varies, but there is no x", "y, declare it, such as", "x = {column = \"y"],
    ),
    "a row that comes again": (lambda lines: "\n".join([*lines[:50], lines[39], *lines[50:]]),
        ["row 51, column t", "time must increase, but 0.19 s comes before", "(0.24 s); keep one run in a file"],
    ),
    "three runs in a file": (lambda lines: "\n".join([*lines, *lines[1:], *lines[1:]]),
        ["row 402, column t", "time must increase", "and so in 2 rows; keep one run in a file"],
    ),
    "all rows doubled": (every_row(lambda line: f"{line}\n{line}"), ["row 3, column t", "repeated"]),
    "two files with headers": (lambda lines: "\n".join([*lines, *lines]), ["column t", "'t' is text"]),
    "no input": (without("u_x"), ["x but no u_x", "in run.toml"]),
    "no rope length": (without("l"), ["u_l but no l", "l = 0.7, under [locked]"]),
    "a rope that moves without input": (without("u_l"), ["declare the hoist's input"]),
    "no time": (without("t"), ["no column t for the time"]),
    "psi and l exchanged": (exchanged("psi", "l"), ["column l: a rope length"]),
    "time and angle exchanged": (exchanged("t", "psi"), ["column t", "no time; declare the column"]),
    "input and position exchanged": (
        exchanged("u_x", "x"),
        ["column x: 4 m away from the row above, 5 ms before", "input such as u_x"],
    ),
    "blanks in names, too": (
        lambda lines: "\n".join(lines).replace(",", " ").replace("u_x", "motor voltage"),
        ["row 1", "blanks between the columns, and not as many names"],
    ),
    "JSON": (lambda lines: '{"t": [0, 1], "x": [1, 2]}', ["row 1", "JSON, not a table", "from_arrays"]),
    "LabVIEW": (
        lambda lines: "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nX_Value\tx\n0\t1\n",
        ["row 1", "LabVIEW measurement file (.lvm)", "'No headers'"],
    ),
    "a serial plotter": (
        lambda lines: "\r\n".join(f"t:{k}\tu_x:-0.5 x:{k / 7:.3f}" for k in range(60)),
        ["row 1", "serial plotter", "first row such as t,u_x,x,psi"],
    ),
    "points for thousands": (
        lambda lines: german(lines, ";").replace("\n0,01;", "\n1.000,01;"),
        ["row 2", "decimal points alone"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("edit", "needles"), REFUSED.values(), ids=REFUSED)
def test_refused(write, lines, edit, needles, refusal):
    path = write(edit(lines))
    message = refusal(path)
    assert [needle for needle in needles if needle not in message] == []
    assert message.isprintable()
    # `check` lists it among all problems.
    (inspected,) = inspect_recordings([path])
    assert message in inspected.problems


def test_fifty_samples_will_do(write, lines):
    assert load_recording(write("\n".join(lines[:51]))).times.size == 50


def test_a_million_will_do(write, columns):
    columns["u_x"][7] = 1e6
    assert load_recording(write(columns)).u_x[7] == 1e6


def test_no_such_file(tmp_path, refusal):
    assert "no such file" in refusal(tmp_path / "absent.csv")
    assert "check the name" in refusal(tmp_path / "absent" / "absent.mat")


def test_a_folder_is_no_recording(tmp_path, refusal):
    assert "folder" in refusal(tmp_path)
    assert "*.csv" in refusal(tmp_path)


def test_a_model_file_is_no_recording(write, refusal):
    assert "TOML" in refusal(write("[bridge]\n", name="model.toml"))


def test_the_culprit_is_found_in_large_files(write, refusal):
    text = "t,u_x,x\n" + "".join(f"{index / 100},1,{index % 7}\n" for index in range(50_000))
    path = write(text.replace("\n400.0,1,", "\n400.0,l,"))
    assert "row 40002, column u_x" in refusal(path)
