"""What no recording of a bridge can contain, from times that stand still to degrees called radians."""

import json
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from jbridge.errors import InputError
from jbridge.recordings.tables.columns import OF_EXPORTS, UNITS, Column

LARGEST = 1e6
"""Beyond this in SI units nothing on a laboratory rig is measured."""
LEAST_SAMPLES = 50
SHORTEST = 1e-6
"""Time between rows [s] that no log of a rig has: times that differ by less come from arithmetic, not from a clock."""
USUAL = 0.01
"""Time between the rows of a log [s], as far as units are told by it."""
OFTEN = 0.05
"""Share of rows with a wrong time from which the column is at fault, not a few rows."""
FASTEST = 50e-6
"""Time between rows [s] below which the unit of the time is doubted."""
SLOWEST = 0.5
"""Time between rows [s] that leaves less than three samples of a swing on a rope of 0.5 m."""
COUNTERS = tuple(2**bits * tick for bits in (16, 32) for tick in (1e-6, 1e-3))
"""Times [s] after which a microcontroller's counter of microseconds or milliseconds starts again."""
GRAVITY = 9.81
LONGEST = 20.0
"""Way of a cart or length of a rope [m] that no laboratory has, and speed that no cart reaches [m/s]."""
TOO_FAST = 2.0
"""Multiple of what gravity and the cart can give a load, above which its angle cannot be in radians."""
MOST_MOMENTS = 100_000
"""Moments at which the acceleration of an angle is looked at, for recordings of many hours."""

Refuse = Callable[[int, str, str], InputError]
"""Makes the error for a sample of a channel: its index, the channel, what is wrong and what to do."""


def check_finite(refuse: Refuse, name: str, values: np.ndarray) -> None:
    """Raises the InputError for the first NaN or infinite value, if there is one."""
    bad = ~np.isfinite(values)
    if bad.any():
        sample = int(bad.argmax())
        what = "NaN" if np.isnan(values[sample]) else "infinite"
        raise refuse(sample, name, f"the value is {what}; delete the row, since a gap is a missing row")


def check_size(refuse: Refuse, name: str, values: np.ndarray, column: Column) -> None:
    """Raises the InputError for the first value beyond 1e6, if there is one.

    Args:
        refuse: makes the error.
        name: of the channel.
        values: in SI units.
        column: that they were read from.
    """
    bad = np.abs(values) > LARGEST
    if bad.any():
        sample = int(bad.argmax())
        if name == "t":
            line = from_its_start(column, values).line("t")
            remedy = f"count time from the start of the run, in its unit; declare {line} under [columns]"
        else:
            declared = f'{name} = {{column = {json.dumps(column.name, ensure_ascii=False)}, unit = "..."}}'
            remedy = f"correct it, or declare its unit under [columns]: {declared}"
        raise refuse(sample, name, f"{values[sample]:g} in SI units is beyond 1e6; {remedy}")


def from_its_start(column: Column, times: np.ndarray) -> Column:
    """Returns the column of times [s] such that they begin at 0, in the unit whose steps are most like a log's."""
    size = column.size("t")
    offset, step = column.sign * float(times[0]) / size + column.offset, abs(float(np.median(np.diff(times)))) / size
    if column.scale is not None or step == 0.0:
        return replace(column, offset=offset)
    return replace(column, unit=unit_of_log(step) or column.unit, offset=offset)


def check_times(refuse: Refuse, times: np.ndarray, column: Column) -> None:
    """Raises the InputError for the first time that comes before the one above, or less than a microsecond after it.

    Two rows of one time come from a coarse clock; many of them are an error, too.

    Args:
        refuse: makes the error.
        times: of the rows [s].
        column: that they were read from.
    """
    steps = np.diff(times)
    bad = (steps < SHORTEST) & (steps != 0)
    often = why_often(steps, column) if (steps < SHORTEST).any() else ""
    if often:
        raise refuse(int((steps < SHORTEST).argmax()) + 1, "t", often)
    if not bad.any():
        return
    sample, count = int(bad.argmax()) + 1, int(np.count_nonzero(bad))
    now, before = times[sample], times[sample - 1]
    more = f", and so in {count} rows" if count > 1 else ""
    if now > before:
        raise refuse(
            sample,
            "t",
            f"{now - before:.3g} s after the row above, less than a microsecond{more}; delete one of the rows, or"
            ' declare the unit under [columns]: t = {column = "...", unit = "..."}',
        )
    raise refuse(
        sample,
        "t",
        f"time must increase, but {now!s} s comes before that of the row above ({before!s} s){more}; keep one run in a"
        " file, and begin another one with this row",
    )


def counted_on(times: np.ndarray) -> tuple[np.ndarray, str]:
    """Returns times from 0 that count on where a counter of 16 or 32 bits starts again, and a sentence on it.

    Args:
        times: of the rows [s].
    """
    steps = np.diff(times)
    falls = steps < 0
    usual = float(np.median(steps[steps > 0])) if falls.any() and (steps > 0).any() else math.inf
    for period in COUNTERS:
        missing = steps[falls] + period
        if period > 100 * usual and np.all((missing > 0) & (missing < 3 * usual)):
            on = times - times[0] + period * np.concatenate([[0], np.cumsum(falls)])
            return (
                on,
                f"The time starts again after {period:.6g} s, as a counter does; it is counted on from the first row.",
            )
    return times, ""


def unit_of_log(step: float) -> str | None:
    """Returns the unit in which times that are so far apart are likeliest those of a log, if there is one."""
    sizes = {unit: size for unit, size in UNITS["t"].items() if FASTEST <= step * size <= SLOWEST}
    return min(sizes, key=lambda unit: (unit in OF_EXPORTS, abs(np.log(step * sizes[unit] / USUAL))), default=None)


def as_of_log(column: Column, step: float) -> Column | None:
    """Returns the column of a time in the unit that makes the time between its rows [s] that of a log, if one does."""
    if column.scale is not None:
        factors = (f for f in (1e3, 1e6, 1e-3, 1e-6, 1e-9) if FASTEST <= f * step <= SLOWEST)
        return next((replace(column, scale=column.scale * f) for f in factors), None)
    unit = unit_of_log(step / UNITS["t"][column.unit])
    return None if unit is None else replace(column, unit=unit)


def in_unit_of_log(column: Column, raw: np.ndarray) -> Column:
    """Returns the column of a time in the unit in which rows come as often as in a log, where its own makes none.

    Args:
        column: of the time.
        raw: its numbers, as the file has them.
    """
    raw = raw[np.isfinite(raw)]
    step = float(np.median(np.abs(np.diff(raw)))) * UNITS["t"][column.unit] if raw.size > 1 else 0.0
    doubted = 0 < step < FASTEST or step > SLOWEST
    return (as_of_log(column, step) if doubted else None) or column


def why_often(steps: np.ndarray, column: Column) -> str:
    """Returns why times fail to increase in more than one row of twenty, and what to do; nothing if they do not."""
    longer = as_of_log(column, float(np.median(steps)))
    if longer is not None and np.median(steps) < SHORTEST:
        return f"a row every {np.median(steps):.3g} s is no log of a rig; declare {longer.line('t')} under [columns]"
    same, falls = float(np.mean(np.abs(steps) < SHORTEST)), float(np.mean(steps <= -SHORTEST))
    if falls > OFTEN and falls + same == 1:
        return "the time falls from row to row; sort the rows by time"
    if falls > OFTEN:
        return (
            f"it falls in {100 * falls:.0f} % of the rows, so that it is no time; declare the column of the time under"
            ' [columns]: t = {column = "...", unit = "s"}, or sort the rows if this is it'
        )
    if same > OFTEN:
        return (
            f"{100 * same:.0f} % of the rows have the time of the row above; export the time with more digits, or"
            " delete repeated rows"
        )
    return ""


def check_length(refuse: Refuse, length: np.ndarray) -> None:
    """Raises the InputError for the first rope length that is not above 0."""
    bad = length <= 0
    if bad.any():
        sample = int(bad.argmax())
        raise refuse(
            sample,
            "l",
            f"a rope length of {length[sample]:g} m; it runs from the pivot to the load's centre, above 0:"
            ' correct it, or declare the sensor, l = {column = "...", sign = ..., offset = ...}',
        )


def excess_of_angle(times: np.ndarray, psi: np.ndarray, x: np.ndarray | None, length: np.ndarray) -> float:
    """Returns how much faster an angle turns than gravity and the cart can make it; in radians it is at most 2.

    The size of an angle says little: a load that goes over the top turns through many radians. Its
    acceleration says more. Friction aside, a load on a rope has `l psi'' = -g sin(psi) - cos(psi) x''`, never
    more than `g + abs(x'')`, at whatever angle, after however many turns, and wherever the angle's zero is.
    Degrees read as radians exceed this, a swing of 10 degrees by a factor of 10. Second differences over an
    eighth of the swing's period keep noise and counts out of the accelerations. The excess is the multiple of
    the limit that they exceed for half of some swing. Twofold leaves room for a length that is wrong by two and
    lets a swing of less than 3 degrees pass.

    Args:
        times: Times of the rows [s].
        psi: Swing angle, radians as declared.
        x: Cart position [m], if there is a cart.
        length: Rope length [m].
    """
    reach = 2 * np.pi * np.sqrt(np.median(length) / GRAVITY) / 8
    span = times[-1] - times[0]
    if span < 4 * reach or np.median(np.diff(times)) > reach / 2:
        return 0.0
    moments = np.arange(times[0] + reach, times[-1] - reach, max(reach / 2, span / MOST_MOMENTS))
    swing = min(moments.size, max(1, round(8 * reach / (moments[1] - moments[0]))))

    def acceleration(values: np.ndarray) -> np.ndarray:
        before, now, after = (np.interp(moments + shift, times, values) for shift in (-reach, 0.0, reach))
        return np.abs(after - 2 * now + before) / reach**2

    needed = acceleration(psi) * np.interp(moments, times, length)
    limit = GRAVITY + (0.0 if x is None else acceleration(x))
    return float(np.median(sliding_window_view(needed / limit, swing), axis=1).max())
