"""How well an input separates explanations that the recordings cannot tell apart.

What counts is not how far two simulations of the input are apart but how much of that is left when the wrong rival is
fitted to the new recording and the old ones together: with `d` the weighted difference, `J` the rival's Jacobian on
the new recording and `M` its normal matrix on the old ones, the least of `|d - J p|^2 + p' M p` over its parameters
`p` (the sequential design of Hunter and Reiner, Technometrics 7, 1965; T-optimality in the words of Atkinson and
Fedorov, Biometrika 62, 1975).

A diagnosis that goes on with the new recording weighs rivals by `EFFECTIVE log(cost)` (`trials`), so that distance `D`
moves their scores apart by `s = EFFECTIVE log(1 + D / cost)`. A difference of log-likelihoods with mean `s / 2` has
variance `s`: where today's odds of the truth are `o`, a rival is preferred with probability
`Phi(-(s / 2 + log o) / sqrt(s))`.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from ..identification.problem import Setting
from ..identify.base import columns_for
from ..identify.lanes import Batch
from ..identify.setting import lanes_for
from ..identify.solve import reduce
from ..identify.uncertainty import inverse_normal
from ..model.effects.base import AXIS_OF_SITE
from ..recordings import Recording
from .candidates import SITE_OF_NUMBER
from .plays import Play
from .reach import Reach
from .trials import EFFECTIVE, Fitted


@dataclasses.dataclass(frozen=True)
class Contender:
    """One of several explanations that the recordings cannot tell apart, as a fitted model."""

    kind: str
    site: str
    probability: float
    fitted: Fitted
    normal: NDArray[np.float64]
    """Normal matrix of its free parameters on the recordings that there are."""

    @property
    def axis(self) -> str:
        """The axis that it is about."""
        return AXIS_OF_SITE[SITE_OF_NUMBER.get(self.site, self.site)]


def contender(kind: str, site: str, probability: float, fitted: Fitted) -> Contender:
    """A fitted explanation with what the recordings say about its numbers."""
    count = len(fitted.free)
    width = columns_for(count)
    gram = fitted.engine.gram(fitted.vector[None], fitted.free[None], fitted.initial[None], fitted.batch, columns=width)
    reduced = reduce(gram.products[0], count, width, fitted.initial, fitted.batch.initial, fitted.batch.prior)
    return Contender(kind, site, probability, fitted, reduced.matrix)


@dataclasses.dataclass(frozen=True)
class Separation:
    """What an input would bring."""

    play: Play
    log_wrong: float
    """Logarithm of the expected chance of a wrong decision."""


def separations(
    plays: Sequence[Play], contenders: Sequence[Contender], setting: Setting, reach: Reach
) -> list[Separation]:
    """What inputs would bring, the best first, without those that leave their limits.

    Args:
        plays: inputs.
        contenders: at least two.
        setting: noise and what the rig has.
        reach: limits.
    """
    found: list[Separation] = []
    recordings = [as_recording(play, reach, setting) for play in plays]
    room = min(c.fitted.batch.count for c in contenders)
    for first in range(0, len(plays), room):
        part = recordings[first : first + room]
        runs = [played(contender, setting, part) for contender in contenders]
        for i, play in enumerate(plays[first : first + room]):
            if all(_is_inside(run.predicted[i, : run.points[i]], reach, setting) for run in runs):
                found.append(Separation(play, _log_wrong(contenders, runs, i)))
    return sorted(found, key=lambda s: s.log_wrong)


def as_recording(play: Play, reach: Reach, setting: Setting) -> Recording:
    """A play as a recording of the rig at rest, so that lanes are made of it as of any other."""
    like = next((r for r in setting.recordings if r.u_l is not None), setting.recordings[0])
    count = int(np.floor(reach.seconds / reach.period + 1e-6)) + 1
    times = np.round(np.arange(count) * reach.period, 6)
    changed: dict[str, Any] = {
        name: play.waves[name].volts(times, drive) if name in play.waves else np.full(count, drive.rest)
        for name, drive in reach.drives.items()
    }
    for axis in ("x", "psi", "l"):
        if getattr(like, axis) is not None:
            changed[axis] = np.full(count, play.start[axis])
    # A sensor slower than the log stays so.
    fresh = {}
    for axis, flags in like.fresh.items():
        every = max(1, round(1.0 / max(float(np.mean(flags)), 1e-3)))
        fresh[axis] = np.arange(count) % every == 0
    return dataclasses.replace(
        like,
        name="next",
        times=times,
        fresh=fresh,
        locked_length=None if like.locked_length is None else start_length(play, setting),
        override={},
        extras={},
        notes=(),
        begun=0.0,
        earlier=None,
        u_x=changed.get("u_x"),
        u_l=changed.get("u_l"),
        x=changed.get("x"),
        psi=changed.get("psi"),
        l=changed.get("l"),
    )


@dataclasses.dataclass(frozen=True)
class Runs:
    """One contender's simulations of some inputs."""

    batch: Batch
    predicted: NDArray[np.float64]
    """Lane, sample, channel."""
    tangents: NDArray[np.float64]
    """Weighted, of free parameters and initial states: lane, column, sample and channel."""
    normal: NDArray[np.float64]
    """Normal matrix of the free parameters on the recordings that there are."""

    @property
    def points(self) -> list[int]:
        """Samples of each input."""
        return [grid.intervals + 1 for grid in self.batch.grids]


def played(contender: Contender, setting: Setting, recordings: Sequence[Recording]) -> Runs:
    """A contender's simulations of inputs, with its tangents."""
    fitted = contender.fitted
    table, count = fitted.engine.table, len(fitted.free)
    width = columns_for(count)
    # In the shape of the training lanes, so that the program of the fit serves again.
    batch = lanes_for(table, fitted.plant, setting, recordings, None, fitted.batch)
    vector, free = fitted.vector[None], fitted.free[None]
    gram = fitted.engine.gram(vector, free, batch.initial[None], batch, columns=width, keep=True)
    assert gram.tangents is not None
    used = np.concatenate([np.arange(count), width + np.arange(batch.initial.shape[1])])
    return Runs(batch, gram.predicted[0], gram.tangents[0][:, used], contender.normal)


def _is_inside(readings: NDArray[np.float64], reach: Reach, setting: Setting) -> bool:
    """Whether readings `(sample, 3)` keep within the limits."""
    if not np.isfinite(readings).all():
        return False
    return all(
        reach.low[axis] <= readings[:, k].min() and readings[:, k].max() <= reach.high[axis]
        for k, axis in enumerate(("x", "psi", "l"))
        if axis in setting.axes
    )


def _log_wrong(contenders: Sequence[Contender], runs: Sequence[Runs], i: int) -> float:
    """Logarithm of the chance that another contender is preferred to the true one, whichever that is."""
    total = sum(c.probability for c in contenders)
    terms = []
    for truth, own in zip(contenders, runs, strict=True):
        new = float((np.asarray(own.batch.lanes.weight[i]) > 0).sum())
        for rival, other in zip(contenders, runs, strict=True):
            if rival is not truth:
                apart = EFFECTIVE * np.log1p(distance(own, other, i) / (truth.fitted.cost + new))
                odds = truth.probability / rival.probability
                terms.append(np.log(truth.probability / total) + log_preferred(odds, float(apart)))
    return min(float(logsumexp(terms)), float(np.log(guess([c.probability for c in contenders]))))


def log_preferred(odds: float, apart: float) -> float:
    """Logarithm of the chance that a rival is preferred to the truth.

    Args:
        odds: of the truth against the rival, today.
        apart: expected distance of their scores from the new recording alone.
    """
    return float(log_ndtr(-(0.5 * apart + np.log(odds)) / np.sqrt(max(apart, 1e-12))))


def guess(chances: Sequence[float]) -> float:
    """Chance of being wrong without a further recording, from the probability of each explanation."""
    return max(1.0 - max(chances) / sum(chances), 1e-12)


def distance(truth: Runs, rival: Runs, i: int) -> float:
    """Sum of squares over the noise by which a rival, refitted, misses what the truth would record of input `i`."""
    weight = np.asarray(rival.batch.lanes.weight[i])
    apart = ((truth.predicted[i] - rival.predicted[i]) * weight).ravel()
    tangents, prior = rival.tangents[i], rival.batch.prior[i]
    count = len(rival.normal)
    held = ~np.isfinite(prior)
    known = np.zeros((len(tangents), len(tangents)))
    known[:count, :count] = rival.normal
    known[count:, count:] = np.diag(np.where(held, 1.0, np.where(held, 0.0, prior) ** 2))
    tangents = np.concatenate([tangents[:count], np.where(held[:, None], 0.0, tangents[count:])])
    right = tangents @ apart
    return max(float(apart @ apart - right @ inverse_normal(tangents @ tangents.T + known) @ right), 0.0)


def start_length(play: Play, setting: Setting) -> float:
    """Rope length at the start [m]; where the rope is locked, that of the recordings."""
    return play.start["l"] if "l" in setting.axes else float(np.round(setting.length, 3))
