"""The fit at a glance: every channel's error as a multiple of its noise, before and after."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import FigureBase
from matplotlib.ticker import NullFormatter

from ...identification.result import Errors
from ..text.words import CHANNELS
from .style import AFTER, BEFORE, Picture, picture


def draw_improvement(
    name: str, before: Errors, after: Errors, noise: Mapping[str, float], window: float, labels: tuple[str, str]
) -> Picture | None:
    """Errors on the hold-out, free runs and windows; None where no noise is known to measure by.

    Args:
        name: of the picture's file.
        before, after: errors on the hold-out.
        noise: of each channel [m, rad, m].
        window: length of the windows [s].
        labels: what the model before and after is called; one that is empty is left out.
    """
    rows = []
    for channel, quantity in CHANNELS.items():
        for errors, how in (("free_run", "whole recording"), ("window", f"windows of {window:g} s")):
            pair = [getattr(side, errors).get(channel) for side in (before, after)]
            scale = noise.get(channel)
            if scale and all(value is not None and np.isfinite(value) and value > 0 for value in pair):
                rows.append((f"{quantity}\n{how}", [value / scale for value in pair]))
    if not rows:
        return None

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        places = np.arange(len(rows))[::-1]
        ratios = np.array([pair for _, pair in rows])
        panel.axvspan(1e-3, 1.0, color="#f0f0f0", linewidth=0, zorder=0)
        panel.axvline(1.0, color="#606060", linewidth=1.2)
        panel.hlines(places, ratios[:, 1], ratios[:, 0], color="#b0b0b0", linewidth=3.0, zorder=1)
        drawn = [i for i, said in enumerate(labels) if said]
        colours = (BEFORE, AFTER)
        for i in drawn:
            panel.plot(ratios[:, i], places, "o", color=colours[i], markersize=9, label=labels[i], zorder=2)
        for place, pair in zip(places, ratios, strict=True):
            ends = sorted((pair[i], colours[i]) for i in drawn)
            for (value, colour), side in zip(ends, (-1, 1) if len(ends) == 2 else (1,), strict=True):
                panel.annotate(
                    f"{value:.1f}" if value < 10 else f"{value:.0f}",
                    (value, place),
                    xytext=(9 * side, 0),
                    textcoords="offset points",
                    ha="left" if side > 0 else "right",
                    va="center",
                    color=colour,
                    bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.5},
                )
        panel.set_xscale("log")
        panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
        panel.set_xlim(min(0.4, 0.5 * ratios.min()), 2.2 * max(ratios.max(), 5.0))
        panel.set_ylim(-0.6, len(rows) - 0.4)
        panel.set_yticks(places, [said for said, _ in rows])
        panel.tick_params(axis="y", length=0)
        panel.grid(False, axis="y")
        panel.set_xlabel("rms error as a multiple of the channel's noise [-]")
        figure.legend(loc="outside upper left", ncols=2)

    return picture(
        name,
        "Error on the hold-out, before and after",
        0.9 + 0.5 * len(rows),
        draw,
        "An error of 1 times the noise is as good as the sensors can show.",
    )
