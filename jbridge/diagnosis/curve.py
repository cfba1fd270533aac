"""A force without a name, where no effect of the catalogue fits: it makes the simulation usable and can be seen."""

from ..identify.setting import scene_of
from .candidates import Candidate, unnamed_forces
from .search import Search
from .trials import State, Trial

_CURVE_PAYS = 0.8
"""Cost, relative to the model without it, that a force without a name must reach to be kept."""


def force_without_a_name(search: Search, state: State) -> State | None:
    """The model with a force without a name, on the axis where that explains most; None if it explains little."""
    scene = scene_of(search.setting, state.plant)
    seeds = unnamed_forces(search.setting, scene)
    search.progress("fitting a force without a name")

    def one(seed: Candidate) -> Trial:
        engine, vector, free = search.extended(state, seed)
        # Beside a curve of place and velocity friction, damping and maps have no numbers of their own: they stay.
        return search.refit_rows(state, [seed], engine, seed.set(engine.table, vector)[None], free[:0])

    best = min(search.each(one, seeds), key=lambda t: t.cost)
    if best.cost > _CURVE_PAYS * state.cost or best.cross_validated > state.cross_validated:
        return None
    return State(**best.shared(), accepted=state.accepted)
