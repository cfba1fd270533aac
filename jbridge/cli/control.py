"""`jbridge control`: how a controller moves the load."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import jbridge
from jbridge import InputError

from .common import MODEL, OUT, Commands, Console, command, controller_of, model_path, written

_HELP = """\
Simulates how a controller moves the load along a reference, and says how each
move went.

Without --controller the paper's two fuzzy controllers are used, without
--reference the paper's moves. DIR receives control.html (to look at),
control.json (the same in numbers), run.csv (the run as a recording), the
figures, and controller.toml (the controller, to change and use again). Several
controllers are compared in a table that says which of them to take.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    control = command(commands, "control", "simulate how a controller moves the load", _HELP, run)
    control.epilog = "example:\n  jbridge control fitted/model.toml --controller fuzzy.toml --out moves"
    control.add_argument("model", metavar="MODEL.toml", type=model_path, help=MODEL)
    control.add_argument(
        "--controller",
        metavar="CONTROLLER.toml",
        nargs="+",
        help="the controller; the paper's by default; several are compared, each in a folder of its own",
    )
    control.add_argument("--reference", metavar="REF.toml", help="points to visit, speed, rest; the paper's by default")
    control.add_argument("--out", metavar="DIR", required=True, help=OUT)


def run(arguments: argparse.Namespace, console: Console) -> None:
    files = arguments.controller or [None]
    given = [path for path in (arguments.model, *files, arguments.reference) if path]
    names = _names(files)
    jbridge.check_output(arguments.out, folder=True, inputs=given)
    console("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    controllers = {name: controller_of(file) for name, file in zip(names, files, strict=True)}
    folders = {name: Path(arguments.out) / (name if len(files) > 1 else "") for name in names}
    for folder in folders.values():
        read = [path for controller in controllers.values() for path in controller.files]
        jbridge.check_output(folder, folder=True, inputs=[*given, *read])
    runs, failed = {}, {}
    for name, controller in controllers.items():
        if arguments.reference:
            path = jbridge.load_reference(arguments.reference, controller.period)
        else:
            path = jbridge.paper_path(controller.period)
        console(f"simulating {name}")
        try:
            runs[name] = jbridge.track(model, controller, path)
        except InputError as error:
            failed[name] = str(error)
    if not runs:
        raise InputError("; ".join(dict.fromkeys(failed.values())))
    alone = len(controllers) == 1
    texts = []
    for name, track in runs.items():
        console("drawing")
        jbridge.save_tracking(folders[name], track, controllers[name])
        texts.append(f"{name}:\n" * (not alone) + jbridge.describe_tracking(track, folders[name]))
    if len(runs) > 1:
        texts.append(jbridge.describe_rivals(runs))
    # Those that run are compared all the same.
    console.show("\n".join(texts), lambda: {name: written(folders[name], "control.json") for name in runs})
    if failed:
        raise InputError("; ".join(dict.fromkeys(failed.values())))


def _names(files: Sequence[str | None]) -> list[str]:
    """What controllers are called: by their files, and those whose files are called alike by their folders."""
    paths = [Path(file or "paper") for file in files]
    stems = [path.stem for path in paths]
    names = [path.resolve().parent.name if stems.count(path.stem) > 1 else path.stem for path in paths]
    if len(set(names)) < len(names):
        raise InputError(
            f"--controller: {', '.join(map(str, files))} are called alike; rename one, its results need it"
        )
    return names
