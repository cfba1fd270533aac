"""What a rig's owner declares beside a recording: in `NAME.toml`, and in the folder's `recordings.toml`.

A folder's file has tables for recordings, under a quoted name or a pattern that several share:

    ["train-1.csv".columns]
    x = {column = "cart_mm", unit = "mm"}

    ["hoist_*.csv".override]
    load_mass = 0.25

What fits a recording is put together, key by key: patterns first, a narrower one after the wider one, then its own
table, then `NAME.toml`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from jbridge._toml import read_tables
from jbridge.errors import InputError, listed, quoted
from jbridge.recordings.recording import MEASURED
from jbridge.recordings.tables.columns import Column, plain_column
from jbridge.recordings.tables.declarations import Where, parse_columns

SECTIONS = ("columns", "hold", "resolution", "override", "trim", "initial", "locked")
FOLDER_FILE = "recordings.toml"
PARAMETERS = (
    "cart_mass",
    "load_mass",
    "winch_mass",
    "gravity",
    "cart_damping",
    "swing_damping",
    "hoist_damping",
    "cart_gain",
    "hoist_gain",
)
"""What `[override]` may set: the parameters under `[bridge]` in a model file."""
POSITIVE = ("cart_mass", "load_mass", "winch_mass", "gravity")
NOT_NEGATIVE = ("cart_damping", "swing_damping", "hoist_damping")


@dataclass(frozen=True, kw_only=True)
class Sidecar:
    """Declarations for one recording; without a file, none."""

    source: str = ""
    """Where they stand: the file and, in a folder's file, the table."""
    lines: str = ""
    """The nearest of these tables, as in `["*.csv".*] in recordings.toml`; nothing without one."""
    places: Mapping[str, str] = field(default_factory=dict)
    """The same of the table that says it, by declared channel."""
    elsewhere: frozenset[tuple[str, str]] = frozenset()
    """Sections and keys in the tables of other recordings of the folder."""
    columns: Mapping[str, Column | None] = field(default_factory=dict)
    """Column of each declared channel; None where the file's column of that name is to be left out."""
    hold: Mapping[str, bool] = field(default_factory=dict)
    """Per channel, whether its sensor is slower than the log."""
    resolution: Mapping[str, float] = field(default_factory=dict)
    """Per channel, the size of one count [m, rad]."""
    override: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the model for this run."""
    initial: Mapping[str, float] = field(default_factory=dict)
    """State at the start of a simulation [m, rad]."""
    locked: float | None = None
    """Length of a locked rope [m]."""
    start: float = float("-inf")
    """Rows before this time are left out [s], by the file's own clock."""
    stop: float = float("inf")
    """Rows after this time are left out [s]."""

    def column(self, channel: str) -> Column | None:
        """Returns the column of a channel: the declared one, else the one of its name in SI units."""
        return self.columns[channel] if channel in self.columns else plain_column(channel)

    def place(self, path: Path, section: str = "columns", key: str = "") -> str:
        """Returns where a line for a recording belongs: into the table that says it, else into the nearest one.

        Times of [trim] are of one recording. Where tables of other recordings say the same of a channel, a table of its
        own contradicts none of them.
        """
        lines = self.places.get(key) if section == "columns" else ""
        pattern = section == "trim" and self.lines.startswith('["')
        if not lines and (pattern or (section, key) in self.elsewhere):
            lines = f'["{path.name}".*] in {FOLDER_FILE}'
        lines = lines or self.lines or f"[*] in {path.with_suffix('.toml').name}"
        before, _, after = lines.rpartition("*] in ")
        return f"{before}{section}] in {after}"

    def over(self, other: "Sidecar") -> "Sidecar":
        """Returns both together; where both declare the same, this one counts."""
        nothing = Sidecar()
        return Sidecar(
            source=" and ".join(filter(None, (other.source, self.source))),
            lines=self.lines or other.lines,
            places={**other.places, **self.places},
            elsewhere=self.elsewhere | other.elsewhere,
            columns={**other.columns, **self.columns},
            hold={**other.hold, **self.hold},
            resolution={**other.resolution, **self.resolution},
            override={**other.override, **self.override},
            initial={**other.initial, **self.initial},
            locked=other.locked if self.locked is None else self.locked,
            start=other.start if self.start == nothing.start else self.start,
            stop=other.stop if self.stop == nothing.stop else self.stop,
        )


def find_sidecar(path: Path, given: Path | None = None) -> Sidecar:
    """Returns what is declared for a recording in the folder's `recordings.toml` and in `NAME.toml` beside it.

    Args:
        path: The recording.
        given: A file to read instead of both, of either form.

    Raises:
        InputError: naming the file and the key.
    """
    own, folder = path.with_suffix(".toml"), path.with_name(FOLDER_FILE)
    beside = [file for file in dict.fromkeys((folder, own)) if file.is_file()]
    found = Sidecar()
    for file in beside if given is None else [given]:
        document = read_tables(file, "sidecar")
        whole = given is not None or file == own
        if whole and not is_folder_file(file, document):
            layers = [(Where(str(file), f"[*] in {file.name}"), document)]
        else:
            layers = tables_for(path, file, document)
            found = Sidecar(elsewhere=said_elsewhere(path, document)).over(found)
        for layer in layers:
            found = parse_sidecar(*layer).over(found)
    return found


def is_folder_file(path: Path, document: Mapping[str, object]) -> bool:
    """Says which of the two forms a file has, where its name leaves that open."""
    named = path.name == FOLDER_FILE or any(key.endswith((".csv", ".mat")) for key in document)
    return named and not document.keys() & set(SECTIONS)


def tables_for(path: Path, file: Path, document: Mapping[str, object]) -> list[tuple[Where, dict[str, object]]]:
    """Returns the tables of a folder's file that fit a recording's name: those of patterns, then its own."""
    for key, value in document.items():
        if key in SECTIONS:
            raise InputError(
                f"{file}: [{key}] stands outside any recording's table; write"
                f' ["{path.name}".{key}], or ["*{path.suffix}".{key}] for all'
            )
        if isinstance(value, dict) and value.keys() <= {"csv", "mat"} and value:
            ending = next(iter(value))
            raise InputError(f'{file}: [{key}.{ending}] needs quotes around the file name: ["{key}.{ending}"]')
    fit = [key for key in document if key != path.name and fnmatchcase(path.name, key)]
    patterns = sorted(fit, key=lambda key: sum(is_narrower(key, other) for other in fit))
    own = [path.name] if path.name in document else []
    fitting = {key: Where(f'{file}, table "{key}"', f'["{key}".*] in {file.name}') for key in (*patterns, *own)}
    tables = {key: where.table(document, key) for key, where in fitting.items()}
    refuse_contradictions(path, file, {key: tables[key] for key in patterns})
    return [(where, tables[key]) for key, where in fitting.items()]


def said_elsewhere(path: Path, document: Mapping[str, object]) -> frozenset[tuple[str, str]]:
    """Returns the sections and keys in those tables of a folder's file that do not fit a recording."""
    others = [table for name, table in document.items() if not fnmatchcase(path.name, name) and name != path.name]
    sections = [item for table in others if isinstance(table, dict) for item in table.items()]
    return frozenset((section, key) for section, said in sections if isinstance(said, dict) for key in said)


def is_narrower(pattern: str, other: str) -> bool:
    """Says whether a pattern fits a part of what another one fits, as `hoist_*.csv` does of `*.csv`.

    What fits a text with stars in it does so, too, with anything in their place, and what fits any letter fits each of
    a set in brackets. Two patterns with a set each are not compared.
    """
    if "[" in other and "[" in pattern:
        return False
    # Letters that no set has stand for a set, and for any letter.
    one, two = (re.sub(r"\[[^]]+\]", "\0", each).replace("?", "\1") for each in (pattern, other))
    return fnmatchcase(one, other) and ("[" in pattern or not fnmatchcase(two, pattern))


def refuse_contradictions(path: Path, file: Path, tables: Mapping[str, Mapping[str, object]]) -> None:
    """Of two patterns, neither is the nearer one, unless one is narrower than the other; they come in this order."""
    said: dict[tuple[str, str], list[str]] = {}
    for pattern, table in tables.items():
        for section, declared in table.items():
            for key in declared if isinstance(declared, dict) else ():
                before = said.setdefault((section, key), [])
                for first in before:
                    if not is_narrower(pattern, first):
                        raise InputError(
                            f"{file}: the tables {listed(map(quoted, (first, pattern)))} both fit {path.name} and both"
                            f' say {section}.{key}; keep one, or say it in ["{path.name}".{section}]'
                        )
                before.append(pattern)


def parse_sidecar(where: Where, document: Mapping[str, object]) -> Sidecar:
    """Returns the declarations of one table; every key must be known and every value of the right kind."""
    where.check_keys(document, SECTIONS)
    tables = {section: (where.within(section), where.table(document, section)) for section in SECTIONS}
    trim_where, trim_table = tables["trim"]
    trim = trim_where.numbers(trim_table, ("start", "stop"))
    start, stop = trim.get("start", float("-inf")), trim.get("stop", float("inf"))
    if start >= stop:
        raise trim_where.error(f"start = {start:g} is not before stop = {stop:g}; give both in seconds of the file")
    locked_where, locked_table = tables["locked"]
    hold_where, hold_table = tables["hold"]
    override_where, override_table = tables["override"]
    initial_where, initial_table = tables["initial"]
    resolution_where, resolution_table = tables["resolution"]
    columns = dict(parse_columns(*tables["columns"]))
    return Sidecar(
        source=where.place,
        lines=where.lines,
        places=dict.fromkeys(columns, where.lines),
        columns=columns,
        hold=parse_flags(hold_where, hold_table),
        resolution=resolution_where.numbers(resolution_table, MEASURED, positive=MEASURED),
        override=override_where.numbers(override_table, PARAMETERS, positive=POSITIVE, not_negative=NOT_NEGATIVE),
        initial=initial_where.numbers(initial_table, MEASURED, positive=("l",)),
        locked=locked_where.numbers(locked_table, ("l",), positive=("l",)).get("l"),
        start=start,
        stop=stop,
    )


def parse_flags(where: Where, table: Mapping[str, object]) -> dict[str, bool]:
    where.check_keys(table, MEASURED)
    flags = {}
    for key, value in table.items():
        if not isinstance(value, bool):
            raise where.error(f"{key} must be true or false, not {quoted(str(value))}")
        flags[key] = value
    return flags
