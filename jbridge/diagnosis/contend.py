"""Explanations that the recordings cannot tell apart, each as a fitted model of its own."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ..model.plant import Plant
from .candidates import WRONG_VALUE
from .names import explanation_name
from .result import Continued, Former, NamedEffect
from .revise import without
from .search import Search
from .separate import Contender, contender
from .steps import Step
from .trials import State, Trial

_MOST = 3
"""Explanations beside the chosen one."""
_NEAR = 0.9
"""Cost, relative to the model without it, from which a refused explanation of what has no name comes near."""


def contenders(search: Search, state: State, steps: Sequence[Step], effects: Sequence[NamedEffect]) -> list[Contender]:
    """The named effect that is least certain, and its rivals; empty where each name stands alone.

    Args:
        search: recordings.
        state: the final model.
        steps: how it was found.
        effects: what was named, with rivals.
    """
    unsure = [effect for effect in effects if effect.equivalents]
    if not unsure:
        return []
    effect = max(unsure, key=lambda e: sum(rival.probability for rival in e.equivalents))
    step = next(step for step in steps if step.chosen.candidate.name == (effect.kind, effect.site))
    trials = {trial.candidate.name: trial for trial in step.passed}
    found = [contender(effect.kind, effect.site, effect.probability or 0.0, state)]
    for rival in effect.equivalents:
        fitted = _in_place(search, state, step.chosen, trials[rival.kind, rival.site])
        if np.isfinite(fitted.cost):
            found.append(contender(rival.kind, rival.site, rival.probability, fitted))
    return found if len(found) > 1 else []


def nearest(state: State, refused: Sequence[tuple[Trial, str]]) -> list[Contender]:
    """Of what was refused, the explanations that come nearest to what has no name; empty where fewer than two do."""
    near = [trial for trial, _ in refused if trial.cost < _NEAR * state.cost]
    best: dict[tuple[str, str], Trial] = {}
    for trial in sorted(near, key=lambda t: t.score):
        best.setdefault(trial.candidate.name, trial)
    chosen = list(best.items())[:_MOST]
    # Which of them it is, if any, nobody knows.
    return [contender(*name, 1.0 / len(chosen), trial) for name, trial in chosen] if len(chosen) > 1 else []


def _in_place(search: Search, state: State, chosen: Trial, trial: Trial) -> State:
    """The final model with a rival in the place of what was chosen, fitted."""
    kind, site = trial.candidate.name
    others = tuple(a for a in state.accepted if a.name != chosen.candidate.name)
    accepted = (*others, trial.candidate)
    if len(state.plant.effects) <= len(trial.plant.effects) and not others:
        return search.polish(trial.plant, trial.known, state.initial, accepted)
    old = next((a for a in state.accepted if a.name == chosen.candidate.name), chosen.candidate)
    plant, known = without(search, state, old)
    if kind == WRONG_VALUE:
        bridge = dataclasses.replace(plant.bridge, **{site: getattr(trial.plant.bridge, site)})
        return search.polish(Plant(bridge, plant.effects), known - {site}, state.initial, accepted)
    own = next(effect for effect in reversed(trial.plant.effects) if (effect.kind, effect.site) == (kind, site))
    return search.polish(plant.adding(own), known, state.initial, accepted)


def explanations(effects: Sequence[NamedEffect]) -> tuple[Mapping[str, object], ...]:
    """Everything that was named or could not be told from it."""
    rows = []
    for effect in effects:
        rows.append({"kind": effect.kind, "site": effect.site, "probability": effect.probability})
        rows += [{"kind": r.kind, "site": r.site, "probability": r.probability} for r in effect.equivalents]
    return tuple(rows)


def continued(former: Former, effects: Sequence[NamedEffect], new: Sequence[str]) -> Continued:
    """What further recordings have made of an earlier diagnosis.

    Args:
        former: the earlier diagnosis.
        effects: what is named now.
        new: names of the new recordings.
    """
    after = explanations(effects)
    before = [(str(row["kind"]), str(row["site"])) for row in former.explanations]
    now = [(str(row["kind"]), str(row["site"])) for row in after]
    left = [name for name in before if name in now]
    extra = [name for name in now if name not in before]
    lead = f"With {', '.join(new)}, "
    if not before:
        text = f"{lead}as before, nothing is named." if not now else f"{lead}what had no name has one: {_listed(now)}."
    elif not left:
        text = f"{lead}none of the {len(before)} former explanations is left"
        text += f"; now it is {_listed(extra)}." if extra else "."
    else:
        be = "is" if len(left) == 1 else "are"
        text = f"{lead}{len(left)} of {len(before)} explanations {be} left: {_listed(left)}."
        if extra:
            text += f" New among them: {_listed(extra)}."
    return Continued(tuple(new), former.explanations, after, text)


def _listed(names: Sequence[tuple[str, str]]) -> str:
    return ", ".join(explanation_name(*name) for name in names)
