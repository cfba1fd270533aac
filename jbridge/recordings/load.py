"""Reads recordings: columns become channels in SI units, and everything that cannot be right is refused."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jbridge._display import Displayed
from jbridge.errors import InputError
from jbridge.recordings.channels import Channels, in_nearest_turn, pick_columns, read_channels
from jbridge.recordings.dropouts import lost_together
from jbridge.recordings.hold import Hold, declared_hold, detect_hold, fresh_rows
from jbridge.recordings.notes import describe, held_note, lost_notes
from jbridge.recordings.parts import Parts, find_parts
from jbridge.recordings.plausibility.gains import check_gains, check_units
from jbridge.recordings.plausibility.inputs import stale_notes, unlogged_inputs
from jbridge.recordings.plausibility.lengths import doubtful_length
from jbridge.recordings.plausibility.names import doubtful_channels, doubts_without_time
from jbridge.recordings.plausibility.sensors import HANGS, doubtful_silence, sensor_notes
from jbridge.recordings.plausibility.signs import doubtful_signs, signs_of
from jbridge.recordings.plausibility.units import doubtful_angle, doubtful_units
from jbridge.recordings.plausibility.zeros import zero_notes
from jbridge.recordings.recording import INPUTS, MEASURED, Commands, Recording
from jbridge.recordings.resolution import estimate_resolution
from jbridge.recordings.sidecar import Sidecar, find_sidecar
from jbridge.recordings.tables.columns import Column
from jbridge.recordings.tables.csv_table import read_csv
from jbridge.recordings.tables.mat_table import read_mat
from jbridge.recordings.tables.table import Table

PathLike = str | os.PathLike[str]


def load_recording(
    path: PathLike, *, inputs_only: bool = False, sidecar: PathLike | None = None, force: bool = False
) -> Recording:
    """Returns the recording in a CSV or .mat file, with what its sidecar declares.

    Args:
        path: The file; its sidecar is `NAME.toml` beside it, or a table in the folder's `recordings.toml`.
        inputs_only: Whether measured channels may be absent, as in the input of a simulation.
        sidecar: A sidecar elsewhere, of either form, for a recording in a folder that is not one's own.
        force: Whether to take what is plainly in another unit, of another sign or called otherwise.

    Raises:
        InputError: on whatever cannot be a recording: one line with file, row, column and what to do.
    """
    return read(path, inputs_only, sidecar, ignore if force else refuse).recording


def load_recordings(
    paths: Sequence[PathLike],
    *,
    sidecar: PathLike | None = None,
    force: bool = False,
) -> tuple[Recording, ...]:
    """Returns several recordings of one rig, checked against each other.

    A channel at rest does not show whether its sensor is slower than the log. Where the other recordings
    agree that it is, it is taken to be so here, too. An angle whose zero is not the same in all recordings is told in
    a note. The arguments are those of `load_recording`.

    Raises:
        InputError: as `load_recording`; also for a file named twice, and for an input in two units.
    """
    check_named_once(paths)
    readings = [read(path, False, sidecar, ignore if force else refuse) for path in paths]
    recordings = [reading.recording for reading in readings]
    check_units(paths, recordings)
    if not force:
        check_gains(paths, recordings)
    return tuple(beside_others(readings, [False] * len(readings)))


def check_named_once(paths: Sequence[PathLike]) -> None:
    """Raises an InputError for a file that is named twice."""
    seen: set[Path] = set()
    for path in paths:
        resolved = Path(path).resolve()
        if resolved in seen:
            raise InputError(f"{path}: the recording is named twice; name it once")
        seen.add(resolved)


def constant_inputs(recordings: Sequence[Recording]) -> set[str]:
    """Returns the inputs (`u_x`, `u_l`) that some recording has and that change in none of them."""
    found = set()
    for name in INPUTS:
        inputs = [values for recording in recordings if (values := getattr(recording, name)) is not None]
        if inputs and all(np.ptp(values) == 0 for values in inputs):
            found.add(name)
    return found


@dataclass(frozen=True, repr=False)
class Inspection(Displayed):
    """What a file was read as, and everything that is wrong with it."""

    path: str
    """The file, as the caller named it."""
    recording: Recording | None
    """None where nothing could be read."""
    columns: Mapping[str, Column]
    """The column of each channel, with unit and sign."""
    signs: Mapping[str, bool | None]
    """By `psi`, `u_x`, `u_l`: whether the sign fits the laws of motion; None where the recording does not tell."""
    problems: tuple[str, ...]
    """Each a line with what mends it; the first one is what other commands refuse the file with."""
    refusal: str = ""
    """Why nothing could be read, whatever is forced; empty where something was."""


def inspect_recordings(paths: Sequence[PathLike]) -> tuple[Inspection, ...]:
    """Returns what each file is read as, with all that is doubtful about it, and refuses nothing.

    What several recordings contradict each other in is the problem of the last one.
    """
    readings: list[Reading | None] = []
    problems: list[list[InputError]] = [[] for _ in paths]
    refusals: list[str] = []
    for path, doubts in zip(paths, problems, strict=True):
        try:
            readings.append(read(path, False, None, doubts.append))
            refusals.append("")
        except InputError as error:
            readings.append(None)
            refusals.append(str(error))
            # Where something was told before, the refusal is among it or follows from it.
            if not doubts:
                doubts.append(error)
    signs = [
        {} if reading is None or doubts else signs_of(reading.recording)
        for reading, doubts in zip(readings, problems, strict=True)
    ]
    every = [reading for reading in readings if reading is not None]
    names = [path for path, reading in zip(paths, readings, strict=True) if reading is not None]
    recordings = [reading.recording for reading in every]
    for check in (
        lambda: check_named_once(names),
        lambda: check_units(names, recordings),
        lambda: check_gains(names, recordings),
    ):
        try:
            check()
        except InputError as error:
            problems[-1].append(error)
            break
    wrong = [bool(doubts) for reading, doubts in zip(readings, problems, strict=True) if reading is not None]
    compared = dict(zip(map(id, every), beside_others(every, wrong), strict=True))
    return tuple(
        Inspection(
            str(path),
            None if reading is None else compared[id(reading)],
            {} if reading is None else reading.columns,
            sign,
            tuple(map(str, doubts)),
            why,
        )
        for path, reading, sign, doubts, why in zip(paths, readings, signs, problems, refusals, strict=True)
    )


@dataclass(frozen=True)
class Reading:
    """A recording, and what it shows about the rate of each of its sensors."""

    recording: Recording
    holds: dict[str, Hold]
    columns: dict[str, Column]
    """The column that each channel was read from."""


def refuse(doubt: InputError) -> None:
    """Refuses a recording at the first doubt."""
    raise doubt


def ignore(doubt: InputError) -> None:
    """Takes a recording whatever is doubtful about it."""


def read(path: PathLike, inputs_only: bool, sidecar: PathLike | None, tell: Callable[[InputError], None]) -> Reading:
    """Returns a recording; `tell` receives what is implausible about it, and may raise that."""
    path = Path(path)
    table = read_table(path)
    declared = find_sidecar(path, None if sidecar is None else Path(sidecar))
    return make_reading(path, table, declared, inputs_only, tell)


def make_reading(
    path: Path, table: Table, declared: Sidecar, inputs_only: bool, tell: Callable[[InputError], None]
) -> Reading:
    """Returns the recording in a table of columns, checked; `path` gives its name, and may stand for arrays."""
    columns = pick_columns(path, table, declared)
    if "t" not in columns:
        doubts = doubts_without_time(path, table, declared, columns, inputs_only)
        for doubt in doubts:
            tell(doubt)
        raise doubts[0]
    channels = read_channels(path, table, declared, columns)
    for doubt in doubtful_channels(channels, declared, inputs_only):
        tell(doubt)
    parts = find_parts(channels, declared, inputs_only)
    times = channels.values["t"]
    of_units = [*doubtful_units(channels), *doubtful_length(channels, parts.locked_length)]
    of_units += [*doubtful_angle(channels, parts.locked_length), *doubtful_silence(channels)]
    for doubt in of_units:
        tell(doubt)
    channels = channels if of_units else in_nearest_turn(channels)
    values = channels.values
    measured = {name: values[name] for name in MEASURED if name in values}
    resolution = {
        name: declared.resolution[name] if name in declared.resolution else estimate_resolution(samples)
        for name, samples in measured.items()
    }
    holds = {
        name: declared_hold(times, samples, resolution[name], declared.hold[name])
        if name in declared.hold
        else detect_hold(times, samples, resolution[name])
        for name, samples in measured.items()
    }
    fresh = {name: fresh_rows(times, measured[name], hold) for name, hold in holds.items()}
    quick = {name: measured[name] for name, hold in holds.items() if not hold.held and name not in declared.hold}
    lost = lost_together(times, quick, resolution)
    fresh |= {name: ~rows for name, rows in lost.items()}
    samples = {name: (times[rows], measured[name][rows]) for name, rows in fresh.items()}
    if not of_units:
        length = parts.locked_length
        for doubt in (*doubtful_signs(channels, samples, length), *unlogged_inputs(channels, samples, length)):
            tell(doubt)
    arrays: dict[str, Any] = {
        name: read_only(values[name]) if name in values and name not in parts.unused else None
        for name in (*INPUTS, *MEASURED)
    }
    before = channels.earlier
    recording = Recording(
        name=path.name,
        times=read_only(times),
        fresh={name: read_only(rows) for name, rows in fresh.items()},
        resolution=resolution,
        units={name: unit for name, unit in channels.units.items() if name not in parts.unused},
        locked_length=parts.locked_length,
        override=channels.gains | dict(declared.override),
        initial=dict(declared.initial),
        extras={name: read_only(column) for name, column in all_extras(channels, parts).items()},
        notes=(
            *channels.notes,
            *parts.notes,
            *describe(channels, declared, resolution, holds),
            *lost_notes(times, lost),
            *([] if of_units else sensor_notes(channels, samples, resolution, holds, parts.locked_length)),
            *stale_notes(channels, samples, resolution),
        ),
        earlier=Commands(
            read_only(before["t"]),
            *(read_only(before[name]) if arrays[name] is not None else None for name in INPUTS),
        )
        if before["t"].size
        else None,
        **arrays,
    )
    return Reading(recording, holds, channels.columns)


def read_table(path: Path) -> Table:
    """Returns the columns of a file, or refuses what is no file that can be read."""
    if path.suffix.lower() == ".toml":
        raise InputError(f"{path}: a TOML file, not a recording; name the .csv or .mat that it belongs to")
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the name and the folder") from None
    except IsADirectoryError:
        raise InputError(f"{path}: a folder, not a recording; name its files, such as {path / '*.csv'}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the file's permissions") from None
    return (read_mat if path.suffix.lower() == ".mat" else read_csv)(path, content)


def read_only(values: np.ndarray) -> np.ndarray:
    values = np.ascontiguousarray(values)
    values.setflags(write=False)
    return values


def all_extras(channels: Channels, parts: Parts) -> dict[str, np.ndarray]:
    return channels.extras | {name: channels.values[name] for name in parts.unused}


def beside_others(readings: Sequence[Reading], wrong: Sequence[bool]) -> list[Recording]:
    """Returns the recordings of one rig, each with the rate of its sensors and a note on its angle's zero as they are
    told by all; angles in files that are read wrongly tell nothing."""
    recordings = [share_holds(reading, readings) for reading in readings]
    columns = [{} if doubted else each.columns for each, doubted in zip(readings, wrong, strict=True)]
    for i, note in zero_notes(recordings, columns).items():
        others = (each for each in recordings[i].notes if not each.startswith(HANGS))
        recordings[i] = replace(recordings[i], notes=(*others, note))
    return recordings


def share_holds(reading: Reading, readings: Sequence[Reading]) -> Recording:
    """Returns the recording, its undecided channels taken as held where all that decide say so."""
    recording = reading.recording
    for name, hold in reading.holds.items():
        decided = [other.holds[name] for other in readings if name in other.holds]
        decided = [other for other in decided if other.held is not None]
        if hold.held is not None or not decided or not all(other.held for other in decided):
            continue
        periods = [other.period for other in decided if other.period > 0]
        shared = Hold(True, float(np.median(periods)) if periods else 0.0)
        values = getattr(recording, name)
        fresh = read_only(fresh_rows(recording.times, values, shared))
        note = held_note(name, shared, "as in the other recordings")
        recording = replace(recording, fresh=recording.fresh | {name: fresh}, notes=(*recording.notes, note))
    return recording
