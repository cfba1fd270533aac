"""Reads and writes comma-separated values.

Reading is fast where the file is clean. Where it is not, it is read a second time, cell by cell, to say which
row and column to correct.
"""

import csv
import io
import os
import re
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jbridge._files import replace_text
from jbridge.errors import InputError, cut, listed, quoted
from jbridge.recordings.tables.clock import LIKE_A_DATE, clock_seconds, is_clock
from jbridge.recordings.tables.csv_lines import filled_lines, is_number, refuse_no_header, to_plain_table, told_units
from jbridge.recordings.tables.table import Table

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
"""Control characters that no text carries; tabs, line breaks and escapes are not among them."""
NO_TABLES = (
    (r"<", "a web page (HTML or XML), not a recording; download the file itself, not its page"),
    (
        r"\{|\[\s*[\[{\"\d-]",
        "JSON, not a table; write its signals as columns of comma-separated text, or read it in Python and give the"
        " arrays to jbridge.Recording.from_arrays",
    ),
    (
        r"LabVIEW Measurement",
        "a LabVIEW measurement file (.lvm); write it again with 'No headers', as text with the names of the columns in"
        " the first row, or delete all rows above that of the names (X_Value, ...) and the column Comment",
    ),
    (
        r"(?:(?:[^\W\d]\w*:[ \t]*[-+]?\d[\d.eE+-]*[ \t,;]*){2,}(?:\r?\n|\Z)){2}",
        "a name with each number, as for a serial plotter; print the names once, in a first row such as t,u_x,x,psi,"
        " and then numbers alone with commas between them",
    ),
)
"""Beginnings of texts that are no tables, what they are and what to do."""


def read_csv(path: Path, content: bytes) -> Table:
    """Returns the columns of a CSV file: one header row, then numbers only, with `,` between them.

    A byte-order mark, CRLF line ends, quoted cells and blank lines are accepted. Other separators, decimal commas,
    lines of comment, text above the header, a row of units, times of day and the row numbers of a data frame are read
    and said.

    Raises:
        InputError: naming file, row and column.
    """
    lines = decode(path, content).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    told = told_units(lines)
    notes = to_plain_table(path, lines)
    filled = filled_lines(lines)
    if not filled:
        raise InputError(f"{path}: nothing but comments; record or export the run again")
    header = read_header(path, lines, filled)
    if len(filled) == 1:
        raise InputError(f"{path}, row {filled[0] + 1}: only a header, no samples; record the run again")
    body = [lines[number] for number in filled[1:]]
    rows = np.array(filled[1:]) + 1
    faulty: dict[str, InputError] = {}
    clocks: dict[str, InputError] = {}
    matrix = parse_fast(body, len(header))
    if matrix is None:
        cells = [split(path, row, line) for row, line in zip(rows.tolist(), body, strict=True)]
        columns, faulty, clocks = parse_carefully(path, header, cells, rows)
    else:
        columns = dict(zip(header, np.ascontiguousarray(matrix.T), strict=True))
    if not header[0]:
        if "" not in columns or np.any(np.diff(columns.pop("")) != 1):
            raise unnamed(path, filled[0] + 1, 0)
        notes += ("The first column has no name and numbers the rows; it is left out.",)
    return Table(
        str(path),
        f"{path}, row {filled[0] + 1}",
        columns,
        rows,
        faulty=faulty,
        clocks=clocks,
        told=told,
        notes=notes,
    )


def decode(path: Path, content: bytes) -> str:
    """Returns the text of a file, or refuses what is no text or no table."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            content = content.decode("utf-16").encode()  # what spreadsheets call Unicode text
        except UnicodeDecodeError:
            raise InputError(f"{path}: damaged UTF-16 text; save it as 'CSV UTF-8'") from None
    if content.startswith(b"MATLAB 5.0 MAT-file"):
        raise InputError(f"{path}: this is a MATLAB file, not text; rename it to end in .mat")
    if BINARY.search(content[:65536]):
        raise InputError(f"{path}: binary, not text; export the recording as comma-separated text (.csv)")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise InputError(
            f"{path}, row {row}: byte 0x{byte:02x} is not UTF-8 text; save the file as 'CSV UTF-8',"
            " or write its names without special letters"
        ) from None
    if not text.strip():
        raise InputError(f"{path}: the file is empty; record or export the run again")
    begins = text.lstrip()
    for beginning, what in NO_TABLES:
        if re.match(beginning, begins):
            raise InputError(f"{path}, row {text.count(chr(10), 0, len(text) - len(begins)) + 1}: {what}")
    return text


def read_header(path: Path, lines: list[str], filled: list[int]) -> list[str]:
    """Returns the names of the columns, or refuses what cannot be a header of a comma-separated table."""
    row, line = filled[0] + 1, lines[filled[0]]
    names = [name.strip() for name in split(path, row, line)]
    if len(names) == 1 and any("," in lines[number] for number in filled[1:100]):
        raise refuse_no_header(path, row, line)
    if len(names) == 1 and len(line.split()) > 1 and is_number(lines[filled[-1]].split()[0]):
        raise InputError(
            f"{path}, row {row}: blanks between the columns, and not as many names as numbers; export with commas"
        )
    if all(is_number(name) for name in names):
        raise InputError(
            f"{path}, row {row}: numbers where the names of the columns belong; put a row such as t,u_x,x,psi first"
        )
    for place, name in enumerate(names):
        if not name and place:
            raise unnamed(path, row, place)
        if not name.isprintable():
            raise InputError(f"{path}, row {row}, column {quoted(name)}: the name has control characters; rename it")
        if name in names[:place]:
            raise InputError(
                f"{path}, row {row}, column {cut(name)}: the name is there twice, as column"
                f" {names.index(name) + 1} and {place + 1}; rename or delete one"
            )
    return names


def unnamed(path: Path, row: int, place: int) -> InputError:
    return InputError(f"{path}, row {row}, column {place + 1}: the column has no name; name it or delete it")


def split(path: Path, row: int, line: str) -> list[str]:
    try:
        return next(csv.reader([line]))
    except csv.Error as error:
        raise InputError(f"{path}, row {row}: not comma-separated text ({error}); export it again") from None


def parse_fast(body: list[str], width: int) -> np.ndarray | None:
    """Returns the rows as numbers, or None where a row needs a closer look."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            matrix = np.loadtxt(body, delimiter=",", comments=None, quotechar='"', ndmin=2)
    except (ValueError, UserWarning, DeprecationWarning):
        return None
    return matrix if matrix.shape == (len(body), width) else None


def parse_carefully(
    path: Path, header: list[str], cells: list[list[str]], rows: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, InputError], dict[str, InputError]]:
    """Returns the columns of numbers and of times of day, and the refusals that `Table` keeps: of columns in which a
    cell can be read as neither, and of those with times of day where numbers belong.

    Raises:
        InputError: a row has more or fewer cells than the header.
    """
    faults = [fault_of_row(row, header) for row in cells]
    if any(faults):
        raise refuse_cell(path, "", rows, faults)
    columns, clocks = {}, {}
    found: list[tuple[int, str, InputError]] = []
    for place, name in enumerate(header):
        column = [row[place] for row in cells]
        where = f", column {cut(name)}"
        values: list[float | None] = [float(cell) if is_number(cell) else None for cell in column]
        if is_clock(column[0]):
            no_numbers = [None if is_number(cell) else describe_cell(cell.strip(), name) for cell in column]
            clocks[name] = refuse_cell(path, where, rows, no_numbers)
            values = clock_seconds(column)
        faults = [
            describe_cell(cell.strip(), name) if value is None else None
            for cell, value in zip(column, values, strict=True)
        ]
        if any(faults):
            first = next(index for index, fault in enumerate(faults) if fault)
            found.append((first, name, refuse_cell(path, where, rows, faults)))
        else:
            columns[name] = np.array(values, dtype=np.float64)
    return columns, {name: error for _, name, error in sorted(found, key=lambda each: each[0])}, clocks


def refuse_cell(path: Path, where: str, rows: np.ndarray, faults: list[tuple[str, str] | None]) -> InputError:
    """Returns the refusal of the first row with a fault: what is wrong and what to do."""
    first, (problem, remedy) = next((index, fault) for index, fault in enumerate(faults) if fault is not None)
    alike = sum(fault is not None for fault in faults)
    if alike > len(faults) / 2:  # not to be mended row by row
        problem += f", and so in {alike} of {len(faults)} rows"
        remedy = remedy.replace("correct or delete the row", "export plain numbers, one to a column")
    return InputError(f"{path}, row {rows[first]}{where}: {problem}; {remedy}")


def fault_of_row(cells: list[str], header: list[str]) -> tuple[str, str] | None:
    """Returns what is wrong with the length of a row, and what to do; None where it is right."""
    if len(cells) == len(header):
        return None
    if not any(map(is_number, cells)):
        return f"{quoted(','.join(cells))} is text among the numbers", "delete the row"
    remedy = "correct or delete the row"
    if len(cells) > len(header):
        remedy += "; if its extra commas are decimal commas, export with decimal points"
    return f"{len(cells)} cells for {len(header)} columns", remedy


def describe_cell(cell: str, name: str) -> tuple[str, str]:
    """Returns what is wrong with a cell that is no number, and what to do."""
    if not cell:
        return "the cell is empty", "delete the row, since a gap is a missing row"
    if cell == name:
        return f"{quoted(cell)} is text, the header once more", "keep one run in a file"
    if DECIMAL_COMMA.fullmatch(cell):
        return f"{quoted(cell)} has a decimal comma", "export with decimal points"
    if LIKE_A_DATE.fullmatch(cell):
        remedy = "export seconds, or times such as 2024-03-05 14:03:59.500"
        return f"{quoted(cell)} is a date or a time of day, not a number or a time that can be read", remedy
    if is_number(cell):
        return f"{quoted(cell)} is no time of day as in the first row", "correct or delete the row"
    return f"{quoted(cell)} is text, not a number", "correct or delete the row"


def save_csv(path: str | os.PathLike[str], columns: Mapping[str, np.ndarray]) -> None:
    """Writes columns of equal length as CSV, so that reading gives the same numbers.

    Each number has the fewest digits that do. The file appears whole or not at all.

    Args:
        path: Where to write; an existing file is replaced.
        columns: Numbers by the name of their column, in the order of the columns.

    Raises:
        ValueError: if there is no column, or if they differ in length.
        InputError: if the file cannot be written.
    """
    lengths = {name: np.shape(values) for name, values in columns.items()}
    if not columns or len(set(lengths.values())) != 1 or len(next(iter(lengths.values()))) != 1:
        raise ValueError(f"a table needs columns of one length, got {listed(lengths.items())}")
    target = Path(path)
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(columns)
    numbers = [np.asarray(values, dtype=np.float64).tolist() for values in columns.values()]
    text.writelines(",".join(map(repr, row)) + "\n" for row in zip(*numbers, strict=True))
    replace_text(target, text.getvalue())
