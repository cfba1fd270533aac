"""Steps of a search: what each accepted, from which trials, and what became of it later."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from .candidates import Candidate
from .levels import simpler_laws
from .trials import State, Trial, as_trial

HOLDS = 0.1
"""Least share of the excess over noise that an effect must remove from recordings left out."""


@dataclasses.dataclass
class Step:
    """One acceptance: what was chosen, and from which trials."""

    number: int
    """Round of the search, from 1."""
    chosen: Trial
    trials: list[Trial]
    refused: dict[tuple[str, str], str]
    """Why explanations did not pass."""

    @property
    def passed(self) -> list[Trial]:
        """What could be it. A law that contains one of the others and needs more numbers for no gain is left out."""
        found = [trial for trial in self.trials if trial.candidate.name not in self.refused]
        return [
            trial
            for trial in found
            if trial is self.chosen
            or not any(other.score < trial.score and _contains(trial, other.candidate.name) for other in found)
        ]


def _contains(trial: Trial, name: tuple[str, str]) -> bool:
    """Whether a refitted law is another one with more to it."""
    kind, site = name
    own = [e for e in trial.plant.effects if (e.kind, e.site) == trial.candidate.name]
    return trial.candidate.site == site and any(kind == simple for e in own for simple, _ in simpler_laws(e))


def weights_of(step: Step) -> dict[tuple[str, str], float]:
    """Probability of every explanation of a step that passed."""
    scores = np.array([t.score for t in step.passed])
    odds = np.exp(-0.5 * (scores - scores.min()))
    return {t.candidate.name: float(o / odds.sum()) for t, o in zip(step.passed, odds, strict=True)}


def refused_with(steps: Sequence[Step], why: str) -> list[tuple[Trial, str]]:
    """The trials of rounds whose choice does not stand, for a reason, and why each was not taken."""
    return [
        (trial, why if trial is step.chosen else step.refused.get(trial.candidate.name, "") or "explains less")
        for step in steps
        for trial in step.trials
    ]


def as_simplified(step: Step, state: State) -> Step:
    """The step with the law that was accepted in the end, with its fit in place of the refit that stopped short."""
    final = state.accepted[-1]
    if final.name == step.chosen.candidate.name:
        return step
    simple = dataclasses.replace(as_trial(state, final, step.chosen.z), stands_for=step.chosen.cost)
    trials = [simple, *(trial for trial in step.trials if trial.candidate.name != final.name)]
    refused = {name: why for name, why in step.refused.items() if name != final.name}
    refused[step.chosen.candidate.name] = "a simpler law explains as much"
    return Step(step.number, simple, trials, refused)


def renamed(step: Step, old: Candidate, final: Candidate) -> Step:
    """The step with a simpler law in place of the one that it chose, weighed as that was."""
    if step.chosen.candidate.name != old.name or final.name == old.name:
        return step
    simple = dataclasses.replace(step.chosen, candidate=final)
    trials = [simple, *(trial for trial in step.trials if trial.candidate.name != final.name)]
    refused = {name: why for name, why in step.refused.items() if name != final.name}
    return Step(step.number, simple, trials, refused | {old.name: "a simpler law explains as much"})


def by_gap_closed(steps: list[Step], state: State) -> list[Step]:
    """Steps whose effects were kept, first that without which the model would be worst."""
    kept = {candidate.name for candidate in state.accepted}
    left = [step for step in steps if step.chosen.candidate.name in kept]
    return sorted(left, key=lambda step: -state.without.get(step.chosen.candidate.name, 0.0))
