"""Table and pictures of the controllers that `run.py` compares, from its kept numbers alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

plt.style.use("jbridge.report.figures.common")

COMPARED = {
    "paper": "#0a6ebd",
    "paper tuned": "#00805c",
    "extended tuned": "#8a4f9e",
    "PID tuned, ZV": "#dd6a00",
    "LQR": "#3c3c3c",
}
"""Controllers that the pictures show, and their colours."""
_MOVES = ("paper", "paper tuned", "extended tuned", "LQR")
_MEASURES = {
    "settling_load": ("load settled [s]", 1.0),
    "residual_swing": ("swing left [deg]", 180 / np.pi),
    "itae_x": ("ITAE of x [m s^2]", 1.0),
}
_POSITIONS = {
    "x": ("cart position\nx [m]", 1.0),
    "l": ("rope length\nl [m]", 1.0),
    "psi": ("swing angle\npsi [deg]", 180 / np.pi),
}
_VOLTAGES = {"u_x": ("cart drive\nu_x [V]", 1.0), "u_l": ("hoist drive\nu_l [V]", 1.0)}


def draw(kept: Mapping[str, Any], folder: Path) -> None:
    """Writes `tuning-table.md` and `tuning-*.png`."""
    (folder / "tuning-table.md").write_text(table(kept), encoding="utf-8")
    for name, figure in pictures(kept).items():
        figure.savefig(folder / f"tuning-{name}.png", dpi=110, metadata={"Software": None})
        plt.close(figure)


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
            "",
            "![The fastest moves](tuning-limit.png)",
        ]
    lines += [
        "",
        "![How many held-out bridges and moves stay below a value; what never settles is missing](tuning-ensemble.png)",
        "",
        "![The first move on the virtual rig](tuning-move-1.png)",
        "",
        "![The second move on the virtual rig](tuning-move-2.png)",
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


def pictures(kept: Mapping[str, Any]) -> dict[str, plt.Figure]:
    """The held-out bridges, both moves on the virtual rig, and the fastest moves, as far as they were computed."""
    out = {"ensemble": _ensemble(kept)}
    for number in range(2):
        shown = [name for name in _MOVES if name in kept["controllers"]]
        runs = {name: kept["controllers"][name]["rig"][number]["run"] for name in shown}
        reference = kept["controllers"][shown[0]]["rig"][number]["reference"]
        out[f"move-{number + 1}"] = _run(f"Move {number + 1} on the virtual rig", runs, _POSITIONS, reference)
    if "limit" in kept:
        runs = {f"move {k}, {move['seconds']:.2f} s": move["run"] for k, move in enumerate(kept["limit"], start=1)}
        title = "The fastest swing-free moves found, on the fitted model"
        out["limit"] = _run(title, runs, _POSITIONS | _VOLTAGES)
    return out


def _ensemble(kept: Mapping[str, Any]) -> plt.Figure:
    """How many bridges and moves stay below what: a panel for each measure, a line for each controller."""
    figure, panels = plt.subplots(1, len(_MEASURES), figsize=(8.0, 3.5), layout="constrained")
    for panel, (key, (label, factor)) in zip(panels, _MEASURES.items(), strict=True):
        for name, colour in COMPARED.items():
            if name in kept["controllers"]:
                values = np.sort(factor * _values(kept, name, "held_out", key).ravel())  # never comes last
                panel.step(
                    values, 100 * np.arange(1, len(values) + 1) / len(values), where="post", color=colour, label=name
                )
        panel.set_xlabel(label)
        panel.set_ylim(0, 101)
    panels[0].set_ylabel("held-out bridges and moves [%]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=5, fontsize=9)
    return figure


def _run(
    title: str,
    runs: Mapping[str, Mapping[str, list[float]]],
    rows: Mapping[str, tuple[str, float]],
    reference: Mapping[str, list[float]] | None = None,
) -> plt.Figure:
    """Signals over time, one panel each."""
    figure, panels = plt.subplots(len(rows), 1, figsize=(8.0, 2.0 * len(rows)), sharex=True, layout="constrained")
    for panel, (key, (label, factor)) in zip(panels, rows.items(), strict=True):
        if reference and key in reference:
            panel.plot(reference["t"], reference[key], color="#3c3c3c", alpha=0.5, lw=3.2, label="reference")
        for (name, run), dashes in zip(runs.items(), ("-", "--", ":", "-."), strict=False):
            panel.plot(run["t"], factor * np.array(run[key], float), dashes, color=COMPARED.get(name), label=name)
        panel.set_ylabel(label)
    panels[-1].set_xlabel("time [s]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), fontsize=9)
    return figure
