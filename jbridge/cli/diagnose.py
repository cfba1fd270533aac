"""`jbridge diagnose`: why recordings and simulation differ."""

import argparse
import dataclasses
import math

import jbridge
from jbridge import InputError

from .common import FORCE, Commands, Console, add_recordings, add_workers, command, loaded, written

_HELP = """\
Finds out why recordings and simulation differ: whether the model lacks
anything, where, and what it is.

DIR receives report.html (to look at), report.json (the same in numbers),
model.toml (the model with what was found) and the figures.

Recordings behind --holdout are the proof: no parameter is estimated from them,
and they are opened when the search has ended. Without any, the last quarter of
the recordings is held out. Ctrl-C writes what was found by then, without
a verdict.

Where explanations cannot be told apart, DIR receives next_experiment.csv, an
input that would separate them. Play it, and call the same command again with
the new recording behind --with: the diagnosis goes on from the report in DIR.

With --each, every folder of recordings is diagnosed on its own: files called
holdout* are its proof, and a model.toml in it takes the place of MODEL.toml.
DIR receives a folder with the report of each, and each.csv with what was found.
Called again, it goes on where it stopped.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    diagnose = command(commands, "diagnose", "find out why recordings and simulation differ", _HELP, run)
    diagnose.epilog = (
        "example:\n  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --out report\n"
        "  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv \\\n"
        "    --with wednesday-1.csv --out report\n"
        "  jbridge diagnose model.toml --each rig-1 rig-2 rig-3 --out reports"
    )
    add_recordings(diagnose, least=0)
    diagnose.add_argument(
        "--budget",
        metavar="SECONDS",
        type=_budget,
        default=300.0,
        help="time for the diagnosis, about; what was found by then is reported (%(default)g)",
    )
    diagnose.add_argument(
        "--with",
        dest="new",
        metavar="NEW.csv",
        nargs="+",
        action="extend",
        default=[],
        help="recordings made since the report in DIR, with which its diagnosis goes on",
    )
    diagnose.add_argument("--force", action="store_true", help=FORCE)
    diagnose.add_argument(
        "--each", metavar="FOLDER", nargs="+", action="extend", default=[], help="folders to diagnose one by one"
    )
    add_workers(diagnose)


def run(arguments: argparse.Namespace, console: Console) -> None:
    if arguments.each:
        _each(arguments, console)
        return
    if not arguments.recordings:
        raise InputError("name recordings to learn from, or folders of them behind --each; see jbridge diagnose --help")
    former = jbridge.load_former(arguments.out) if arguments.new else None
    model, recordings, holdout = loaded(arguments, console)
    count = len(recordings) - len(arguments.new)
    result = jbridge.diagnose(
        model,
        recordings[:count],
        holdout,
        new=recordings[count:],
        former=former,
        budget=arguments.budget,
        progress=console,
    )
    console("drawing")
    jbridge.save_report(arguments.out, result)
    console.show(jbridge.describe_diagnosis(result, arguments.out), lambda: written(arguments.out, "report.json"))
    if result.stopped == "interrupted":
        raise KeyboardInterrupt


def _each(arguments: argparse.Namespace, console: Console) -> None:
    if arguments.recordings or arguments.holdout or arguments.new:
        raise InputError("--each takes folders in place of recordings; put them, and holdout*.csv, into folders")
    jbridge.set_up(arguments.cache)
    jbridge.load_model(arguments.model)  # refused before anything is written
    found = jbridge.diagnose_each(
        arguments.model,
        arguments.each,
        arguments.out,
        budget=arguments.budget,
        force=arguments.force,
        workers=arguments.workers,
        scheduler=arguments.scheduler,
        progress=console,
    )
    rows = [dataclasses.asdict(finding) for finding in found]
    lines = [f"{row['folder']}: {row['verdict'] or 'not read'}\n  {row['statement']}\n" for row in rows]
    console.show("".join(lines) + f"\n{arguments.out}/each.csv\n", lambda: {"out": arguments.out, "folders": rows})


def _budget(text: str) -> float:
    """A time that a diagnosis can do something with."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1.0 <= value < 1e6:
        raise argparse.ArgumentTypeError(f"{text}: give seconds, at least 1")
    return value
