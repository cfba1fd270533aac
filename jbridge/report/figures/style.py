"""How all figures look: colours that colour-blind eyes tell apart, legible type, no frame where none is needed."""

import io
from collections.abc import Callable
from dataclasses import dataclass

import matplotlib as mpl
import matplotlib.style
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from numpy.typing import NDArray
from PIL import Image

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
_COLOURS = 128
"""Of a picture: with a palette it takes a third of the room of one with every shade, and no eye tells them apart."""
STYLE = "jbridge.report.figures.common"
"""Name by which Matplotlib finds the style sheet beside this module; the figures of experiments use it, too."""


@dataclass(frozen=True)
class Picture:
    """A drawn figure."""

    name: str
    """Of its file, without the ending."""
    title: str
    """What to see in it."""
    png: bytes
    figure: Figure
    """The same, to be changed and saved in other ways."""


def drawable(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A simulation that runs away, cut off at 1000 km where drawing (and squaring) would overflow."""
    return np.clip(values, -1e6, 1e6)


def shortened(name: str) -> str:
    """A recording's name as it fits into a title; a `$` in it is no formula."""
    return (name if len(name) <= 60 else f"{name[:57]}...").replace("$", r"\$")


def picture(name: str, title: str, height: float, draw: Callable[[FigureBase], None], explanation: str = "") -> Picture:
    """Draws a figure of the common width.

    Args:
        name: of its file.
        title: stands above it, and is said to those who cannot see it.
        height: without the title [inch].
        draw: fills the empty figure.
        explanation: stands below the title.
    """
    # A figure of its own canvas leaves pyplot, its global state and the display alone.
    with mpl.style.context(STYLE):
        above = 0.5 if explanation else 0.3
        figure = Figure(figsize=(WIDTH, above + height), layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(2, 1, height_ratios=(above, height))
        top, bottom = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
        top.text(0.01, 1 - 0.06 / above, title, va="top", fontsize=11.5, fontweight="bold")
        top.text(0.01, 0.0, explanation, va="bottom", fontsize=10, color="#505050")
        draw(bottom)
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=_DPI)
    return Picture(name, title, _with_palette(content), figure)


def _with_palette(png: io.BytesIO) -> bytes:
    """The same picture in few colours."""
    content = io.BytesIO()
    with Image.open(png) as full:
        full.convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE).save(content, "PNG", optimize=True)
    return content.getvalue()
