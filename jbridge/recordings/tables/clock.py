"""Reads times of day, and dates with them, as seconds."""

import re
from datetime import UTC, datetime
from math import inf

DAY, HOUR = 86_400.0, 3_600.0
CLOCK = re.compile(r"(?:([01]?\d|2[0-3]):)?([0-5]?\d):([0-5]?\d(?:\.\d+)?)")
"""Hours, minutes and seconds; without hours, as a spreadsheet shows short times, the seconds need a fraction."""
DATED = re.compile(r"\d{4}-\d\d-\d\d[T ]\d{1,2}:\d\d")
LIKE_A_DATE = re.compile(r"\d{1,4}[./-]\d{1,2}[./-]\d{1,4}.*:\d\d.*|\d{1,2}:\d\d.*")
"""What looks like a date with a time, or like a time of day, whether it can be read or not."""


def is_clock(cell: str) -> bool:
    """Says whether a cell is a time of day, `14:03:59.5`, or a date with one, `2024-03-05 14:03:59.5`."""
    match = CLOCK.fullmatch(cell.strip())
    return bool(DATED.match(cell.strip()) or (match and (match[1] or "." in match[3])))


def clock_seconds(cells: list[str]) -> list[float | None]:
    """Returns a column of times as seconds from its first row; None for a cell that is no time as the first one is.

    A time of day that falls back by more than half its circle has passed midnight, or the full hour where no hours are
    given. Dates with an offset from UTC are compared in UTC.

    >>> clock_seconds(["23:59:59.5", "0:00:00.25"])
    [0.0, 0.75]
    """
    circle, first = seconds_of(cells[0].strip()) or (0.0, 0.0)
    read: list[float | None] = []
    before, turns = first, 0.0
    for kind, value in (seconds_of(cell.strip()) or (None, 0.0) for cell in cells):
        if kind != circle:
            read.append(None)
            continue
        turns += circle if value - before < -abs(circle) / 2 else 0.0
        before = value
        read.append(round(value + turns - first, 6))
    return read


def seconds_of(cell: str) -> tuple[float, float] | None:
    """Returns the circle after which a time comes again [s] and its seconds, or None where it is no time.

    A date never comes again: its circle is infinite, and the negative of that where it has an offset from UTC.
    """
    if DATED.match(cell):
        try:
            date = datetime.fromisoformat(cell)
        except ValueError:
            return None
        circle = inf if date.tzinfo is None else -inf
        date = date if date.tzinfo is None else date.astimezone(UTC).replace(tzinfo=None)
        return circle, (date - datetime(2000, 1, 1)).total_seconds()
    match = CLOCK.fullmatch(cell)
    if match is None:
        return None
    return HOUR if match[1] is None else DAY, HOUR * float(match[1] or 0) + 60.0 * float(match[2]) + float(match[3])
