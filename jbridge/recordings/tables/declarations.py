"""Takes values out of the tables of a sidecar, and what they declare about columns."""

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import isfinite

from jbridge.errors import InputError, quoted
from jbridge.recordings.recording import INPUTS
from jbridge.recordings.tables.columns import CHANNELS, UNITS, Column, plain_column


@dataclass(frozen=True)
class Where:
    """A place in a TOML file; takes values out of its table and refuses what does not fit."""

    place: str
    lines: str = ""
    """Where lines of its tables belong, as `Sidecar.lines` has it."""

    def error(self, problem: str) -> InputError:
        return InputError(f"{self.place}: {problem}")

    def within(self, section: str) -> "Where":
        return Where(f"{self.place}, [{section}]")

    def check_keys(self, table: Mapping[str, object], known: tuple[str, ...]) -> None:
        for key in table:
            if key not in known:
                close = get_close_matches(key, known, 1)
                hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(known)}"
                raise self.error(f"unknown key {quoted(key)}; {hint}")

    def table(self, parent: Mapping[str, object], key: str) -> dict[str, object]:
        value = parent.get(key, {})
        if not isinstance(value, dict):
            raise self.error(f"{key} must be a table, not {quoted(str(value))}; write [{key}]")
        return value

    def number(
        self, table: Mapping[str, object], key: str, *, positive: bool = False, not_negative: bool = False
    ) -> float:
        value = table[key]
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.error(f"{key} must be a number, not {quoted(str(value))}")
        if abs(value) > sys.float_info.max or not isfinite(value) or (positive and value <= 0):
            raise self.error(
                f"{key} must be {'above 0' if positive and value <= 0 else 'finite'}, not {quoted(str(value))}"
            )
        if not_negative and value < 0:
            raise self.error(f"{key} must not be negative, as {quoted(str(value))} is")
        return float(value)

    def numbers(
        self,
        table: Mapping[str, object],
        known: tuple[str, ...],
        *,
        positive: tuple[str, ...] = (),
        not_negative: tuple[str, ...] = (),
    ) -> dict[str, float]:
        self.check_keys(table, known)
        return {
            key: self.number(table, key, positive=key in positive, not_negative=key in not_negative) for key in table
        }


def parse_columns(where: Where, table: Mapping[str, object]) -> Iterator[tuple[str, Column | None]]:
    where.check_keys(table, CHANNELS)
    for channel, value in table.items():
        if isinstance(value, str):
            yield channel, Column(value, plain_column(channel).unit)
        elif isinstance(value, dict):
            yield channel, parse_column(Where(f"{where.place}, {channel}"), channel, value)
        elif value is False and channel != "t":
            yield channel, None
        else:
            raise where.error(
                f"{channel} must be a column's name, a table such as"
                f' {{column = "...", unit = "..."}}, or false; not {quoted(str(value))}'
            )


def parse_column(where: Where, channel: str, table: Mapping[str, object]) -> Column:
    """Returns how a channel's column is read, from a table such as `{column = "theta", unit = "deg"}`."""
    where.check_keys(table, ("column", "unit", "sign", "offset", "scale", "radius", "late"))
    name = table.get("column", channel)
    if not isinstance(name, str):
        raise where.error(f"column must be a column's name, not {quoted(str(name))}")
    scaled = "scale" in table
    unit = table.get("unit", "count" if scaled else plain_column(channel).unit)
    known = (*UNITS[channel], "count") if scaled else tuple(UNITS[channel])
    if scaled and channel in INPUTS:
        raise where.error("an input takes no scale; give its unit (V, A, %, count, N or N m), and its gain carries it")
    if scaled and unit != "count":
        raise where.error(f'scale is the size of one count: write unit = "count", not {quoted(str(unit))}')
    if unit == "count" and not scaled and channel not in INPUTS:
        raise where.error("unit count needs the size of one count in SI units, such as scale = 5.5e-5")
    if not isinstance(unit, str) or unit not in known:
        raise where.error(f"unknown unit {quoted(str(unit))}; known for {channel} are {', '.join(known)}")
    if "radius" in table and unit != "N m":
        raise where.error('radius is that of the pulley on which a torque acts: write unit = "N m", or leave it out')
    sign = where.number(table, "sign") if "sign" in table else 1.0
    if sign not in (1.0, -1.0):
        raise where.error(f"sign must be 1 or -1, not {sign:g}; a factor belongs into the unit or into scale")
    if "late" in table and channel not in INPUTS:
        raise where.error(
            "late is for inputs (u_x, u_l) only; a sensor that lags is the effect sensor_delay of the model"
        )
    late = where.number(table, "late") if "late" in table else 0.0
    if late % 1:
        raise where.error(f"late must be a whole number of rows, not {late:g}; a delay in s is the effect input_delay")
    return Column(
        name,
        unit,
        sign,
        where.number(table, "offset") if "offset" in table else 0.0,
        where.number(table, "scale", positive=True) if scaled else None,
        where.number(table, "radius", positive=True) if "radius" in table else None,
        int(late),
    )
