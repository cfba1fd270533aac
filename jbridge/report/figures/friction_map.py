"""Friction by place: the curve that was found, with its intervals."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import FigureBase

from ...identification.result import Estimate
from ..text.quantities import as_list, pretty_unit
from ..text.words import capital, effect_name
from .style import BACKWARDS, FORWARDS, Picture, picture

KINDS = ("position_dependent_friction", "position_direction_friction")
_CURVES = {
    "levels": ("in both directions", FORWARDS, "o"),
    "positive": ("towards larger values", FORWARDS, ">"),
    "negative": ("towards smaller values", BACKWARDS, "<"),
}


_HEADROOM = 4.0
"""Top of the picture over the highest level, at most."""


def draw_friction_map(name: str, kind: str, site: str, parameters: Mapping[str, Estimate]) -> Picture | None:
    """Friction over place; None for an effect that is no map, or without its places."""
    curves = [key for key in _CURVES if key in parameters]
    if kind not in KINDS or "knots" not in parameters or not curves:
        return None
    places = np.array(as_list(parameters["knots"].value), dtype=np.float64)
    quantity = "rope length l" if site == "hoist" else "cart position x"

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        for key in curves:
            said, colour, marker = _CURVES[key]
            estimate = parameters[key]
            values = _array(estimate.value, places.size)
            low, high = _array(estimate.low, places.size), _array(estimate.high, places.size)
            panel.fill_between(places, low, high, color=colour, alpha=0.18, linewidth=0)
            panel.plot(places, values, color=colour, marker=marker, markersize=6, linewidth=2.0, label=f"motion {said}")
        # Where no recording passed, an interval may have no end; it must not flatten the curve.
        most = max((np.nanmax(_array(parameters[key].value, places.size), initial=0.0) for key in curves), default=0.0)
        panel.set_ylim(0.0, min(panel.get_ylim()[1], _HEADROOM * most) if most > 0.0 else None)
        panel.set_xlabel(f"{quantity} [m]")
        panel.set_ylabel(f"friction level [{pretty_unit(parameters[curves[0]].unit)}]")
        figure.legend(loc="outside upper left", ncols=2)

    return picture(name, capital(effect_name(kind, site)), 3.2, draw, "Level by place, with its 95 % intervals.")


def _array(value: float | list[float] | None, size: int) -> np.ndarray:
    """A vector of the map's size; NaN where nothing is known, which is not drawn."""
    numbers = np.array([np.nan if number is None else number for number in as_list(value)], dtype=np.float64)
    return numbers if numbers.size == size else np.full(size, np.nan)
