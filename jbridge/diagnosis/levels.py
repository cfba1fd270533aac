"""Friction beside friction: the level common to both is counted once, with the plain Coulomb friction."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model.effects.base import AbstractEffect, parameters_of
from ..model.effects.friction import (
    CoulombFriction,
    DirectionDependentFriction,
    FrictionDrift,
    PositionDependentFriction,
    PositionDirectionFriction,
    StribeckFriction,
)
from ..model.parameters import ParameterTable

ADDED_LEVELS = {
    "direction_dependent_friction": ("positive", "negative"),
    "position_dependent_friction": ("levels",),
    "position_direction_friction": ("positive", "negative"),
    "stribeck_friction": ("level",),
}
"""Levels of which, beside a Coulomb friction, the smallest stands at zero."""
_ABOVE = {"stribeck_friction": ("breakaway",)}
"""What else is counted from the same zero."""


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
            places = [*places, *(p for key in _ABOVE.get(kind, ()) for p in table.positions(f"{kind}@{site}.{key}"))]
            vector[places] -= common
            vector[plain] += common
    return vector


def taking_over(
    effects: Sequence[AbstractEffect], gone: AbstractEffect, known: Collection[str] = ()
) -> tuple[AbstractEffect, ...]:
    """The effects without one of them, which leaves what it has of a plain friction to another law on its axis.

    A Coulomb friction leaves its level to a law that contains one, and such a law its mean level to a Coulomb friction;
    a level that is known stays as it is.
    """
    rest = [effect for effect in effects if effect is not gone]
    plain = isinstance(gone, CoulombFriction)
    level: Any = gone.level if isinstance(gone, CoulombFriction) else None
    level = dict(simpler_laws(gone)).get(CoulombFriction.kind, {}).get("level", level)
    for place, effect in enumerate(rest):
        if level is None or effect.site != gone.site:
            continue
        keys = (*ADDED_LEVELS.get(effect.kind, ()), *_ABOVE.get(effect.kind, ())) if plain else ()
        if not plain and isinstance(effect, CoulombFriction):
            keys = ("level",)
        if keys and not any(f"{effect.kind}@{effect.site}.{key}" in known for key in keys):
            names = [parameters_of(type(effect))[key].name for key in keys]
            rest[place] = dataclasses.replace(effect, **{name: getattr(effect, name) + level for name in names})
            break
    return tuple(rest)


def on_even_knots(
    knots: ArrayLike, curves: Mapping[str, ArrayLike], count: int
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Another number of knots, evenly spaced over the same places, and piecewise linear curves read off there."""
    old = np.asarray(knots)
    new = np.linspace(old[0], old[-1], count)
    return new, {key: np.interp(new, old, np.asarray(curve)) for key, curve in curves.items()}


def simpler_laws(effect: AbstractEffect) -> list[tuple[str, dict[str, Any]]]:
    """Laws of friction that a law contains, the simplest first, at values that come close to it."""
    if isinstance(effect, StribeckFriction | FrictionDrift):
        return [("coulomb_friction", {"level": float(effect.level)})]
    if isinstance(effect, DirectionDependentFriction):
        return [("coulomb_friction", {"level": 0.5 * float(effect.positive + effect.negative)})]
    if isinstance(effect, PositionDependentFriction):
        return [("coulomb_friction", {"level": float(effect.levels_at.mean())})]
    if isinstance(effect, PositionDirectionFriction):
        up, down = np.asarray(effect.positive), np.asarray(effect.negative)
        middle = {"knots": np.asarray(effect.knots), "levels": 0.5 * (up + down)}
        return [
            ("coulomb_friction", {"level": 0.5 * float(up.mean() + down.mean())}),
            ("direction_dependent_friction", {"positive": float(up.mean()), "negative": float(down.mean())}),
            ("position_dependent_friction", middle),
        ]
    return []
