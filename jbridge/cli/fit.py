"""`jbridge fit`: a model's unknown numbers, from recordings."""

import argparse

import jbridge

from .common import FORCE, Commands, Console, add_recordings, command, loaded, written

_HELP = """\
Estimates the unknown parameters of a model from recordings, with 95 %
intervals.

What [bridge] lists under `known` stays as it is; the rest are guesses to start
from. DIR receives model.toml (the fitted model), fit.html (to look at),
fit.json (the same in numbers) and the figures.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    fit = command(commands, "fit", "estimate the unknown parameters of a model", _HELP, run)
    fit.epilog = "example:\n  jbridge fit model.toml monday-*.csv --holdout tuesday-1.csv --out fitted"
    add_recordings(fit)
    fit.add_argument(
        "--window",
        metavar="SECONDS",
        type=float,
        help="fit windows of this length alone, in place of 0.3, 1 and 3 s and whole recordings, where free runs"
        " amplify small errors",
    )
    fit.add_argument("--force", action="store_true", help=FORCE)


def run(arguments: argparse.Namespace, console: Console) -> None:
    model, recordings, holdout = loaded(arguments, console)
    result = jbridge.fit(model, recordings, holdout, window=arguments.window, progress=console)
    console("drawing")
    jbridge.save_fit(arguments.out, result)
    console.show(jbridge.describe_fit(result, arguments.out), lambda: written(arguments.out, "fit.json"))
