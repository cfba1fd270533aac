"""`jbridge figures`: the paper's figures and tables."""

import argparse

import jbridge

from .common import Commands, Console, command

_HELP = """\
Redraws the figures and tables of the paper from saved data, each with the
number of its counterpart: Figures 1, 4, 5, 6, 8, 9, 10, Tables 1 and 2.

The data come from experiments/paper/run.py, which plays, estimates and
controls the virtual rig.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    figures = command(commands, "figures", "redraw the paper's figures and tables", _HELP, run)
    figures.epilog = "example:\n  jbridge figures"
    figures.add_argument(
        "--data", metavar="DATA.json", default="figures/data/paper.json", help="what was measured (%(default)s)"
    )
    figures.add_argument("--out", metavar="DIR", default="figures", help="folder for the results (%(default)s)")


def run(arguments: argparse.Namespace, console: Console) -> None:
    jbridge.check_output(arguments.out, folder=True, inputs=[arguments.data])
    jbridge.set_up(arguments.cache)
    console("drawing")
    files = jbridge.save_paper(arguments.out, arguments.data)
    console.show("".join(f"{path}\n" for path in files), lambda: {"files": [str(path) for path in files]})
