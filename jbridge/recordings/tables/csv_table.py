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
from jbridge.errors import InputError, listed, quoted
from jbridge.recordings.tables.table import Table

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
BINARY = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
"""Control characters that no text carries; tabs, line breaks and escapes are not among them."""


def read_csv(path: Path, content: bytes) -> Table:
    """Returns the columns of a CSV file: one header row, then numbers only, with `,` between them.

    A byte-order mark, CRLF line ends, quoted cells and blank lines are accepted; semicolons or tabs in place of the
    commas, and decimal commas, are read and said.

    Raises:
        InputError: naming file, row and column.
    """
    lines = decode(path, content).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if re.fullmatch(r'"?sep=[;,\t]"?', lines[0].strip(" ")):
        lines[0] = ""  # a line that tells spreadsheets the separator
    filled = [number for number, line in enumerate(lines) if line.strip()]
    notes = use_commas(path, lines, filled)
    header = read_header(path, lines, filled)
    if len(filled) == 1:
        raise InputError(f"{path}, row {filled[0] + 1}: only a header, no samples; record the run again")
    body = [lines[number] for number in filled[1:]]
    rows = np.array(filled[1:]) + 1
    matrix = parse_fast(body, len(header))
    if matrix is None:
        matrix = parse_carefully(path, header, body, rows)
    matrix = np.ascontiguousarray(matrix.T)
    columns = dict(zip(header, matrix, strict=True))
    return Table(str(path), f"{path}, row {filled[0] + 1}", columns, rows, notes=notes)


def decode(path: Path, content: bytes) -> str:
    """Returns the text of a file, or refuses what is no text or no table."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"{path}: the text is encoded as UTF-16; save it as 'CSV UTF-8'")
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
    if text.lstrip().startswith("<"):
        raise InputError(
            f"{path}, row 1: a web page (HTML or XML), not a recording; download the file itself, not its page"
        )
    return text


def read_header(path: Path, lines: list[str], filled: list[int]) -> list[str]:
    """Returns the names of the columns, or refuses what cannot be a header of a comma-separated table."""
    row, line = filled[0] + 1, lines[filled[0]]
    names = [name.strip() for name in split(path, row, line)]
    if len(names) == 1 and len(names[0].split()) > 2 and is_number(lines[filled[-1]].split()[0]):
        raise InputError(
            f"{path}, row {row}: blanks between the columns; export with commas, or convert with"
            f" sed 's/^ *//; s/  */,/g' {path.name} > converted.csv"
        )
    if len(names) == 1 and any("," in lines[number] for number in filled[1:100]):
        raise InputError(
            f"{path}, row {row}: {quoted(line)} is no row of column names; delete the rows above the header, and others"
            " that hold text"
        )
    if all(is_number(name) for name in names):
        raise InputError(
            f"{path}, row {row}: numbers where the names of the columns belong; put a row such as t,u_x,x,psi first"
        )
    for place, name in enumerate(names):
        if not name:
            raise InputError(f"{path}, row {row}, column {place + 1}: the column has no name; name it or delete it")
        if name in names[:place]:
            raise InputError(
                f"{path}, row {row}, column {name}: the name is there twice, as column"
                f" {names.index(name) + 1} and {place + 1}; rename or delete one"
            )
    return names


def use_commas(path: Path, lines: list[str], filled: list[int]) -> tuple[str, ...]:
    """Rewrites a table with semicolons or tabs, or with decimal commas, as a plain one; returns sentences on that.

    Decimal commas are taken for such only where no number has a point, since `1.234,5` leaves open what each means.

    Raises:
        InputError: points and commas are mixed.
    """
    if not filled:
        return ()
    header = lines[filled[0]]
    separator = next((sign for sign in ";\t" if sign in header and "," not in header), ",")
    body = [lines[number] for number in filled[1:]]
    commas = [row for row in body if re.search(r"\d,\d" if separator != "," else r'"[-+]?\d+,\d+', row)]
    if separator == "," and not commas:
        return ()
    if commas and any(re.search(r"\d\.\d", row) for row in body):
        if separator == ",":
            return ()  # the cell itself is refused
        number = lines.index(commas[0])
        raise InputError(
            f"{path}, row {number + 1}: decimal commas among numbers with points; export with decimal points alone"
        )
    for number in filled:
        line = lines[number]
        if separator == ",":
            line = re.sub(r'"([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)"', r"\1.\2", line)
        else:
            line = (line.replace(",", ".") if number != filled[0] else line).replace(separator, ",")
        lines[number] = line
    names = {";": "semicolons", "\t": "tabs"}
    notes = (f"The columns are separated by {names[separator]}.",) if separator != "," else ()
    return (*notes, "The numbers have decimal commas.") if commas else notes


def split(path: Path, row: int, line: str) -> list[str]:
    try:
        return next(csv.reader([line]))
    except csv.Error as error:
        raise InputError(f"{path}, row {row}: not comma-separated text ({error}); export it again") from None


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python reads 1_000 as a thousand; no logger means that


def parse_fast(body: list[str], width: int) -> np.ndarray | None:
    """Returns the rows as numbers, or None where a row needs a closer look."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            matrix = np.loadtxt(body, delimiter=",", comments=None, quotechar='"', ndmin=2)
    except (ValueError, UserWarning, DeprecationWarning):
        return None
    return matrix if matrix.shape == (len(body), width) else None


def parse_carefully(path: Path, header: list[str], body: list[str], rows: np.ndarray) -> np.ndarray:
    """Returns the rows as numbers, or refuses the first cell that is none or row of another length."""
    matrix = np.empty((len(body), len(header)))
    for index, (row, line) in enumerate(zip(rows.tolist(), body, strict=True)):
        cells = split(path, row, line)
        if len(cells) != len(header):
            hint = "correct or delete the row"
            if len(cells) > len(header):
                hint += "; if its extra commas are decimal commas, export with decimal points"
            raise InputError(f"{path}, row {row}: {len(cells)} cells for {len(header)} columns; {hint}")
        for name, cell in zip(header, cells, strict=True):
            if not is_number(cell):
                raise InputError(f"{path}, row {row}, column {name}: {describe(cell)}")
        matrix[index] = [float(cell) for cell in cells]
    return matrix


def describe(cell: str) -> str:
    if not cell.strip():
        return "the cell is empty; delete the row, since a gap is a missing row"
    if DECIMAL_COMMA.fullmatch(cell.strip()):
        return f"{quoted(cell)} has a decimal comma; export with decimal points"
    return f"{quoted(cell)} is text, not a number; correct or delete the row"


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
