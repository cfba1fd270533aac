"""Which candidates are refitted: what a screen expects of them, in one ranking and cut short."""

import dataclasses
from collections.abc import Sequence

from .levels import ADDED_LEVELS
from .screen import Screened

_MOST = 5
"""Most candidates that are refitted at a time."""
_ALWAYS = 3
"""Candidates that are refitted whatever the screen expects."""
_HOPELESS = 4.0
"""Predicted cost, relative to the best candidate's, beyond which a refit is not worth its time."""


def merged(first: Sequence[Screened], second: Sequence[Screened]) -> list[Screened]:
    """Two rankings as one: costs relative to the best of each, the better rank counts."""
    both = []
    for ranked in (first, second):
        least = max(ranked[0].cost, 1e-9) if ranked else 1.0
        both += [dataclasses.replace(item, cost=item.cost / least) for item in ranked]
    return sorted(both, key=lambda item: item.cost)


def shortlist(ranked: Sequence[Screened]) -> list[Screened]:
    """The best candidates, with a second seed where one is nearly as good.

    What the linear screen expects of a candidate is close to what a refit finds unless the mismatch is large, so few
    refits are enough; more follow where none of them explains the recordings.
    """
    if not ranked:
        return []
    least = ranked[0].cost
    seen: dict[tuple[str, str], Screened] = {}
    second: set[tuple[str, str]] = set()
    chosen = []
    for item in ranked:
        name = item.candidate.name
        if name not in seen:
            if len(seen) < _ALWAYS or (len(seen) < _MOST and item.cost < _HOPELESS * least):
                chosen.append(item)
                seen[name] = item
        elif name not in second and item.cost < 1.5 * seen[name].cost:
            chosen.append(item)
            second.add(name)
    return chosen


def with_simpler(chosen: list[Screened], ranked: Sequence[Screened]) -> list[Screened]:
    """With every law of friction, plain Coulomb friction on the same axis, which may explain as much with less."""
    names = {item.candidate.name for item in chosen}
    sites = {item.candidate.site for item in chosen if item.candidate.kind in ADDED_LEVELS}
    plain = [item for item in ranked if item.candidate.kind == "coulomb_friction" and item.candidate.site in sites]
    return chosen + [item for item in plain if item.candidate.name not in names]
