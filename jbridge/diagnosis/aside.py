"""A recording set aside: what happened in it once would be learned as if it were a law, and spoil what is one.

A reading that jumps, a push or a stuck wheel in one of several recordings draws the numbers of a fit away from all the
others, and would get names. Where much is left and one recording is, or was before later names, met far worse than any
other, the others are asked alone. They have the word only if what they say holds on the hold-out, and meets the odd
recording, too, until something happens.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identification.problem import Setting
from ..identify.evaluate import evaluate
from ..identify.lanes import Batch
from ..model.plant import Plant
from ..recordings import Recording
from ..recordings.recording import INPUTS
from .adequacy import LARGE, ratios
from .result import Interval

RATE = "_rate"
_FEWEST = 4
"""Recordings below which none can be spared."""
_STANDS_OUT = 2.0
"""Error of the worst recording over that of the next one: the others pay for it, so this is less than it will be."""
_AWAY = 5.0
"""Error over noise at which a simulation has left a recording, if it stays there"""
_LASTING = 0.1
"""for so long [s],"""
_CLEARLY = 3.0
"""and that of all that follows, if something happened."""
_UNDISTURBED = 1.0
"""Shortest time [s] before that: most laws of physics would show from the start."""
_SHORTLY = 0.5
"""Time [s] within which a force that begins somewhere drives a simulation away,"""
_BEYOND = 0.05
"""and share of a range by which one must leave it to be anywhere else."""


def stands_out(batch: Batch, predicted: NDArray[np.float64]) -> int | None:
    """The place of a recording that is met far worse than all others, if they are enough without it.

    Args:
        batch, predicted: see `ratios`.
    """
    worst = ratios(batch, predicted).max(axis=1)
    if len(worst) < _FEWEST:
        return None
    second, first = np.argsort(worst, kind="stable")[-2:]
    # Of two that run away neither is the odd one.
    odd = np.isfinite(worst[second]) and worst[first] > LARGE and worst[first] >= _STANDS_OUT * worst[second]
    return int(first) if odd else None


class Event(NamedTuple):
    """Something that happened in a recording that a model met until then."""

    when: Interval
    channel: str
    """Where that led most,"""
    ratio: float
    """and how far off, over the noise."""
    beyond: str | None
    """The first input or channel that is just then where no other recording has it, or the channel with `RATE` whose
    rate is: a law may begin there, too."""


def event(plant: Plant, setting: Setting, recording: Recording, others: Sequence[Recording]) -> Event | None:
    """What happened in a recording, if a model meets it until an instant.

    Args:
        plant: the model, from the other recordings.
        setting: noise and units.
        recording: the odd one.
        others: those.
    """
    run = evaluate(plant, setting, [recording], windows=False)
    grid, weight = run.batch.grids[0], np.asarray(run.batch.lanes.weight)[0, : run.batch.grids[0].intervals + 1]
    off = (run.predicted[0, : len(weight)] - np.asarray(run.batch.lanes.y)[0, : len(weight)]) * weight
    row = _left(off, weight, max(3, round(_LASTING / recording.period)))
    if row is None:
        return None
    begun = float(grid.times[row])
    before, after = _ratio(off[:row], weight[:row]), _ratio(off[row:], weight[row:])
    channel = int(np.argmax(after))
    if begun < _UNDISTURBED or before.max() > LARGE or not after[channel] >= _CLEARLY:
        return None
    when = Interval(recording.name, begun, float(grid.times[-1]))
    beyond = _beyond(recording, others, recording.start + begun, setting.noise)
    return Event(when, AXES[channel], float(after[channel]), beyond)


def _left(off: NDArray[np.float64], weight: NDArray[np.float64], lasting: int) -> int | None:
    """The row from which some channel stays away from a simulation for so many samples: one alone is a glitch."""
    first = []
    for k in range(off.shape[1]):
        rows = np.flatnonzero(weight[:, k] > 0)
        away = ~(np.abs(off[rows, k]) <= _AWAY)
        if len(rows) >= lasting:
            stays = np.lib.stride_tricks.sliding_window_view(away, lasting).mean(axis=1) > 0.5
            first += [int(row) for row in rows[np.flatnonzero(stays & away[: len(stays)])[:1]]]
    return min(first, default=None)


def _beyond(
    recording: Recording, others: Sequence[Recording], instant: float, noise: Mapping[str, float]
) -> str | None:
    just = (recording.times >= instant - _SHORTLY) & (recording.times < instant)
    known = [_course(other) for other in others]
    for name, own in _course(recording).items():
        reached = [course[name] for course in known if name in course]
        if not reached:
            continue
        low, high = min(map(np.min, reached)), max(map(np.max, reached))
        margin = max(_BEYOND * (high - low), _AWAY * noise.get(name.removesuffix(RATE), 0.0))
        if np.any((own[just] < low - margin) | (own[just] > high + margin)):
            return name
    return None


def _course(recording: Recording) -> dict[str, NDArray[np.float64]]:
    """Inputs, channels, and how far each channel has gone within the latest tenth of a second."""
    step = max(1, round(_LASTING / recording.period))
    course = {name: values for name in (*INPUTS, *AXES) if (values := getattr(recording, name)) is not None}
    for axis in AXES:
        if axis in course:
            values = course[axis]
            course[axis + RATE] = values - np.concatenate([np.full(step, values[0]), values])[: len(values)]
    return course


def _ratio(off: np.ndarray, weight: np.ndarray) -> np.ndarray:
    number = np.maximum(np.count_nonzero(weight, axis=0), 1)
    return np.sqrt(np.nan_to_num(np.sum(off**2, axis=0) / number, nan=np.inf, posinf=np.inf))
