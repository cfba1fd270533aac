"""One plant that holds every effect of the catalogue at its null value, so that one program serves all candidates."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from .effects.base import AXIS_OF_SITE, AbstractEffect, AbstractMechanism, Scene, parameters_of
from .effects.catalogue import KINDS
from .plant import Plant


def make_effect(kind: str, site: str, values: Mapping[str, Any]) -> AbstractEffect:
    """An effect from parameter values by key; what is not given stands at its null value."""
    cls = KINDS[kind]
    arguments: dict[str, Any] = {info.name: info.null for info in parameters_of(cls).values()}
    for key, value in values.items():
        info = parameters_of(cls).get(key)
        arguments[info.name if info is not None else key] = value
    return cls(**arguments, site=site)


def null_effect(kind: str, site: str, scene: Scene) -> AbstractEffect:
    """The effect at its null value, its shapes (knots, reference length) fitting the recordings."""
    seed = KINDS[kind].seeds(site, scene)[0].values
    values = {}
    for key, info in parameters_of(KINDS[kind]).items():
        if key in seed and not info.fitted:
            values[key] = seed[key]
        elif info.vector:
            values[key] = np.full(len(seed[key]), info.null)
    return make_effect(kind, site, values)


def superset(plant: Plant, scene: Scene, axes: Collection[str], mechanism: str | None = None) -> Plant:
    """The plant with every effect that it lacks at its null value, in the catalogue's order.

    Args:
        plant: the model so far.
        scene: gives the shapes' ranges.
        axes: those of `x`, `psi`, `l` that exist in the recordings.
        mechanism: the kind of one hidden-coordinate effect to add, which has no null value.
    """
    present = {(effect.kind, effect.site) for effect in plant.effects}
    effects = list(plant.effects)
    for kind, cls in KINDS.items():
        for site in cls.sites:
            if (kind, site) in present or AXIS_OF_SITE[site] not in axes:
                continue
            if issubclass(cls, AbstractMechanism):
                if kind == mechanism:
                    seed = cls.seeds(site, scene)[0]
                    effects.append(make_effect(kind, site, seed.values))
            else:
                effects.append(null_effect(kind, site, scene))
    order = list(KINDS)
    effects.sort(key=lambda effect: (order.index(effect.kind), effect.sites.index(effect.site)))
    return Plant(plant.bridge, tuple(effects))
