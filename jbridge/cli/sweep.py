"""`jbridge sweep`: one question to many bridges."""

import argparse
import dataclasses

import jbridge
from jbridge import InputError

from .common import Commands, Console, add_workers, command

_HELP = """\
Runs a controller on many bridges: every point of a grid or of a sample of
parameters of model, controller and reference.

DIR receives part-*.parquet (a row for each rollout: its parameters and how the
move went) and nothing else, so that it reads as one table. DIR.sweep.json has
units, versions, seed and settings, DIR.failures.csv the rollouts that diverged.
A sweep that was interrupted goes on where it stopped when it is called again.
"""


def add(commands: Commands) -> None:
    """Adds the command to the parser."""
    sweep = command(commands, "sweep", "simulate a controller on many bridges", _HELP, run)
    sweep.epilog = "example:\n  jbridge sweep friction.toml --out friction"
    sweep.add_argument("spec", metavar="SPEC.toml", help="what to vary, and how: model, [sample], [[vary]]")
    sweep.add_argument("--out", metavar="DIR", required=True, help="folder for the results; those that it has are kept")
    sweep.add_argument(
        "--gpu", action="store_true",
        help="compute in this process on a graphics processor; pays with chunks of 10,000 rollouts and more",
    )  # fmt: skip
    add_workers(sweep)


def run(arguments: argparse.Namespace, console: Console) -> None:
    jbridge.check_output(arguments.out, folder=True)
    console("reading")
    jbridge.set_up(arguments.cache, gpu=arguments.gpu)
    if arguments.gpu:
        _refuse_without_gpu(arguments)
    question = jbridge.load_sweep(arguments.spec)
    workers = 0 if arguments.gpu else arguments.workers
    result = jbridge.run_sweep(
        question, arguments.out, workers=workers, scheduler=arguments.scheduler, progress=console
    )
    done = f"{result.count:,} rollouts, {result.failed:,} failed, in {result.seconds:.1f} s"
    kept = result.count - result.computed
    console.show(
        f"{result.folder}: {done}{f' ({kept:,} were there already)' if kept else ''}\n",
        lambda: {**dataclasses.asdict(result), "folder": str(result.folder)},
    )


def _refuse_without_gpu(arguments: argparse.Namespace) -> None:
    import jax

    if arguments.scheduler is not None:
        raise InputError("--gpu is for this process, not for the workers of a --scheduler; leave one of the two out")
    if jax.default_backend() == "cpu":
        raise InputError(
            "--gpu: JAX sees no graphics processor; install jax[cuda13], or what fits yours, or leave it out"
        )
