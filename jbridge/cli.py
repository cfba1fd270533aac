"""The command `jbridge`: check, simulate, fit, diagnose, control, tune, export, sweep, figures.

Exit status 0 whatever the verdict; 2 for input that a person can correct, with one line on what to do and nothing
written; 130 when interrupted. Everything else is a bug and shows its traceback.
"""

import argparse
import contextlib
import errno
import importlib.util
import io
import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

import jbridge
from jbridge import InputError

_FULL = (errno.ENOSPC, errno.EDQUOT)
"""What the system says where a disk, or the share of it that one may use, is full."""
_RECORDING = "a recording: CSV or MATLAB .mat with columns t, u_x, x and what else the rig has (u_l, psi, l)"
_MODEL = "the model: a TOML file with [bridge] and any [[effect]]"
_FORCE = "take columns that are plainly in another unit, of another sign or called otherwise as they are"
_OUT = "folder for the results; files in it are replaced one by one"
_SIMULATE = """\
Plays the inputs of a recording on a model and writes what the sensors would
read, without noise.

The output has the columns t, the inputs, and x [m], psi [rad], l [m] as far as
the rig has them. A recording with measurements starts in the state that its
first half second tells best, as in the reports of fit and diagnose. A file of
inputs alone starts at rest at the [initial] table of its sidecar.
"""
_CHECK = """\
Says what recordings are read as, in seconds: columns, units, sampling, gaps,
noise, resolution and signs; with a model, which of its numbers these
recordings can tell.

All problems are listed, each with the line that mends it; the exit status is
then 2, as it would be for the commands that refuse such a recording. DIR
receives check.png (the signals) and check.html (all of it).
"""
_FIT = """\
Estimates the unknown numbers of a model from recordings, with 95 % intervals.

What [bridge] lists under `known` stays as it is; the rest are guesses to start
from. DIR receives model.toml (the fitted model), fit.html (to look at),
fit.json (the same in numbers) and the figures.
"""
_DIAGNOSE = """\
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
_CONTROL = """\
Lets a controller move the load of a model along a reference, and says how each
move went.

Without --controller the paper's two fuzzy controllers are used, without
--reference the paper's moves. DIR receives control.html (to look at),
control.json (the same in numbers), run.csv (the run as a recording), the
figures, and controller.toml (the controller, to change and use again). Several
controllers are compared in a table that says which of them to take.
"""
_TUNE = """\
Makes a controller better: moves a fuzzy controller's sets, scales and rule
weights, or another law's gains, by gradients through simulated moves on many
bridges about a model, and compares on further bridges and moves.

Without --controller the rules named by --rules are tuned: the paper's, or the
extended ones, in which velocity and swing angle act; or a PID controller, or
state feedback that begins as an LQR of the model. DIR receives
controller.toml (tuned, for jbridge control), controller.h (the same in C),
tune.html (to look at), tune.json (the same in numbers) and the figures.

Bridges scatter by the uncertainties that the model has from a fit or a
diagnosis, otherwise by shares that laboratory bridges need.
"""
_EXPORT = """\
Writes a controller or a model in the language of another program.

A controller becomes one header in C99 (--to c): no allocation, double or float,
and a self-test. A model becomes MuJoCo's XML (--to mujoco), a linear system
about the load hanging still on --rope metres for Python (--to statespace), or a
MATLAB function with its numbers (--to matlab); what the language cannot say of
a model's effects is named in the file.
"""
_SWEEP = """\
Runs a controller on many bridges: every point of a grid or of a sample of
parameters of model, controller and reference.

DIR receives part-*.parquet (a row for each rollout: its parameters and how the
move went) and nothing else, so that it reads as one table. DIR.sweep.json has
units, versions, seed and what was asked, DIR.failures.csv what ran away. A sweep
that was interrupted goes on where it stopped when it is called again.
"""
_FIGURES = """\
Redraws the figures and tables of the paper from saved data, each with the
number of its counterpart: Figures 1, 4, 5, 6, 8, 9, 10, Tables 1 and 2.

The data come from experiments/paper/run.py, which plays, estimates and
controls the virtual rig.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status.

    Args:
        argv: arguments, those of the process by default.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A terminal that lacks a sign such as the degree's gets another one instead of an error.
            stream.reconfigure(errors="replace")
    progress = _Progress()
    try:
        arguments = _parser().parse_args(argv)
        with contextlib.ExitStack() as around:
            if arguments.quiet:
                progress.silence()
                around.enter_context(contextlib.redirect_stdout(io.StringIO()))
            arguments.run(arguments, progress)
        sys.stdout.flush()
        return 0
    except InputError as error:
        progress.clear()
        print(f"jbridge: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        progress.clear()
        print("jbridge: interrupted; files that were finished are whole", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever read the summary has gone; what was saved is saved. The interpreter flushes once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.errno not in _FULL:
            raise
        progress.clear()
        print(f"jbridge: {error.strerror}; make room, and call again; finished files are whole", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the interpreter's last flush, as above
        return 2
    finally:
        progress.clear()


def _simulate(arguments: argparse.Namespace, progress: "_Progress") -> None:
    jbridge.check_output(arguments.out, folder=False, inputs=[arguments.model, arguments.input])
    progress("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    recording = jbridge.load_recording(arguments.input, inputs_only=True, force=arguments.force)
    progress("simulating")
    columns = jbridge.simulate(model, recording, arguments.initial)
    Path(arguments.out).parent.mkdir(parents=True, exist_ok=True)
    jbridge.save_csv(arguments.out, columns)
    progress.clear()
    print(f"{arguments.out}: {len(columns['t'])} rows of {', '.join(columns)}")


def _check(arguments: argparse.Namespace, progress: "_Progress") -> None:
    model_file, *rest = arguments.files
    paths = rest if model_file.lower().endswith(".toml") else arguments.files
    if not paths:
        raise InputError(f"{model_file}: a model without recordings; name at least one, see jbridge check --help")
    if arguments.out:
        jbridge.check_output(arguments.out, folder=True, inputs=arguments.files)
    progress("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(model_file) if paths is rest else None
    inspections = jbridge.inspect_recordings(paths)
    problems = [problem for each in inspections for problem in each.problems]
    found, mismatch = None, ""
    if model is not None and (arguments.force or not problems):
        progress("linearising")
        recordings = [each.recording for each in inspections if each.recording is not None]
        try:
            found = jbridge.identifiability(model, recordings) if recordings else None
        except InputError as error:
            mismatch = str(error)
    text = jbridge.describe_check(inspections, found, mismatch)
    if arguments.out:
        progress("drawing")
        jbridge.save_check(arguments.out, inspections, text)
    progress.clear()
    print(text, end="")
    unread = any(each.recording is None for each in inspections)
    if mismatch or (problems and (unread or not arguments.force)):
        raise InputError([*problems, mismatch][0])


def _fit(arguments: argparse.Namespace, progress: "_Progress") -> None:
    model, recordings, holdout = _load(arguments, progress)
    result = jbridge.fit(model, recordings, holdout, window=arguments.window, progress=progress)
    progress("drawing")
    jbridge.save_fit(arguments.out, result)
    progress.clear()
    print(jbridge.describe_fit(result, arguments.out), end="")


def _diagnose(arguments: argparse.Namespace, progress: "_Progress") -> None:
    former = jbridge.load_former(arguments.out) if arguments.new else None
    model, recordings, holdout = _load(arguments, progress)
    count = len(recordings) - len(arguments.new)
    result = jbridge.diagnose(
        model,
        recordings[:count],
        holdout,
        new=recordings[count:],
        former=former,
        budget=arguments.budget,
        progress=progress,
    )
    progress("drawing")
    jbridge.save_report(arguments.out, result)
    progress.clear()
    print(jbridge.describe_diagnosis(result, arguments.out), end="")
    if result.stopped == "interrupted":
        raise KeyboardInterrupt


def _control(arguments: argparse.Namespace, progress: "_Progress") -> None:
    files = arguments.controller or [None]
    given = [path for path in (arguments.model, *files, arguments.reference) if path]
    names = [Path(file or "paper").stem for file in files]
    if len(set(names)) < len(names):
        raise InputError(
            f"--controller: {', '.join(map(str, files))} are called alike; rename one, its results need it"
        )
    jbridge.check_output(arguments.out, folder=True, inputs=given)
    progress("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    controllers = {name: _controller(file) for name, file in zip(names, files, strict=True)}
    runs = {}
    for name, controller in controllers.items():
        if arguments.reference:
            path = jbridge.load_reference(arguments.reference, controller.period)
        else:
            path = jbridge.paper_path(controller.period)
        progress(f"simulating {name}")
        runs[name] = jbridge.track(model, controller, path)
    for name, run in runs.items():
        folder = Path(arguments.out) if len(runs) == 1 else Path(arguments.out) / name
        progress("drawing")
        jbridge.save_tracking(folder, run, controllers[name])
        progress.clear()
        print(f"{name}:\n" * (len(runs) > 1) + jbridge.describe_tracking(run, folder), end="\n" * (len(runs) > 1))
    if len(runs) > 1:
        print(jbridge.describe_rivals(runs), end="")


def _tune(arguments: argparse.Namespace, progress: "_Progress") -> None:
    given = [path for path in (arguments.model, arguments.controller) if path]
    jbridge.check_output(arguments.out, folder=True, inputs=given)
    if not 0.0 <= arguments.delay < 1e3:
        raise InputError(f"--delay {arguments.delay:g}: give milliseconds, 0 or more and less than 1000")
    progress("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    if arguments.controller or arguments.rules == "paper":
        controller = _controller(arguments.controller)
    else:
        controller = _law(arguments.rules, model)
    tuning = jbridge.tune(
        model,
        controller,
        plants=arguments.plants,
        steps=arguments.steps,
        starts=arguments.starts,
        seed=arguments.seed,
        region=_region(arguments.rail, arguments.rope),
        scatter=jbridge.Scatter(late=1e-3 * arguments.delay),
        progress=progress,
    )
    progress("drawing")
    jbridge.save_tuning(arguments.out, tuning)
    progress.clear()
    print(jbridge.describe_tuning(tuning, arguments.out), end="")


def _law(rules: str, model: "jbridge.Model") -> "jbridge.Controller":
    """A controller to begin with, made for a model."""
    given = jbridge.compensation_for(model.plant)
    if rules == "extended":
        return jbridge.Controller(jbridge.extended_controller(given))
    if rules == "pid":
        return jbridge.Controller(jbridge.Pid(compensation=given))
    return jbridge.lqr_controller(model, given)


def _region(rail: list[float] | None, rope: list[float] | None) -> "jbridge.Region | None":
    """Where moves begin and end, if that is told."""
    if rail is None and rope is None:
        return None
    ends = {}
    for name, given, usual, least in (
        ("rail", rail, jbridge.PAPER_REGION.rail, -float("inf")),
        ("rope", rope, jbridge.PAPER_REGION.rope, 0.0),
    ):
        low, high = given or usual
        if not least < low < high < float("inf"):
            raise InputError(f"--{name} {low:g} {high:g}: give the lower end and the higher one in metres")
        ends[name] = (low, high)
    return jbridge.Region(**ends)


def _controller(path: str | None) -> "jbridge.Controller":
    """The controller of a file, or the paper's."""
    return jbridge.load_controller(path) if path else jbridge.Controller(jbridge.paper_controller())


def _export(arguments: argparse.Namespace, progress: "_Progress") -> None:
    jbridge.check_output(arguments.out, folder=True, inputs=[arguments.source])
    progress("reading")
    jbridge.set_up(arguments.cache)
    path = jbridge.save_export(arguments.out, arguments.source, arguments.to, rope=arguments.rope)
    progress.clear()
    print(path)


def _sweep(arguments: argparse.Namespace, progress: "_Progress") -> None:
    question_folder = Path(arguments.out)
    if question_folder.exists() and not question_folder.is_dir():
        raise InputError(f"{arguments.out}: a file, where the folder for the results belongs; choose another --out")
    progress("reading")
    jbridge.set_up(arguments.cache)
    question = jbridge.load_sweep(arguments.spec)
    result = jbridge.run_sweep(
        question, arguments.out, workers=arguments.workers, scheduler=arguments.scheduler, progress=progress
    )
    progress.clear()
    done = f"{result.count:,} rollouts, {result.failed:,} failed, in {result.seconds:.1f} s"
    kept = result.count - result.computed
    print(f"{result.folder}: {done}{f' ({kept:,} were there already)' if kept else ''}")


def _figures(arguments: argparse.Namespace, progress: "_Progress") -> None:
    jbridge.check_output(arguments.out, folder=True, inputs=[arguments.data])
    jbridge.set_up(arguments.cache)
    progress("drawing")
    files = jbridge.save_paper(arguments.out, arguments.data)
    progress.clear()
    for path in files:
        print(path)


def _load(
    arguments: argparse.Namespace, progress: "_Progress"
) -> tuple["jbridge.Model", tuple["jbridge.Recording", ...], tuple["jbridge.Recording", ...]]:
    """Model, recordings and hold-out, once it is clear that results can be written."""
    learnt = [*arguments.recordings, *getattr(arguments, "new", ())]
    paths = [*learnt, *arguments.holdout]
    jbridge.check_output(arguments.out, folder=True, inputs=[arguments.model, *paths])
    progress("reading")
    jbridge.set_up(arguments.cache)
    model = jbridge.load_model(arguments.model)
    recordings = jbridge.load_recordings(learnt, force=arguments.force)
    # All together are checked against each other, yet nothing about a hold-out may colour the others.
    every = jbridge.load_recordings(paths, force=arguments.force) if arguments.holdout else ()
    return model, recordings, every[len(recordings) :]


class _Progress:
    """One line on a terminal that says what is going on and for how long; silent elsewhere."""

    def __init__(self) -> None:
        self._stream = sys.stderr
        self._shown = self._stream.isatty()
        self._start = time.monotonic()

    def __call__(self, message: str) -> None:
        if self._shown:
            line = f"{time.monotonic() - self._start:4.0f} s  {' '.join(message.split())}"
            # A line that wraps could not be taken back.
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(f"\r\x1b[K{line[:width]}")
            self._stream.flush()

    def silence(self) -> None:
        """From now on nothing is shown."""
        self._shown = False

    def clear(self) -> None:
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, like every other refusal."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")


class _Version(argparse.Action):
    """Looks the version up only when asked for it."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"jbridge {jbridge.__version__}")
        parser.exit()


def _parser() -> _Parser:
    parser = _Parser(
        prog="jbridge",
        description="A simulator of a laboratory loading bridge (gantry crane)\n"
        "that finds out why recordings and simulation differ.",
        epilog="example:\n  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --out report",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, title="commands")
    simulate = _command(commands, "simulate", "what the rig's sensors would read", _SIMULATE, _simulate)
    simulate.epilog = "example:\n  jbridge simulate model.toml --input staircase.csv --out simulated.csv"
    simulate.add_argument("model", metavar="MODEL.toml", help=_MODEL)
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
    check = _command(commands, "check", "what recordings are read as, and can tell", _CHECK, _check)
    check.usage = "jbridge check [-h] [--out DIR] [--force] [--no-cache] [--quiet] [MODEL.toml] REC.csv [REC.csv ...]"
    check.epilog = "example:\n  jbridge check model.toml monday-*.csv --out checked"
    check.add_argument("files", metavar="[MODEL.toml] REC.csv", nargs="+", help=f"{_RECORDING}; a model may come first")
    check.add_argument("--out", metavar="DIR", help=_OUT)
    fit = _command(commands, "fit", "the model's unknown numbers, from recordings", _FIT, _fit)
    fit.epilog = "example:\n  jbridge fit model.toml monday-*.csv --holdout tuesday-1.csv --out fitted"
    _add_recordings(fit)
    fit.add_argument(
        "--window",
        metavar="SECONDS",
        type=float,
        help="fit windows of this length, each from a start of its own, where whole recordings drift apart by luck",
    )
    diagnose = _command(commands, "diagnose", "why recordings and simulation differ", _DIAGNOSE, _diagnose)
    diagnose.epilog = (
        "example:\n  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --out report\n"
        "  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --with wednesday-1.csv --out report"
    )
    _add_recordings(diagnose)
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
    control = _command(commands, "control", "how a controller moves the load", _CONTROL, _control)
    control.epilog = "example:\n  jbridge control fitted/model.toml --controller fuzzy.toml --out moves"
    control.add_argument("model", metavar="MODEL.toml", help=_MODEL)
    control.add_argument(
        "--controller",
        metavar="CONTROLLER.toml",
        nargs="+",
        help="the controller; the paper's by default; several are compared, each in a folder of its own",
    )
    control.add_argument("--reference", metavar="REF.toml", help="points to visit, speed, rest; the paper's by default")
    control.add_argument("--out", metavar="DIR", required=True, help=_OUT)
    tune = _command(commands, "tune", "a controller made better by gradients", _TUNE, _tune)
    tune.epilog = "example:\n  jbridge tune fitted/model.toml --rules extended --out tuned"
    tune.add_argument("model", metavar="MODEL.toml", help=_MODEL)
    tune.add_argument("--controller", metavar="CONTROLLER.toml", help="the controller to begin with")
    tune.add_argument(
        "--rules", choices=("paper", "extended", "pid", "lqr"), default="paper", help="otherwise (%(default)s)"
    )
    tune.add_argument("--plants", type=int, default=64, metavar="N", help="bridges to learn from (%(default)s)")
    tune.add_argument("--steps", type=int, default=200, metavar="N", help="gradient steps (%(default)s)")
    tune.add_argument("--starts", type=int, default=3, metavar="N", help="starts; the best one goes on (%(default)s)")
    tune.add_argument("--seed", type=int, default=0, metavar="N", help="of bridges, moves and starts (%(default)s)")
    tune.add_argument("--rail", type=float, nargs=2, metavar=("LOW", "HIGH"), help="where carts move to [m] (0 1.2)")
    tune.add_argument("--rope", type=float, nargs=2, metavar=("LOW", "HIGH"), help="rope lengths [m] (0.185 0.7)")
    tune.add_argument("--delay", type=float, default=0.0, metavar="MS", help="drives answer up to so late [ms] (0)")
    tune.add_argument("--out", metavar="DIR", required=True, help=_OUT)
    export = _command(commands, "export", "a controller in C, a model for other programs", _EXPORT, _export)
    export.epilog = (
        "example:\n  jbridge export tuned/controller.toml --to c --out rig\n"
        "  jbridge export fitted/model.toml --to mujoco --out scene"
    )
    export.add_argument("source", metavar="MODEL.toml|CONTROLLER.toml", help="what is exported")
    export.add_argument("--to", choices=("c", "mujoco", "statespace", "matlab"), required=True, help="the language")
    export.add_argument("--rope", type=float, default=0.5, metavar="METRES", help="at a model's working point (0.5)")
    export.add_argument("--out", metavar="DIR", required=True, help=_OUT)
    sweep = _command(commands, "sweep", "one question to many bridges", _SWEEP, _sweep)
    sweep.epilog = "example:\n  jbridge sweep friction.toml --out friction"
    sweep.add_argument("spec", metavar="SPEC.toml", help="what to vary, and how: model, [sample], [[vary]]")
    sweep.add_argument("--out", metavar="DIR", required=True, help="folder for the results; those that it has are kept")
    sweep.add_argument(
        "--workers", type=_count, default=_workers(), metavar="N",
        help="processes on this machine, replaced if they die; 0 computes in this one (default: %(default)s)",
    )  # fmt: skip
    sweep.add_argument("--scheduler", metavar="ADDRESS", help="of dask.distributed, whose workers see DIR, too")
    figures = _command(commands, "figures", "the paper's figures and tables", _FIGURES, _figures)
    figures.epilog = "example:\n  jbridge figures"
    figures.add_argument(
        "--data", metavar="DATA.json", default="figures/data/paper.json", help="what was measured (%(default)s)"
    )
    figures.add_argument("--out", metavar="DIR", default="figures", help="folder for the results (%(default)s)")
    for command in (check, simulate, fit, diagnose):
        command.add_argument("--force", action="store_true", help=_FORCE)
    for command in (check, simulate, fit, diagnose, control, tune, export, sweep, figures):
        command.add_argument(
            "--no-cache", dest="cache", action="store_false", help="do not keep programs for the next run"
        )
        command.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return parser


def _workers() -> int:
    """One process beside this one, which is replaced if it dies, where dask.distributed is installed."""
    return 1 if importlib.util.find_spec("distributed") else 0


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) > 1024:
        raise argparse.ArgumentTypeError(f"{text}: give a whole number from 0 to 1024")
    return int(text)


def _budget(text: str) -> float:
    """A time that a diagnosis can do something with."""
    value = float(text)
    if not 1.0 <= value < 1e6:
        raise argparse.ArgumentTypeError(f"{text}: give seconds, at least 1")
    return value


def _command(
    commands: "argparse._SubParsersAction[_Parser]",
    name: str,
    brief: str,
    description: str,
    run: Callable[[argparse.Namespace, _Progress], None],
) -> _Parser:
    command = commands.add_parser(
        name,
        help=brief,
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(run=run)
    return command


def _add_recordings(command: _Parser) -> None:
    command.add_argument("model", metavar="MODEL.toml", help=_MODEL)
    command.add_argument("recordings", metavar="REC.csv", nargs="+", help=_RECORDING)
    command.add_argument(
        "--holdout",
        metavar="REC.csv",
        nargs="+",
        action="extend",
        default=[],
        help="recordings kept apart as proof; every file up to the next option",
    )
    command.add_argument("--out", metavar="DIR", required=True, help=_OUT)


if __name__ == "__main__":
    sys.exit(main())
