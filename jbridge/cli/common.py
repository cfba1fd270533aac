"""What all commands share: their parser, what they show, and how recordings are named and read."""

import argparse
import importlib.util
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

import jbridge
from jbridge import InputError

RECORDING = "a recording: CSV or MATLAB .mat with columns t, u_x, x and what else the rig has (u_l, psi, l)"
MODEL = "the model: a TOML file with [bridge] and any [[effect]]"
FORCE = "accept columns with an implausible unit, sign or name"
OUT = "folder for the results; files in it are replaced one by one"


class Console:
    """What a command shows: while it runs what is going on, in the end what it found, as text or as one JSON object."""

    def __init__(self) -> None:
        self._style = "text"
        self.bar = jbridge.ProgressBar()

    def set_style(self, style: str) -> None:
        """From now on `text`, `json`, or `quiet`: nothing but errors."""
        self._style = style
        self.bar = jbridge.ProgressBar(shown=style != "quiet")

    def __call__(self, message: str) -> None:
        """Shows what is going on."""
        self.bar(message)

    def show(self, text: str, found: Callable[[], Mapping[str, Any]]) -> None:
        """Shows what was found.

        Args:
            text: for people.
            found: the same for programs; asked only where it is wanted.
        """
        self.bar.clear()
        if self._style == "json":
            print(json.dumps(_without_nan(found())))
        elif self._style == "text":
            print(text, end="")


def _without_nan(value: Any) -> Any:
    """The same with null for what is not known or not finite, which JSON cannot say."""
    if isinstance(value, Mapping):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def written(folder: str | Path, name: str) -> dict[str, Any]:
    """What a command has just written, with the folder that it lies in."""
    return {"out": str(folder), **json.loads((Path(folder) / name).read_text(encoding="utf-8"))}


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, like every other refusal."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"
"""Where a command adds itself."""


def command(
    commands: Commands,
    name: str,
    brief: str,
    description: str,
    run: Callable[[argparse.Namespace, Console], None],
) -> Parser:
    """Adds a command with the options that all have."""
    added = commands.add_parser(
        name,
        help=brief,
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    added.set_defaults(run=run)
    added.add_argument("--no-cache", dest="cache", action="store_false", help="do not keep programs for the next run")
    shown = added.add_mutually_exclusive_group()
    shown.add_argument(
        "--json", dest="style", action="store_const", const="json", default="text", help="print one JSON object"
    )
    shown.add_argument("--quiet", dest="style", action="store_const", const="quiet", help="print nothing but errors")
    return added


def model_path(text: str) -> str:
    """The name of a model's file, for the parser; a recording in its place is refused before anything is read."""
    if text.lower().endswith((".csv", ".mat")):
        raise argparse.ArgumentTypeError(f"{text}: a recording; name the model, a TOML file, before the recordings")
    return text


def add_recordings(command: Parser, *, least: int = 1) -> None:
    command.add_argument("model", metavar="MODEL.toml", type=model_path, help=MODEL)
    command.add_argument("recordings", metavar="REC.csv", nargs="+" if least else "*", help=RECORDING)
    command.add_argument(
        "--holdout",
        metavar="REC.csv",
        nargs="+",
        action="extend",
        default=[],
        help="hold-out recordings, which take no part in the fit; every file up to the next option",
    )
    command.add_argument("--out", metavar="DIR", required=True, help=OUT)


def add_workers(command: Parser) -> None:
    command.add_argument(
        "--workers", type=_count, default=_workers(), metavar="N",
        help="processes on this machine, replaced if they die; 0 computes in this one (default: %(default)s)",
    )  # fmt: skip
    command.add_argument(
        "--scheduler", metavar="ADDRESS", help="address of a dask.distributed scheduler; its workers need access to DIR"
    )


def _workers() -> int:
    """One process beside this one, which is replaced if it dies, where dask.distributed is installed."""
    return 1 if importlib.util.find_spec("distributed") else 0


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) > 1024:
        raise argparse.ArgumentTypeError(f"{text}: give a whole number from 0 to 1024")
    return int(text)


def loaded(
    arguments: argparse.Namespace, console: Console
) -> tuple["jbridge.Model", tuple["jbridge.Recording", ...], tuple["jbridge.Recording", ...]]:
    """Model, recordings and hold-out, once it is clear that results can be written."""
    learnt = [*arguments.recordings, *getattr(arguments, "new", ())]
    paths = [*learnt, *arguments.holdout]
    jbridge.check_output(arguments.out, folder=True, inputs=[arguments.model, *paths])
    console("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    recordings = jbridge.load_recordings(learnt, force=arguments.force)
    # All together are checked against each other, yet nothing about a hold-out may colour the others.
    every = jbridge.load_recordings(paths, force=arguments.force) if arguments.holdout else ()
    if not arguments.force:
        jbridge.check_model_gains(model, [*recordings, *every[len(recordings) :]])
    return model, recordings, every[len(recordings) :]


def controller_of(path: str | None) -> "jbridge.Controller":
    """The controller of a file, or the paper's."""
    return jbridge.load_controller(path) if path else jbridge.Controller(jbridge.paper_controller())
