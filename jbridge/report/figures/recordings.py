"""Recordings as they were read, side by side."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import FigureBase

from ...recordings import Recording
from .style import RECORDED, Picture, picture, shortened

_SIDE = 4
"""Recordings beside each other in one picture."""
_ROWS = {
    "x": ("x [m]", 1.0),
    "psi": ("psi [deg]", 180.0 / np.pi),
    "l": ("l [m]", 1.0),
    "u_x": ("u_x", 1.0),
    "u_l": ("u_l", 1.0),
}


def draw_recordings(name: str, recordings: Sequence[Recording]) -> tuple[Picture, ...]:
    """One picture for every four recordings: what was measured, then what was commanded.

    Args:
        name: of the first picture's file; others get a number.
        recordings: in the order of the pictures.
    """
    groups = [recordings[i : i + _SIDE] for i in range(0, len(recordings), _SIDE)]
    return tuple(
        _draw(name if k == 0 else f"{name}-{k + 1}", group, "Recordings as they were read")
        for k, group in enumerate(groups)
    )


def _draw(name: str, recordings: Sequence[Recording], title: str) -> Picture:
    channels = [channel for channel in _ROWS if any(getattr(r, channel) is not None for r in recordings)]

    def draw(figure: FigureBase) -> None:
        panels = figure.subplots(len(channels), len(recordings), squeeze=False, sharex="col", sharey="row")
        for column, recording in enumerate(recordings):
            panels[0, column].set_title(shortened(recording.name), fontsize=9)
            for row, channel in enumerate(channels):
                panel, values = panels[row, column], getattr(recording, channel)
                label, factor = _ROWS[channel]
                if values is not None and channel in recording.fresh:
                    times, samples = recording.samples(channel)
                    panel.plot(times, factor * samples, color=RECORDED, linewidth=1.0)
                elif values is not None:
                    panel.step(recording.times, values, where="post", color=RECORDED, linewidth=1.0)
                if column == 0:
                    unit = recording.units.get(channel)
                    panel.set_ylabel(label if unit is None else f"{label} [{unit}]")
            panels[-1, column].set_xlabel("time [s]")

    return picture(name, title, 0.6 + 1.4 * len(channels), draw)
