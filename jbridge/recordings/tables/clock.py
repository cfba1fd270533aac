"""Reads times of day, and dates with them, as seconds."""

import re
from datetime import datetime

DAY, HOUR = 86_400.0, 3_600.0
CLOCK = re.compile(r"(?:(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)")
"""Hours, minutes and seconds; without hours, as a spreadsheet shows short times, the seconds need a fraction."""
DATED = re.compile(r"\d{4}-\d\d-\d\d[T ]\d{1,2}:\d\d")
LIKE_A_DATE = re.compile(r"\d{1,4}[./-]\d{1,2}[./-]\d{1,4}.*:\d\d.*|\d{1,2}:\d\d.*")
"""What looks like a date with a time, or like a time of day, whether it can be read or not."""


def is_clock(cell: str) -> bool:
    """Says whether a cell is a time of day, `14:03:59.5`, or a date with one, `2024-03-05 14:03:59.5`."""
    match = CLOCK.fullmatch(cell.strip())
    return bool(DATED.match(cell.strip()) or (match and (match[1] or "." in match[3])))


def clock_seconds(cells: list[str]) -> list[str]:
    """Returns a column of times as seconds from its first row; a cell that cannot be read stays as it is.

    A time of day that falls back by more than half its circle has passed midnight, or the full hour where no hours are
    given.

    >>> clock_seconds(["23:59:59.5", "0:00:00.25"])
    ['0.0', '0.75']
    """
    seconds = [seconds_of(cell.strip()) for cell in cells]
    first = next((value for value in seconds if value is not None), 0.0)
    circle = DAY if cells[0].count(":") > 1 else HOUR
    read, before, turns = [], first, 0.0
    for cell, value in zip(cells, seconds, strict=True):
        if value is None:
            read.append(cell)
            continue
        if not DATED.match(cell.strip()):
            turns += circle if value - before < -circle / 2 else 0.0
            before = value
        read.append(repr(round(value + turns - first, 6)))
    return read


def seconds_of(cell: str) -> float | None:
    """Returns the seconds of one time, or None where it is none."""
    if DATED.match(cell):
        try:
            date = datetime.fromisoformat(cell)
        except ValueError:
            return None
        return (date.replace(tzinfo=None) - datetime(2000, 1, 1)).total_seconds()
    match = CLOCK.fullmatch(cell)
    if match is None:
        return None
    return HOUR * float(match[1] or 0) + 60.0 * float(match[2]) + float(match[3])
