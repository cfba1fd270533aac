"""`jbridge export`: a controller in C, a model for other programs."""

import argparse

import jbridge

from .common import OUT, Commands, Console, command

_HELP = """\
Writes a controller or a model in the language of another program.

A controller or a model becomes one header in C99 (--to c): no allocation,
double or float, and a self-test; a model with all its effects is advanced by
--period seconds at each call. A model becomes a functional mock-up unit
(--to fmu, FMI 3.0 co-simulation), with a library where a C compiler is found.
A model also becomes MuJoCo's XML (--to mujoco), a linear system about the load
hanging still on --rope metres for Python (--to statespace), or a MATLAB
function with its numbers (--to matlab); what these cannot say of a model's
effects is named in the file.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    export = command(commands, "export", "write a controller or a model for other programs", _HELP, run)
    export.epilog = (
        "example:\n  jbridge export tuned/controller.toml --to c --out rig\n"
        "  jbridge export fitted/model.toml --to mujoco --out scene"
    )
    export.add_argument("source", metavar="MODEL.toml|CONTROLLER.toml", help="what is exported")
    targets = ("c", "fmu", "mujoco", "statespace", "matlab")
    export.add_argument("--to", choices=targets, required=True, help="the language")
    export.add_argument(
        "--rope", type=float, default=0.5, metavar="METRES", help="rope length at the working point (0.5)"
    )
    export.add_argument("--period", type=float, metavar="SECONDS", help="sampling period of a model in C or FMU (0.01)")
    export.add_argument("--out", metavar="DIR", required=True, help=OUT)


def run(arguments: argparse.Namespace, console: Console) -> None:
    jbridge.check_output(arguments.out, folder=True, inputs=[arguments.source])
    console("reading")
    jbridge.set_up(arguments.cache)
    path = jbridge.save_export(
        arguments.out, arguments.source, arguments.to, rope=arguments.rope, period=arguments.period
    )
    console.show(f"{path}\n", lambda: {"out": str(path)})
