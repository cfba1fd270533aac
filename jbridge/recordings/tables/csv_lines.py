"""Rewrites the lines of a log or of a spreadsheet's export as those of a plain comma-separated table.

Lines are blanked rather than removed, so that each keeps its number, and every rewriting is reported in a sentence.
"""

import csv
import re
from pathlib import Path

from jbridge.errors import InputError, quoted
from jbridge.recordings.tables.columns import SPELLINGS, UNITS

STAMP = re.compile(r"\s*\d{1,2}:\d\d:\d\d(?:\.\d+)? -> ")
"""What a serial monitor that shows times puts before each line."""
COMMENT = re.compile(r"\s*(?:[#%]|//)")
"""Start of a line of comment, and of what a spreadsheet writes for an error in a formula."""
SEMICOLON = re.compile(r"\s*;")
"""Start of a line of comment, too, where semicolons do not separate columns."""
UNIT_OF = re.compile(r"(?:[#%;]+|//)?\s*([^\s:=,;\[(]+)\s*(?:[:=]|(?=[\[(]))\s*([\[(]?[^\s\])]+[\])]?)")
"""A column's name and its unit."""
WITH_COMMA = re.compile(r"[\d:]+(?:,\d+)+(?:[eE][-+]?\d+)?")
"""A number, or a time of day, with decimal comma or separators of thousands."""
THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")
NAMES = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
"""Separators other than commas."""
NO_UNIT = {"-", "1", ""}
"""What stands in a row of units where a column has none."""
KNOWN_UNITS = {*SPELLINGS, *(unit for units in UNITS.values() for unit in units), *NO_UNIT}
ROWS = 3
"""Lines in sequence that begin with a number, from which on they are rows."""


def to_plain_table(path: Path, lines: list[str]) -> tuple[str, ...]:
    """Rewrites the lines of a file, in place, as those of a comma-separated table; returns sentences on what was done.

    Raises:
        InputError: decimal commas and decimal points are mixed.
    """
    if re.fullmatch(r'"?sep=[;,\t|]"?', lines[0].strip(" ")):
        lines[0] = ""  # a line that tells spreadsheets the separator
    return (
        *drop_stamps(lines),
        *drop_comments(lines),
        *drop_titles(lines),
        *use_commas(path, lines),
        *drop_empty_column(lines),
        *merge_units(lines),
    )


def told_units(lines: list[str]) -> dict[str, str]:
    """Returns the units that lines above the header give, such as `# angle: rad`, by name."""
    found = {}
    for line in lines:
        if starts_with_number(line):
            break
        match = UNIT_OF.fullmatch(line.strip())
        if match and (units := units_in([match[2]])):
            found[match[1]] = units[0]
    return found


def filled_lines(lines: list[str]) -> list[int]:
    """Returns the indices of the lines that are not blank."""
    return [number for number, line in enumerate(lines) if line.strip()]


def drop_stamps(lines: list[str]) -> tuple[str, ...]:
    """Removes the time of day that a serial monitor writes before each line."""
    filled = filled_lines(lines)
    if not filled or not all(STAMP.match(lines[number]) for number in filled):
        return ()
    for number in filled:
        lines[number] = STAMP.sub("", lines[number], count=1)
    return ("The serial monitor's time of day before each line is left out.",)


def drop_comments(lines: list[str]) -> tuple[str, ...]:
    """Blanks lines of comment; the last one before a table without header names its columns, if there is one.

    Below the header, what has as many cells as it is a row, be it that it begins with an error such as `#N/A`.
    """
    filled = filled_lines(lines)
    comments = [number for number in filled if COMMENT.match(lines[number])]
    behind = [number for number in filled if SEMICOLON.match(lines[number])]
    others = set(filled).difference(comments, behind)
    if others and not any(";" in lines[number] for number in others):
        comments = sorted([*comments, *behind])
    if not comments:
        return ()
    marked = set(comments)
    rest = [number for number in filled if number not in marked]
    first = rest[0] if rest else len(lines)
    before = [number for number in comments if number < first]
    if before and rest and starts_with_number(lines[first]):
        first = before.pop()
        lines[first] = re.sub(r"^\s*(?:[#%]+|//+|;+)\s*", "", lines[first])
        rest.insert(0, first)
    if rest:
        separator = separator_of(lines[first], [lines[number] for number in rest[1:]])
        width = len(cells_of(lines[first], separator))
        below = [number for number in comments if number > first]
        before += [
            number
            for number in below
            if number in behind or width == 1 or len(cells_of(lines[number], separator)) != width
        ]
    for number in before:
        lines[number] = ""
    if not before:
        return ()
    many = "line" if len(before) == 1 else "lines"
    return (f"{len(before)} {many} of comment, row {before[0] + 1} the first, are left out.",)


def drop_titles(lines: list[str]) -> tuple[str, ...]:
    """Blanks lines of text above the header, which is the one of them that has as many cells as the rows below it.

    Where two of them have, and the lower one is no row of units, it is open which one names the columns.
    """
    filled = filled_lines(lines)
    numbers = [starts_with_number(lines[number]) for number in filled]
    first = next((k for k in range(len(filled)) if all(numbers[k : k + ROWS])), 0)
    text, rows = filled[:first], [lines[number] for number in filled[first : first + 100]]
    fitting = []
    for number in text:
        separator = separator_of(lines[number], rows)
        names, cells = cells_of(lines[number], separator), cells_of(rows[0], separator)
        closed = len(cells) == len(names) + 1 and not cells[-1]  # each row ends with a separator
        if len(names) > 1 and (len(names) == len(cells) or closed) and not any(map(is_number, names)):
            fitting.append((number, names))
    if len(fitting) == 2 and fitting[1][0] == text[-1] and units_in(fitting[1][1]):
        fitting.pop()
    if len(fitting) != 1 or fitting[0][0] == text[0]:
        return ()
    above = [number for number in text if number < fitting[0][0]]
    title = quoted(lines[above[0]].strip())
    for number in above:
        lines[number] = ""
    many = "line" if len(above) == 1 else "lines"
    return (f"{len(above)} {many} of text above the header, {title} the first, are left out.",)


def cells_of(line: str, separator: str) -> list[str]:
    """Returns the cells of a line; what is no separated text is one."""
    try:
        return next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return [line]


def starts_with_number(line: str) -> bool:
    return bool(re.match(r'\s*"?[-+]?(?:\d|\.\d)', line))


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python reads 1_000 as a thousand; no logger means that


def use_commas(path: Path, lines: list[str]) -> tuple[str, ...]:
    """Puts commas in the place of other separators, and points in that of decimal commas.

    Decimal commas are taken for such only where no number has a point, since `1.234,5` leaves open what each means,
    and where they cannot all be separators of thousands, as in `1,600`.

    Raises:
        InputError: points and commas are mixed, or it is open what a comma means.
    """
    filled = filled_lines(lines)
    if not filled:
        return ()
    header, body = lines[filled[0]], [lines[number] for number in filled[1:]]
    separator = separator_of(header, body)
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
    if commas:
        refuse_thousands(path, lines, header, separator, commas)
    for number in filled:
        line = lines[number]
        if separator == ",":
            line = re.sub(r'"([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)"', r"\1.\2", line)
        else:
            line = line.replace(",", ".") if number != filled[0] else line
            line = ",".join(line.split()) if separator == " " else line.replace(separator, ",")
        lines[number] = line
    notes = (f"The columns are separated by {NAMES[separator]}.",) if separator != "," else ()
    return (*notes, "The numbers have decimal commas.") if commas else notes


def refuse_thousands(path: Path, lines: list[str], header: str, separator: str, commas: list[str]) -> None:
    """Raises the InputError for the first of a file's numbers with commas if each may have separators of thousands."""
    names, rows = cells_of(header, separator), (cells_of(line, separator) for line in commas)
    if all(THOUSANDS.fullmatch(number) for row in rows for cell in row for number in WITH_COMMA.findall(cell)):
        cells = cells_of(commas[0], separator)
        place = next((place for place, cell in enumerate(cells) if WITH_COMMA.search(cell)), 0)
        raise InputError(
            f"{path}, row {lines.index(commas[0]) + 1}, column {names[place] if place < len(names) else place + 1}:"
            f" {quoted(cells[place])} has a decimal comma or one between thousands, which the file leaves open; export"
            " without separators of thousands and with decimal points"
        )


def separator_of(header: str, body: list[str]) -> str:
    """Returns what separates the columns: blanks only where nothing else can, and where they give equal rows."""
    if "," in header:
        return ","
    for separator in ";\t|":
        if separator in header:
            return separator
    width = len(header.split())
    blanks = width > 1 and body and all(len(row.split()) == width for row in (body[0], body[len(body) // 2]))
    return " " if blanks and starts_with_number(body[0]) else ","


def drop_empty_column(lines: list[str]) -> tuple[str, ...]:
    """Removes the separator with which a logger ends each row."""
    filled = filled_lines(lines)
    if len(filled) < 2:
        return ()
    header, *body = (lines[number].rstrip() for number in filled)
    # The last row of a log may be cut.
    if not all(row.endswith(",") for row in body[: max(1, len(body) - 1)]):
        return ()
    names, cells = (len(cells_of(line, ",")) for line in (header, body[0]))
    if cells < names or (cells == names and not header.endswith(",")):
        return ()  # in the latter case a column that has a name, and is empty
    for number in filled:
        lines[number] = lines[number].rstrip().removesuffix(",")
    return ("Each row ends with a separator, which is left out.",)


def merge_units(lines: list[str]) -> tuple[str, ...]:
    """Puts a row of units below the names of the columns into brackets behind them."""
    filled = filled_lines(lines)
    if len(filled) < 2:
        return ()
    names, cells = (lines[number].split(",") for number in filled[:2])
    units = units_in(cells)
    if len(names) != len(units):
        return ()
    named = [
        f"{name.strip().strip(chr(34))} [{unit}]" if unit not in NO_UNIT else name
        for name, unit in zip(names, units, strict=True)
    ]
    lines[filled[0]], lines[filled[1]] = ",".join(named), ""
    return (f"Row {filled[1] + 1} is read as the units of the columns.",)


def units_in(cells: list[str]) -> list[str]:
    """Returns the units in a row of units, without their brackets; nothing where a row is none."""
    units = [cell.strip().strip('"').strip("[]()").strip() for cell in cells]
    known = all(unit in KNOWN_UNITS or unit.lower() in KNOWN_UNITS for unit in units)
    return units if known and not NO_UNIT.issuperset(units) else []


def refuse_no_header(path: Path, row: int, line: str) -> InputError:
    """Returns the refusal of text above the header."""
    return InputError(
        f"{path}, row {row}: {quoted(line)} is no row of column names; delete the rows above the header, and others"
        " that hold text"
    )
