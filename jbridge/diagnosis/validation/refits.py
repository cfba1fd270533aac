"""Models of a fixed structure, and their fits without some of their effects."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ...identification.estimation import Problem, engine_for
from ...identification.sensitivity.engine import Engine
from ...identification.solver import Point, Start
from ...model.parameters import ParameterTable
from ...model.plant import Plant
from ..structures.candidates import WRONG_VALUE
from ..structures.space import Name, is_apart
from ..structures.structure import Structure

REFIT = 8
"""Iterations of a fit without one of the effects."""


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
    free = []
    for place in map(int, model.point.free):
        entry = table.entry(place)
        kind, site = entry.group.rpartition(".")[0].split("#")[0].partition("@")[::2]
        if (WRONG_VALUE, entry.group) in left:
            vector[place] = getattr(base.plant.bridge, entry.group)
        elif (kind, site) in left:
            vector[place] = entry.info.null
        else:
            free.append(entry.name)
    plant, engine = table.unravel(vector), model.engine
    if apart:
        plant = Plant(plant.bridge, tuple(e for e in plant.effects if (e.kind, e.site) not in apart))
        engine = engine_for(problem.setting, problem.data, plant)
    places = np.array([engine.table.positions(name)[0] for name in free], np.int64)
    states = base.point.states if len(model.names) == len(left) else model.point.states
    start = Start(np.array(engine.table.ravel(plant), dtype=float), places, states)
    [point] = problem.solve(engine, [start], REFIT)
    fitted = engine.table.unravel(point.vector)
    return Fixed(fitted, tuple(n for n in model.names if n not in left), engine, point)
