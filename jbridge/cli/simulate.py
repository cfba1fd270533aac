"""`jbridge simulate`: what the rig's sensors would read."""

import argparse
from pathlib import Path

import jbridge

from .common import FORCE, MODEL, Commands, Console, command, model_path

_HELP = """\
Simulates a model with the inputs of a recording and writes what the sensors
would read, without noise.

The output has the columns t, the inputs, and x [m], psi [rad], l [m] as far as
the rig has them. For a recording with measurements the initial state is
estimated from its first half second, as in the reports of fit and diagnose. A
file of inputs alone starts at rest at the [initial] table of its sidecar.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    simulate = command(commands, "simulate", "simulate what the rig's sensors would read", _HELP, run)
    simulate.epilog = "example:\n  jbridge simulate model.toml --input staircase.csv --out simulated.csv"
    simulate.add_argument("model", metavar="MODEL.toml", type=model_path, help=MODEL)
    simulate.add_argument("--input", metavar="REC.csv", required=True, help="the inputs: t, u_x and, if driven, u_l")
    simulate.add_argument(
        "--initial",
        choices=("estimated", "first-row"),
        default="estimated",
        help="start of a recording with measurements: estimated from its first 0.5 s, or at rest at its first row"
        " (%(default)s)",
    )
    simulate.add_argument(
        "--out", metavar="OUT.csv", required=True, help="where to write; an existing file is replaced"
    )
    simulate.add_argument("--force", action="store_true", help=FORCE)


def run(arguments: argparse.Namespace, console: Console) -> None:
    jbridge.check_output(arguments.out, folder=False, inputs=[arguments.model, arguments.input])
    console("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    recording = jbridge.load_recording(arguments.input, inputs_only=True, force=arguments.force)
    console("simulating")
    columns = jbridge.simulate(model, recording, arguments.initial)
    Path(arguments.out).parent.mkdir(parents=True, exist_ok=True)
    jbridge.save_csv(arguments.out, columns)
    rows, names = len(columns["t"]), list(columns)
    console.show(
        f"{arguments.out}: {rows} rows of {', '.join(names)}\n",
        lambda: {"out": arguments.out, "rows": rows, "columns": names},
    )
