"""Turns the columns of a file into channels in SI units, of one length, finite and within bounds."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from jbridge.errors import InputError, cut, listed, quoted
from jbridge.recordings.checks import (
    LARGEST,
    LEAST_SAMPLES,
    check_finite,
    check_length,
    check_size,
    check_times,
    counted_on,
)
from jbridge.recordings.recording import INPUTS
from jbridge.recordings.sidecar import Sidecar
from jbridge.recordings.tables.columns import CHANNELS, GAINS, Column, labelled_columns, near_column, plain_column
from jbridge.recordings.tables.table import Table

TURN = 2 * np.pi


@dataclass(frozen=True, kw_only=True)
class Channels:
    """What a file gives for each channel, and where in the file it stands."""

    table: Table
    columns: dict[str, Column]
    """The column that each channel was read from."""
    rows: np.ndarray
    """The number of each sample here among those of the file, of which some were trimmed or left out."""
    values: dict[str, np.ndarray]
    """Channels in SI units by name, `t` among them."""
    earlier: dict[str, np.ndarray]
    """Time and inputs of the rows that were trimmed off just before, as far back as they are numbers."""
    extras: dict[str, np.ndarray]
    """Columns that are no channel, as they are."""
    notes: tuple[str, ...]
    near: dict[str, Column] = field(default_factory=dict)
    """Columns that are probably meant for a channel that was not found, by their names."""
    left_out: frozenset[str] = frozenset()
    """Channels that the sidecar declares to be absent."""
    declared: Sidecar = field(default_factory=Sidecar)
    """What is declared about the file."""

    def error(self, sample: int, channel: str, problem: str) -> InputError:
        """Returns the refusal of one sample of a channel (or extra column), in the terms of the file."""
        row = self.rows[sample : sample + 1]
        if channel not in self.columns:
            return self.table.error(int(row[0]), channel, problem)
        column = self.columns[channel]
        row = column.logged_in(row, self.table.columns[column.name].size)
        return self.table.error(int(row[0]), column.name, problem)

    def place(self, key: str, section: str = "columns") -> str:
        """Returns where a line about the file belongs: the table and file that say it of a channel, or may."""
        return self.declared.place(Path(self.table.path), section, key)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each input."""
        return {name: self.columns[name].input_unit for name in INPUTS if name in self.columns}

    @property
    def gains(self) -> dict[str, float]:
        """Gains of the drives whose inputs are forces, or torques on a known radius, by the parameter's name."""
        found = {GAINS[name]: self.columns[name].gain for name in INPUTS if name in self.columns}
        return {name: gain for name, gain in found.items() if gain is not None}


def read_channels(path: Path, table: Table, declared: Sidecar, columns: dict[str, Column]) -> Channels:
    """Returns the channels in columns of a file, the time among them, each number checked.

    Raises:
        InputError: naming file, row and column.
    """
    raw = {channel: column.convert(table.columns[column.name], channel) for channel, column in columns.items()}
    raw["t"], counted = counted_on(raw["t"])
    times = raw["t"]
    for channel, values in raw.items():
        if values.size != times.size:
            raise InputError(
                f"{path}, column {cut(columns[channel].name)}: {values.size} values, but {cut(columns['t'].name)} has"
                f" {times.size}; save vectors of one length"
            )
        late = columns[channel].late
        if late and abs(late) >= values.size:
            raise InputError(
                f"{path}, column {cut(columns[channel].name)}: late = {late} rows, of {values.size} that the file has;"
                " declare the rows from a command to the one that logs it, mostly 1"
            )
    used = {column.name for column in columns.values()}
    left_out = frozenset(channel for channel in CHANNELS if declared.column(channel) is None)
    others = {name: values for name, values in table.columns.items() if name not in used | left_out}
    extras = {name: values for name, values in others.items() if values.size == times.size and name not in table.clocks}
    notes = [*table.notes, *filter(None, [counted])]
    if columns["t"].name in table.clocks:
        notes.append(
            f"Column {quoted(columns['t'].name)} has times of day, which are read as seconds from the first row."
        )
    labelled = [name for name in columns if name not in declared.columns and columns[name].name != name]
    if labelled:
        notes.append(f"Units are those of the header: {', '.join(f'{n} in {columns[n].unit}' for n in labelled)}.")
    skipped = [name for name in others if name not in extras and name not in table.clocks]
    if skipped:
        notes.append(f"Vectors that differ from the time in length are left out: {listed(map(quoted, skipped))}.")
    no_numbers = [name for name in table.faulty | table.clocks if name not in used | left_out]
    if no_numbers:
        notes.append(left_out_note(no_numbers))
    near = near_columns(table, {*columns, *left_out}, (*extras, *no_numbers))
    every = np.arange(times.size)
    channels = trim(
        path,
        Channels(
            table=table,
            columns=columns,
            rows=every,
            values=raw,
            earlier={},
            extras=extras,
            notes=tuple(notes),
            near=near,
            left_out=left_out,
            declared=declared,
        ),
    )
    for name, values in channels.values.items():
        check_finite(channels.error, name, values)
        check_size(channels.error, name, values, columns[name])
    unknown = [name for name, values in channels.extras.items() if not np.isfinite(values).all()]
    if unknown:
        channels = replace(
            channels,
            extras={name: values for name, values in channels.extras.items() if name not in unknown},
            notes=(*channels.notes, left_out_note(unknown)),
        )
    if channels.extras:
        note = f"Columns that are no channel are kept but not used: {listed(map(quoted, channels.extras))}."
        channels = replace(channels, notes=(*channels.notes, note))
    if "l" in channels.values:
        check_length(channels.error, channels.values["l"])
    return unwrap(channels)


def left_out_note(names: list[str]) -> str:
    return f"Columns that are no channel and do not hold numbers only are left out: {listed(map(quoted, names))}."


def near_columns(table: Table, known: set[str], names: Iterable[str]) -> dict[str, Column]:
    """Returns the columns, of those called so, that are probably meant for a channel that is not known."""
    unknown = [channel for channel in CHANNELS if channel not in known]
    sizes = {
        name: float(np.max(np.abs(raw), initial=0.0, where=np.isfinite(raw))) for name, raw in table.columns.items()
    }
    return {channel: column for channel in unknown if (column := near_column(channel, names, table.told, sizes))}


def pick_columns(path: Path, table: Table, declared: Sidecar) -> dict[str, Column]:
    """Returns the column of each channel that the file has."""
    columns, faulty = {}, []
    for channel in CHANNELS:
        column = declared.column(channel)
        if column is None:
            continue
        names = [*table.columns, *table.faulty]
        if channel not in declared.columns:
            column = header_column(table, channel, names, declared) or column
        if column.name in table.clocks and channel != "t":
            raise table.clocks[column.name]
        if column.name in table.faulty:
            faulty.append(column.name)
        if column.name in table.columns:
            columns[channel] = column
        elif column.name in table.unusable:
            raise InputError(
                f"{path}, column {cut(column.name)}: {table.unusable[column.name]}, where a vector with a number"
                f" per sample belongs; save it as one, or rename it"
            )
        elif channel in declared.columns and column.name not in table.faulty:
            raise InputError(
                f"{table.header}: no column {cut(column.name)}, which {declared.source} declares for {channel};"
                f" the columns are {listed(map(quoted, table.columns))}"
            )
    for name, error in table.faulty.items():
        if name in faulty:
            raise error
    if "t" in columns and columns["t"].name in table.clocks and (columns["t"].unit, columns["t"].scale) != ("s", None):
        raise InputError(
            f"{table.header}, column {cut(columns['t'].name)}: times of day are read as seconds from the first row;"
            f" declare {replace(plain_column('t'), name=columns['t'].name).line('t')} under"
            f" {declared.place(path, key='t')}"
        )
    return columns


def header_column(table: Table, channel: str, names: list[str], declared: Sidecar) -> Column | None:
    """Returns the column that a header gives a channel by its name, or by name and unit, if there is one.

    Raises:
        InputError: there are two.
    """
    found = [plain_column(channel)] if channel in names else []
    found += labelled_columns(channel, names)
    if len(found) > 1:
        one, other = (quoted(column.name) for column in found[:2])
        raise InputError(
            f"{table.header}: columns {one} and {other} are both {channel}; delete or rename one, or declare"
            f" {found[0].line(channel)} under {declared.place(Path(table.path), key=channel)}"
        )
    return found[0] if found else None


def unwrap(channels: Channels) -> Channels:
    """Returns the channels with the angle of a load that goes over the top made continuous.

    A sensor that starts again at each turn jumps by nearly a turn from one row to the next, which no load
    does, and stays within one turn. Degrees declared as radians do not, so that they are refused and not
    unwrapped.
    """
    psi = channels.values.get("psi")
    if psi is None or np.ptp(psi) > 1.01 * TURN:
        return channels
    jumps = int(np.count_nonzero(np.abs(np.diff(psi)) > 0.9 * TURN))
    if jumps == 0:
        return channels
    note = f"The angle jumps by a turn {jumps} times, where its sensor starts again; the jumps are taken out."
    values = channels.values | {"psi": np.unwrap(psi)}
    return replace(channels, values=values, notes=(*channels.notes, note))


def in_nearest_turn(channels: Channels) -> Channels:
    """Returns the channels with the angle in that of all turns in which it hangs near 0 for the longest time.

    Recordings of one rig then agree, in whichever turn their sensor, or their cut, began.
    """
    psi = channels.values.get("psi")
    hangs = np.zeros(0) if psi is None else np.round(psi[np.cos(psi) > 0] / TURN)
    if psi is None or not hangs.any():
        return channels
    turns, rows = np.unique(hangs, return_counts=True)
    return replace(channels, values=channels.values | {"psi": psi - turns[rows.argmax()] * TURN})


def trim(path: Path, channels: Channels) -> Channels:
    """Returns the rows within the declared times, without those that have the time of the row above.

    Raises:
        InputError: their times do not increase, or they are not enough for a recording.
    """
    times, declared = channels.values["t"], channels.declared
    within = np.flatnonzero((times >= declared.start) & (times <= declared.stop))
    first = 0 if declared.start == -np.inf else int(within[0]) if within.size else times.size
    last = times.size if declared.stop == np.inf else int(within[-1]) + 1 if within.size else first
    inside = replace(channels, rows=channels.rows[first:last])
    check_finite(inside.error, "t", times[first:last])
    check_times(inside.error, times[first:last], channels.columns["t"])
    again = np.concatenate([[False], times[1:] == times[:-1]])
    rows = first + np.flatnonzero(~again[first:last])
    if rows.size < LEAST_SAMPLES:
        if times.size < LEAST_SAMPLES:
            remedy = "record for longer or more often"
        else:
            remedy = f"the file runs from {times[0]:g} to {times[-1]:g} s: widen [trim] in {declared.source}"
        raise InputError(f"{path}: {rows.size} samples, at least {LEAST_SAMPLES} are needed; {remedy}")
    notes = channels.notes
    if last - first < times.size:
        notes = (*notes, f"Of {times.size} rows, {last - first} lie within the declared [trim].")
    if rows.size < last - first:
        row = channels.table.row_numbers[first + again[first:last].argmax()]
        many = "row has" if rows.size == last - first - 1 else "rows have"
        notes = (*notes, f"{last - first - rows.size} {many} the time of the row above, row {row} the first, left out.")
    return replace(
        channels,
        rows=rows,
        values={name: values[rows] for name, values in channels.values.items()},
        earlier=inputs_before(channels, np.flatnonzero(~again[:first])),
        extras={name: values[rows] for name, values in channels.extras.items()},
        notes=notes,
    )


def inputs_before(channels: Channels, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Returns time and inputs of the given rows, back to the last in which something is no number or no input, or at
    which the time falls."""
    found = {name: values[rows] for name, values in channels.values.items() if name in ("t", *INPUTS)}
    good = np.all([np.abs(values) <= LARGEST for values in found.values()], axis=0)
    falls = np.flatnonzero(~(found["t"][1:] > found["t"][:-1]))
    bad = max([-1, *np.flatnonzero(~good)[-1:], *falls[-1:]])
    return {name: values[bad + 1 :] for name, values in found.items()}
