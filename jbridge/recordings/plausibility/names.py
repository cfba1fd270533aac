"""Channels that are missing, and columns that are nearly called like them."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from jbridge.errors import InputError, cut, listed, quoted
from jbridge.recordings.channels import Channels, near_columns
from jbridge.recordings.checks import in_unit_of_log
from jbridge.recordings.parts import contradictions
from jbridge.recordings.plausibility.inputs import shared_columns
from jbridge.recordings.plausibility.refusals import FORCE
from jbridge.recordings.sidecar import Sidecar
from jbridge.recordings.tables.columns import CHANNELS, Column, near_column, plain_column, unit_in
from jbridge.recordings.tables.table import Table


def doubtful_channels(channels: Channels, declared: Sidecar, inputs_only: bool) -> list[InputError]:
    """Returns all refusals of channels that are missing, or that contradict each other.

    What is nearly called like a channel counts as this channel for the others.
    """
    locked = declared.locked is not None
    told = dict(doubtful_names(channels, locked))
    told |= {} if inputs_only else dict(doubtful_absence(channels, locked))
    others = contradictions(channels, declared, inputs_only, frozenset(told))
    return [*told.values(), *shared_columns(channels), *others]


def doubts_without_time(
    path: Path, table: Table, declared: Sidecar, columns: dict[str, Column], inputs_only: bool
) -> list[InputError]:
    """Returns the refusals of a file without a time: of this first, then of other channels that are missing.

    The numbers in its columns are not checked.
    """
    names = [*table.columns, *table.faulty]
    meant = near_column("t", names, table.told)
    refusal = no_time(path, table, declared, meant)
    if not table.columns:
        return [refusal]
    left_out = frozenset(channel for channel in CHANNELS if declared.column(channel) is None)
    used = {column.name for column in (*columns.values(), *([meant] if meant else []))} | left_out
    others = [name for name in names if name not in used]
    # Any of the others may be the time where none is called so.
    extras = {name: table.columns[name] for name in others if name in table.columns and meant is not None}
    channels = Channels(
        table=table,
        columns=columns,
        rows=np.arange(max(values.size for values in table.columns.values())),
        values={channel: column.convert(table.columns[column.name], channel) for channel, column in columns.items()},
        earlier={},
        extras=extras,
        notes=(),
        near=near_columns(table, {"t", *columns, *left_out}, others),
        left_out=left_out,
        declared=declared,
    )
    return [refusal, *doubtful_channels(channels, declared, inputs_only)]


def no_time(path: Path, table: Table, declared: Sidecar, meant: Column | None) -> InputError:
    """Returns the refusal of a file without a column of the time, with the columns that it has instead.

    Args:
        path: of the file.
        table: of its columns.
        declared: about it.
        meant: the column that is probably the time.
    """
    names = [*table.columns, *table.faulty]
    if names:
        meant = meant or only_rising(table)
        if meant is not None and meant.name in table.columns and meant.name not in table.clocks:
            meant = in_unit_of_log(meant, table.columns[meant.name])
        line = 't = {column = "...", unit = "s"}' if meant is None else meant.line("t")
        found, place = listed(map(quoted, names)), declared.place(path, key="t")
        remedy = f"rename one, or declare {line} under {place}"
        return InputError(f"{table.header}: no column t for the time; the columns are {found}; {remedy}")
    held = (
        ", ".join(f"{cut(name)} is {what}" for name, what in list(table.unusable.items())[:3]) or "there is no variable"
    )
    return InputError(
        f"{table.header}: no column t for the time; {held}; save each signal as a vector, in MATLAB t = data(1, :);"
        f" x = data(2, :); save('{path.stem}_v7.mat', 't', 'x', '-v7')"
    )


def only_rising(table: Table) -> Column | None:
    """Returns the only column that rises in every row, as a time in seconds; a channel, and what counts the rows, is
    none."""
    others = {name: raw for name, raw in table.columns.items() if name not in CHANNELS and raw.size > 1}
    rising = [name for name, raw in others.items() if np.all(np.diff(raw) > 0) and np.any(np.diff(raw) != 1.0)]
    return Column(rising[0], unit_in(rising[0], "t")[0] or "s") if len(rising) == 1 else None


def doubtful_names(channels: Channels, locked: bool) -> Iterator[tuple[str, InputError]]:
    """Yields the channels that are missing and needed, and the refusals of columns that are nearly called so.

    Args:
        channels: of the recording.
        locked: whether the rope's length is declared.
    """
    there, near = channels.values.keys(), channels.near.keys()
    # Where an axis lacks its partner the recording is refused in any case.
    needed = (
        {"x", "psi"} | ({"u_x"} if "x" in near else set()) | ({"l"} if not locked and "u_l" not in there else set())
    )
    for channel, column in channels.near.items():
        if channel in needed:
            yield (
                channel,
                InputError(
                    f"{channels.table.header}, column {cut(column.name)}: not used, and there is no {channel}; declare"
                    f" {column.line(channel)} under {channels.place(channel)}, or {channel} = false if it is something"
                    f" else{FORCE}"
                ),
            )


def doubtful_absence(channels: Channels, locked: bool) -> Iterator[tuple[str, InputError]]:
    """Yields cart or swing where it is missing though other declarations speak of it, and the refusal that names the
    columns that may be it.

    Args:
        channels: of the recording.
        locked: whether the rope's length is declared.
    """
    values, others = channels.values, listed(map(cut, channels.extras))
    driven = "u_x" in values and np.ptp(values["u_x"]) > 0
    for channel, there, why in (
        ("x", driven, "u_x varies, but there is no x that it moves"),
        ("psi", locked and "x" in values, "the rope is declared locked, but there is no psi"),
    ):
        known = values.keys() | channels.near.keys() | channels.left_out
        if there and channel not in known and channels.extras:
            name = next(iter(channels.extras))
            line = Column(name, unit_in(name, channel)[0] or plain_column(channel).unit).line(channel)
            yield (
                channel,
                InputError(
                    f"{channels.table.header}: {why}; if it is one of the columns not used, {others}, declare it, such"
                    f" as {line}, under {channels.place(channel)}, otherwise {channel} = false{FORCE}"
                ),
            )
