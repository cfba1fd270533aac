"""Fuzzy systems to look at: sets, surfaces, and which rules spoke when."""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from numpy.typing import NDArray

from ....fuzzy.inference import AbstractSystem, Mamdani
from ....fuzzy.rules import Variable, in_words
from ..style import AFTER, BEFORE, RECORDED, Picture, picture

UNITS = {"error": "1", "velocity": "m/s", "angle": "deg"}
"""Units of what the controllers read."""
_COLOURS = ("#0a6ebd", "#00805c", "#8a4f9e", "#dd6a00", "#3c3c3c")
_POINTS = 61


def draw_variable(
    panel: Axes, variable: Variable, label: str, limit: float | None = None, faint: bool = False, scale: float = 1.0
) -> None:
    """The sets of a variable.

    Args:
        panel: where to.
        variable: whose sets.
        label: of the axis.
        limit: shows what lies within this distance of zero; the whole universe by default.
        faint: draws thin dashed lines without names, for comparison.
        scale: what 1 in the variable is on the axis; `limit` is on the axis.
    """
    low, high = (scale * float(variable.low), scale * float(variable.high)) if limit is None else (-limit, limit)
    values = np.linspace(low, high, 1201)
    found = variable.degrees(variable.clip(jnp.asarray(values / scale)))
    named: list[tuple[float, str, str]] = []
    for colour, said, degrees in zip(_COLOURS, variable.labels, found, strict=False):
        curve = np.asarray(degrees)
        if faint:
            panel.plot(values, curve, color=colour, linewidth=1.0, linestyle=(0, (4, 3)), alpha=0.6)
            continue
        panel.plot(values, curve, color=colour)
        if curve.max() < 0.9:  # its peak lies outside
            continue
        at = float(values[curve >= curve.max() - 1e-9].mean())
        if named and abs(at - named[-1][0]) < 0.04 * (high - low):
            named[-1] = (named[-1][0], f"{named[-1][1]} {said}", RECORDED)
        else:
            named.append((at, said, colour))
    for at, said, colour in named:
        side = "left" if at < low + 0.02 * (high - low) else "right" if at > high - 0.02 * (high - low) else "center"
        panel.annotate(said, (at, 1.03), ha=side, color=colour, fontsize=9)
    panel.set_xlim(low, high)
    panel.set_ylim(0.0, 1.22)
    panel.set_yticks([0, 0.5, 1])
    panel.set_xlabel(label)
    panel.set_ylabel("degree")


def draw_changed_sets(
    name: str,
    title: str,
    before: Mamdani,
    after: Mamdani,
    scales: tuple[float, float] | None = None,
    command: str = "V",
) -> Picture:
    """The sets of two systems of the same structure, the former dashed.

    Args:
        name: of the picture's file.
        title: stands above it.
        before, after: the systems.
        scales: what an error of 1 is in each of them [m], to draw errors in metres.
        command: the unit of what they conclude.
    """
    pairs = list(zip((*before.inputs, *before.outputs), (*after.inputs, *after.outputs), strict=True))
    units = UNITS | {variable.name: command for variable in after.outputs}

    def draw(figure: FigureBase) -> None:
        panels = np.atleast_1d(figure.subplots(len(pairs), 1))
        for number, (panel, (old, new)) in enumerate(zip(panels, pairs, strict=True)):
            in_metres = scales is not None and number == 0
            own = scales if scales is not None and in_metres else (1.0, 1.0)
            unit = "m" if in_metres else units.get(new.name, "1")
            limits = [scale * (_close(v) or float(v.high)) for v, scale in zip((old, new), own, strict=True)]
            limit = max(limits) if in_metres else _close(old, new)
            draw_variable(panel, old, "", limit, faint=True, scale=own[0])
            draw_variable(panel, new, f"{new.name} [{unit}]", limit, scale=own[1])

    return picture(name, title, 1.6 * len(pairs), draw, "Dashed: as given. Solid: tuned.")


def _close(*variables: Variable) -> float | None:
    """How far from zero something happens, if that is a small part of the universe."""
    most = float(variables[0].high)
    inner = 0.0
    for variable in variables:
        for member in variable.sets:
            values = [float(leaf) for leaf in jax.tree.leaves(member)]
            inner = max([inner, *(abs(value) for value in values if abs(value) < 0.999 * most)])
    return 1.3 * inner if float(variables[0].low) == -most and 0.0 < inner <= 0.4 * most else None


def surface(
    system: AbstractSystem, across: int, along: int, reach: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The first output over two inputs, the others at the middle of their universes.

    Args:
        system: what concludes.
        across, along: which inputs.
        reach: how far from their middles to go.

    Returns:
        Values of the two inputs, and the output `(along, across)`.
    """
    middles = [float(variable.middle) for variable in system.inputs]
    first = middles[across] + reach[0] * np.linspace(-1, 1, _POINTS)
    second = middles[along] + reach[1] * np.linspace(-1, 1, _POINTS)
    values = np.tile(middles, (_POINTS, _POINTS, 1))
    values[:, :, across], values[:, :, along] = first[None, :], second[:, None]
    found = jax.vmap(jax.vmap(lambda v: system.infer(v).output[0]))(jnp.asarray(values))
    return first, second, np.asarray(found)


def draw_surfaces(
    name: str,
    title: str,
    systems: Mapping[str, AbstractSystem],
    reach: float,
    scales: Sequence[float],
    command: str = "V",
) -> Picture:
    """The command over the error and each further input, one row a system.

    Args:
        name: of the picture's file.
        title: stands above it.
        systems: by what they are called, all with the same inputs.
        reach: how far from zero the error is shown [m].
        scales: what an error of 1 is in each of them [m]; beyond it, it counts as 1.
        command: the unit of what they conclude.
    """
    first = next(iter(systems.values()))
    others = range(1, len(first.inputs))

    def draw(figure: FigureBase) -> None:
        grid = figure.subplots(len(systems), len(others), squeeze=False)
        for row, (said, system), scale in zip(grid, systems.items(), scales, strict=True):
            most = float(system.outputs[0].high) if isinstance(system, Mamdani) else 1.0
            for panel, number in zip(row, others, strict=True):
                x, y = system.inputs[0], system.inputs[number]
                half = 0.5 * float(y.high - y.low)
                a, b, found = surface(system, 0, number, (reach / scale, half))
                drawn = panel.contourf(
                    scale * a, b, found, levels=np.linspace(-most, most, 25), cmap="RdBu_r", extend="both"
                )
                panel.contour(scale * a, b, found, levels=[0.0], colors=[RECORDED], linewidths=0.8)
                panel.set_xlabel(f"{x.name} [m]")
                panel.set_ylabel(f"{y.name} [{UNITS.get(y.name, '1')}]")
                panel.set_title(said, fontsize=10)
                figure.colorbar(drawn, ax=panel, label=f"command [{command}]", ticks=[-most, 0, most])

    said = "Black line: zero. Other inputs in their middle."
    return picture(name, title, 2.7 * len(systems), draw, said)


def silent_share(system: AbstractSystem, values: NDArray[np.float64]) -> float:
    """Share of some inputs `(time, input)` for which no rule fires, so that the output is its mid-range."""
    return float(1.0 - np.mean(np.asarray(jax.vmap(system.infer)(jnp.asarray(values)).fired)[:, 0]))


def draw_rules(
    name: str,
    title: str,
    system: AbstractSystem,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    command: str = "V",
) -> Picture:
    """Which rules spoke when, and what they concluded together.

    Args:
        name: of the picture's file.
        title: stands above it.
        system: whose rules.
        times: [s].
        values: of the inputs, `(time, input)`.
        command: the unit of what they conclude.
    """
    found = jax.vmap(system.infer)(jnp.asarray(values))
    strength, output = np.asarray(found.strength), np.asarray(found.output)[:, 0]
    words = [in_words(rule, system.inputs, system.outputs) for rule in system.rules]
    silent = ~np.asarray(found.fired)[:, 0]

    def draw(figure: FigureBase) -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 0.24 * len(words) + 0.4))
        above.step(times, output, where="post", color=AFTER)
        if silent.any():
            above.fill_between(times, *above.get_ylim(), where=silent.tolist(), color=BEFORE, alpha=0.2, step="post")
        above.set_ylabel(f"command [{command}]")
        drawn = below.pcolormesh(
            times, np.arange(len(words)), strength.T, cmap="Blues", vmin=0, vmax=1, shading="nearest", rasterized=True
        )
        below.set_yticks(np.arange(len(words)), [f"{i + 1}  {text[3:]}" for i, text in enumerate(words)], fontsize=7.5)
        below.invert_yaxis()
        below.grid(False)
        below.set_xlabel("time [s]")
        figure.colorbar(drawn, ax=[above, below], label="firing strength", shrink=0.6, pad=0.01)

    said = ""
    if silent.any():
        said = f"In {100 * silent.mean():.2g} % of the time no rule fires (shaded) and the output is its mid-range."
    return picture(name, title, 1.6 + 0.26 * len(words), draw, said)


def draw_descent(name: str, title: str, cost: NDArray[np.float64], softness: NDArray[np.float64]) -> Picture:
    """The cost over the steps of a search, and the softness that it had."""

    def draw(figure: FigureBase) -> None:
        left = figure.subplots()
        left.plot(np.arange(len(cost)), cost, color=_COLOURS[0])
        left.set_xlabel("step")
        left.set_ylabel("cost of the smooth controller")
        right = left.twinx()
        right.semilogy(np.arange(len(softness)), softness, color="#909090", linestyle=(0, (4, 3)))
        right.set_ylabel("softness", color="#707070")
        right.grid(False)

    return picture(name, title, 2.8, draw)


def draw_ensemble(
    name: str,
    title: str,
    found: Mapping[str, Mapping[str, NDArray[np.float64]]],
    measures: Mapping[str, tuple[str, float]],
    explanation: str = "",
) -> Picture:
    """How many bridges and moves stay below what: one panel a measure, one line a controller.

    Args:
        name: of the picture's file.
        title: stands above it.
        found: measures by controller and name, any shape; nan counts as never.
        measures: label and factor of each measure to draw.
        explanation: stands below the title.
    """

    def draw(figure: FigureBase) -> None:
        panels = np.atleast_1d(figure.subplots(1, len(measures)))
        for panel, (key, (label, factor)) in zip(panels, measures.items(), strict=True):
            for (said, own), colour in zip(found.items(), _COLOURS, strict=False):
                values = np.sort(factor * np.ravel(own[key]))
                share = 100 * np.arange(1, len(values) + 1) / len(values)
                panel.step(values, share, where="post", color=colour, label=said)
            panel.set_xlabel(label)
            panel.set_ylim(0, 101)
        panels[0].set_ylabel("bridges and moves [%]")
        handles, names = panels[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=4)

    return picture(name, title, 3.0, draw, explanation)
