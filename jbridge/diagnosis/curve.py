"""A force without a name, where no effect of the catalogue fits: it makes the simulation usable and can be seen."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..identification.problem import scene_of
from ..identify.left_out import several
from ..model.effects.base import AXIS_OF_SITE, AbstractFriction
from ..model.effects.catalogue import make_effect
from ..model.effects.forces import ResidualForce
from ..model.effects.friction import CoulombFriction, PositionDirectionFriction
from ..recordings import Recording
from .adequacy import LARGE
from .candidates import Candidate, unnamed_forces
from .levels import on_even_knots
from .revise import PAYS, without
from .search import Search
from .trials import State, Trial

_CURVE_PAYS = 0.8
"""Cost, relative to the model without it, that a force without a name must reach to be kept."""
_MOST_PLACES = 49
"""Knots in place of the finest curve."""
_FAR = 3.0
"""Error over noise that a map leaves, above which a force with as many numbers is not expected to leave little."""
_LITTLE = 0.05
"""Way near a knot, relative to that near the knot which is passed most, that tells of a level."""
_AS_WELL = 0.003
"""Rise of the cost up to which a force with as many numbers does as well as a map."""
_CONSTANT = 0.5
"""Variance over place of what a map has in both directions, relative to that of half their difference, up to which it
may be a force and the same friction everywhere."""


def force_without_a_name(search: Search, state: State) -> State | None:
    """The model with a force without a name, on the axis where that explains most; None if it explains little.

    Its knots in place are doubled as long as that is worth it.
    """
    scene = scene_of(search.setting, state.plant)
    # A model file that keeps a curve already has it at that axis.
    seeds = [seed for seed in unnamed_forces(search.setting, scene) if not _has_curve(state, seed.site)]
    if not seeds:
        return None
    search.progress("fitting a force without a name")
    best = min(search.each(lambda seed: _with_curve(search, state, seed), seeds), key=lambda t: t.cost)
    while several(state.batch) and 2 * len(best.candidate.values["places"]) - 1 <= _MOST_PLACES:
        found = _with_curve(search, state, _twice_as_fine(best))
        if not found.cross_validated <= best.cross_validated * (1 - PAYS):
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
    force = next(trial.plant.all(ResidualForce, trial.candidate.site))
    places, by_place = on_even_knots(force.places, {"by_place": force.by_place}, 2 * len(force.places) - 1)
    by_speed = {"speeds": np.asarray(force.speeds), "by_speed": np.asarray(force.by_speed)}
    return dataclasses.replace(trial.candidate, values={"places": places} | by_place | by_speed)


def of_place_alone(search: Search, state: State, accepted: Candidate) -> tuple[State, State] | None:
    """The model without an accepted map of friction, and with a force that hangs on the place alone instead.

    A map by place and direction can play any such force, a hollow in the rail or a magnet: it hinders one way where
    it helps the other. That is not friction, and with as many numbers the force follows it twice as closely. What the
    map has in common everywhere is Coulomb friction, which the first model keeps, too.

    Args:
        search: what can be tried.
        state: the model with the map.
        accepted: the map.

    Returns:
        None for another explanation, where the force explains less or leaves much, and where little is left without it.
    """
    site = accepted.site
    friction = next((e for e in state.plant.effects if (e.kind, e.site) == accepted.name), None)
    if not isinstance(friction, PositionDirectionFriction) or _has_curve(state, site) or state.chi > _FAR:
        return None
    knots = np.asarray(friction.knots)
    passed = _passed(search.setting.recordings, site, knots)
    if not passed.any():
        return None
    both = 0.5 * np.asarray(friction.positive + friction.negative)
    force = np.where(passed > 0, 0.5 * np.asarray(friction.negative - friction.positive), 0.0)
    level = float(np.average(both, weights=passed))
    spread = np.average((both - level) ** 2, weights=passed)
    if spread > _CONSTANT * np.cov(force, aweights=passed, ddof=0):
        return None
    search.progress("trying a force of the place alone instead")
    plant, known = without(search, state, accepted)
    others = [a for a in state.accepted if a is not accepted]
    if not any(plant.all(AbstractFriction, site)):
        plain = Candidate(CoulombFriction.kind, site, {"level": level}, ("level",), False)
        plant = plant.adding(make_effect(plain.kind, site, plain.values))
        others.append(plain)
    places, by_place = on_even_knots(knots, {"by_place": force}, 2 * len(knots) - 1)
    values = {"places": places, "speeds": [-1.0, 1.0], "by_speed": [0, 0]} | by_place
    curved = plant.adding(make_effect(ResidualForce.kind, site, values))
    no_speed = known | {f"{ResidualForce.kind}@{site}.by_speed"}
    found = search.polish(curved, no_speed, state.initial, tuple(others))
    if found.worst > LARGE or found.cost > state.cost * (1 + _AS_WELL):
        return None
    bare = search.polish(plant, known, state.initial, tuple(others))
    # Of what leaves little one may as well be the other.
    return (bare, found) if bare.worst > LARGE else None


def _passed(recordings: Sequence[Recording], site: str, knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Way [m] near each knot, in that direction in which it is shorter; 0 where that tells nothing of a level."""
    ways = np.zeros((2, len(knots)))
    for recording in recordings:
        at = getattr(recording, AXIS_OF_SITE[site])
        if at is not None:
            step = np.diff(at)
            near = np.clip(1.0 - np.abs(at[:-1] - knots[:, None]) / (knots[1] - knots[0]), 0.0, 1.0)
            ways += np.stack([near @ np.maximum(step, 0.0), near @ np.maximum(-step, 0.0)])
    passed = ways.min(axis=0)
    return np.where(passed < _LITTLE * passed.max(), 0.0, passed)


def _has_curve(state: State, site: str) -> bool:
    return any(state.plant.all(ResidualForce, site))
