"""Everything that could be missing: one candidate for each effect, site and place to start looking."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...identification.setting import Setting
from ...model.effects.base import AXIS_OF_SITE, MOMENTS, SITES, Scene, Seed
from ...model.effects.catalogue import CATALOGUE, make_effect
from ...model.fields import options_of
from ...model.parameters import ParameterTable
from ...model.plant import Plant

WRONG_VALUE = "wrong_value"
"""The kind of the commonest cause of all: a known number that is wrong. Its site is the parameter's name."""
SITE_OF_NUMBER = {
    "cart_mass": "cart", "cart_damping": "cart", "cart_gain": "cart_drive",
    "load_mass": "swing", "swing_damping": "swing",
    "winch_mass": "hoist", "hoist_damping": "hoist", "hoist_gain": "hoist_drive",
}  # fmt: skip
"""Numbers that a rig's owner may know wrong, by the site where they act. Gravity is not among them."""


_ELSEWISE = MOMENTS | {"period", "phase", "position", "rest", "velocity", "exponent"}
"""Keys that say when, where or how fast an effect acts."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One explanation and where to start it."""

    kind: str
    site: str
    values: Mapping[str, Any]
    free: tuple[str, ...]
    """Keys that are estimated."""
    finite: bool
    """Whether it is present at `values`, so that a linear screen cannot weigh it from its null value."""

    linear: tuple[str, ...] = ()
    """Of an absent effect, those of them that do something at `values`."""

    @property
    def harmonic(self) -> bool:
        """Whether its amplitude and phase stand for a sine and a cosine."""
        return {"amplitude", "phase"} <= set(self.linear)

    @property
    def name(self) -> tuple[str, str]:
        return self.kind, self.site

    @property
    def sizes(self) -> tuple[str, ...]:
        """Keys that say how large it is; not when, where or how fast."""
        return tuple(key for key in self.free if key not in _ELSEWISE)

    def group(self, key: str) -> str:
        """The parameter's name in a table."""
        return self.site if self.kind == WRONG_VALUE else f"{self.kind}@{self.site}.{key}"

    def places(self, table: ParameterTable, keys: Sequence[str] | None = None) -> NDArray[np.int64]:
        """Where its free parameters stand, or some of them."""
        wanted = self.free if keys is None else keys
        return np.array([place for key in wanted for place in table.positions(self.group(key))], np.int64)

    def set(self, table: ParameterTable, vector: NDArray[np.float64]) -> NDArray[np.float64]:
        """A parameter vector with the candidate's values put in."""
        vector = vector.copy()
        for key, value in self.values.items():
            if key == "coulomb":
                # What is left of the plain friction that this law takes the place of.
                plain = f"coulomb_friction@{self.site}.level"
                if plain in table.names():
                    vector[table.positions(plain)] = value
            elif isinstance(value, str):
                words = options_of(CATALOGUE[self.kind])[key]
                vector[table.option_place(self.group(key))] = words.index(value)
            else:
                places = table.positions(self.group(key))
                vector[places] = np.broadcast_to(np.asarray(value, dtype=float), len(places))
        return vector


def candidates(plant: Plant, known: Iterable[str], setting: Setting, scene: Scene) -> list[Candidate]:
    """All candidates that the plant does not have yet and that the recordings have the parts for.

    Args:
        plant: the model.
        known: parameters that are not estimated.
        setting: recordings and noise.
        scene: what seeds go by.
    """
    present = {(effect.kind, effect.site) for effect in plant.effects}
    found = []
    for kind, cls in CATALOGUE.items():
        for site in cls.sites:
            if cls.beside and present.isdisjoint((other, site) for other in cls.beside):
                continue
            if (kind, site) in present or not _exists(site, setting) or not _has_room(plant, kind, site):
                continue
            found += [_candidate(kind, site, seed) for seed in cls.seeds(site, scene)]
    for number, site in SITE_OF_NUMBER.items():
        if number in known and AXIS_OF_SITE[site] in setting.axes:
            found.append(Candidate(WRONG_VALUE, number, {}, (number,), False, (number,)))
    return found


def _has_room(plant: Plant, kind: str, site: str) -> bool:
    """Whether a plant can hold an effect, in the place of those that it contains."""
    parts = {part.kind for part in CATALOGUE[kind].contains}
    left = tuple(e for e in plant.effects if e.kind not in parts or e.site != site)
    try:
        Plant(plant.bridge, (*left, make_effect(kind, site, {}))).check()
    except ValueError:
        return False
    return True


def _candidate(kind: str, site: str, seed: Seed) -> Candidate:
    linear = seed.free if seed.linear is None else seed.linear
    return Candidate(kind, site, dict(seed.values), seed.free, seed.finite, () if seed.finite else linear)


def _exists(site: str, setting: Setting) -> bool:
    assert site in SITES
    axis = AXIS_OF_SITE[site]
    if site.endswith("_sensor"):
        if site == "l_sensor" and "psi" in setting.axes:
            return True
        return axis in setting.axes and axis in setting.noise
    return axis in setting.axes
