"""`jbridge diagnose`: why recordings and simulation differ."""

import argparse

import jbridge

from .common import FORCE, Commands, Console, add_recordings, command, loaded, written

_HELP = """\
Finds out why recordings and simulation differ: whether the model lacks
anything, where, and what it is.

DIR receives report.html (to look at), report.json (the same in numbers),
model.toml (the model with what was found) and the figures.

Recordings behind --holdout are the proof: no number is learned from them, and
they are opened once, when the structure is fixed. Without any, the last quarter
of the recordings plays that part. Ctrl-C writes what was found by then, without
a verdict.

Where explanations cannot be told apart, DIR receives next_experiment.csv, an
input that would separate them. Play it, and call the same command again with
the new recording behind --with: the diagnosis goes on from the report in DIR.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    diagnose = command(commands, "diagnose", "why recordings and simulation differ", _HELP, run)
    diagnose.epilog = (
        "example:\n  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --out report\n"
        "  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --with wednesday-1.csv --out report"
    )
    add_recordings(diagnose)
    diagnose.add_argument(
        "--budget",
        metavar="SECONDS",
        type=_budget,
        default=300.0,
        help="time for the whole diagnosis; what was found by then is reported (%(default)g)",
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


def run(arguments: argparse.Namespace, console: Console) -> None:
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


def _budget(text: str) -> float:
    """A time that a diagnosis can do something with."""
    value = float(text)
    if not 1.0 <= value < 1e6:
        raise argparse.ArgumentTypeError(f"{text}: give seconds, at least 1")
    return value
