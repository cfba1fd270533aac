"""Prediction error over the horizon, before and after, with the noise as a line."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import FigureBase
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ...diagnosis.result import Horizon
from ...model.names import QUANTITIES
from ..text.quantities import scale_for
from ..text.words import CHANNELS
from .style import AFTER, BEFORE, Picture, picture


def draw_horizons(
    name: str, horizons: Sequence[Horizon], noise: Mapping[str, float], labels: tuple[str, str]
) -> Picture | None:
    """Root mean square errors on the hold-out in windows of each length; None where there is nothing to draw.

    Args:
        name: of the picture's file.
        horizons: errors before and after.
        noise: of each channel [m, rad, m].
        labels: what the model before and after is called; one that is empty is left out.
    """
    channels = [axis for axis in CHANNELS if any(axis in row.before for row in horizons)]
    if len(horizons) < 2 or not channels:
        return None
    seconds = np.array([row.seconds for row in horizons])

    def draw(figure: FigureBase) -> None:
        panels = np.atleast_1d(figure.subplots(1, len(channels)))
        for panel, axis in zip(panels, channels, strict=True):
            _, unit = QUANTITIES[axis]
            runs = [[getattr(row, side).get(axis, np.nan) for row in horizons] for side in ("before", "after")]
            scale = scale_for(unit, [float(np.nanmax(runs))])
            for values, label, colour in zip(runs, labels, (BEFORE, AFTER), strict=True):
                if label:
                    panel.plot(seconds, scale.factor * np.array(values), "o-", color=colour, label=label)
            if noise.get(axis):
                panel.axhline(scale.factor * noise[axis], color="#606060", linewidth=1.2, linestyle="--", label="noise")
            spread = [(row.scatter or {}).get(axis, np.nan) for row in horizons]
            if np.isfinite(spread).any():
                panel.plot(seconds, scale.factor * np.array(spread), ":", color="#606060", label="scatter of repeats")
            panel.set_xscale("log")
            panel.set_yscale("log")
            # A panel spans a decade at least: small differences look small.
            low, high = panel.get_ylim()
            room = max(np.sqrt(10.0 / (high / low)), 1.0)
            panel.set_ylim(low / room, high * room)
            panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            panel.yaxis.set_minor_formatter(NullFormatter())
            panel.set_xticks(seconds, [f"{s:g}" for s in seconds])
            panel.xaxis.set_minor_formatter(NullFormatter())
            panel.set_xlabel("horizon [s]")
            panel.set_ylabel(f"rms error of {CHANNELS[axis]} [{scale.unit}]")
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=4)

    return picture(
        name,
        "Prediction error over the horizon, on the hold-out",
        3.4,
        draw,
        "Rms error of simulations that start again after each horizon; sensors can show nothing below their noise.",
    )
