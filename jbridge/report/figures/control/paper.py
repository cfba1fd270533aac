"""The paper's figures, with their numbers: the sketch, the validation, the sets, the tracking."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Rectangle
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from ....fuzzy.inference import Mamdani
from ....fuzzy.rules import Variable
from ..style import AFTER, BEFORE, RECORDED, Picture, picture
from .fuzzy import UNITS, draw_variable
from .tracking import Run, draw_commands, draw_positions, draw_way

RIG = "virtual rig"


def arrays(run: Mapping[str, Sequence[float]]) -> dict[str, NDArray[np.float64]]:
    return {name: np.asarray(values, dtype=float) for name, values in run.items()}


def draw_sketch() -> Picture:
    """Figure 1: the bridge with its quantities."""

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        panel.set_axis_off()
        panel.set_aspect("equal")
        panel.plot([0, 1.5], [0, 0], color=RECORDED, linewidth=3)
        for end in (0.0, 1.5):
            panel.plot([end, end], [-0.06, 0.06], color=RECORDED, linewidth=3)
        x, psi, length = 0.7, 0.38, 0.62
        panel.add_patch(Rectangle((x - 0.12, -0.045), 0.24, 0.09, facecolor="#d5e3f0", edgecolor=RECORDED, zorder=3))
        panel.add_patch(Circle((x, 0.0), 0.026, facecolor="white", edgecolor=RECORDED, zorder=4))
        load = (x + length * np.sin(psi), -length * np.cos(psi))
        panel.plot([x, load[0]], [0, load[1]], color=RECORDED, linewidth=1.6, zorder=2)
        panel.plot([x, x], [0, -0.66], color="#909090", linewidth=1.0, linestyle=(0, (5, 4)))
        panel.add_patch(Circle(load, 0.042, facecolor="#f2d16b", edgecolor=RECORDED, zorder=4))
        panel.add_patch(Arc((x, 0), 0.5, 0.5, theta1=-90, theta2=-90 + np.degrees(psi), color=AFTER))
        _arrow(panel, (0.0, 0.15), (x, 0.15))
        _arrow(panel, (x + 0.13, 0.045), (x + 0.42, 0.045), BEFORE)
        _arrow(panel, load, (load[0] + 0.2, load[1] + 0.06), "#00805c")
        for text, at, colour in (
            ("cart position $x$", (0.26, 0.18), AFTER),
            ("cart, mass $m_1$", (x - 0.13, -0.1), RECORDED),
            ("driving force $F_p = K_x u_x$", (x + 0.15, 0.075), BEFORE),
            ("winch, inertia $J / r^2$", (x - 0.1, 0.065), RECORDED),
            ("swing angle $\\psi$", (x - 0.03, -0.27), AFTER),
            ("rope length $l$", (x + 0.17, -0.26), RECORDED),
            ("load, mass $m_2$", (load[0] + 0.06, load[1] - 0.06), RECORDED),
            ("load velocity $v_2$", (load[0] + 0.2, load[1] + 0.08), "#00805c"),
            ("rail, 1.5 m", (1.2, -0.09), RECORDED),
        ):
            left = text.startswith(("cart,", "winch", "swing"))
            panel.annotate(text, at, color=colour, fontsize=10, ha="right" if left else "left")
        panel.set_xlim(-0.05, 1.6)
        panel.set_ylim(-0.78, 0.26)

    return picture("paper-figure-1", "The loading bridge and its quantities", 4.4, draw, "Figure 1 of the paper")


def _arrow(panel: Axes, start: tuple[float, float], end: tuple[float, float], colour: str = AFTER) -> None:
    panel.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=12, color=colour, linewidth=1.6))


def draw_validation(steps: Mapping[str, Mapping[str, Sequence[float]]]) -> Picture:
    """Figure 4: +-2 V steps; the model before and after the estimation beside the rig."""
    rig, before, after = (arrays(steps[name]) for name in ("rig", "before", "after"))

    def draw(figure: FigureBase) -> None:
        panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 2.0, 1.6))
        panels[0].step(rig["t"], rig["u_x"], where="post", color=RECORDED)
        panels[0].set_ylabel("cart drive\nu_x [V]")
        for panel, axis, factor, label in (
            (panels[1], "x", 1.0, "cart position\nx [m]"),
            (panels[2], "psi", 180 / np.pi, "swing angle\npsi [deg]"),
        ):
            panel.plot(rig["t"], factor * rig[axis], color=RECORDED, alpha=0.5, linewidth=3.4, label=RIG)
            panel.plot(before["t"], factor * before[axis], color=BEFORE, label="model, first guess")
            panel.plot(after["t"], factor * after[axis], color=AFTER, label="model, estimated")
            panel.set_ylabel(label)
        panels[1].axhline(rig["x"][0], color="#909090", linewidth=0.9, linestyle=(0, (5, 4)))
        panels[-1].set_xlabel("time [s]")
        figure.align_ylabels(panels)
        handles, names = panels[1].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=3)

    said = f"Figure 4 of the paper: the cart does not return to where it was (dashed). {RIG.capitalize()}, l = 0.7 m"
    return picture("paper-figure-4", "Steps of 2 V and -2 V", 5.6, draw, said)


def draw_sets(name: str, title: str, system: Mamdani, explanation: str) -> Picture:
    """Figures 5 and 6: membership functions; of the error also those close to zero."""
    variables: list[Variable] = [*system.inputs, *system.outputs]

    def draw(figure: FigureBase) -> None:
        panels = figure.subplots(len(variables) + 1, 1)
        draw_variable(panels[0], variables[0], "normalised error [1]")
        close = 0.02 * float(variables[0].high)
        draw_variable(panels[1], variables[0], "the same, around zero [1]", close)
        for panel, variable in zip(panels[2:], variables[1:], strict=True):
            draw_variable(panel, variable, f"{variable.name} [{UNITS.get(variable.name, '1')}]")

    return picture(name, title, 1.55 * (len(variables) + 1), draw, explanation)


def draw_tracking(tracking: Mapping[str, Any]) -> tuple[Picture, ...]:
    """Figures 8, 9 and 10: positions, control signals, and the load's way."""
    reference: Run = arrays(tracking["reference"])
    runs: dict[str, Run] = {"fitted model": arrays(tracking["model"]), RIG: arrays(tracking["rig"])}
    points = [("T_z", 0.0, 0.185), ("T_1", 1.2, 0.6), ("T_2", 0.5, 0.3)]
    return (
        draw_positions(
            "paper-figure-8", "Tracking the reference", reference, runs, f"Figure 8 of the paper; {RIG} dashed"
        ),
        draw_commands("paper-figure-9", "Control signals", runs, f"Figure 9 of the paper; {RIG} dashed"),
        draw_way("paper-figure-10", "The load's way", reference, runs, points, f"Figure 10 of the paper; {RIG} dashed"),
    )


def draw_starts(starts: Mapping[str, Any]) -> Picture:
    """Where many starts of the estimation begin and end, relative to the median of those that arrive."""
    ratios = np.asarray(starts["ratios"], dtype=float)
    arrived = ratios <= 1.01 * np.nanmin(ratios)
    numbers = starts["numbers"]

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        for row, number in enumerate(numbers):
            found, begun = (np.asarray(number[key], dtype=float) for key in ("found", "start"))
            middle = np.median(found[arrived])
            lift = row + 0.18 * np.linspace(-1, 1, len(found))
            panel.plot(begun / middle, lift, ".", color="#b0b0b0", markersize=3, label="starts" if row == 0 else None)
            for chosen, colour, said in ((~arrived, BEFORE, "ended elsewhere"), (arrived, AFTER, "arrived")):
                shown = said if row == 0 and chosen.any() else None
                panel.plot(found[chosen] / middle, lift[chosen], "o", color=colour, markersize=3.5, label=shown)
        panel.set_xscale("log")
        panel.set_xlim(0.15, 7.0)
        panel.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_yticks(range(len(numbers)), [n["name"].replace("_", " ") for n in numbers], fontsize=7.5)
        panel.invert_yaxis()
        panel.set_xlabel("value over the median of those that arrived")
        figure.legend(loc="outside upper left", ncols=3)

    said = f"{int(arrived.sum())} of {len(ratios)} starts come within 1 % of the smallest error"
    title = f"The estimation from many random starts, {RIG}"
    return picture("paper-starts", title, 0.9 + 0.2 * len(numbers), draw, said)


def draw_friction(rows: Sequence[Mapping[str, Any]]) -> Picture:
    """The friction table by partition and direction, the rig's own and found."""

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        for side, colour, said in (("positive", AFTER, "to the right"), ("negative", BEFORE, "to the left")):
            own = [row for row in rows if row["side"] == side]
            middle = [0.5 * (row["low"] + row["high"]) for row in own]
            half = [0.5 * (row["high"] - row["low"]) for row in own]
            panel.errorbar(
                middle, [row["rig"] for row in own], xerr=half, fmt="none", color=colour, alpha=0.45, linewidth=5,
                label=f"{RIG}, {said}",
            )  # fmt: skip
            panel.plot(middle, [row["found"] for row in own], "o", color=colour, label=f"found, {said}")
        panel.set_ylim(0, 1.1 * max(max(row["rig"], row["found"]) for row in rows))
        panel.set_xlabel("place on the rail [m]")
        panel.set_ylabel("friction [N]")
        figure.legend(loc="outside upper left", ncols=4)

    said = f"Mean of each partition of the rail, estimated from ramps; {RIG}"
    return picture("paper-friction", "Friction by place and direction", 3.0, draw, said)
