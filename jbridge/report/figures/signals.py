"""Recorded and simulated signals over time, below each its residuals, which overlaid curves hide, and the inputs."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from ...identification.result import Trace
from ...model.names import quantity_name
from ..text.quantities import Scale, pretty_unit
from ..text.words import CHANNELS
from .style import AFTER, BEFORE, NOISE, RECORDED, Picture, drawable, picture, shortened

_RESIDUALS = {"x": Scale(1e3, "mm"), "psi": Scale(180.0 / np.pi, "deg"), "l": Scale(1e3, "mm")}
_ROLES = {
    "train": "training recording",
    "holdout": "hold-out recording: never used for fitting",
    "simulated": "",
}
_INPUTS = {"u_x": "cart drive\nu_x", "u_l": "hoist drive\nu_l"}


def draw_signals(name: str, trace: Trace, units: Mapping[str, str], labels: tuple[str, str]) -> Picture:
    """One recording with its simulations.

    Args:
        name: of the picture's file.
        trace: the recording.
        units: of the inputs.
        labels: what the simulations before and after are called; one that is empty is left out.
    """
    channels = [channel for channel in CHANNELS if channel in trace.measured]
    inputs = [channel for channel in _INPUTS if channel in trace.inputs]
    compared = any(labels)
    heights = ([2.0, 1.0] if compared else [2.0]) * len(channels) + [1.0] * len(inputs)

    def draw(figure: FigureBase) -> None:
        panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for panel, channel in zip(panels[:: 2 if compared else 1], channels, strict=False):
            _draw_channel(panel, trace, channel, labels)
        for panel, channel in zip(panels[1::2] if compared else (), channels, strict=False):
            _draw_residuals(panel, trace, channel, labels)
        for panel, channel in zip(panels[len(panels) - len(inputs) :], inputs, strict=True):
            panel.step(trace.times, trace.inputs[channel], where="post", color=RECORDED, linewidth=1.0)
            panel.set_ylabel(f"{_INPUTS[channel]} [{pretty_unit(units[channel])}]")
        panels[-1].set_xlabel("time from the recording's start [s]")
        panels[-1].set_xlim(trace.times[0], trace.times[-1])
        figure.align_ylabels(panels)
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=3)

    return picture(name, shortened(trace.recording), 0.7 + 1.05 * sum(heights), draw, _ROLES[trace.role])


def _draw_channel(panel: Axes, trace: Trace, channel: str, labels: tuple[str, str]) -> None:
    scale = Scale(180 / np.pi, "deg") if channel == "psi" else Scale(1.0, "m")
    # A sensor slower than the grid leaves gaps, over which the line is drawn on.
    seen = np.isfinite(trace.measured[channel])
    if seen.any():
        panel.plot(
            trace.times[seen],
            scale.factor * trace.measured[channel][seen],
            color=NOISE,
            linewidth=5.0,
            label="recorded",
        )
    for simulated, colour, said in zip((trace.before, trace.after), (BEFORE, AFTER), labels, strict=True):
        if said and channel in simulated:
            panel.plot(
                trace.times, scale.factor * drawable(simulated[channel]), color=colour, linewidth=1.2, label=said
            )
    # A simulation that runs away must not flatten the recording.
    shown = [trace.measured[channel][seen], drawable(trace.after.get(channel, np.empty(0)))]
    low, high = _range(np.concatenate(shown), trace.before.get(channel) if labels[0] else None)
    panel.set_ylim(scale.factor * low, scale.factor * high)
    panel.set_ylabel(f"{quantity_name(channel)}\n{channel} [{scale.unit}]")


def _draw_residuals(panel: Axes, trace: Trace, channel: str, labels: tuple[str, str]) -> None:
    scale, recorded = _RESIDUALS[channel], trace.measured[channel]
    panel.axhline(0.0, color=NOISE, linewidth=1.0)
    left = [np.empty(0), np.empty(0)]
    for k, (simulated, colour) in enumerate(((trace.before, BEFORE), (trace.after, AFTER))):
        if labels[k] and channel in simulated:
            left[k] = recorded - drawable(simulated[channel])
            seen = np.isfinite(left[k])
            panel.plot(trace.times[seen], scale.factor * left[k][seen], color=colour, linewidth=1.0)
    # A simulation that runs away is cut off, one that moves where the record rests is not.
    span, last = recorded[np.isfinite(recorded)], np.abs(left[1] if left[1].size else left[0])
    usual = np.quantile(last[np.isfinite(last)], 0.9) if np.isfinite(last).any() else 0.0
    most = max(float(np.ptp(span)) if span.size else 1.0, 2.0 * float(usual))
    low, high = _range(np.clip(np.concatenate([[0.0], *left]), -most, most), None)
    panel.set_ylim(scale.factor * low, scale.factor * high)
    panel.set_ylabel(f"residual\n[{scale.unit}]")


def _range(wanted: NDArray[np.float64], other: NDArray[np.float64] | None) -> tuple[float, float]:
    """Limits that show all of `wanted`, and of `other` up to twice that span beyond."""
    wanted = wanted[np.isfinite(wanted)]
    if not wanted.size:
        return -1.0, 1.0
    low, high = float(wanted.min()), float(wanted.max())
    span = max(high - low, 1e-4)
    if other is not None and np.isfinite(other).any():
        low = min(low, max(float(np.nanmin(other)), low - 2 * span))
        high = max(high, min(float(np.nanmax(other)), high + 2 * span))
    margin = 0.06 * max(high - low, 1e-4)
    return low - margin, high + margin
