"""Models of a fixed structure, and their fits without some of their effects."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...identification.estimation import Problem, engine_for
from ...identification.sensitivity.engine import Engine
from ...identification.setting import Setting, moments_of
from ...identification.solver import Point, Start
from ...model.effects.catalogue import CATALOGUE
from ...model.parameters import ParameterTable
from ...model.plant import Plant
from ...recordings import Recording
from ..structures.candidates import WRONG_VALUE
from ..structures.space import Name, is_apart
from ..structures.structure import Structure


@dataclasses.dataclass(frozen=True)
class Fixed:
    """A model of fixed structure, fitted, with its own program."""

    plant: Plant
    names: tuple[Name, ...]
    engine: Engine
    point: Point

    @property
    def table(self) -> ParameterTable:
        return self.engine.table


def of_its_own(problem: Problem, structure: Structure) -> Fixed:
    """A structure that no search changes any more, without room for others."""
    plant, point = structure.plant, structure.point
    engine = engine_for(problem.setting, problem.data, plant)
    places = np.array([engine.table.positions(name)[0] for name in structure.free], np.int64)
    own = dataclasses.replace(point, vector=np.array(engine.table.ravel(plant), dtype=float), free=places)
    return Fixed(plant, structure.names, engine, own)


def refitted(problem: Problem, model: Fixed, base: Structure, left: Sequence[Name], own: bool = False) -> Fixed:
    """A model without some of its added effects, fitted again.

    The model's own program serves where these have null values; mechanisms have none.

    Args:
        problem: the recordings.
        model: with the effects.
        base: the model as given, refitted.
        left: what is left out.
        own: whether the model no longer has them, not even with null values.
    """
    table = model.table
    vector, apart = model.point.vector.copy(), [name for name in left if own or is_apart(name[0])]
    if len(model.names) == len(left):
        # The model as given stands at its own optimum.
        there = ParameterTable(base.plant)
        values = np.array(there.ravel(base.plant), dtype=float)
        for name in there.names():
            vector[table.positions(name)] = values[there.positions(name)]
    free = _free(table, model.point.free, left)
    for place in map(int, model.point.free):
        entry = table.entry(place)
        if (WRONG_VALUE, entry.group) in left:
            vector[place] = getattr(base.plant.bridge, entry.group)
        elif owner_of(entry.group) in left:
            vector[place] = entry.info.null
    plant, engine = table.unravel(vector), model.engine
    if apart:
        plant = Plant(plant.bridge, tuple(e for e in plant.effects if (e.kind, e.site) not in apart))
        engine = engine_for(problem.setting, problem.data, plant)
    places = np.array([engine.table.positions(name)[0] for name in free], np.int64)
    states = base.point.states if len(model.names) == len(left) else model.point.states
    start = Start(np.array(engine.table.ravel(plant), dtype=float), places, states)
    [point] = problem.solve(engine, [start])
    fitted = engine.table.unravel(point.vector)
    return Fixed(fitted, tuple(n for n in model.names if n not in left), engine, point)


def replaced(
    problem: Problem, model: Fixed, base: Structure, name: Name, source: Structure, other: Name
) -> Fixed | None:
    """A model with another effect in the place of one of its own, fitted again; None where it has no room for that.

    Args:
        problem: the recordings.
        model: with the effect.
        base: the model as given, refitted.
        name: of the effect.
        source: a structure with the other effect, from which it takes its first numbers.
        other: name of that effect.
    """
    names = (*(n for n in model.names if n != name), other)
    plant = exchanged(model.plant, base.plant, names, name, source.plant)
    if plant is None:
        return None
    free = _free(model.table, model.point.free, (name,))
    free += [source.space.table.entry(p).name for p in source.places(other)]
    engine = engine_for(problem.setting, problem.data, plant)
    places = np.array([engine.table.positions(n)[0] for n in free], np.int64)
    start = Start(np.array(engine.table.ravel(plant), dtype=float), places, model.point.states)
    [point] = problem.solve(engine, [start])
    return Fixed(engine.table.unravel(point.vector), names, engine, point)


def exchanged(plant: Plant, base: Plant, names: Sequence[Name], name: Name, theirs: Plant) -> Plant | None:
    """A plant with another plant's effect in the place of one of its own.

    None where what else it has contains the other effect or is contained in it, and where physics has room for one.

    Args:
        plant: with the effect.
        base: the plant as given, whose number a wrong value has again.
        names: of all effects that are added to that, the other effect the last.
        name: of the effect that goes.
        theirs: a plant with the other effect.
    """
    *rest, other = names
    if any(_contains(one, two) for n in rest for one, two in ((n, other), (other, n))):
        return None
    numbers = {}
    effects = [e for e in plant.effects if (e.kind, e.site) != name]
    if name[0] == WRONG_VALUE:
        numbers[name[1]] = getattr(base.bridge, name[1])
    if other[0] == WRONG_VALUE:
        numbers[other[1]] = getattr(theirs.bridge, other[1])
    else:
        effects += [e for e in theirs.effects if (e.kind, e.site) == other]
    found = Plant(dataclasses.replace(plant.bridge, **numbers), tuple(effects))
    try:
        found.check()
    except ValueError:
        return None
    return found


def _free(table: ParameterTable, places: NDArray[np.int64], left: Sequence[Name]) -> list[str]:
    """Names of free parameters but those of some effects."""
    out = []
    for place in map(int, places):
        entry = table.entry(place)
        if (WRONG_VALUE, entry.group) not in left and owner_of(entry.group) not in left:
            out.append(entry.name)
    return out


def recording_of(setting: Setting, model: Fixed, name: Name) -> Recording | None:
    """The one recording in which an effect acts, if it does in one alone."""
    table = model.table
    moments = [place for place in moments_of(table) if owner_of(table.entry(place).name) == name]
    found = [setting.when(float(model.point.vector[place]))[0] for place in moments]
    return next((recording for recording in found if recording is not None), None)


def _contains(one: Name, other: Name) -> bool:
    """Whether a law has another one of its site as a limit."""
    return one[1] == other[1] and other[0] in {c.kind for c in getattr(CATALOGUE.get(one[0]), "contains", ())}


def owner_of(group: str) -> Name:
    """The effect that has a parameter, by the parameter's name."""
    kind, _, site = group.rpartition(".")[0].split("#")[0].partition("@")
    return kind, site
