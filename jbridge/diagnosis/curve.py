"""A force without a name, where no effect of the catalogue fits: it makes the simulation usable and can be seen."""

import dataclasses

import numpy as np

from ..identify.setting import scene_of
from ..model.effects.catalogue import make_effect
from ..model.effects.forces import ResidualForce
from ..model.effects.friction import CoulombFriction, PositionDirectionFriction
from ..model.plant import Plant
from .candidates import Candidate, unnamed_forces
from .revise import PAYS, SUPERFLUOUS, without
from .search import Search
from .trials import State, Trial, several

_CURVE_PAYS = 0.8
"""Cost, relative to the model without it, that a force without a name must reach to be kept."""
_MOST_PLACES = 57
_CONSTANT = 0.5
"""Variance over place of what a map has in both directions, relative to that of half their difference, up to which it
may be a force and the same friction everywhere."""


def force_without_a_name(search: Search, state: State) -> State | None:
    """The model with a force without a name, on the axis where that explains most; None if it explains little.

    Its knots in place are doubled as long as that is worth it.
    """
    scene = scene_of(search.setting, state.plant)
    seeds = unnamed_forces(search.setting, scene)
    search.progress("fitting a force without a name")
    best = min(search.each(lambda seed: _with_curve(search, state, seed), seeds), key=lambda t: t.cost)
    while several(state.batch) and 2 * len(best.candidate.values["places"]) - 1 <= _MOST_PLACES:
        found = _with_curve(search, state, _twice_as_fine(best))
        if found.cross_validated > best.cross_validated * (1 - PAYS):
            break
        best = found
    if best.cost > _CURVE_PAYS * state.cost or best.cross_validated > state.cross_validated:
        return None
    return State(**best.shared(), accepted=state.accepted)


def _with_curve(search: Search, state: State, seed: Candidate) -> Trial:
    engine, vector, free = search.extended(state, seed)
    # Beside a curve of place and velocity friction, damping and maps have no numbers of their own: they stay.
    return search.refit_rows(state, [seed], engine, seed.set(engine.table, vector)[None], free[:0])


def _twice_as_fine(trial: Trial) -> Candidate:
    """The same force with a knot more in every gap."""
    force = next(e for e in trial.plant.effects if isinstance(e, ResidualForce))
    old = np.asarray(force.places)
    places = np.linspace(old[0], old[-1], 2 * len(old) - 1)
    values = {
        "places": places,
        "by_place": np.interp(places, old, np.asarray(force.by_place)),
        "speeds": np.asarray(force.speeds),
        "by_speed": np.asarray(force.by_speed),
    }
    return dataclasses.replace(trial.candidate, values=values)


def of_place_alone(search: Search, state: State, accepted: Candidate) -> State | None:
    """The model with a force that hangs on the place alone, if that is what an accepted map of friction plays.

    A map by place and direction can play any such force, a hollow in the rail or a magnet: it hinders one way where
    it helps the other. That is not friction, and with as many numbers the force follows it twice as closely.

    Args:
        search: what can be tried.
        state: the model with the map.
        accepted: the map; any other explanation gives None.
    """
    friction = next((e for e in state.plant.effects if (e.kind, e.site) == accepted.name), None)
    if not isinstance(friction, PositionDirectionFriction) or not several(state.batch):
        return None
    both = 0.5 * np.asarray(friction.positive + friction.negative)
    force = 0.5 * np.asarray(friction.negative - friction.positive)
    if both.var() > _CONSTANT * force.var():
        return None
    search.progress("trying a force of the place alone instead")
    plant, known = without(search, state, accepted)
    plain = [e for e in plant.effects if isinstance(e, CoulombFriction) and e.site == friction.site]
    level = sum((float(e.level) for e in plain), float(both.mean()))
    rest = [e for e in plant.effects if not any(e is other for other in plain)]
    old = np.asarray(friction.knots)
    places = np.linspace(old[0], old[-1], 2 * len(old) - 1)
    values = {"places": places, "by_place": np.interp(places, old, force), "speeds": [-1.0, 1.0], "by_speed": [0, 0]}
    dry = make_effect(CoulombFriction.kind, friction.site, {"level": level})
    curve = make_effect(ResidualForce.kind, friction.site, values)
    known |= {f"{ResidualForce.kind}@{friction.site}.by_speed"}
    others = tuple(a for a in state.accepted if a is not accepted)
    found = search.polish(Plant(plant.bridge, (*rest, dry, curve)), known, state.initial, others)
    return found if found.cost < state.cost * (1 + SUPERFLUOUS) else None
