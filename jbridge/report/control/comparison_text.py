"""Table of controllers simulated on one model and one reference, with a recommendation."""

import textwrap
from collections.abc import Mapping

import numpy as np

from ...simulation.tracking import Tracking
from ..text.quantities import digits, percent, plain
from ..text.tables import WIDTH, Table

_TIE = 1.05
"""Times to settle within this factor are alike: another rope or friction changes them by more."""


def describe_rivals(runs: Mapping[str, Tracking]) -> str:
    """A table of how controllers did, and which of them to take.

    To be taken is the one that settles the most moves, of several the one with the least mean time to settle, and of
    those that are as quick within 5 % the one whose cart's input travels least; the text says so if another one does
    that with half the travel of its inputs or less.

    Args:
        runs: of each controller, by name, along the same reference.
    """
    units = dict.fromkeys(f"{run.units.get(name, 'V')}/s" for run in runs.values() for name in run.command)
    head = (
        "controller", "moves settled", "load settled, s", "swing left", "ITAE x, l", f"travel, {', '.join(units)}",
        "sign changes", "at the limit",
    )  # fmt: skip
    rows = []
    for name, run in runs.items():
        times, mean = _settled(run)
        swing = max(move.residual_swing for move in run.moves)
        itae = (sum(move.itae[axis] for move in run.moves) for axis in ("x", "l"))
        travel = (float(np.mean([move.travel[axis] for move in run.moves])) for axis in ("x", "l"))
        limit = (float(np.mean([move.saturation[axis] for move in run.moves])) for axis in ("x", "l"))
        changes = (sum(move.sign_changes[axis] for move in run.moves) for axis in ("x", "l"))
        rows.append(
            (
                name,
                f"{times} of {len(run.moves)}",
                digits(mean) if times else "never",
                f"{plain(np.degrees(swing))}°",
                ", ".join(map(plain, itae)),
                ", ".join(map(plain, travel)),
                ", ".join(map(str, changes)),
                ", ".join(percent(share) for share in limit),
            )
        )
    return "\n".join([*Table(head, rows).turned(), *textwrap.wrap(_advice(runs), WIDTH)]) + "\n"


def _settled(run: Tracking) -> tuple[int, float]:
    """How many moves settle, and the mean time of those [s]."""
    times = [time for move in run.moves if (time := move.settling_time["load"]) is not None]
    return len(times), float(np.mean(times)) if times else np.inf


def _advice(runs: Mapping[str, Tracking]) -> str:
    count = max(_settled(run)[0] for run in runs.values())
    if not count:
        return "No controller settles any move; none is recommended."
    times = {name: mean for name, (number, mean) in ((n, _settled(run)) for n, run in runs.items()) if number == count}
    quick = [name for name, mean in times.items() if mean <= _TIE * min(times.values())]
    best = min(quick, key=lambda name: _travel(runs[name]))
    mean = times[best]
    of = len(runs[best].moves)
    text = f"Take {best}: on this model it settles {count} of {of} moves, in {digits(mean)} s on average."
    if count < of:
        text += f" The load does not settle in the other {of - count}."
    calm = min(times, key=lambda name: _travel(runs[name]))
    if calm != best and _travel(runs[calm]) <= 0.5 * _travel(runs[best]):
        text += f" {calm} settles as many with {_travel(runs[calm]) / _travel(runs[best]):.0%} of the travel of u_x."
    return text


def _travel(run: Tracking) -> float:
    return float(np.mean([move.travel["x"] for move in run.moves]))
