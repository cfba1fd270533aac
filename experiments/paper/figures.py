"""The paper's figures and tables with their numbers, from the numbers that `run.py` keeps."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Rectangle
from matplotlib.ticker import NullFormatter

import jbridge

plt.style.use("jbridge.report.figures.common")
RIG = "virtual rig"
DARK, BLUE, ORANGE, GREEN, GREY = "#3c3c3c", "#0a6ebd", "#dd6a00", "#00805c", "#909090"
POINTS = {"T_z": (0.0, 0.185), "T_1": (1.2, 0.6), "T_2": (0.5, 0.3)}
"""Cart positions and rope lengths that the paper's load visits [m]."""
UNITS = {"error": "m", "velocity": "m/s", "angle": "deg", "voltage": "V"}
AXES = {
    "x": ("cart position\nx [m]", 1.0),
    "l": ("rope length\nl [m]", 1.0),
    "psi": ("swing angle\npsi [deg]", 180 / np.pi),
}
INPUTS = {"u_x": "cart drive u_x [V]", "u_l": "hoist drive u_l [V]"}


def draw(kept: Mapping[str, Any], folder: Path) -> None:
    """Writes `paper-table.md` and `paper-*.png`."""
    (folder / "paper-table.md").write_text(table(kept), encoding="utf-8")
    for name, figure in pictures(kept).items():
        figure.savefig(folder / f"paper-{name}.png", dpi=110, metadata={"Software": None})
        plt.close(figure)


def pictures(kept: Mapping[str, Any]) -> dict[str, Figure]:
    """Figures 1, 4, 5, 6, 8, 9 and 10, the friction by place, and the estimation's starts where they were run."""
    law, tracking = jbridge.paper_controller(), kept["tracking"]
    reference, runs = arrays(tracking["reference"]), {"fitted model": tracking["model"], RIG: tracking["rig"]}
    runs = {name: arrays(run) for name, run in runs.items()}
    return {
        "figure-1": sketch(),
        "figure-4": validation(kept["steps"]),
        "figure-5": sets("Sets of the cart's controller (Figure 5; corners assumed)", law.cart),
        "figure-6": sets("Sets of the hoist's controller (Figure 6; corners assumed)", law.hoist),
        "figure-8": positions(reference, runs),
        "figure-9": commands(runs),
        "figure-10": way(reference, runs),
        "friction": friction(kept["friction"]),
    } | ({"starts": starts(kept["starts"])} if "starts" in kept else {})


def arrays(run: Mapping[str, Sequence[float]]) -> dict[str, np.ndarray]:
    return {name: np.asarray(values, dtype=float) for name, values in run.items()}


def panels_of(title: str, height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, Any]:
    """A figure with a title, and its panels."""
    figure, panels = plt.subplots(rows, columns, figsize=(8, height), layout="constrained", **options)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure, panels


def sketch() -> Figure:
    """Figure 1: the bridge with its quantities."""
    figure, panel = panels_of("The loading bridge and its quantities (Figure 1)", 4.8)
    panel.set_axis_off()
    panel.set_aspect("equal")
    panel.plot([0, 1.5], [0, 0], color=DARK, linewidth=3)
    for end in (0.0, 1.5):
        panel.plot([end, end], [-0.06, 0.06], color=DARK, linewidth=3)
    x, psi, length = 0.7, 0.38, 0.62
    panel.add_patch(Rectangle((x - 0.12, -0.045), 0.24, 0.09, facecolor="#d5e3f0", edgecolor=DARK, zorder=3))
    panel.add_patch(Circle((x, 0.0), 0.026, facecolor="white", edgecolor=DARK, zorder=4))
    load = (x + length * np.sin(psi), -length * np.cos(psi))
    panel.plot([x, load[0]], [0, load[1]], color=DARK, linewidth=1.6, zorder=2)
    panel.plot([x, x], [0, -0.66], color=GREY, linewidth=1.0, linestyle=(0, (5, 4)))
    panel.add_patch(Circle(load, 0.042, facecolor="#f2d16b", edgecolor=DARK, zorder=4))
    panel.add_patch(Arc((x, 0), 0.5, 0.5, theta1=-90, theta2=-90 + np.degrees(psi), color=BLUE))
    arrow(panel, (0.0, 0.15), (x, 0.15), BLUE)
    arrow(panel, (x + 0.13, 0.045), (x + 0.42, 0.045), ORANGE)
    arrow(panel, load, (load[0] + 0.2, load[1] + 0.06), GREEN)
    for text, at, colour in (
        ("cart position $x$", (0.26, 0.18), BLUE),
        ("cart, mass $m_1$", (x - 0.13, -0.1), DARK),
        ("driving force $F_p = K_x u_x$", (x + 0.15, 0.075), ORANGE),
        ("winch, inertia $J / r^2$", (x - 0.1, 0.065), DARK),
        ("swing angle $\\psi$", (x - 0.03, -0.27), BLUE),
        ("rope length $l$", (x + 0.17, -0.26), DARK),
        ("load, mass $m_2$", (load[0] + 0.06, load[1] - 0.06), DARK),
        ("load velocity $v_2$", (load[0] + 0.2, load[1] + 0.08), GREEN),
        ("rail, 1.5 m", (1.2, -0.09), DARK),
    ):
        left = text.startswith(("cart,", "winch", "swing"))
        panel.annotate(text, at, color=colour, fontsize=10, ha="right" if left else "left")
    panel.set_xlim(-0.05, 1.6)
    panel.set_ylim(-0.78, 0.26)
    return figure


def arrow(panel: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    panel.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=12, color=colour, linewidth=1.6))


def validation(steps: Mapping[str, Mapping[str, Sequence[float]]]) -> Figure:
    """Figure 4: +-2 V steps; the model before and after the estimation beside the rig."""
    rig, before, after = (arrays(steps[name]) for name in ("rig", "before", "after"))
    figure, panels = panels_of("Steps of 2 V and -2 V (Figure 4), l = 0.7 m", 6.0, 3, sharex=True)
    panels[0].step(rig["t"], rig["u_x"], where="post", color=DARK)
    panels[0].set_ylabel("cart drive\nu_x [V]")
    for panel, axis in zip(panels[1:], ("x", "psi"), strict=True):
        label, factor = AXES[axis]
        panel.plot(rig["t"], factor * rig[axis], color=DARK, alpha=0.5, linewidth=3.4, label=RIG)
        panel.plot(before["t"], factor * before[axis], color=ORANGE, label="model, first guess")
        panel.plot(after["t"], factor * after[axis], color=BLUE, label="model, estimated")
        panel.set_ylabel(label)
    panels[1].axhline(rig["x"][0], color=GREY, linewidth=0.9, linestyle=(0, (5, 4)))
    panels[1].legend(loc="upper left", fontsize=8)
    panels[-1].set_xlabel("time [s]")
    return figure


def sets(title: str, system: Any) -> Figure:
    """Figures 5 and 6: membership functions; of the error also those close to zero."""
    error, *others = (*system.inputs, *system.outputs)
    shown = [(error, 1.0, "normalised error [1]"), (error, 0.02, "the same, around zero [1]")]
    shown += [(variable, 1.0, f"{variable.name} [{UNITS[variable.name]}]") for variable in others]
    figure, panels = panels_of(title, 1.6 * len(shown), len(shown))
    for panel, (variable, share, label) in zip(panels, shown, strict=True):
        values = share * np.linspace(float(variable.low), float(variable.high), 1201)
        for name, degrees in zip(variable.labels, variable.degrees(jnp.asarray(values)), strict=True):
            panel.plot(values, degrees, label=name)
        panel.set_xlim(values[0], values[-1])
        panel.set_xlabel(label)
        panel.set_ylabel("degree")
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    return figure


def positions(reference: Mapping[str, np.ndarray], runs: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Figure 8: the reference, the model and the rig."""
    figure, panels = panels_of("Tracking the reference (Figure 8)", 6.6, 3, sharex=True)
    for panel, (axis, (label, factor)) in zip(panels, AXES.items(), strict=True):
        if axis in reference:
            panel.plot(reference["t"], factor * reference[axis], color=DARK, alpha=0.5, linewidth=3, label="reference")
        for (name, run), style in zip(runs.items(), ("-", "--"), strict=True):
            panel.plot(run["t"], factor * run[axis], style, label=name)
        panel.set_ylabel(label)
    panels[0].legend(loc="lower right", fontsize=8)
    panels[-1].set_xlabel("time [s]")
    return figure


def commands(runs: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Figure 9: the voltages of both drives."""
    figure, panels = panels_of("Control signals (Figure 9)", 3.6, 1, 2)
    for panel, (axis, label) in zip(panels, INPUTS.items(), strict=True):
        for (name, run), style in zip(runs.items(), ("-", "--"), strict=True):
            panel.step(run["t"], run[axis], style, where="post", linewidth=1.1, label=name)
        panel.set_xlabel("time [s]")
        panel.set_ylabel(label)
    panels[0].legend(fontsize=8)
    return figure


def way(reference: Mapping[str, np.ndarray], runs: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Figure 10: the load's way, seen from in front of the rig."""
    figure, panel = panels_of("The load's way (Figure 10)", 4.8)
    panel.plot(reference["x"], reference["l"], color=DARK, alpha=0.5, linewidth=3, label="reference")
    for (name, run), style in zip(runs.items(), ("-", "--"), strict=True):
        panel.plot(run["x"] + run["l"] * np.sin(run["psi"]), run["l"] * np.cos(run["psi"]), style, label=name)
    for name, at in POINTS.items():
        panel.plot(*at, "o", color=DARK)
        panel.annotate(name, at, xytext=(0, 8), textcoords="offset points", ha="center")
    panel.set_aspect("equal", adjustable="datalim")
    panel.invert_yaxis()
    panel.set_xlabel("load's horizontal position [m]")
    panel.set_ylabel("load's depth below the rail [m]")
    panel.legend(fontsize=8)
    return figure


def starts(found: Mapping[str, Any]) -> Figure:
    """Where many starts of the estimation begin and end, relative to the median of those that arrive."""
    arrived, numbers = arrivals(found), found["numbers"]
    title = f"The estimation from random starts: {arrived.sum()} of {arrived.size} within 1 % of the smallest error"
    figure, panel = panels_of(title, 1.4 + 0.2 * len(numbers))
    for row, number in enumerate(numbers):
        ends, begun = (np.asarray(number[key], dtype=float) for key in ("found", "start"))
        middle = np.median(ends[arrived])
        lift = row + 0.18 * np.linspace(-1, 1, len(ends))
        for chosen, values, colour, said in (
            (np.ones_like(arrived), begun, "#b0b0b0", "starts"),
            (~arrived, ends, ORANGE, "ended elsewhere"),
            (arrived, ends, BLUE, "arrived"),
        ):
            panel.plot(
                values[chosen] / middle, lift[chosen], "o", color=colour, markersize=3, label=None if row else said
            )
    panel.set_xscale("log")
    panel.set_xlim(0.15, 7.0)
    panel.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_yticks(range(len(numbers)), [n["name"].replace("_", " ") for n in numbers], fontsize=7.5)
    panel.invert_yaxis()
    panel.set_xlabel("value over the median of those that arrived")
    figure.legend(loc="outside lower left", ncols=3, fontsize=8)
    return figure


def arrivals(found: Mapping[str, Any]) -> np.ndarray:
    """Which starts end within 1 % of the smallest error."""
    ratios = np.asarray(found["ratios"], dtype=float)
    return ratios <= 1.01 * np.nanmin(ratios)


def friction(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """The friction table by partition and direction, the rig's own and found."""
    figure, panel = panels_of("Friction by place and direction, mean of each partition of the rail", 3.6)
    for side, colour, said in (("positive", BLUE, "to the right"), ("negative", ORANGE, "to the left")):
        own = [row for row in rows if row["side"] == side]
        middle = [0.5 * (row["low"] + row["high"]) for row in own]
        half = [0.5 * (row["high"] - row["low"]) for row in own]
        rig, label = [row["rig"] for row in own], f"{RIG}, {said}"
        panel.errorbar(middle, rig, xerr=half, fmt="none", color=colour, alpha=0.45, linewidth=5, label=label)
        panel.plot(middle, [row["found"] for row in own], "o", color=colour, label=f"found, {said}")
    panel.set_ylim(0, 1.1 * max(max(row["rig"], row["found"]) for row in rows))
    panel.set_xlabel("place on the rail [m]")
    panel.set_ylabel("friction [N]")
    figure.legend(loc="outside lower left", ncols=4, fontsize=8)
    return figure


def table(kept: Mapping[str, Any]) -> str:
    """Tables 1 and 2, what the paper says in words beside what is measured, and the numbers found."""
    law = jbridge.paper_controller()
    scale = float(law.cart_scale)
    lines = [
        "# The paper's experiments, repeated",
        "",
        f"The paper's device is not at hand; a {RIG} plays it (MuJoCo, true stick-slip, its numbers concealed from the",
        "estimation). Redrawn by `python experiments/paper/run.py --figures`; do not edit.",
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
        *universes("cart position x", law.cart, scale),
        *universes("rope length l", law.hoist, scale),
        "",
        f"The error is divided by {scale:g} m, the paper's range, and its sets lie on [-1, 1].",
        "",
        "## What the paper says, and what is measured here",
        "",
        "| paper | measured |",
        "|---|---|",
        *claims(kept),
        "",
        "## Numbers found beside the virtual rig's own",
        "",
        "| number | rig | found | error |",
        "|---|---|---|---|",
        *numbers(kept),
    ]
    return "\n".join(lines) + "\n"


def universes(name: str, system: Any, scale: float) -> list[str]:
    rows = []
    for variable in (*system.inputs, *system.outputs):
        factor = scale if variable.name == "error" else 1.0
        low, high = (factor * float(end) for end in (variable.low, variable.high))
        rows.append(f"| {name} | {variable.name} | {low:g} | {high:g} | {UNITS[variable.name]} |")
    return rows


def claims(kept: Mapping[str, Any]) -> list[str]:
    steps, tracking = kept["steps"], kept["tracking"]
    rig, before, after = (arrays(steps[name]) for name in ("rig", "before", "after"))

    def away(run: Mapping[str, np.ndarray]) -> float:
        return 1e3 * float(np.sqrt(np.mean((run["x"] - rig["x"]) ** 2)))

    back = 1e3 * (rig["x"][-1] - rig["x"][0])
    moves, rms = tracking["moves"], tracking["rms"]
    over = {name: [100 * max(m["overshoot"][k] for m in moves[name]) for k in ("x", "l")] for name in moves}
    steady = {name: [1e3 * max(abs(m["steady_error"][k]) for m in moves[name]) for k in ("x", "l")] for name in moves}
    effort = {name: [float(np.mean([m["effort"][k] for m in moves[name]])) for k in ("x", "l")] for name in moves}
    errors = [abs(row["error"]) for row in kept["friction"]]
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
    if "starts" in kept:
        arrived = arrivals(kept["starts"])
        rows.append(
            (
                "parameters found by comparing simulation and device",
                f"{arrived.sum()} of {arrived.size} random starts (50 %) arrive within 1 % of the smallest error",
            )
        )
    if "diagnosis" in kept:
        told = kept["diagnosis"]
        named = "; ".join(f"{kind}, {site}".replace("_", " ") for kind, site in told["effects"])
        rows.append(
            (
                "friction by place and direction, dead zones and the winch's delay have to be modelled",
                f"`jbridge diagnose` alone, from a viscous model: `{told['verdict']}`; named: {named or 'nothing'}",
            )
        )
    return [f"| {said} | {measured} |" for said, measured in rows]


def numbers(kept: Mapping[str, Any]) -> list[str]:
    rows = []
    for row in kept["numbers"]:
        if row.get("std") is None:
            continue
        error = 100 * (row["value"] / row["rig"] - 1)
        rows.append(f"| {row['name']} | {row['rig']:.4g} {row['unit']} | {row['value']:.4g} | {error:+.2f} % |")
    return rows
