"""Second thoughts about what was accepted: a simpler law in its place, and what is superfluous dropped."""

import dataclasses

from ..model.effects.catalogue import make_effect
from ..model.plant import Plant
from .candidates import WRONG_VALUE, Candidate
from .levels import simpler_laws
from .search import Search, settled
from .trials import State

SUPERFLUOUS = 0.02
"""Rise of the cost up to which an effect is dropped again."""


def simplify(search: Search, state: State, place: int = -1) -> State:
    """An accepted law of friction, the latest by default, in its simplest form that holds as well without a recording.

    From the start that a screen gives, a refit of a simple law may stop short where a law with more parameters
    finds its way round; from that law's values it does not.
    """
    latest = state.accepted[place]
    effect = next((e for e in state.plant.effects if (e.kind, e.site) == latest.name), None)
    if effect is None:
        return state
    rest = tuple(e for e in state.plant.effects if e is not effect)
    for kind, values in simpler_laws(effect):
        if any((e.kind, e.site) == (kind, effect.site) for e in rest):
            continue
        search.progress(f"trying {kind.replace('_', ' ')} instead")
        plant = settled(Plant(state.plant.bridge, (*rest, make_effect(kind, effect.site, values))))
        simple = Candidate(kind, effect.site, {}, tuple(k for k in values if k != "knots"), False)
        accepted = list(state.accepted)
        accepted[place] = simple
        found = search.polish(plant, state.known, state.initial, tuple(accepted))
        if found.cross_validated < state.cross_validated * (1 + SUPERFLUOUS):
            return found
    return state


def prune(search: Search, state: State) -> State:
    """Drops accepted explanations that the others have made superfluous, the latest first.

    What stays is kept with the cost that the model has without it.
    """
    costs: dict[tuple[str, str], float] = {}
    for candidate in reversed(state.accepted):
        if len(state.accepted) == 1:
            break
        search.progress(f"trying without {candidate.kind.replace('_', ' ')}")
        plant, known = without(search, state, candidate)
        kept = tuple(a for a in state.accepted if a is not candidate)
        fewer = search.polish(plant, known, state.initial, kept)
        if fewer.cost < state.cost * (1 + SUPERFLUOUS):
            state = fewer
        else:
            costs[candidate.name] = fewer.cost
    return dataclasses.replace(state, without=costs)


def without(search: Search, state: State, candidate: Candidate) -> tuple[Plant, frozenset[str]]:
    """The state's plant without an accepted explanation, and what is known then."""
    if candidate.kind == WRONG_VALUE:
        given = getattr(search.given.bridge, candidate.site)
        bridge = dataclasses.replace(state.plant.bridge, **{candidate.site: given})
        return Plant(bridge, state.plant.effects), state.known | {candidate.site}
    rest = tuple(e for e in state.plant.effects if (e.kind, e.site) != candidate.name)
    return Plant(state.plant.bridge, rest), state.known
