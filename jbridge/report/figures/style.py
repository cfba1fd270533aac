"""How all figures look: colours that colour-blind eyes tell apart, legible type, no frame where none is needed."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

RECORDED = "#3c3c3c"
BEFORE = "#dd6a00"
AFTER = "#0a6ebd"
SHADE = "#f2d16b"
"""Regions and times in which the mismatch sits."""
NOISE = "#c9c9c9"
MARK = "#d9a400"
"""What is singled out among several."""
FORWARDS = "#00805c"
BACKWARDS = "#8a4f9e"

WIDTH = 8.0
"""Width of every figure [inch]."""
_DPI = 130
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#808080",
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 10.0,
    "lines.linewidth": 1.4,
    "xtick.color": "#404040",
    "ytick.color": "#404040",
    "figure.facecolor": "white",
    # A channel sampled more slowly than the grid is drawn in pieces; dots keep lone samples visible.
    "path.simplify": True,
}


@dataclass(frozen=True)
class Picture:
    """A drawn figure."""

    name: str
    """Of its file, without the ending."""
    title: str
    """What to see in it."""
    png: bytes


def picture(name: str, title: str, height: float, draw: Callable[[Figure], None]) -> Picture:
    """Draws a figure of the common width.

    Args:
        name: of its file.
        title: said above it on the page, and to those who cannot see it.
        height: [inch].
        draw: fills the empty figure.
    """
    # A figure of its own canvas leaves pyplot, its global state and the display alone.
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        FigureCanvasAgg(figure)
        figure.suptitle(title, x=0.01, ha="left", fontsize=11.5, fontweight="bold")
        draw(figure)
        content = io.BytesIO()
        # Without the metadata the same data give the same bytes on every version.
        figure.savefig(content, format="png", dpi=_DPI, metadata={"Software": None})
    return Picture(name, title, content.getvalue())

