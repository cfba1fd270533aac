"""`jbridge check`: what recordings are read as, and what they can tell."""

import argparse
import dataclasses
from collections.abc import Sequence
from typing import Any

import jbridge
from jbridge import InputError

from .common import FORCE, OUT, RECORDING, Commands, Console, command

_HELP = """\
Says in seconds how recordings are read: columns, units, sampling, gaps, noise,
resolution and signs; with a model, which of its parameters these recordings
determine.

All problems are listed, each with the line that mends it; the exit status is
then 2, as it would be for the commands that refuse such a recording. DIR
receives check.png (the signals) and check.html (all of it).
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    check = command(commands, "check", "check units, signs and names of recordings, in seconds", _HELP, run)
    check.usage = (
        "jbridge check [-h] [--out DIR] [--force] [--no-cache] [--json | --quiet]\n"
        "                     [MODEL.toml] REC.csv [REC.csv ...]"
    )
    check.epilog = "example:\n  jbridge check model.toml monday-*.csv --out checked"
    check.add_argument("files", metavar="[MODEL.toml] REC.csv", nargs="+", help=f"{RECORDING}; a model may come first")
    check.add_argument("--out", metavar="DIR", help=OUT)
    check.add_argument("--force", action="store_true", help=FORCE)


def run(arguments: argparse.Namespace, console: Console) -> None:
    model_file, *rest = arguments.files
    paths = rest if model_file.lower().endswith(".toml") else arguments.files
    if not paths:
        raise InputError(f"{model_file}: a model without recordings; name at least one, see jbridge check --help")
    if arguments.out:
        jbridge.check_output(arguments.out, folder=True, inputs=arguments.files)
    console("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(model_file) if paths is rest else None
    inspections = jbridge.inspect_recordings(paths)
    problems = [problem for each in inspections for problem in each.problems]
    found, mismatch = None, ""
    if model is not None and (arguments.force or not problems):
        console("linearising")
        recordings = [each.recording for each in inspections if each.recording is not None]
        try:
            found = jbridge.identifiability(model, recordings) if recordings else None
            if not arguments.force:
                jbridge.check_model_gains(model, recordings)
        except InputError as error:
            mismatch = str(error)
    text = jbridge.describe_check(inspections, found, mismatch)
    if arguments.out:
        console("drawing")
        jbridge.save_check(arguments.out, inspections, text)
    console.show(text, lambda: _found(inspections, found, mismatch))
    refused = [*jbridge.shared_problems(inspections, forced=arguments.force), mismatch]
    if any(refused):
        raise InputError(refused[0])


def _found(
    inspections: Sequence["jbridge.Inspection"], told: "jbridge.Identifiability | None", mismatch: str
) -> dict[str, Any]:
    """What was read and what it tells, as JSON has it."""
    recordings = [
        {
            "file": each.path,
            "rows": None if each.recording is None else len(each.recording.times),
            "period": None if each.recording is None else each.recording.period,
            "columns": {channel: dataclasses.asdict(column) for channel, column in each.columns.items()},
            "signs": dict(each.signs),
            "notes": [] if each.recording is None else list(each.recording.notes),
            "problems": list(each.problems),
        }
        for each in inspections
    ]
    out: dict[str, Any] = {"recordings": recordings, "mismatch": mismatch or None}
    if told is not None:
        out["noise"] = dict(told.noise)
        out["parameters"] = {name: dataclasses.asdict(e) for name, e in told.parameters.items()}
        out |= {"estimated": list(told.estimated), "warnings": list(told.warnings)}
    return out
