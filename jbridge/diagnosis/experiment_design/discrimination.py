"""How well an input separates explanations that the recordings cannot tell apart.

What counts is not how far two simulations of the input are apart but how much of that is left when the wrong rival is
fitted to the new recording and the old ones together: with `d` the weighted difference, `J` the rival's Jacobian on
the new recording and `M` its normal matrix on the old ones, the least of `|d - J p|^2 + p' M p` over its parameters
`p` (the sequential design of Hunter and Reiner, Technometrics 7, 1965; T-optimality in the words of Atkinson and
Fedorov, Biometrika 62, 1975).

A diagnosis that goes on with the new recording compares the logarithms of errors (`identification.likelihood`), so
that distance `D` moves the rivals' criteria apart by half of `s = n log(1 + D / N)`, with `N` samples of which `n` are
independent. A difference of log-likelihoods with mean `s / 2` has variance `s`: where today's odds of the truth are
`o`, a rival is preferred with probability `Phi(-(s / 2 + log o) / sqrt(s))`.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from ...identification.data.windows import WHOLE, Data, make_data
from ...identification.estimation import Problem, engine_for
from ...identification.sensitivity.engine import Job, Sensitivity
from ...identification.sensitivity.windowed_rollout import STATES
from ...identification.setting import Setting
from ...identification.uncertainty import inverse_normal
from ...model.effects.base import AXIS_OF_SITE
from ...model.parameters import ParameterTable
from ...model.plant import Plant
from ...recordings import Recording
from ..structures.candidates import SITE_OF_NUMBER
from .inputs import Play
from .limits import Reach


@dataclasses.dataclass(frozen=True)
class Contender:
    """One of several explanations that the recordings cannot tell apart, as a fitted model."""

    kind: str
    site: str
    probability: float
    plant: Plant
    free: tuple[str, ...]
    """Names of its free parameters,"""
    normal: NDArray[np.float64]
    """and their normal matrix on the recordings that there are."""

    @property
    def axis(self) -> str:
        """The axis that it is about."""
        return AXIS_OF_SITE[SITE_OF_NUMBER.get(self.site, self.site)]


@dataclasses.dataclass(frozen=True)
class Separation:
    """What an input would bring."""

    play: Play
    log_wrong: float
    """Logarithm of the expected chance of a wrong decision."""


def separations(
    plays: Sequence[Play], contenders: Sequence[Contender], problem: Problem, reach: Reach
) -> list[Separation]:
    """What inputs would bring, the best first, without those that leave their limits.

    Args:
        plays: inputs.
        contenders: at least two.
        problem: the recordings, their noise, and how many independent samples they have.
        reach: limits.
    """
    setting = problem.setting
    recordings = [as_recording(play, reach, setting) for play in plays]
    data = make_data(recordings, (WHOLE,), setting.noise, problem.data.samples)
    runs = [played(contender, setting, data) for contender in contenders]
    effective = problem.likelihood.total / len(problem.data.grids)
    found = [
        Separation(play, _log_wrong(contenders, runs, i, effective))
        for i, play in enumerate(plays)
        if all(_is_inside(run.predicted[i], reach, setting) for run in runs)
    ]
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

    predicted: list[NDArray[np.float64]]
    """By input `(sample, 3)`."""
    tangents: list[NDArray[np.float64]]
    """Of free parameters and initial states, over the noise: by input `(column, sample and channel)`."""
    scale: list[NDArray[np.float64]]
    """One over the noise where there is a sample, by input `(sample, 3)`."""
    prior: list[NDArray[np.float64]]
    """Precision of the initial states by input; infinite where one is held."""
    normal: NDArray[np.float64]
    """Normal matrix of the free parameters on the recordings that there are."""


def played(contender: Contender, setting: Setting, data: Data) -> Runs:
    """A contender's simulations of inputs, with its tangents."""
    engine = engine_for(setting, data, contender.plant)
    table = ParameterTable(contender.plant)
    vector = np.array(table.ravel(contender.plant), dtype=float)
    free = np.array([table.positions(name)[0] for name in contender.free], np.int64)
    jobs = [Job(vector, t.recording, t.begins, t.states, free) for t in data.tilings]
    found: dict[int, Sensitivity] = {}
    engine.sensitivities(jobs, lambda i, got: found.update({i: got}))
    runs, predicted = Runs([], [], [], [], contender.normal), engine.predict(jobs)
    for i, own in enumerate(data.tilings):
        stop = int(own.stops[-1])
        seen = data.measured[own.recording, :stop]
        noise = np.where(np.isnan(data.noise[own.recording]), 1.0, data.noise[own.recording])
        scale = seen / noise
        runs.predicted.append(predicted[i][:stop])
        runs.tangents.append((found[i].tangents[:, :stop] * scale).reshape(len(free) + STATES, -1))
        runs.scale.append(scale)
        runs.prior.append(own.precision[0])
    return runs


def _is_inside(readings: NDArray[np.float64], reach: Reach, setting: Setting) -> bool:
    """Whether readings `(sample, 3)` keep within the limits."""
    if not np.isfinite(readings).all():
        return False
    return all(
        reach.low[axis] <= readings[:, k].min() and readings[:, k].max() <= reach.high[axis]
        for k, axis in enumerate(("x", "psi", "l"))
        if axis in setting.axes
    )


def _log_wrong(contenders: Sequence[Contender], runs: Sequence[Runs], i: int, effective: float) -> float:
    """Logarithm of the chance that another contender is preferred to the true one, whichever that is."""
    total = sum(c.probability for c in contenders)
    terms = []
    for truth, own in zip(contenders, runs, strict=True):
        new = float((own.scale[i] > 0).sum())
        for rival, other in zip(contenders, runs, strict=True):
            if rival is not truth:
                apart = min(effective, new) * np.log1p(distance(own, other, i) / new)
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
    apart = ((truth.predicted[i] - rival.predicted[i]) * rival.scale[i]).ravel()
    tangents, prior = rival.tangents[i], rival.prior[i]
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
