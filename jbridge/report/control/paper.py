"""The paper's figures and tables, from saved data."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..._files import read_json
from ...control.paper import ERROR_RANGE, cart_system, hoist_system
from ...errors import InputError
from ...fuzzy.inference import Mamdani
from ..figures.control.paper import (
    RIG,
    arrays,
    draw_friction,
    draw_sets,
    draw_sketch,
    draw_starts,
    draw_tracking,
    draw_validation,
)
from ..figures.style import Picture
from ..files import PathLike, alone_in_folder, write_bytes, write_text
from ..text.words import effect_name

TABLE = "paper-table.md"
_SOUGHT = ("steps", "tracking", "friction", "numbers")


def save_paper(folder: PathLike, data: PathLike) -> tuple[Path, ...]:
    """Draws Figures 1, 4, 5, 6, 8, 9 and 10, the friction by place, and the tables.

    Args:
        folder: where to.
        data: what `experiments/paper/run.py` saved.

    Returns:
        The files, in order.

    Raises:
        InputError: the data are not there, or a file cannot be written.
    """
    try:
        saved = read_json(Path(data))
    except FileNotFoundError:
        raise InputError(f"{data}: no such file; run python experiments/paper/run.py first") from None
    except OSError as problem:
        reason = (problem.strerror or "cannot be read").lower()
        raise InputError(f"{data}: {reason}; give the file that experiments/paper/run.py saved") from None
    except ValueError:
        raise InputError(f"{data}: not the data of experiments/paper/run.py; run it again") from None
    missing = [key for key in _SOUGHT if key not in saved]
    if missing:
        raise InputError(f"{data}: has no {', '.join(missing)}; run python experiments/paper/run.py to its end")
    return _save(folder, saved)


@alone_in_folder
def _save(folder: PathLike, saved: Mapping[str, Any]) -> tuple[Path, ...]:
    target, pictures = Path(folder), paper_pictures(saved)
    for drawn in pictures:
        write_bytes(target / f"{drawn.name}.png", drawn.png)
    write_text(target / TABLE, paper_tables(saved))
    return (*(target / f"{drawn.name}.png" for drawn in pictures), target / TABLE)


def paper_pictures(saved: Mapping[str, Any]) -> tuple[Picture, ...]:
    assumed = "corners assumed: the paper prints none"
    return (
        draw_sketch(),
        draw_validation(saved["steps"]),
        draw_sets(
            "paper-figure-5", "Sets of the cart's controller", cart_system(), f"Figure 5 of the paper; {assumed}"
        ),
        draw_sets(
            "paper-figure-6", "Sets of the hoist's controller", hoist_system(), f"Figure 6 of the paper; {assumed}"
        ),
        *draw_tracking(saved["tracking"]),
        draw_friction(saved["friction"]),
        *([draw_starts(saved["starts"])] if "starts" in saved else []),
    )


def paper_tables(saved: Mapping[str, Any]) -> str:
    """Tables 1 and 2, what the paper says in words beside what is measured, and the numbers found."""
    lines = [
        "# The paper's experiments, repeated",
        "",
        f"The paper's device is not at hand; a {RIG} plays it (MuJoCo, true stick-slip, its numbers concealed from the",
        "estimation). Redrawn by `jbridge figures`, measured by `python experiments/paper/run.py`; do not edit.",
        "",
        "## Table 1: given parameters",
        "",
        "| parameter | paper | here |",
        "|---|---|---|",
        "| r | 0.3183 m (a circumference of 2 m; 0.03183 m likely) | not used: the rope's force and speed are |",
        "| m_t | 0.2 kg | as J/r^2 = m_t/2 = 0.1 kg, a solid drum |",
        "| m_1 | 5.5 kg | 5.5 kg |",
        "| m_2 | 0.143 kg | 0.143 kg |",
        "",
        "## Table 2: universes of the controllers",
        "",
        "| controller | variable | lower | upper | unit |",
        "|---|---|---|---|---|",
        *_universes("cart position x", cart_system()),
        *_universes("rope length l", hoist_system()),
        "",
        f"The error is divided by {ERROR_RANGE:g} m, the paper's range, and its sets lie on [-1, 1].",
        "",
        "## What the paper says, and what is measured here",
        "",
        "| paper | measured |",
        "|---|---|",
        *_words(saved),
        "",
        "## Numbers found beside the virtual rig's own",
        "",
        "| number | rig | found | error |",
        "|---|---|---|---|",
        *_numbers(saved),
    ]
    return "\n".join(lines) + "\n"


def _universes(name: str, system: Mamdani) -> list[str]:
    units = {"error": "m", "velocity": "m/s", "angle": "deg", "voltage": "V"}
    rows = []
    for variable in (*system.inputs, *system.outputs):
        factor = ERROR_RANGE if variable.name == "error" else 1.0
        low, high = (factor * float(end) for end in (variable.low, variable.high))
        rows.append(f"| {name} | {variable.name} | {low:g} | {high:g} | {units[variable.name]} |")
    return rows


def _words(saved: Mapping[str, Any]) -> list[str]:
    steps, tracking = saved["steps"], saved["tracking"]
    rig, before, after = (arrays(steps[name]) for name in ("rig", "before", "after"))

    def away(run: Mapping[str, np.ndarray]) -> float:
        return 1e3 * float(np.sqrt(np.mean((run["x"] - rig["x"]) ** 2)))

    back = 1e3 * (rig["x"][-1] - rig["x"][0])
    moves, rms = tracking["moves"], tracking["rms"]
    over = {name: [100 * max(m["overshoot"][k] for m in moves[name]) for k in ("x", "l")] for name in moves}
    steady = {name: [1e3 * max(abs(m["steady_error"][k]) for m in moves[name]) for k in ("x", "l")] for name in moves}
    effort = {name: [float(np.mean([m["effort"][k] for m in moves[name]])) for k in ("x", "l")] for name in moves}
    errors = [abs(row["error"]) for row in saved["friction"]]
    rows = [
        ("the cart does not return to the initial position", f"it ends {back:+.1f} mm from where it was ({RIG})"),
        (
            "friction is not constant along the bar and depends on direction",
            f"found by partition and direction: median error {100 * float(np.median(errors)):.1f} %, "
            f"largest {100 * max(errors):.1f} %",
        ),
        (
            "the adjusted model closes the gap (Figure 4)",
            f"error of x over the steps {away(before):.1f} mm before, {away(after):.2f} mm after",
        ),
        (
            "the discrepancy between model and device in tracking is quite small (Figure 8)",
            f"rms x {1e3 * rms['x']:.2f} mm, l {1e3 * rms['l']:.2f} mm, psi {np.degrees(rms['psi']):.2f} degrees",
        ),
        (
            "slight overshoots",
            f"x {over['model'][0]:.1f} % (model), {over['rig'][0]:.1f} % ({RIG}); "
            f"l {over['model'][1]:.1f} %, {over['rig'][1]:.1f} %",
        ),
        (
            "a negligible steady-state error",
            f"x {steady['model'][0]:.1f} mm (model), {steady['rig'][0]:.1f} mm ({RIG}); "
            f"l {steady['model'][1]:.1f} mm, {steady['rig'][1]:.1f} mm",
        ),
        (
            "the actuators of the real device are slightly more loaded",
            f"mean square voltage, rig over model: cart {effort['rig'][0] / effort['model'][0]:.2f}, "
            f"hoist {effort['rig'][1] / effort['model'][1]:.2f}",
        ),
    ]
    if "starts" in saved:
        ratios = np.asarray(saved["starts"]["ratios"], dtype=float)
        arrived = int(np.sum(ratios <= 1.01 * np.nanmin(ratios)))
        rows.append(
            (
                "parameters found by comparing simulation and device",
                f"{arrived} of {len(ratios)} random starts (50 %) arrive within 1 % of the smallest error",
            )
        )
    if "diagnosis" in saved:
        told = saved["diagnosis"]
        named = "; ".join(effect_name(kind, site) for kind, site in told["effects"])
        rows.append(
            (
                "friction by place and direction, dead zones and the winch's delay have to be modelled",
                f"`jbridge diagnose` alone, from a viscous model: `{told['verdict']}`; named: {named or 'nothing'}",
            )
        )
    return [f"| {said} | {measured} |" for said, measured in rows]


def _numbers(saved: Mapping[str, Any]) -> list[str]:
    rows = []
    for row in saved["numbers"]:
        if row.get("std") is None:
            continue
        error = 100 * (row["value"] / row["rig"] - 1)
        rows.append(f"| {row['name']} | {row['rig']:.4g} {row['unit']} | {row['value']:.4g} | {error:+.2f} % |")
    return rows
