"""Looking one explanation ahead: two laws together may hold on recordings left out where neither does alone.

Drag and dry friction of a swing, say: large swings make too much or too little of either, so that a small one which was
left out is met worse, and only both together meet it.
"""

import dataclasses
from collections.abc import Mapping, Sequence

from .screen import Screen
from .steps import Step
from .trials import NOT_HELD, State, Trial, explained, floor_of, held

_LEADS = 0.5
"""Least share of the excess that the first of the two must explain where it was fitted."""


@dataclasses.dataclass(frozen=True)
class Before:
    """A search before it took an explanation that only another one beside it can bear out."""

    state: State
    steps: tuple[Step, ...]
    screened: Screen
    learnable_after: float
    refused: list[tuple[Trial, str]]

    def holds(self, trial: Trial, least: float, floor: float) -> bool:
        """Whether both together hold on recordings left out."""
        return held(self.state, trial, floor) >= least


def leading(state: State, trials: Sequence[Trial], reasons: Mapping[tuple[str, str], str]) -> list[Trial]:
    """What was refused for nothing but recordings left out, if it explains much, the best first.

    Args:
        state: the model so far.
        trials: the refits, the best first.
        reasons: why each did not pass.
    """
    floor = floor_of(trials)
    return [t for t in trials if reasons[t.candidate.name] == NOT_HELD and explained(state, t, floor) >= _LEADS]
