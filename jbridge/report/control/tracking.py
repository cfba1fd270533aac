"""What `control` leaves: the run as a recording, how each move went, and the pictures."""

import dataclasses
import json
import math
import textwrap
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._types import Axes
from ...control.base import Reference
from ...control.files import Controller, save_controller
from ...control.fuzzy import FuzzyController
from ...fuzzy.inference import AbstractSystem
from ...recordings import save_csv
from ...simulation.noise import NOISE
from ...simulation.tracking import Tracking
from ..figures.control.fuzzy import draw_rules, draw_surfaces, silent_share
from ..figures.control.tracking import Run, draw_commands, draw_positions, draw_way
from ..figures.style import Picture
from ..files import PathLike, alone_in_folder, write_bytes, write_text
from ..text.html import page
from ..text.quantities import digits, percent, plain
from ..text.tables import WIDTH, Table
from ..text.words import capital
from .warnings import tracking_warnings, warning_lines

RUN = "run.csv"
_NEVER = "not within the time"
_HEAD = (
    "move",
    "to x, l [m]",
    "x and l settled [s]",
    "load settled [s]",
    "overshoot of x, l",
    "steady error of x, l",
    "swing left",
    "travel of u_x, u_l [{}]",
    "sign changes of u_x, u_l",
    "u_x, u_l at the limit",
)


@alone_in_folder
def save_tracking(folder: PathLike, tracking: Tracking, controller: Controller) -> Path:
    """Writes run.csv (the run as a recording), controller.toml, control.json, figures/*.png and control.html.

    Args:
        folder: where to.
        tracking: the closed loop.
        controller: what commanded it.

    Returns:
        The path of control.html.

    Raises:
        InputError: if a file cannot be written.
    """
    target = Path(folder)
    save_csv(target / RUN, tracking.columns)
    save_controller(target / "controller.toml", controller)
    moves = [dataclasses.asdict(move) for move in tracking.moves]
    remarks = [*map(capital, tracking_warnings(tracking)), *silence(tracking, controller)]
    content = {
        "schema": 1,
        "moves": moves,
        "warnings": remarks,
        "noise": list(tracking.noise),
        "units": _units(tracking),
    }
    write_text(target / "control.json", json.dumps(content, indent=2) + "\n")
    pictures = (*tracking_pictures(tracking), *rule_pictures(tracking, controller))
    for drawn in pictures:
        write_bytes(target / "figures" / f"{drawn.name}.png", drawn.png)
    moved = _table(tracking)
    shown = page(
        "control.html",
        tracking=tracking,
        moves=moved,
        noise=noise_sentence(tracking),
        remarks=remarks,
        pictures=pictures,
    )
    write_text(target / "control.html", shown)
    return target / "control.html"


def describe_tracking(tracking: Tracking, folder: PathLike | None = None) -> str:
    """How each move went, as a table for the terminal."""
    lines = [
        *warning_lines(tracking_warnings(tracking)),
        *_table(tracking).turned(),
        *textwrap.wrap(noise_sentence(tracking), WIDTH),
    ]
    if folder is not None:
        lines += [f"Report      {Path(folder) / 'control.html'}", f"            {Path(folder) / RUN}"]
    return "\n".join(lines) + "\n"


def tracking_pictures(tracking: Tracking) -> tuple[Picture, ...]:
    """Positions, commands and the load's way."""
    reference: Run = {"t": tracking.times, **tracking.reference}
    units = _units(tracking)
    runs: dict[str, Run] = {"simulated": {"t": tracking.times, **tracking.position, **tracking.command}}
    stops = [("start", float(tracking.reference["x"][0]), float(tracking.reference["l"][0]))]
    for number, goal in enumerate(_goals(tracking), start=1):
        stops.append((f"goal {number}", *goal))
    return (
        draw_positions("positions", "Positions along the reference", reference, runs),
        draw_commands("commands", "What the controller commands", runs, units),
        draw_way("way", "The way of the load", reference, runs, stops),
    )


def rule_pictures(tracking: Tracking, controller: Controller) -> tuple[Picture, ...]:
    """For a fuzzy controller, what its rules say and which of them spoke when."""
    pictures = []
    units = dict(zip(("cart", "hoist"), _units(tracking).values(), strict=True))
    for axis, system, found in _asked(tracking, controller):
        most = 0.5 * float(system.inputs[0].high - system.inputs[0].low)
        reach = most * float(np.clip(1.2 * np.abs(found[:, 0]).max() / most, 0.02, 1.0))
        scale, unit = float(getattr(controller.law, f"{axis}_scale")), units[axis]
        pictures += [
            draw_rules(f"rules-{axis}", f"The {axis}'s rules over time", system, tracking.times, found, unit),
            draw_surfaces(
                f"surface-{axis}", f"What the {axis}'s rules say", {axis: system}, scale * reach, [scale], unit
            ),
        ]
    return tuple(pictures)


def silence(tracking: Tracking, controller: Controller) -> list[str]:
    """Sentences on times in which no rule of a fuzzy controller fired."""
    shares = {axis: silent_share(system, values) for axis, system, values in _asked(tracking, controller)}
    return [
        f"No rule of the {axis} fires in {percent(share)} of the time; its command is then the middle of its range."
        for axis, share in shares.items()
        if share > 0
    ]


def _asked(tracking: Tracking, controller: Controller) -> list[tuple[str, AbstractSystem, NDArray[np.float64]]]:
    """Each fuzzy system of a controller and its inputs over the run; nothing for another law."""
    law = controller.law
    if not isinstance(law, FuzzyController):
        return []
    measured = Axes(*(jnp.asarray(tracking.measured[axis]) for axis in ("x", "psi", "l")))
    columns = [told[axis] for told in (tracking.reference, tracking.reference_speed) for axis in ("x", "l")]
    wanted = Reference(*map(jnp.asarray, columns))
    asked = law.inputs(measured, wanted, controller.period)
    systems = (("cart", law.cart), ("hoist", law.hoist))
    return [(axis, system, np.asarray(values)) for (axis, system), values in zip(systems, asked, strict=True)]


def _goals(tracking: Tracking) -> list[tuple[float, float]]:
    ends = [*(move.start for move in tracking.moves[1:]), float("inf")]
    out = []
    for end in ends:
        row = int((tracking.times < end).sum()) - 1
        out.append((float(tracking.reference["x"][row]), float(tracking.reference["l"][row])))
    return out


def noise_sentence(tracking: Tracking) -> str:
    """What the encoders add to what the controller reads."""
    if not any(tracking.noise):
        return "Encoders read without noise."
    x, psi, l = tracking.noise
    sizes = f"{plain(1e3 * x)} mm (x), {plain(math.degrees(psi))}° (psi)"
    # No sensor reads a rope that is locked.
    sizes += f", {plain(1e3 * l)} mm (l)" if l else ""
    also = " and in tune" if tracking.noise in (NOISE, (*NOISE[:2], 0.0)) else ""
    return f"Encoders read with noise, the same in every run{also}: {sizes}, standard deviations."


def _units(tracking: Tracking) -> dict[str, str]:
    """Unit of each input."""
    return {name: tracking.units.get(name, "V") for name in tracking.command}


def _table(tracking: Tracking) -> Table:
    """How each move went."""
    units = dict.fromkeys(f"{unit}/s" for unit in _units(tracking).values())
    return Table([name.format(", ".join(units)) for name in _HEAD], _rows(tracking))


def _rows(tracking: Tracking) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for number, (move, (x, l)) in enumerate(zip(tracking.moves, _goals(tracking), strict=True), start=1):
        settled = [
            _NEVER if move.settling_time[k] is None else digits(move.settling_time[k]) for k in ("x", "l", "load")
        ]
        rows.append(
            (
                str(number),
                f"{x:.3g}, {l:.3g}",
                f"{settled[0]}, {settled[1]}",
                settled[2],
                ", ".join(f"{plain(100 * move.overshoot[k])} %" for k in ("x", "l")),
                ", ".join(f"{plain(1e3 * move.steady_error[k])} mm" for k in ("x", "l")),
                f"{plain(math.degrees(move.residual_swing))}°",
                ", ".join(plain(move.travel[k]) for k in ("x", "l")),
                ", ".join(str(move.sign_changes[k]) for k in ("x", "l")),
                ", ".join(percent(move.saturation[k]) for k in ("x", "l")),
            )
        )
    return rows
