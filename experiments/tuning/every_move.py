"""Table and picture of the moves on rigs that were known by their recordings alone, from kept numbers."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

plt.style.use("jbridge.report.figures.common")

NAME = "tuning-from-recordings"
RIVAL, OURS = "paper's rules", "extended rules tuned"
COLOURS = {RIVAL: "#dd6a00", OURS: "#0a6ebd"}
Moves = dict[str, list[dict[str, Any]]]
"""Of each controller, how every move went."""


def draw(kept: dict[str, Any], folder: Path) -> None:
    """Writes the table in markdown and the picture."""
    (folder / f"{NAME}.md").write_text(table(kept), encoding="utf-8")
    figure = picture(kept)
    figure.savefig(folder / f"{NAME}.png", dpi=110, metadata={"Software": None})
    plt.close(figure)


def table(kept: dict[str, Any]) -> str:
    """All controllers in one line each, then every move of the paper's rules and of the tuned ones, then the rigs."""
    names = list(next(iter(kept.values()))["moves"])
    every = {name: [move for rig in kept.values() for move in rig["moves"][name]] for name in names}
    count = len(every[RIVAL])
    lines = [
        "# Controllers tuned from recordings",
        "",
        f"Rigs ({', '.join(kept)}) in another engine (MuJoCo), with friction by place and direction,",
        "dead zones and a delay in each drive. `jbridge` knows them by six recordings and the paper's model",
        "with round guesses, which has no delays: `jbridge fit` estimates the model, `jbridge tune` makes the",
        "extended rules fit it, and the rig plays them, the paper's two moves and six others, 10 s each. Settled:",
        "the load is within 1 cm of the goal, sideways and in the rope's length, until the end. Swing: largest",
        "angle over the last quarter of the rest, by an encoder of 0.088 degrees a count. ITAE: of cart and",
        "rope together.",
        "Redrawn by `python experiments/tuning/from_recordings.py --figures`; do not edit.",
        "",
        f"| controller | moves settled, of {count} | settled, median [s] | swing, median (worst) [deg] |"
        " ITAE, median (worst) [m s^2] | travel of u_x, median [V/s] |",
        "|---|---|---|---|---|---|",
        *(_summary(name, moves) for name, moves in every.items()),
        "",
        f"Moves of {count} that go better than with the paper's rules (settle earlier, or at all; less swing; ITAE):",
        "",
        "| controller | settling | swing (equal) | ITAE | all three |",
        "|---|---|---|---|---|",
        *(_better(name, moves, every[RIVAL]) for name, moves in every.items() if name != RIVAL),
        "",
        f"![Every move: the load's distance from its goal]({NAME}.png)",
        "",
        "## Every move",
        "",
        f"The {RIVAL} / the {OURS}.",
        "",
        "| rig | move | from x, l to x, l [m] | settled [s] | swing [deg] | ITAE [m s^2] |",
        "|---|---|---|---|---|---|",
        *(row for number, rig in kept.items() for row in _moves(number, rig["moves"])),
        "",
        "## Fits and tuning",
        "",
        "The fit's errors on a recording that took no part, and the tuning's held-out bridges (as given / tuned):",
        "",
        "| rig | delays [ms] | error of x, psi, l | bridges, steps | moves never settled | travel of u_x [V/s] |"
        " fit, tuning [s] |",
        "|---|---|---|---|---|---|---|",
        *(_rig(number, rig) for number, rig in kept.items()),
    ]
    return "\n".join([*lines, ""])


def _settled(move: dict[str, Any]) -> float:
    time = move["settling"]["load"]
    return np.inf if time is None else time


def _itae(move: dict[str, Any]) -> float:
    return sum(move["itae"].values())


def _swing(move: dict[str, Any]) -> float:
    return float(np.degrees(move["swing"]))


def _time(seconds: float) -> str:
    return f"{seconds:.3g}" if np.isfinite(seconds) else "never"


def _summary(name: str, moves: list[dict[str, Any]]) -> str:
    times, swings, errors = ([of(move) for move in moves] for of in (_settled, _swing, _itae))
    travel = float(np.median([move["travel"]["x"] for move in moves]))
    return (
        f"| {name} | {np.isfinite(times).sum()} | {_time(float(np.median(times)))} |"
        f" {np.median(swings):.2g} ({max(swings):.2g}) | {np.median(errors):.3g} ({max(errors):.3g}) | {travel:.2g} |"
    )


def _better(name: str, moves: list[dict[str, Any]], rivals: list[dict[str, Any]]) -> str:
    pairs = list(zip(moves, rivals, strict=True))
    wins = np.array([[of(ours) < of(theirs) for of in (_settled, _swing, _itae)] for ours, theirs in pairs])
    equal = sum(bool(np.isclose(_swing(ours), _swing(theirs))) for ours, theirs in pairs)
    settling, swing, itae = wins.sum(axis=0)
    return f"| {name} | {settling} | {swing} ({equal}) | {itae} | {wins.all(axis=1).sum()} |"


def _moves(rig: str, moves: Moves) -> list[str]:
    rows = []
    for number, pair in enumerate(zip(moves[RIVAL], moves[OURS], strict=True), start=1):
        ends = " to ".join(", ".join(f"{value:.2f}" for value in pair[0][key]) for key in ("from", "to"))
        settled = " / ".join(_time(_settled(move)) for move in pair)
        swing = " / ".join(f"{_swing(move):.2g}" for move in pair)
        itae = " / ".join(f"{_itae(move):.3g}" for move in pair)
        rows.append(f"| {rig} | {number} | {ends} | {settled} | {swing} | {itae} |")
    return rows


def _rig(number: str, rig: dict[str, Any]) -> str:
    delays = ", ".join(f"{1e3 * e['delay']:.3g}" for e in rig["truth"] if e["kind"] == "input_delay")
    errors, before, after = rig["holdout"], rig["ensemble"]["before"], rig["ensemble"]["after"]
    error = f"{1e3 * errors['x']:.2g} mm, {np.degrees(errors['psi']):.2g} deg, {1e3 * errors['l']:.2g} mm"
    never = f"{before['never']} / {after['never']} of {after['moves']}"
    seconds = ", ".join(f"{rig['seconds'][key]:.0f}" for key in ("fit", "tune"))
    travel = f"{before['travel']:.2g} / {after['travel']:.2g}"
    search = f"{rig['search']['bridges']}, {rig['search']['steps']}"
    return f"| {number} | {delays} | {error} | {search} | {never} | {travel} | {seconds} |"


def picture(kept: dict[str, Any]) -> plt.Figure:
    """A row of panels for each rig, a panel for each move: sideways distance of the load from its goal over time."""
    count = len(next(iter(kept.values()))["moves"][OURS])
    figure, panels = plt.subplots(
        len(kept), count, figsize=(1.7 * count, 1.9 * len(kept) + 0.5), squeeze=False, sharex=True, sharey=True,
        layout="constrained",
    )  # fmt: skip
    for row, (number, rig) in zip(panels, kept.items(), strict=True):
        for k, panel in enumerate(row):
            wanted = rig["moves"][OURS][k]
            panel.axhspan(-10, 10, color="#e6e6e6")
            panel.plot(wanted["t"], 1e3 * np.array(wanted["wanted"]), color="#3c3c3c", lw=2.5, alpha=0.4)
            for name, colour in COLOURS.items():
                move = rig["moves"][name][k]
                panel.plot(move["t"], 1e3 * np.array(move["aside"]), color=colour, lw=1.1)
            panel.set_ylim(-60, 60)
            panel.set_title(f"rig {number}, move {k + 1}", fontsize=8)
            panel.tick_params(labelsize=7)
    keys = [plt.Line2D([], [], color=colour, label=name) for name, colour in COLOURS.items()]
    keys.append(plt.Line2D([], [], color="#3c3c3c", lw=2.5, alpha=0.4, label="reference"))
    figure.legend(handles=keys, loc="outside upper center", ncols=len(keys), fontsize=9)
    figure.supxlabel("time [s]", fontsize=9)
    figure.supylabel("load beside its goal [mm]", fontsize=9)
    return figure
