"""When a push on the load may have begun and ended: all pairs of times, weighed by a linear screen.

A load swings once in a second or two, and a push that is thought to begin half a swing off does the opposite: from
there a refit ends a whole swing away from the truth. So times are looked at closely. A push from one time to another
is a push from the one on, less a push from the other on, so a column for every time serves all pairs of them.
"""

import dataclasses

import numpy as np

from ..identify.uncertainty import inverse_normal
from .candidates import Candidate
from .normal import Tangents

_PARTS = 32
"""Parts of a recording at whose edges a push is thought to begin and to end."""
_APART = 2
"""Edges by which a further seed must differ from a better one."""


def gusts(told: Tangents, wind: Candidate, count: int) -> list[Candidate]:
    """The pushes that would gain most, each at another time.

    Args:
        told: the model that lacks it.
        wind: any seed of it.
        count: how many are wanted.
    """
    duration = max(float(grid.times[-1]) for grid in told.batch.grids)
    edges = duration * np.arange(_PARTS + 1) / _PARTS
    never = 2 * duration
    onsets = [_between(wind, float(edge), never) for edge in edges[:-1]]
    whole = told.normal(told.effects(onsets)).over(np.ones(told.batch.count, bool))
    base = len(told.free)
    taken = inverse_normal(whole.matrix[:base, :base]) @ whole.matrix[:base, base:]
    inside = whole.matrix[base:, base:] - whole.matrix[base:, :base] @ taken
    slope = whole.gradient[base:] - taken.T @ whole.gradient[:base]
    # A push that never ends is one less nothing.
    inside, slope = np.pad(inside, (0, 1)), np.pad(slope, (0, 1))
    size = np.diag(inside)
    strength = size[:, None] + size[None] - 2 * inside
    least = 1e-6 * float(strength.max(initial=0.0))
    gain = np.where(strength > least, (slope[:, None] - slope[None]) ** 2 / np.maximum(strength, 1e-300), 0.0)
    gain[np.tril_indices(len(gain))] = 0.0
    found: list[tuple[int, int]] = []
    for place in np.argsort(-gain, axis=None):
        i, j = divmod(int(place), len(gain))
        if gain[i, j] <= 0 or len(found) == count:
            break
        if all(max(abs(i - a), abs(j - b)) >= _APART for a, b in found):
            found.append((i, j))
    return [_between(wind, float(edges[i]), never if j == _PARTS else float(edges[j])) for i, j in found]


def _between(wind: Candidate, start: float, stop: float) -> Candidate:
    return dataclasses.replace(wind, values={**wind.values, "start": start, "stop": stop})
