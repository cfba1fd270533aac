"""Explanations that a linear screen cannot tell from the one that is about to be accepted.

What explains the same in the same recordings is crowded out of a short list by laws that contain the winner and expect
a little more of themselves. It must be refitted all the same, since its name may be the true one.
"""

from collections.abc import Collection, Sequence

from ..model.effects.catalogue import CATALOGUE, make_effect
from .candidates import Candidate
from .levels import simpler_laws
from .screen import Screened

_TIED = 1.02
"""Expected cost, relative to the winner's, up to which it counts as the same."""
_MOST = 3
# A load that hangs a little below the hook swings, at a bridge's frequencies, as on a rope that is longer.
_ALIKE = (("double_pendulum", "swing"), ("sensor_offset", "l_sensor"), ("sensor_scale", "l_sensor"))
# Friction by place and direction plays a spring, which hinders one way as it helps the other; no spring plays a map.
_PLAYED = {("position_direction_friction", "cart"): (("spring_force", "cart"),)}


def look_alikes(winner: Candidate) -> tuple[tuple[str, str], ...]:
    """Effects that may do the same as a winner, though a linear screen beside what else is missing need not say so."""
    alike = tuple(name for name in _ALIKE if name != winner.name) if winner.name in _ALIKE else ()
    return alike + _PLAYED.get(winner.name, ())


def ties(ranked: Sequence[Screened], winner: Candidate, tried: Collection[tuple[str, str]]) -> list[Screened]:
    """What the screen expects to explain as much as the winner does; at most three.

    Args:
        ranked: what the screen expects, the best first.
        winner: what would be accepted.
        tried: kinds and sites that were refitted already.
    """
    own = min((item.cost for item in ranked if item.candidate.name == winner.name), default=None)
    if own is None:
        return []
    found: dict[tuple[str, str], Screened] = {}
    for item in ranked:
        name = item.candidate.name
        if item.cost <= _TIED * own and name not in tried and not _contains(item.candidate, winner):
            found.setdefault(name, item)
    return list(found.values())[:_MOST]


def _contains(candidate: Candidate, winner: Candidate) -> bool:
    """Whether a candidate is the winner's law with more to it."""
    if candidate.kind not in CATALOGUE or candidate.site != winner.site:
        return False
    values = {key: value for key, value in candidate.values.items() if key != "coulomb"}
    laws = simpler_laws(make_effect(candidate.kind, candidate.site, values))
    return winner.kind in [kind for kind, _ in laws]
