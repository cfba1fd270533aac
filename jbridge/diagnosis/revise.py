"""Second thoughts about what was accepted: a simpler law in its place, and what is superfluous dropped."""

import dataclasses

from ..identify.base import measurements
from ..identify.left_out import several
from ..identify.smooth import POOR
from ..model.effects.catalogue import make_effect
from ..model.effects.friction import PositionDependentFriction, PositionDirectionFriction
from ..model.plant import Plant
from ..model.steps import longest_step
from .candidates import WRONG_VALUE, Candidate
from .levels import ADDED_LEVELS, on_even_knots, simpler_laws, taking_over
from .search import Search, left_out_at_best, settled
from .trials import State, Trial

SUPERFLUOUS = 0.02
"""Rise of the cost up to which an effect is dropped again."""
PAYS = 0.05
"""Share of the cost on recordings left out that twice the knots must gain."""
_NOTHING, _NOWHERE = 1.05, 1.15
"""Error over noise, of the whole and of the channel that is met worst, below which nothing is left to explain: what
gains there fits noise, or the engine's own error."""
_LONGER = 8.0
"""How much longer steps may be without an explanation before it is doubted: a belt's stiffness asks for no more."""
_MOST_KNOTS, _LEAST_KNOTS = 29, 3
_Map = PositionDependentFriction | PositionDirectionFriction


def completed(search: Search, state: State, chosen: Trial) -> State:
    """The model with what was chosen, fitted to convergence.

    A belt may have stood for it, for a delay say, and beside it nothing may be left of the belt but a motor without
    inertia, which only dozens of steps an interval could follow. It is dropped first, if it is superfluous. The refit
    that this is judged by need not have converged: what is dropped too soon can be accepted again.
    """
    accepted = (*state.accepted, chosen.candidate)
    refitted = State(**chosen.shared(), accepted=accepted)
    rigid = search.setting.step
    for candidate in state.accepted:
        plant, _ = without(search, refitted, candidate)
        if longest_step(plant, rigid) > _LONGER * longest_step(chosen.plant, rigid):
            fewer = fitted_without(search, refitted, candidate)
            same = measurements(fewer.batch) == measurements(chosen.batch)
            if same and fewer.cost <= chosen.cost * (1 + SUPERFLUOUS):
                return fewer
    return search.polish(chosen.plant, chosen.known, chosen.initial, accepted)


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


def finer(search: Search, state: State, place: int = -1) -> State:
    """An accepted map of friction, the latest by default, with twice the knots as long as those are worth it.

    A map starts on a grid of its own. Where friction changes within a step of that grid more knots tell more, and the
    error that too few leave would be taken for another effect.
    """
    if not several(state.batch):
        return state  # by the recording that they are fitted to, more knots are always worth it
    found, friction = state, _map_of(state, state.accepted[place])
    while friction is not None and (count := 2 * len(friction.knots) - 1) <= _MOST_KNOTS:
        skipped = found is not state
        found = _with_knots(search, found, friction, count)
        # Of a model that leaves much, what one step gives for a recording left out is bounded, and says nothing.
        before, after = ((s.cross_validated if found.chi < POOR else left_out_at_best(s)) for s in (state, found))
        pays = after <= before * (1 - PAYS)
        if pays and not (skipped and found.chi >= POOR):
            state = found
        elif found.chi < POOR:
            break
        # Else what is finer still than these knots spoils the fit with any number: the next ones may tell all of it.
        friction = _map_of(found, found.accepted[place])
    return state


def coarser(search: Search, state: State, place: int = -1) -> State:
    """The same with fewer knots as long as those do as well: where friction changes slowly, fewer are known better."""
    most = state.cost * (1 + SUPERFLUOUS)
    friction = _map_of(state, state.accepted[place])
    while friction is not None and (count := len(friction.knots) // 2 + 1) >= _LEAST_KNOTS:
        found = _with_knots(search, state, friction, count)
        if found.cost > most:
            break
        state = found
        friction = _map_of(state, state.accepted[place])
    return state


def _map_of(state: State, accepted: Candidate) -> _Map | None:
    """The map of friction that an accepted explanation is, if it is one."""
    effect = next((e for e in state.plant.effects if (e.kind, e.site) == accepted.name), None)
    return effect if isinstance(effect, _Map) else None


def _with_knots(search: Search, state: State, friction: _Map, count: int) -> State:
    """The state fitted anew with another number of knots over the same places."""
    search.progress(f"trying {count} places instead of {len(friction.knots)}")
    levels = {key: getattr(friction, "levels_at" if key == "levels" else key) for key in ADDED_LEVELS[friction.kind]}
    knots, at_knots = on_even_knots(friction.knots, levels, count)
    changed = make_effect(friction.kind, friction.site, {"knots": knots} | at_knots)
    plant = settled(Plant(state.plant.bridge, tuple(changed if e is friction else e for e in state.plant.effects)))
    return search.polish(plant, state.known, state.initial, state.accepted)


def prune(search: Search, state: State) -> State:
    """Drops accepted explanations that the others have made superfluous, the latest first.

    What stays is kept with the cost that the model has without it.
    """
    costs: dict[tuple[str, str], float] = {}
    while len(state.accepted) > 1:
        left = [candidate for candidate in reversed(state.accepted) if candidate.name not in costs]
        if not left:
            break
        fewer = fitted_without(search, state, left[0])
        # What the hold-out asked for may gain less than is superfluous otherwise: the hold-out decides.
        least = min(SUPERFLUOUS, search.least_gain(fewer))
        enough = not search.urged and fewer.chi < _NOTHING and fewer.worst < _NOWHERE
        if enough or fewer.cost < state.cost * (1 + least):
            state, costs = fewer, {}  # what was dropped may have stood in for others
        else:
            costs[left[0].name] = fewer.cost
    return dataclasses.replace(state, without=costs)


def fitted_without(search: Search, state: State, candidate: Candidate) -> State:
    """The state fitted anew without an accepted explanation."""
    search.progress(f"trying without {candidate.kind.replace('_', ' ')}")
    plant, known = without(search, state, candidate)
    kept = tuple(a for a in state.accepted if a is not candidate)
    return search.polish(plant, known, state.initial, kept)


def without(search: Search, state: State, candidate: Candidate) -> tuple[Plant, frozenset[str]]:
    """The state's plant without an accepted explanation, and what is known then."""
    if candidate.kind == WRONG_VALUE:
        given = getattr(search.given.bridge, candidate.site)
        bridge = dataclasses.replace(state.plant.bridge, **{candidate.site: given})
        return Plant(bridge, state.plant.effects), state.known | {candidate.site}
    gone = next((e for e in reversed(state.plant.effects) if (e.kind, e.site) == candidate.name), None)
    if gone is None:
        return state.plant, state.known
    return Plant(state.plant.bridge, taking_over(state.plant.effects, gone, state.known)), state.known
