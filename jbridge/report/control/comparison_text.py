"""Table of controllers simulated on one model and one reference, with a recommendation."""

import textwrap
from collections.abc import Mapping

import numpy as np

from ...simulation.tracking import Tracking
from ..text.quantities import digits
from ..text.tables import WIDTH, Table


def describe_rivals(runs: Mapping[str, Tracking]) -> str:
    """A table of how controllers did, and which of them to take.

    To be taken is the one that settles the most moves, of several the one with the least mean time to settle; the text
    says so if another one does that with half the travel of its voltages or less.

    Args:
        runs: of each controller, by name, along the same reference.
    """
    head = (
        "controller", "moves settled", "load settled, s", "swing left", "ITAE x, l", "travel, V/s", "sign changes",
        "at the limit",
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
                f"{np.degrees(swing):.2g}°",
                ", ".join(map(digits, itae)),
                ", ".join(map(digits, travel)),
                ", ".join(map(str, changes)),
                ", ".join(f"{100 * share:.2g} %" for share in limit),
            )
        )
    return "\n".join([*Table(head, rows).turned(), *textwrap.wrap(_advice(runs), WIDTH)]) + "\n"


def _settled(run: Tracking) -> tuple[int, float]:
    """How many moves settle, and the mean time of those [s]."""
    times = [time for move in run.moves if (time := move.settling_time["load"]) is not None]
    return len(times), float(np.mean(times)) if times else np.inf


def _advice(runs: Mapping[str, Tracking]) -> str:
    best = min(runs, key=lambda name: (-_settled(runs[name])[0], _settled(runs[name])[1]))
    count, mean = _settled(runs[best])
    if not count:
        return "None of them settles a move: take none."
    of = len(runs[best].moves)
    text = f"Take {best}: on this model it settles {count} of {of} moves, in {digits(mean)} s on average."
    if count < of:
        text += f" The load does not settle in the other {of - count}."
    calm = min((name for name in runs if _settled(runs[name])[0] == count), key=lambda name: _travel(runs[name]))
    if calm != best and _travel(runs[calm]) <= 0.5 * _travel(runs[best]):
        text += f" {calm} settles as many with {_travel(runs[calm]) / _travel(runs[best]):.0%} of the travel of u_x."
    return text


def _travel(run: Tracking) -> float:
    return float(np.mean([move.travel["x"] for move in run.moves]))
