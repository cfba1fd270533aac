"""An accepted explanation against those that look like it, each beside all that was accepted later.

While something else is still missing, what looks alike may be far apart: a fit takes up the rest with whatever it has.
"""

import dataclasses

from ..model.plant import Plant
from .candidates import Candidate, has_hidden_state
from .mechanisms import mechanisms
from .revise import without
from .search import Search
from .steps import HOLDS, Step
from .ties import look_alikes
from .trials import State, Trial, accepts, as_trial, floor_of

_NEAR = 4.0
"""Cost, relative to the accepted explanation's, up to which another one is fitted to convergence, too: a refit begins
where a linear screen of what is far off sends it, and may stop short."""


def compare_look_alikes(search: Search, state: State, steps: list[Step]) -> tuple[State, list[Step]]:
    """Refits what looks like an accepted explanation in its place, and takes the better one.

    Args:
        search: what can be tried.
        state: with several accepted explanations, on whole recordings.
        steps: how they were found.

    Returns:
        Both, with the trials of these refits in the steps that they belong to.
    """
    if search.window is not None:
        return state, steps
    for candidate in state.accepted:
        present = {a.name for a in state.accepted}
        names = [name for name in look_alikes(candidate) if name not in present]
        place = next((i for i, s in enumerate(steps) if s.chosen.candidate.name == candidate.name), None)
        if not names or place is None:
            continue
        plant, known = without(search, state, candidate)
        others = tuple(a for a in state.accepted if a is not candidate)
        bare = search.polish(plant, known, state.initial, others)
        own = as_trial(state, candidate, steps[place].chosen.z)
        fitted = [(own, state)] + [
            _settled(search, trial, state, plant, others) for trial in _refits(search, bare, names)
        ]
        trials = [trial for trial, _ in fitted]
        # What gains less than the accepted one loses anyway.
        why = {t.candidate.name: "" if t is own else accepts(bare, t, HOLDS, 0.0, floor_of(trials)) for t in trials}
        passed = [(trial, found) for trial, found in fitted if not why[trial.candidate.name]]
        chosen, better = min(passed, key=lambda pair: pair[0].score)
        steps = [*steps[:place], _joined(steps[place], chosen, own, trials, why), *steps[place + 1 :]]
        if chosen is not own:
            costs = {chosen.candidate.name if name == candidate.name else name: c for name, c in state.without.items()}
            state = dataclasses.replace(better, without=costs)
    return state, steps


def _joined(step: Step, chosen: Trial, own: Trial, trials: list[Trial], why: dict[tuple[str, str], str]) -> Step:
    """A step with further trials, and perhaps another choice, weighed as its own are.

    They were fitted beside what was accepted later, too, so their costs are put in proportion.
    """
    scale = step.chosen.weighed / own.cost
    weighed = {
        trial.candidate.name: step.chosen
        if trial is own
        else dataclasses.replace(trial, cost=scale * trial.cost, cross_validated=scale * trial.cross_validated)
        for trial in trials
    }
    before = [trial for trial in step.trials if trial.candidate.name not in why]
    refused = {name: reason for name, reason in step.refused.items() if name not in why}
    refused |= {name: reason for name, reason in why.items() if reason}
    ranked = sorted([*weighed.values(), *before], key=lambda trial: trial.score)
    return Step(step.number, weighed[chosen.candidate.name], ranked, refused)


def _refits(search: Search, bare: State, names: list[tuple[str, str]]) -> list[Trial]:
    """Refits of some explanations beside a state."""
    trials = [trial for name in names if has_hidden_state(name[0]) for trial in mechanisms(search, bare, name)]
    plain = [name for name in names if not has_hidden_state(name[0])]
    if plain:
        ranked = search.look(bare).ranked
        trials += search.refit_all(bare, [item for item in ranked if item.candidate.name in plain])
    return trials


def _settled(
    search: Search, trial: Trial, state: State, plant: Plant, others: tuple[Candidate, ...]
) -> tuple[Trial, State]:
    """A trial that comes near fitted to convergence, and the state that it would make.

    What looks alike asks for the same of all other numbers, so these start where they are (`plant`).
    """
    accepted = (*others, trial.candidate)
    if not trial.cost <= _NEAR * state.cost:
        return trial, State(**trial.shared(), accepted=accepted)
    effect = next(e for e in trial.plant.effects if (e.kind, e.site) == trial.candidate.name)
    found = search.polish(plant.adding(effect), trial.known, state.initial, accepted)
    return as_trial(found, trial.candidate, trial.z), found
