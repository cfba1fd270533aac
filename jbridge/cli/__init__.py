"""The command `jbridge`: demo, check, diagnose, fit, simulate, control, tune, export, sweep.

Exit status 0 whatever the verdict; 2 for input that a person can correct, with one line on what to do and nothing
written (but for `control`, which compares the controllers beside one whose loop runs away); 130 when interrupted.
Everything else is a bug and shows its traceback.
"""

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import jbridge
from jbridge import InputError

from . import check, control, demo, diagnose, export, fit, simulate, sweep, tune
from .common import Console, Parser

COMMANDS = {
    "demo": demo, "check": check, "diagnose": diagnose, "fit": fit, "simulate": simulate, "control": control,
    "tune": tune, "export": export, "sweep": sweep,
}  # fmt: skip
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says where a disk, or the share of it or the size of a file that one may use, is full."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status.

    Args:
        argv: arguments, those of the process by default.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A terminal that lacks a sign such as the degree's gets another one instead of an error.
            stream.reconfigure(errors="replace")
    console = Console()
    try:
        arguments = parser().parse_args(argv)
        console.set_style(arguments.style)
        arguments.run(arguments, console)
        sys.stdout.flush()
        return 0
    except InputError as error:
        console.bar.clear()
        print(f"jbridge: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        console.bar.clear()
        print("jbridge: interrupted; files that were finished are whole", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # Whoever read the summary has gone; what was saved is saved. The interpreter flushes once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.errno not in _FULL:
            raise
        console.bar.clear()
        print(f"jbridge: {error.strerror}; make room, and call again; finished files are whole", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for the interpreter's last flush, as above
        return 2
    finally:
        console.bar.clear()


class _Version(argparse.Action):
    """Looks the version up only when asked for it."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"jbridge {jbridge.__version__}")
        parser.exit()


def parser() -> Parser:
    """The parser of all commands."""
    made = Parser(
        prog="jbridge",
        description="A simulator of a laboratory loading bridge (gantry crane)\n"
        "that finds out why recordings and simulation differ.",
        epilog="example:\n  jbridge diagnose model.toml monday-*.csv --holdout tuesday-1.csv --out report",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    made.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = made.add_subparsers(dest="command", metavar="COMMAND", required=True, title="commands")
    for each in COMMANDS.values():
        each.add(commands)
    return made
