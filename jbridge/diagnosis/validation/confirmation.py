"""What a hold-out says of one effect: how steadily it is met worse without it, and by how much.

An effect without which the hold-out is met worse is confirmed if, in the channel whose error it changes most, leaving
it out more than doubles the square of the typical error: what has no name is a force that hold-outs repeat as well, and
whatever effect is most like it imitates a part of it. The error is that of most windows, as the criterion counts it,
since one that no model meets says nothing of the others; and the factor is a mean over the horizons, since a force
shows in short windows and a wrong length or gain in long ones. Errors of channels are not added up: what one of them
cannot explain says nothing of another, and their noise, which a fine encoder makes as small as one likes, is no common
unit.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...identification.data.windows import HORIZONS
from ...identification.evaluation.errors import Evaluation
from ..criteria import CRITERIA
from ..structures.space import Name, happens_once
from ..structures.structure import steadiness


@dataclasses.dataclass(frozen=True)
class Checked:
    """What the hold-out says of one effect."""

    name: Name
    status: str
    """`confirmed`, `suggested`, or `event` for what happened once, in the recordings alone."""
    explained: float | None
    """Share of the hold-out's excess squared error that comes back without it, as a mean over the channels in which
    any exceeds the noise; None where there is none."""
    steady: float
    """How steadily blocks of the hold-out are met worse without it, in standard errors, see `steadiness`."""


def check_effect(
    name: Name,
    loss: NDArray[np.float64],
    expected: NDArray[np.float64],
    before: Evaluation,
    complete: Evaluation,
    run: Evaluation,
) -> Checked:
    """What the hold-out says of an effect.

    Args:
        name: of the effect.
        loss: of the criterion without it, by block and channel.
        expected: loss by block if the effect is what the model says.
        before: the model as given.
        complete: the model with it.
        run: the model without it.
    """
    steady = steadiness(loss.sum(axis=1), expected)
    own, factors = explained_by_channel(before, complete, run), _factors(complete, run)
    # It is judged where it changes the error most, of the channels that lose. Where hardly more than noise is left,
    # there is nothing that it might imitate.
    losing = [axis for axis, lost in zip(AXES, loss.sum(axis=0), strict=True) if lost > 0.0 and axis in factors]
    most = max(losing, key=lambda axis: factors[axis], default=None)
    nameless = most is not None and factors[most] <= CRITERIA.imitated and _left(complete, most) > CRITERIA.met
    explained = float(np.mean(list(own.values()))) if own else None
    if steady > CRITERIA.confirmed and not nameless:
        return Checked(name, "confirmed", explained, steady)
    once = happens_once(name[0]) and float(loss.sum()) <= 0.0
    return Checked(name, "event" if once else "suggested", explained, steady)


def _left(complete: Evaluation, axis: str) -> float:
    """The largest typical error of a channel over its noise, of the horizons on which models are compared."""
    each = [complete.typical_excess(horizon).get(axis, 0.0) for horizon in complete.horizons if horizon in HORIZONS]
    return math.sqrt(1.0 + max(each, default=0.0))


def _factors(complete: Evaluation, run: Evaluation) -> dict[str, float]:
    """Square of the typical error without an effect over the one with it, as the geometric mean over the horizons on
    which models are compared, by channel."""
    logarithms: dict[str, list[float]] = {}
    for horizon in (h for h in complete.horizons if h in HORIZONS):
        left, without = (each.typical_excess(horizon) for each in (complete, run))
        for axis, square in left.items():
            logarithms.setdefault(axis, []).append(math.log((1.0 + without[axis]) / (1.0 + square)))
    return {axis: math.exp(np.mean(each)) for axis, each in logarithms.items()}


def explained_by_channel(before: Evaluation, after: Evaluation, beside: Evaluation | None = None) -> dict[str, float]:
    """Share of the excess squared error that a model closes, by channel in which it is larger than the noise.

    Args:
        before: the model as given.
        after: the model of which it is told.
        beside: one that is compared with it in place of the model as given.
    """
    horizon, axes = _shown(before)
    first, last, other = (run.excess(horizon) for run in (before, after, beside or before))
    # A noise that is estimated too large leaves less than nothing, and no more than all can be explained.
    return {axis: min((other[axis] - last[axis]) / max(first[axis], other[axis]), 1.0) for axis in axes}


def one_second(run: Evaluation) -> float:
    """The horizon of 1 s, or the nearest that the recordings are long enough for."""
    return min(run.horizons, key=lambda h: abs(math.log(min(h, 1e3))))


def _shown(before: Evaluation) -> tuple[float, list[str]]:
    """The horizon of 1 s, and the channels whose excess is larger than the noise there; the next longer horizon where
    there is none."""
    nearest = one_second(before)
    for horizon in (h for h in before.horizons if h >= nearest):
        axes = [axis for axis, ratio in before.ratios(horizon).items() if ratio**2 - 1.0 > 1.0]
        if axes:
            return horizon, axes
    return nearest, []
