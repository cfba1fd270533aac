"""The force that the motion needs beyond the model's, against what it may depend on."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from ...diagnosis.localization.missing_force import INPUT_OF
from ...diagnosis.result import Region
from ...identification.result import Trace
from ..text.quantities import pretty_unit
from ..text.words import variable_name, variable_unit
from .style import AFTER, BEFORE, SHADE, Picture, picture

FORCES = {
    "x": ("force on the cart", "N"),
    "psi": ("torque on the swing", "N m"),
    "l": ("force along the rope", "N"),
}
_FALLING = {"x": "the cart moves back", "psi": "the swing moves back", "l": "the rope gets shorter"}
_MOST_POINTS = 4000
_MOST_PANELS = 4
_BINS = 36
_LEAST_IN_BIN = 12

Points = NDArray[np.float64]


class Table(NamedTuple):
    """Points of all recordings, one row each."""

    values: Points
    before: Points
    after: Points
    direction: Points
    """Sign of the axis' velocity."""


def draw_force(
    name: str,
    traces: Sequence[Trace],
    axis: str,
    where: Iterable[Region],
    units: Mapping[str, str],
    labels: tuple[str, str],
) -> Picture | None:
    """Residual force of one axis against position, velocity, input and whatever else the mismatch depends on.

    Args:
        name: of the picture's file.
        traces: the recordings to pool.
        axis: `x`, `psi` or `l`.
        where: regions in which the mismatch sits.
        units: of the inputs.
        labels: what the model before and after is called; one that is empty is left out.

    Returns:
        None where no recording has a force on that axis.
    """
    regions = list(where)
    variables = [axis, f"v_{axis}", INPUT_OF[axis], *(region.variable for region in regions)]
    tables = {variable: _pool(traces, axis, variable) for variable in dict.fromkeys(variables)}
    panels = [(variable, table) for variable, table in tables.items() if table is not None][:_MOST_PANELS]
    if not panels:
        return None
    quantity, unit = FORCES[axis]
    columns = 2 if len(panels) in (2, 4) else len(panels)
    rows = -(-len(panels) // columns)

    def draw(figure: FigureBase) -> None:
        grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
        top = _top([table for _, table in panels])
        for panel, (variable, table) in zip(grid.flat, panels, strict=True):
            _draw_panel(panel, table, labels, jumps=variable in (f"v_{axis}", INPUT_OF[axis]))
            spans = [(region.low, region.high) for region in regions if region.variable == variable]
            factor = 180 / np.pi if variable_unit(variable, units).startswith("rad") else 1.0
            low, high = panel.get_xlim()
            for start, stop in spans:
                panel.axvspan(factor * start, factor * stop, color=SHADE, alpha=0.35, linewidth=0, zorder=0)
            panel.set_xlim(low, high)
            panel.set_ylim(-top, top)
            panel.set_xlabel(f"{variable_name(variable)} [{_shown_unit(variable, units)}]")
            panel.axhline(0, color="#808080", linewidth=0.8)
        for panel in grid[:, 0]:
            panel.set_ylabel(f"unexplained {quantity} [{unit}]")
        handles, names = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=2)

    both = any(variable not in (f"v_{axis}", INPUT_OF[axis]) for variable, _ in panels)
    explanation = (
        "Lines: running median"
        + (f", dashed where {_FALLING[axis]}." if both else ".")
        + (" Yellow: where the mismatch sits." if regions else "")
    )
    return picture(name, f"Unexplained {quantity}", 0.6 + 2.8 * rows, draw, explanation)


def _shown_unit(variable: str, units: Mapping[str, str]) -> str:
    return pretty_unit(variable_unit(variable, units)).replace("rad", "deg")


def _pool(traces: Sequence[Trace], axis: str, variable: str) -> Table | None:
    """A variable, and the force before and after, over all recordings; None where that cannot be drawn."""
    pooled: list[Table] = []
    for trace in traces:
        values = values_of(trace, variable)
        if values is None or axis not in trace.force_before:
            continue
        before = trace.force_before[axis]
        after = trace.force_after.get(axis, np.full_like(before, np.nan))
        keep = np.isfinite(values) & (np.isfinite(before) | np.isfinite(after))
        columns = (values, before, after, np.sign(trace.velocities[axis]))
        pooled.append(Table(*(column[keep] for column in columns)))
    if not pooled:
        return None
    table = Table(*(np.concatenate(column) for column in zip(*pooled, strict=True)))
    return table if table.values.size > _LEAST_IN_BIN and np.ptp(table.values) > 0 else None


def values_of(trace: Trace, variable: str) -> Points | None:
    """A variable over time, angles in degrees."""
    if variable == "t":
        return trace.times
    if variable in trace.inputs:
        return trace.inputs[variable]
    source = trace.velocities if variable.startswith("v_") else trace.coordinates
    values = source.get(variable.removeprefix("v_"))
    return None if values is None else values * (180 / np.pi if variable.endswith("psi") else 1.0)


def _top(tables: Sequence[Table]) -> float:
    """A limit that shows nearly all points, since differentiated noise has outliers."""
    forces = np.concatenate([np.concatenate((table.before, table.after)) for table in tables])
    sizes = np.abs(forces[np.isfinite(forces)])
    return 1.25 * float(np.quantile(sizes, 0.985)) if sizes.size and sizes.max() > 0 else 1.0


def _draw_panel(panel: Axes, table: Table, labels: tuple[str, str], jumps: bool) -> None:
    """Dots and running medians; one for either direction of motion, except of velocity and input, which tell it."""
    step = max(table.values.size // _MOST_POINTS, 1)
    every = np.ones(table.values.size, bool)
    ways = [(every, "-")] if jumps else [(table.direction > 0, "-"), (table.direction < 0, (0, (2.5, 1.2)))]
    for force, colour, said in zip((table.before, table.after), (BEFORE, AFTER), labels, strict=True):
        if not said:
            continue
        dots = table.values[::step], force[::step]
        panel.plot(*dots, ".", color=colour, alpha=0.16, markersize=3.0, markeredgewidth=0, zorder=1)
        for number, (way, dashes) in enumerate(ways):
            centres, medians = running_median(table.values[way], force[way], jumps)
            # A white rim keeps the line apart from its own dots.
            panel.plot(centres, medians, color="white", linewidth=4.0, zorder=2)
            name = said if number == 0 else "_"
            panel.plot(centres, medians, color=colour, linewidth=2.2, linestyle=dashes, zorder=3, label=name)
    values = table.values
    low, high = np.quantile(values, [0.002, 0.998])
    margin = 0.03 * (high - low) or 0.5
    panel.set_xlim(low - margin, high + margin)


def running_median(values: Points, force: Points, jumps: bool) -> tuple[Points, Points]:
    """Median force in bins of a variable; bins with few points are NaN, so that a line breaks there.

    Zero is the edge of a bin, because friction and dead zones jump there.

    Args:
        values: of the variable.
        force: at each value.
        jumps: whether the line breaks at zero, as against velocity and input.
    """
    finite = np.isfinite(force)
    values, force = values[finite], force[finite]
    if values.size < _LEAST_IN_BIN:
        return np.empty(0), np.empty(0)
    low, high = np.quantile(values, [0.005, 0.995])
    width = (high - low) / _BINS
    if not width > 0:
        return np.empty(0), np.empty(0)
    first = np.floor(low / width)
    edges = width * np.arange(first, np.ceil(high / width) + 1)
    centres, medians = [], []
    which = np.digitize(values, edges)
    for i in range(1, edges.size):
        inside = force[which == i]
        if jumps and edges[i - 1] == 0.0:
            # What lies left and right of zero is not joined.
            centres.append(0.0)
            medians.append(np.nan)
        centres.append((edges[i - 1] + edges[i]) / 2)
        medians.append(float(np.median(inside)) if inside.size >= _LEAST_IN_BIN else np.nan)
    return np.array(centres), np.array(medians)
