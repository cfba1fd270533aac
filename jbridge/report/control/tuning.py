"""What `tune` leaves: the tuned controller, how it compares, and the pictures."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...control.base import AbstractController
from ...control.files import has_file, save_controller
from ...control.fuzzy import FuzzyController
from ...export.c import controller_header
from ...fuzzy.inference import Mamdani
from ...simulation.move_summary import UNITS
from ...tuning.tune import Tuning
from ..figures.control.fuzzy import draw_changed_sets, draw_descent, draw_ensemble, draw_surfaces
from ..figures.control.tracking import draw_positions
from ..figures.style import Picture
from ..files import PathLike, alone_in_folder, write_bytes, write_text
from ..text.html import page
from ..text.quantities import digits, plain
from ..text.tables import Table
from ..text.words import capital
from .warnings import SHOWN, shown_unit, tuning_warnings, warning_lines

_DRAWN = ("settling_load", "residual_swing", "itae_x")
_SHOWN_ERROR = 0.2
"""How far from zero surfaces show the error, as a share of the larger scale."""
_COURSES = {"train": "tuned on", "held_out": "held out"}


@alone_in_folder
def save_tuning(folder: PathLike, tuning: Tuning) -> Path:
    """Writes controller.toml (tuned), controller.h (the same in C), tune.json, figures/*.png and tune.html.

    Raises:
        InputError: if a file cannot be written.
    """
    target = Path(folder)
    if has_file(tuning.controller.law):
        save_controller(target / "controller.toml", tuning.controller)
        write_text(target / "controller.h", controller_header(tuning.controller, "controller"))
    told: dict[str, Any] = {
        "schema": 1,
        "cost": {name: {"before": a, "after": b} for name, (a, b) in tuning.costs.items()},
        "coordinates": dict(tuning.coordinates),
        "measures": {
            name: {key: {"before": _numbers(before[key]), "after": _numbers(after[key])} for key in UNITS}
            for name, (before, after) in tuning.measures.items()
        },
        "units": {key: re.sub("V", tuning.units.get(f"u_{key[-1]}", "V"), unit) for key, unit in UNITS.items()},
        "history": _numbers(tuning.history),
        "rollouts": tuning.rollouts,
        "seconds": tuning.seconds,
    }
    write_text(target / "tune.json", json.dumps(told, indent=1) + "\n")
    pictures = tuning_pictures(tuning)
    for drawn in pictures:
        write_bytes(target / "figures" / f"{drawn.name}.png", drawn.png)
    write_text(target / "tune.html", _page(tuning, pictures))
    return target / "tune.html"


def _numbers(values: NDArray[np.float64]) -> Any:
    """Nested lists, with null for what never happened."""
    return [_numbers(value) if np.ndim(value) else (float(value) if np.isfinite(value) else None) for value in values]


def describe_tuning(tuning: Tuning, folder: PathLike | None = None) -> str:
    """How the tuned controller compares, as a table for the terminal."""
    head, rows = _rows(tuning)
    lines = [*warning_lines(tuning_warnings(tuning)), *Table(head, rows).lines()]
    lines += ["", "Medians, the largest in brackets."]
    lines += [f"{tuning.rollouts:,} simulated moves in {tuning.seconds:.0f} s"]
    if folder is not None:
        lines += [f"Report      {Path(folder) / 'tune.html'}"]
        if has_file(tuning.controller.law):
            lines += [f"            {Path(folder) / 'controller.toml'}"]
    return "\n".join(lines) + "\n"


def tuning_pictures(tuning: Tuning) -> tuple[Picture, ...]:
    """Sets, surfaces, cost over the steps, and the spread over the held-out bridges."""
    before, after = tuning.given.law, tuning.controller.law
    pictures = [
        draw_ensemble(
            "ensemble",
            "Held-out bridges and moves",
            {"as given": tuning.measures["held_out"][0], "tuned": tuning.measures["held_out"][1]},
            {key: (f"{SHOWN[key][0]} [{SHOWN[key][1]}]", SHOWN[key][2]) for key in _DRAWN},
            "How many of them stay below a value; a line that ends below 100 % has moves that never settle.",
        ),
        _responses(tuning),
        draw_descent("descent", "The way down", tuning.history, tuning.softness),
    ]
    for axis, drive in (("cart", "u_x"), ("hoist", "u_l")):
        pictures += _changed(axis, before, after, tuning.units.get(drive, "V"))
    return tuple(pictures)


def _responses(tuning: Tuning) -> Picture:
    given, tuned = tuning.responses
    units = {name: tuning.units.get(name, "V") for name in ("u_x", "u_l")}
    wanted = {"t": given["t"], "x": given["x_ref"], "l": given["l_ref"]}
    return draw_positions(
        "response", "The first move, on the model itself", wanted, {"as given": given, "tuned": tuned}, units
    )


def _changed(axis: str, before: AbstractController, after: AbstractController, unit: str) -> list[Picture]:
    """Sets and surfaces of one axis (`cart`, `hoist`), as given and tuned; none if its system is not Mamdani's."""
    if not isinstance(before, FuzzyController) or not isinstance(after, FuzzyController):
        return []
    old, new = getattr(before, axis), getattr(after, axis)
    if not isinstance(old, Mamdani) or not isinstance(new, Mamdani):
        return []
    scales = float(getattr(before, f"{axis}_scale")), float(getattr(after, f"{axis}_scale"))
    pair = {"as given": old, "tuned": new}
    return [
        draw_changed_sets(f"sets-{axis}", f"Fuzzy sets of the {axis}", old, new, scales, unit),
        draw_surfaces(
            f"surface-{axis}", f"What the {axis}'s rules say", pair, _SHOWN_ERROR * max(scales), scales, unit
        ),
    ]


def _rows(tuning: Tuning) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    head = ("", *(f"{said}, {when}" for said in _COURSES.values() for when in ("as given", "tuned")))
    rows = [
        ("cost", *(digits(value) for name in _COURSES for value in tuning.costs[name])),
    ]
    for key, (said, _, factor) in SHOWN.items():
        cells = [_spread(factor * own[key]) for name in _COURSES for own in tuning.measures[name]]
        rows.append((f"{said} [{shown_unit(key, tuning.units)}]", *cells))
    return head, rows


def _spread(values: NDArray[np.float64]) -> str:
    filled = np.where(np.isnan(values), np.inf, values)
    middle, most = float(np.median(filled)), float(np.max(filled))
    never = int(np.isinf(filled).sum())
    largest = f"{never} never" if never else plain(most, 3)
    return f"{plain(middle, 3) if np.isfinite(middle) else 'never'} ({largest})"


def _page(tuning: Tuning, pictures: tuple[Picture, ...]) -> str:
    before, after = tuning.costs["held_out"]
    head, rows = _rows(tuning)
    moved = sorted(tuning.coordinates.items(), key=lambda item: -abs(item[1]))
    return page(
        "tune.html",
        before=before,
        after=after,
        remarks=[capital(text) for text in tuning_warnings(tuning)],
        measures=Table(head, rows, range(1, len(head))),
        pictures=pictures,
        moved=Table(("number", "factor"), [(name, digits(float(np.exp(value)))) for name, value in moved], (1,)),
    )
