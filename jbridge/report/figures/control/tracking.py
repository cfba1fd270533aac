"""A closed loop beside its reference: positions, voltages, and the way of the load."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from ..style import AFTER, BEFORE, RECORDED, Picture, drawable, picture

_COLOURS = (AFTER, BEFORE, "#00805c", "#8a4f9e")
_DASHES = ("-", (0, (4, 2)), (0, (1, 1)), (0, (6, 2, 1, 2)))
"""So that a run shows that lies beneath another."""
_ROWS = (
    ("x", "cart position\nx [m]", 1.0),
    ("l", "rope length\nl [m]", 1.0),
    ("psi", "swing angle\npsi [deg]", 57.29577951308232),
)

_DRIVES = {"u_x": "cart drive", "u_l": "hoist drive"}

Run = Mapping[str, NDArray[np.float64]]
"""Columns `t` [s], `x` [m], `psi` [rad], `l` [m], `u_x`, `u_l`."""


def draw_positions(
    name: str, title: str, reference: Run, runs: Mapping[str, Run], units: Mapping[str, str] | None = None
) -> Picture:
    """Positions over time.

    Args:
        name: of the picture's file.
        title: stands above it.
        reference: columns `t`, `x`, `l`.
        runs: by what they are called.
        units: of the inputs that are shown as well.
    """
    rows = (*_ROWS, *((key, f"{_DRIVES[key]}\n{key} [{unit}]", 1.0) for key, unit in (units or {}).items()))

    def draw(figure: FigureBase) -> None:
        panels = figure.subplots(len(rows), 1, sharex=True)
        for panel, (axis, label, factor) in zip(panels, rows, strict=True):
            if axis in reference:
                panel.plot(
                    reference["t"],
                    factor * reference[axis],
                    color=RECORDED,
                    alpha=0.5,
                    linewidth=3.2,
                    label="reference",
                )
            for (said, run), colour, dashes in zip(runs.items(), _COLOURS, _DASHES, strict=False):
                panel.plot(run["t"], factor * drawable(run[axis]), color=colour, linestyle=dashes, label=said)
            panel.set_ylabel(label)
        panels[-1].set_xlabel("time [s]")
        figure.align_ylabels(panels)
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=len(names))

    return picture(name, title, 2.2 * len(rows), draw)


def draw_commands(name: str, title: str, runs: Mapping[str, Run], units: Mapping[str, str]) -> Picture:
    """Commands over time, cart on the left and hoist on the right."""

    def draw(figure: FigureBase) -> None:
        panels = figure.subplots(1, 2)
        for panel, (key, drive) in zip(panels, _DRIVES.items(), strict=True):
            for (said, run), colour, dashes in zip(runs.items(), _COLOURS, _DASHES, strict=False):
                panel.step(run["t"], run[key], where="post", color=colour, linestyle=dashes, linewidth=1.1, label=said)
            panel.set_ylabel(f"{drive} {key} [{units[key]}]")
            panel.set_xlabel("time [s]")
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=len(names))

    return picture(name, title, 3.4, draw)


def draw_way(
    name: str,
    title: str,
    reference: Run,
    runs: Mapping[str, Run],
    points: Sequence[tuple[str, float, float]],
) -> Picture:
    """The load's way in the plane, as one sees it in front of the rig.

    Args:
        name: of the picture's file.
        title: stands above it.
        reference: columns `x`, `l`.
        runs: by what they are called.
        points: names, cart positions and rope lengths of the points to visit [m].
    """

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        panel.plot(reference["x"], reference["l"], color=RECORDED, alpha=0.5, linewidth=3.2, label="reference")
        for (said, run), colour, dashes in zip(runs.items(), _COLOURS, _DASHES, strict=False):
            across, down = run["x"] + run["l"] * np.sin(run["psi"]), run["l"] * np.cos(run["psi"])
            panel.plot(drawable(across), drawable(down), color=colour, linestyle=dashes, label=said)
        middle = 0.5 * (min(x for _, x, _ in points) + max(x for _, x, _ in points))
        for said, x, l in points:
            panel.plot(x, l, "o", color=RECORDED, markersize=6)
            # Names stand inside of the way's ends.
            beside, side = (8, "left") if x <= middle else (-8, "right")
            panel.annotate(said, (x, l), xytext=(beside, -4), textcoords="offset points", ha=side)
        panel.set_aspect("equal", adjustable="datalim")
        panel.invert_yaxis()
        panel.set_xlabel("load's horizontal position [m]")
        panel.set_ylabel("load's depth below the rail [m]")
        figure.legend(loc="outside upper left", ncols=4)

    return picture(name, title, 4.4, draw)
