"""Residuals of a recording over time: structure before, noise after."""

from collections.abc import Iterable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from ...diagnosis.result import Interval
from ...identification.result import Trace
from ..text.quantities import error_scale, times_noise
from ..text.rows import error_text
from ..text.words import CHANNELS
from .style import AFTER, BEFORE, NOISE, SHADE, Picture, drawable, picture, shortened


def draw_residuals(
    name: str, trace: Trace, noise: Mapping[str, float], when: Iterable[Interval], labels: tuple[str, str]
) -> Picture:
    """Recorded minus simulated of one recording, before on the left and after on the right.

    Each panel has its own scale, or nothing would be seen of what remains; the band of twice the noise, drawn in
    both, is the common measure.

    Args:
        name: of the picture's file.
        trace: the recording.
        noise: of each channel [m, rad, m].
        when: times at which the mismatch sits; those of other recordings are left out.
        labels: what the simulations before and after are called; the first may be empty.
    """
    channels = [channel for channel in CHANNELS if channel in trace.measured]
    columns = [
        (simulated, colour, said)
        for simulated, colour, said in zip((trace.before, trace.after), (BEFORE, AFTER), labels, strict=True)
        if said
    ]
    spans = [(interval.start, interval.stop) for interval in when if interval.recording == trace.recording]

    def draw(figure: FigureBase) -> None:
        grid = figure.subplots(len(channels), len(columns), sharex=True, squeeze=False)
        for row, channel in zip(grid, channels, strict=True):
            for panel, (simulated, colour, said) in zip(row, columns, strict=True):
                left = drawable(trace.measured[channel] - simulated.get(channel, np.full_like(trace.times, np.nan)))
                _draw_panel(panel, trace.times, left, noise.get(channel), channel, colour)
                for start, stop in spans:
                    panel.axvspan(start, stop, color=SHADE, alpha=0.35, linewidth=0, zorder=0)
                if channel == channels[0]:
                    panel.set_title(said, color=colour)
            row[0].set_ylabel(f"{CHANNELS[channel]}\nrecorded - simulated\n[{_unit(channel)}]")
        for panel in grid[-1]:
            panel.set_xlabel("time from the recording's start [s]")
            panel.set_xlim(trace.times[0], trace.times[-1])
        figure.align_ylabels(grid[:, 0])

    title = f"Residuals of {shortened(trace.recording)}"
    explanation = "Grey band: twice the noise." + (" Yellow: when the mismatch stands out." if spans else "")
    return picture(name, title, 0.6 + 1.75 * len(channels), draw, f"{explanation} Each panel has its own scale.")


def _unit(channel: str) -> str:
    return "deg" if channel == "psi" else error_scale(channel).unit


def _draw_panel(
    panel: Axes,
    times: NDArray[np.float64],
    left: NDArray[np.float64],
    noise: float | None,
    channel: str,
    colour: str,
) -> None:
    scale = error_scale(channel)
    seen = np.isfinite(left)
    shown = scale.factor * left[seen]
    band = 2 * scale.factor * noise if noise else 0.0
    if band:
        panel.axhspan(-band, band, color=NOISE, alpha=0.6, linewidth=0, zorder=0.5)
    panel.plot(times[seen], shown, color=colour, linewidth=0.9)
    low = min(float(shown.min()) if shown.size else 0.0, -1.5 * band)
    high = max(float(shown.max()) if shown.size else 0.0, 1.5 * band)
    span = (high - low) or 1.0
    # Room for the number above the line.
    panel.set_ylim(low - 0.06 * span, high + 0.26 * span)
    rms = float(np.sqrt(np.mean(left[seen] ** 2))) if shown.size else None
    ratio = f" = {times_noise(rms, noise)}" if band else ""
    panel.text(
        0.99,
        0.97,
        f"rms {error_text(channel, rms)}{ratio}",
        transform=panel.transAxes,
        ha="right",
        va="top",
        fontsize=9,
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.5},
    )
