"""`jbridge demo`: the diagnosis of a rig that comes with the package."""

import argparse
import base64
import importlib.resources
import json
from pathlib import Path

import jbridge

from .common import OUT, Commands, Console, command, written

_HELP = """\
Diagnoses recordings that come with jbridge. Another simulator (MuJoCo) made
them with an effect that the model lacks and that is concealed from the
diagnosis; --reveal prints it. DIR receives what `jbridge diagnose` writes.
"""
_DATA = "demo_data"


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    demo = command(commands, "demo", "diagnose recordings that come with jbridge", _HELP, run)
    demo.epilog = "example:\n  jbridge demo --out demo"
    demo.add_argument("--out", metavar="DIR", default="demo", help=f"{OUT} (default: %(default)s)")
    demo.add_argument("--reveal", action="store_true", help="print what was concealed, and stop")


def run(arguments: argparse.Namespace, console: Console) -> None:
    with importlib.resources.as_file(importlib.resources.files("jbridge") / _DATA) as folder:
        if arguments.reveal:
            # In base64, so that nobody reads it by accident; seal.txt beside it is its SHA-256.
            truth = base64.b64decode((folder / "truth.txt").read_text(encoding="ascii")).decode("utf-8")
            console.show(truth.rstrip() + "\n", lambda: {"concealed": json.loads(truth)})
            return
        _diagnose(folder, arguments, console)


def _diagnose(folder: Path, arguments: argparse.Namespace, console: Console) -> None:
    jbridge.check_output(arguments.out, folder=True)
    console("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(folder / "model.toml")
    train, holdout = (jbridge.load_recordings(sorted(folder.glob(f"{role}-*.csv"))) for role in ("train", "holdout"))
    result = jbridge.diagnose(model, train, holdout, progress=console)
    console("drawing")
    jbridge.save_report(arguments.out, result)
    hint = "Concealed   what it was: jbridge demo --reveal\n"
    text = jbridge.describe_diagnosis(result, arguments.out) + hint
    console.show(text, lambda: written(arguments.out, "report.json"))
    if result.stopped == "interrupted":
        raise KeyboardInterrupt
