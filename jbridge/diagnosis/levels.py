"""Friction beside friction: the level common to both is counted once, with the plain Coulomb friction."""

import numpy as np
from numpy.typing import NDArray

from ..model.parameters import ParameterTable

ADDED_LEVELS = {
    "direction_dependent_friction": ("positive", "negative"),
    "position_dependent_friction": ("levels",),
    "position_direction_friction": ("positive", "negative"),
    "stribeck_friction": ("level",),
}
"""Levels of which, beside a Coulomb friction, the smallest stands at zero."""


def anchored(table: ParameterTable, vector: NDArray[np.float64]) -> NDArray[np.int64]:
    """Places of the levels that stay at zero because a Coulomb friction on the same axis takes the common part."""
    held = []
    for kind, keys in ADDED_LEVELS.items():
        for site in ("cart", "swing", "hoist"):
            try:
                places = [p for key in keys for p in table.positions(f"{kind}@{site}.{key}")]
                table.positions(f"coulomb_friction@{site}.level")
            except KeyError:
                continue
            held.append(places[int(np.argmin(vector[places]))])
    return np.array(held, np.int64)


def settle_levels(table: ParameterTable, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moves what an added friction has in common with the axis' Coulomb friction to the latter."""
    vector = vector.copy()
    for kind, keys in ADDED_LEVELS.items():
        for site in ("cart", "swing", "hoist"):
            try:
                places = [p for key in keys for p in table.positions(f"{kind}@{site}.{key}")]
                plain = table.positions(f"coulomb_friction@{site}.level")
            except KeyError:
                continue
            common = float(vector[places].min())
            if kind == "stribeck_friction":
                places = [*places, *table.positions(f"{kind}@{site}.breakaway")]
            vector[places] -= common
            vector[plain] += common
    return vector
