"""Controllers compared: a table and pictures, from the numbers that experiments/tuning/run.py keeps."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...control.files import load_controller
from ..figures.control.fuzzy import draw_descent, draw_ensemble
from ..figures.control.tracking import draw_positions
from ..figures.style import Picture
from ..files import PathLike, write_bytes, write_text
from .tuning import changed_pictures

COMPARED = ("paper", "paper tuned", "extended tuned", "PID tuned, ZV", "LQR")
"""Controllers that the pictures show."""
_MOVES = ("paper", "paper tuned", "extended tuned", "LQR")


def save_comparison(folder: PathLike, data: PathLike, tuned: PathLike) -> list[Path]:
    """Writes `tuning-table.md` and `tuning-*.png`.

    Args:
        folder: where to.
        data: the kept numbers, JSON.
        tuned: folder of the controllers as TOML, as far as they are there.
    """
    target = Path(folder)
    kept = json.loads(Path(data).read_text(encoding="utf-8"))
    write_text(target / "tuning-table.md", table(kept))
    drawn = pictures(kept, Path(tuned))
    for picture in drawn:
        write_bytes(target / f"{picture.name}.png", picture.png)
    return [target / "tuning-table.md", *(target / f"{picture.name}.png" for picture in drawn)]


def _values(kept: Mapping[str, Any], name: str, course: str, key: str) -> NDArray[np.float64]:
    found = kept["controllers"][name]["measures"][course][key]
    return np.array([[np.nan if value is None else value for value in row] for row in found], dtype=float)


def _spread(values: NDArray[np.float64], factor: float = 1.0) -> str:
    filled = np.where(np.isnan(values), np.inf, factor * values)
    middle, worst = float(np.median(filled)), float(filled.max())
    never = int(np.isinf(filled).sum())
    said = f"{never} of {filled.size} never" if never else f"{worst:.3g}"
    return f"{middle:.3g} ({said})" if np.isfinite(middle) else f"never ({said})"


def _number(value: float | None, factor: float = 1.0, digits: int = 3) -> str:
    return "never" if value is None else f"{factor * value:.{digits}g}"


def table(kept: Mapping[str, Any]) -> str:
    """Every controller on the virtual rig and on held-out bridges."""
    bridges, moves = _values(kept, next(iter(kept["controllers"])), "held_out", "itae_x").shape
    learned = 2 * kept["settings"]["plants"]
    lines = [
        "# Controllers compared",
        "",
        "The paper's two moves on the virtual rig (10 s each), and "
        f"{moves} random moves of its own on each of {bridges} held-out",
        "bridges: friction by a third, load mass by half, dead zones and lag by 0.3 about the fitted model. Settled:",
        "the load is within 1 cm of the goal, sideways and in the rope's length, for the last half second at least",
        "(the reference arrives 1.9 to 7.5 s after its start). Swing: largest angle over",
        "the last quarter of the rest. ITAE: of cart and rope, to the reference that the controller is given (for ZV",
        "and ZVD the shaped one). Of ensembles the median, the worst in brackets. Redrawn by",
        "`python experiments/tuning/run.py --figures`.",
        "",
        "| controller | rig: settled [s] | swing [deg] | larger overshoot of x and l [%] | ITAE [m s^2] |"
        " held out: settled [s] | swing [deg] | ITAE [m s^2] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, entry in kept["controllers"].items():
        rig = entry["rig"]
        settled = ", ".join(_number(run["settling"]["load"]) for run in rig)
        swing = ", ".join(_number(run["swing"], 180 / np.pi, 2) for run in rig)
        beyond = ", ".join(f"{100 * max(run['overshoot'].values()) + 0.0:.2g}" for run in rig)
        itae = ", ".join(f"{sum(run['itae'].values()):.3g}" for run in rig)
        held = [_values(kept, name, "held_out", key) for key in ("settling_load", "residual_swing")]
        errors = _values(kept, name, "held_out", "itae_x") + _values(kept, name, "held_out", "itae_l")
        others = " | ".join((_spread(held[0]), _spread(held[1], 180 / np.pi), _spread(errors)))
        lines.append(f"| {name} | {settled} | {swing} | {beyond} | {itae} | {others} |")
    if {"paper", "paper tuned", "extended tuned", "LQR"} <= set(kept["controllers"]):
        lines += ["", "| measure | aim | measured |", "|---|---|---|", *_aims(kept)]
    if "limit" in kept:
        ways = [move["run"] for move in kept["limit"]]
        shortest = 100 * min(min(run["l"]) for run in ways)
        widest = np.degrees(max(max(map(abs, run["psi"])) for run in ways))
        fastest, wanted = (
            " and ".join(f"{move[key]:.2f} s" for move in kept["limit"]) for key in ("seconds", "reference")
        )
        lines += [
            "",
            "The fastest swing-free moves that optimal control found on the fitted model within 3 V and 10 V take",
            f"{fastest} (`python experiments/tuning/limit.py`); the reference that all controllers follow takes",
            f"{wanted}. It is a limit and no proposal: on the way the rope is {shortest:.0f} cm short and the load",
            f"swings by {widest:.0f} degrees.",
        ]
    lines += [
        "",
        f"Cost of a search with the textbook's inference, on the {learned} moves that it was given. A value with its",
        "gradient counts as five rollouts.",
        "",
        "| search | rollouts | seconds | cost before | after |",
        "|---|---|---|---|---|",
    ]
    for name, entry in kept.get("tuning", {}).items():
        costs = " | ".join(f"{value:.3g}" for value in entry["costs"])
        lines.append(f"| {name} | {entry['rollouts']:,} | {entry['seconds']:.0f} | {costs} |")
    return "\n".join([*lines, ""])


def _aims(kept: Mapping[str, Any]) -> list[str]:
    """What was aimed at beside what is measured."""
    runs = {name: kept["controllers"][name]["rig"] for name in ("extended tuned", "LQR")}
    times = {name: [run["settling"]["load"] for run in own] for name, own in runs.items()}
    pairs = [f"{_number(a)} / {_number(b)} s" for a, b in zip(times["extended tuned"], times["LQR"], strict=True)]
    tuned = runs["extended tuned"]
    swing = ", ".join(f"{_number(run['swing'], 180 / np.pi, 2)} degrees" for run in tuned)
    beyond = ", ".join(f"{100 * max(run['overshoot'].values()) + 0.0:.2g} %" for run in tuned)
    errors = {
        name: _values(kept, name, "held_out", "itae_x") + _values(kept, name, "held_out", "itae_l")
        for name in ("paper", "paper tuned")
    }
    ratio = np.median(errors["paper tuned"]) / np.median(errors["paper"])
    late = {}
    for name in ("extended tuned", "LQR"):
        times_held = np.nan_to_num(_values(kept, name, "held_out", "settling_load"), nan=np.inf)
        most = np.quantile(times_held, 0.99, method="higher")
        late[name] = f"{np.isinf(times_held).sum()} of {times_held.size} never, 99 % within {_number(most)} s"
    seconds = kept["tuning"]["extended tuned"]["seconds"]
    rows = [
        ("extended rules tuned, virtual rig, load within 1 cm, against the LQR", "<= 1.1 times", ", ".join(pairs)),
        ("the same: residual swing", "<= 0.3 degrees", swing),
        ("the same: overshoot", "<= 2 %", beyond),
        ("paper's rules tuned, ITAE on held-out bridges, over that of the hand-set", "<= 0.5", f"{ratio:.2f}"),
        ("extended rules tuned, settling on held-out bridges", "no longer than", late["extended tuned"]),
        ("the LQR's", "", late["LQR"]),
        ("one tuning run", "<= 300 s", f"{seconds:.0f} s"),
    ]
    return [f"| {measure} | {aim} | {measured} |" for measure, aim, measured in rows]


def pictures(kept: Mapping[str, Any], tuned: Path) -> list[Picture]:
    shown = [name for name in COMPARED if name in kept["controllers"]]
    found = {
        name: {key: _values(kept, name, "held_out", key) for key in ("settling_load", "residual_swing", "itae_x")}
        for name in shown
    }
    out = [
        draw_ensemble(
            "tuning-ensemble",
            "{} held-out bridges, {} moves each".format(*next(iter(found.values()))["itae_x"].shape),
            found,
            {
                "settling_load": ("load settled [s]", 1.0),
                "residual_swing": ("swing left [deg]", 180 / np.pi),
                "itae_x": ("ITAE of x [m s^2]", 1.0),
            },
            "How many stay below a value; a line that ends below 100 % has moves that never settle.",
        )
    ]
    for number in range(2):
        runs = {}
        for name in (name for name in _MOVES if name in kept["controllers"]):
            run = kept["controllers"][name]["rig"][number]["run"]
            runs[name] = {key: np.array(values, dtype=float) for key, values in run.items()}
        reference = kept["controllers"][shown[0]]["rig"][number]["reference"]
        wanted = {key: np.array(values, dtype=float) for key, values in reference.items()}
        title = f"Move {number + 1} on the virtual rig"
        out.append(draw_positions(f"tuning-move-{number + 1}", title, wanted, runs))
    for name, entry in kept.get("tuning", {}).items():
        if name in ("paper tuned", "extended tuned") and "softness" in entry:
            curve, softness = (np.array(entry[key], dtype=float) for key in ("history", "softness"))
            said = f"{name.removesuffix(' tuned').capitalize()} rules: the way down"
            out.append(draw_descent(f"tuning-descent-{name.split()[0]}", said, [("tuned", curve)], softness))
    if "limit" in kept:
        runs = {
            f"move {number}, {move['seconds']:.2f} s": {key: np.array(values) for key, values in move["run"].items()}
            for number, move in enumerate(kept["limit"], start=1)
        }
        title = "The fastest swing-free moves found, on the fitted model"
        out.append(draw_positions("tuning-limit", title, {}, runs, volts=True))
    for name in ("paper", "extended"):
        files = [tuned / f"{name}.toml", tuned / f"{name}-tuned.toml"]
        if all(path.exists() for path in files):
            before, after = (load_controller(path).law for path in files)
            for picture in changed_pictures("cart", before, after, f", {name} rules"):
                kind = picture.name.removesuffix("-cart")
                out.append(dataclasses.replace(picture, name=f"tuning-{kind}-{name}"))
    return out
