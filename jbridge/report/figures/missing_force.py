"""The force that the model as given lacks: along a recording, and against what it depends on."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from ...diagnosis.localization.symmetries import most_telling
from ...diagnosis.result import Location, MissingForce
from ...identification.result import Trace
from ..text.quantities import pretty_unit
from ..text.words import variable_name, variable_unit
from .residual_force import FORCES, values_of
from .style import BACKWARDS, BEFORE, FORWARDS, NOISE, SHADE, Picture, picture, shortened

_BINS = 30
_LEAST_IN_BIN = 12
_MOST_POINTS = 4000

Points = NDArray[np.float64]


def draw_missing(
    name: str,
    location: Location,
    traces: Sequence[Trace],
    axis: str,
    units: Mapping[str, str],
) -> Picture | None:
    """The smoothed force along the recording where it is largest, and against two variables.

    Args:
        name: of the picture's file.
        location: forces by recording, what they are like, and where and when they are largest, which is shaded.
        traces: the same recordings, and maybe more.
        axis: on which the force acts, `x`, `psi` or `l`.
        units: of the inputs.

    Returns:
        None where there is no force to draw.
    """
    where, when, likeness = location.where, location.when, location.likeness
    if likeness is None:
        return None
    by_name = {trace.recording: trace for trace in traces}
    pairs = [(force, by_name[force.recording]) for force in location.forces if force.recording in by_name]
    pairs = [(force, trace) for force, trace in pairs if np.isfinite(force.mean).sum() > 1]
    if not pairs:
        return None
    quantity, unit = FORCES[axis]
    factor = 1.0
    if axis == "psi":  # a torque on a load of some hundred grams
        factor, unit = 1e3, f"m{unit}"
    best = most_telling(likeness.by).partition(",")[0]
    variables = list(dict.fromkeys([*[region.variable for region in where[:1]], best, axis, f"v_{axis}"]))[:2]
    shown, _ = max(pairs, key=lambda pair: float(np.nanmean(pair[0].mean ** 2)))
    spans = [(i.start, i.stop) for i in when if i.recording == shown.recording]

    def draw(figure: FigureBase) -> None:
        grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.35))
        course = figure.add_subplot(grid[0, :])
        course.plot(shown.times, factor * shown.mean, color=BEFORE, label="missing force")
        course.axhline(0, color="#808080", linewidth=0.8)
        for start, stop in spans:
            course.axvspan(start, stop, color=SHADE, alpha=0.35, linewidth=0, zorder=-1)
        course.set_xlim(0.0, float(shown.times[-1]))
        course.set_xlabel(f"time in {shortened(shown.recording)} [s]")
        course.set_ylabel(f"{quantity} [{unit}]")
        course.legend(loc="upper right")
        panels = [figure.add_subplot(grid[1, k]) for k in range(len(variables))]
        for panel, variable in zip(panels, variables, strict=True):
            _against(panel, pairs, axis, variable, factor)
            shown_unit = pretty_unit(variable_unit(variable, units)).replace("rad", "deg")
            panel.set_xlabel(f"{variable_name(variable)} [{shown_unit}]")
            panel.axhline(0, color="#808080", linewidth=0.8)
            edges = panel.get_xlim()
            for region in where:
                if region.variable == variable:
                    turn = 180 / np.pi if variable_unit(variable, units).startswith("rad") else 1.0
                    panel.axvspan(
                        turn * region.low, turn * region.high, color=SHADE, alpha=0.35, linewidth=0, zorder=-1
                    )
            panel.set_xlim(edges)
        panels[0].set_ylabel(f"{quantity} [{unit}]")
        if panels[0].get_legend_handles_labels()[0]:
            panels[0].legend(loc="best")

    told = (
        "Smoothed from the recordings, no law assumed; gaps where they do not tell it. Lines: median in each direction."
    )
    if where or spans:
        told += " Shaded: where or when it sits."
    return picture(name, f"Missing {quantity}", 5.6, draw, told)


def _against(
    panel: Axes,
    pairs: Sequence[tuple[MissingForce, Trace]],
    axis: str,
    variable: str,
    factor: float,
) -> None:
    """Points and running medians, each direction of motion by itself."""
    values, forces, speeds = [], [], []
    for force, trace in pairs:
        known = np.isfinite(force.mean)
        values.append(_at(force, trace, variable)[known])
        speeds.append(_at(force, trace, f"v_{axis}")[known])
        forces.append(factor * force.mean[known])
    x, y, v = (np.concatenate(part) for part in (values, forces, speeds))
    some = slice(None, None, max(1, len(x) // _MOST_POINTS))
    panel.plot(x[some], y[some], ".", color=NOISE, markersize=2, zorder=0)
    if not len(x) or not np.ptp(x) > 0:
        return
    low, high = (float(edge) for edge in np.quantile(x, [0.005, 0.995]))
    edges = np.linspace(low, high, _BINS + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for colour, label, chosen in ((FORWARDS, "forwards", v > 0), (BACKWARDS, "backwards", v < 0)):
        place = np.searchsorted(edges, x[chosen]) - 1
        parts = [y[chosen][place == i] for i in range(_BINS)]
        medians = [float(np.median(part)) if len(part) >= _LEAST_IN_BIN else np.nan for part in parts]
        panel.plot(middle, medians, color=colour, label=label)
    top = 1.1 * float(np.quantile(np.abs(y), 0.995))
    if top > 0:
        panel.set_ylim(-top, top)


def _at(force: MissingForce, trace: Trace, variable: str) -> Points:
    """A variable at the force's times, angles in degrees."""
    if variable == "t":
        return force.times
    values = values_of(trace, variable)
    return np.zeros_like(force.times) if values is None else np.interp(force.times, trace.times, values)
