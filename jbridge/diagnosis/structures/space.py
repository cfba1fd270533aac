"""All models that a search compares, as one compiled plant.

Effects without a coordinate of their own stand side by side in one plant, absent at their null values. Which of them a
model has is which of their parameters are free, so that one program serves every model of a search. Mechanisms, and
what has a hidden spring, would slow that program down; each has one of its own.
"""

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...identification.estimation import Problem, engine_for
from ...identification.operating_range import scene_of
from ...identification.sensitivity.engine import Engine
from ...identification.setting import Setting
from ...model.effects.base import MOMENTS, AbstractHysteresis, AbstractMechanism
from ...model.effects.catalogue import CATALOGUE, make_effect
from ...model.effects.motors import SpeedDrive
from ...model.fields import parameters_of
from ...model.parameters import ParameterTable
from ...model.plant import Plant
from .candidates import Candidate, candidates

Name = tuple[str, str]
"""Kind and site of an effect."""
_APART = (AbstractMechanism, AbstractHysteresis, SpeedDrive)


def is_apart(kind: str) -> bool:
    """Whether an effect has a program of its own."""
    cls = CATALOGUE.get(kind)
    # What is proposed beside some effects alone would burden all other searches.
    return cls is not None and (issubclass(cls, _APART) or bool(cls.beside))


def happens_once(kind: str) -> bool:
    """Whether an effect is an event with a time of its own, which no other stretch of the recordings tells of."""
    cls = CATALOGUE.get(kind)
    return cls is not None and bool(MOMENTS & set(parameters_of(cls)))


def looks_like(effect: Name, plainer: Name) -> bool:
    """Whether the catalogue says that some recordings cannot tell an effect from a plainer one."""
    kind, site = effect
    alike = CATALOGUE[kind].alike if kind in CATALOGUE else ()
    return any((each.own_site, each.kind, each.site) == (site, *plainer) for each in alike)


@dataclasses.dataclass(frozen=True)
class Space:
    """A plant with every effect that shares its program, and the vector at which all that is not given is absent."""

    plant: Plant
    own: Plant
    """The part of it that every model here has: the plant as given, and what needs a program of its own."""
    known: frozenset[str]
    engine: Engine
    absent: NDArray[np.float64]

    @property
    def table(self) -> ParameterTable:
        return self.engine.table

    def plant_of(self, vector: NDArray[np.float64], names: Sequence[Name]) -> Plant:
        """The plant of a model, without what it lacks."""
        full = self.table.unravel(vector)
        own = len(self.own.effects)
        chosen = [e for k, e in enumerate(full.effects) if k < own or (e.kind, e.site) in names]
        return Plant(full.bridge, tuple(chosen))

    def with_values(self, plant: Plant) -> NDArray[np.float64]:
        """The vector of a model whose effects all stand in this space."""
        vector = self.absent.copy()
        table = ParameterTable(plant)
        values = np.array(table.ravel(plant), dtype=float)
        for name in table.names():
            vector[self.table.positions(name)] = values[table.positions(name)]
        for group, place in table.options().items():
            vector[self.table.option_place(group)] = values[place]
        return vector


def space_of(problem: Problem, plant: Plant, known: frozenset[str], beside: Space) -> Space:
    """Where a plant is simulated: in the program at hand, if that has room for its effects, else in one of its own.

    Args:
        problem: recordings.
        plant: what is simulated.
        known: its parameters that are not estimated.
        beside: the program at hand.
    """
    wanted, room = (Counter(entry.group for entry in t.entries) for t in (ParameterTable(plant), beside.table))
    fits = all(room[group] == count for group, count in wanted.items())
    if fits and {(e.kind, e.site) for e in beside.own.effects} <= {(e.kind, e.site) for e in plant.effects}:
        return dataclasses.replace(beside, known=known)
    return make_space(problem, plant, known, shared=False)


def make_space(problem: Problem, own: Plant, known: frozenset[str], shared: bool = True, width: int = 0) -> Space:
    """Compiles nothing yet: programs are made when they are first used.

    Args:
        problem: recordings.
        own: what every model has.
        known: parameters that are not estimated.
        shared: whether effects that may be added stand in it; without, it is the plant alone.
        width: see `Engine`.
    """
    effects = []
    if shared:
        seen = {(e.kind, e.site) for e in own.effects}
        first: dict[Name, Candidate] = {}
        for candidate in candidates(own, (), problem.setting, scene_of(problem.setting, own)):
            if not is_apart(candidate.kind) and candidate.name not in seen:
                first.setdefault(candidate.name, candidate)
        effects = [make_effect(kind, site, _null(candidate)) for (kind, site), candidate in first.items()]
    plant = own.adding(*effects)
    engine = engine_for(problem.setting, problem.data, plant, len(own.effects) if shared else None, width)
    absent = np.array(engine.table.ravel(plant), dtype=float)
    return Space(plant, own, known, engine, absent)


def _null(candidate: Candidate) -> Mapping[str, object]:
    """Values at which an effect is absent: its null values, with the shapes (knots, periods) of its first seed."""
    infos = parameters_of(CATALOGUE[candidate.kind])
    out: dict[str, object] = dict(candidate.values)
    for key in candidate.free:
        if key in infos and key in candidate.sizes:
            value = candidate.values.get(key)
            count = len(value) if isinstance(value, list) else None
            out[key] = infos[key].null if count is None else [infos[key].null] * count
    return {key: value for key, value in out.items() if key != "coulomb"}


def proposals(setting: Setting, own: Plant, known: frozenset[str]) -> list[Candidate]:
    """All effects that a model lacks, and all known numbers that may be wrong, each with its places to start: where it
    is absent, unless it has no gradient there.
    """
    return candidates(own, known, setting, scene_of(setting, own))


def largest_shown(every: Sequence[Candidate]) -> dict[str, float]:
    """The largest periods and widths that recordings show, by parameter's name: of a longer period they do not show two
    waves, and one wave is like any other smooth law, but for that of a disc that turns with an angle; of a width beyond
    the inputs they show a slope alone.
    """
    out: dict[str, float] = {}
    for candidate in every:
        for key in ("period", "width"):
            if isinstance(value := candidate.values.get(key), float):
                name = candidate.group(key)
                out[name] = max(out.get(name, 0.0), value)
    return out
