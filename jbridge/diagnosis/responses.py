"""What effects that are singular where they are absent would do at finite sizes, by simulation."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..identify.lanes import Batch
from ..identify.setting import lanes_for
from ..recordings import Recording
from .candidates import ABSENT_WHEN_LARGE, Candidate
from .search import Search
from .trials import State

_ENDS_BY_ITSELF = ("limit", "position")
"""A drive's limit beyond the largest input and a stop beyond the last place do nothing: nothing is weaker than that."""
_WEAKER = (3.0, 9.0, 27.0)
"""By how much weaker than the weakest of its own seeds a singular effect is tried, too."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """Recordings as lanes, with a model's starts on them."""

    recordings: tuple[Recording, ...]
    batch: Batch
    initial: NDArray[np.float64]
    """`(lane, state)`."""
    predicted: NDArray[np.float64]
    """The model's readings: `(lane, sample, channel)`."""


def magnitude(seeds: Sequence[Candidate]) -> str:
    """The number by which the finite seeds of one effect differ: how much of it there is.

    Args:
        seeds: at least one, all of the same kind and site.
    """
    first = seeds[0]
    numbers = [key for key in first.values if key in first.free]
    return next((key for key in numbers if any(s.values[key] != first.values[key] for s in seeds)), numbers[0])


def choices(candidate: Candidate) -> tuple[str, ...]:
    """What a candidate has chosen by word, such as the end of the rail."""
    return tuple(value for value in candidate.values.values() if isinstance(value, str))


def with_weaker(seeds: Sequence[Candidate]) -> list[Candidate]:
    """Finite seeds of one effect, and weaker ones, for each choice of its options."""
    key = magnitude(seeds)
    if key in _ENDS_BY_ITSELF:
        return list(seeds)
    sign = 1.0 if key in ABSENT_WHEN_LARGE else -1.0
    found = list(seeds)
    for choice in dict.fromkeys(map(choices, seeds)):
        weakest = max((s for s in seeds if choices(s) == choice), key=lambda s: sign * s.values[key])
        found += [
            dataclasses.replace(weakest, values={**weakest.values, key: weakest.values[key] * factor**sign})
            for factor in _WEAKER
        ]
    return found


def simulated(
    search: Search, state: State, seeds: list[Candidate], cuts: Sequence[Cut]
) -> list[list[NDArray[np.float64]]]:
    """Weighted change of the readings for seeds of one effect, by cut: lane, column (one), sample and channel (flat).

    Nothing is refitted. A seed whose simulation runs away changes nothing here, and so excludes nothing.

    Args:
        search: recordings.
        state: the model without the effect.
        seeds: of one effect, which has a hidden coordinate.
        cuts: recordings with the model's starts on them.
    """
    engine, vector, _ = search.extended(state, seeds[0])
    plant = engine.table.unravel(seeds[0].set(engine.table, vector))
    found = []
    like = None
    for cut in cuts:
        batch = lanes_for(engine.table, plant, search.setting, cut.recordings, search.window, like)
        like = like or batch
        initial = batch.initial.copy()
        lanes = min(batch.count, cut.batch.count)
        initial[:lanes, :6] = cut.initial[:lanes, :6]
        weight = np.asarray(cut.batch.lanes.weight)
        columns = []
        for seed in seeds:
            predicted = np.asarray(engine.motions(seed.set(engine.table, vector), initial, batch)[1])
            change = np.zeros((cut.batch.count, 1, weight[0].size))
            if predicted.shape == cut.predicted.shape and np.isfinite(predicted).all():
                change[:, 0] = ((predicted - cut.predicted) * weight).reshape(cut.batch.count, -1)
            columns.append(change)
        found.append(columns)
    return found
