"""Does what a model lacks repeat? Asked of the force that is missing, without simulating anything again.

Errors add up along a simulation, and no linear screen can follow one that is far off. The force that each recorded
motion needs beyond the model's stays where it acts.

Smoothing blurs reversals, many times stronger than what is looked for, and the model's own motion under the same
input is blurred alike at the same moments: its force is taken off, and what blur is strong in counts for little. A
recording from which the simulation is so far that this leaves more than there was has no say.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.force_balance import Balance, as_played, balance
from ..identify.lanes import Batch
from ..model.plant import Plant
from .tracks import Track, features, foreseen_by_few, quarters

_SEEN = 0.2
"""Least share of the force's mean square beyond noise, from which it is asked."""
_QUARTERS = 0.6
"""What foresight between quarters of one recording counts: friction that wanders slowly is alike in neighbours."""
_PERIOD = 0.01
"""Least time between the samples that are looked at [s]; the force is smoothed over more than ten of these."""


def repeating_share(
    plant: Plant, batch: Batch, predicted: NDArray[np.float64], noise: Mapping[str, float]
) -> dict[str, float]:
    """For each axis, the share of the missing force (of its mean square) that other recordings foresee.

    Args:
        plant: the fitted model.
        batch: whole recordings. Of a single one, quarters take the place of recordings.
        predicted: the model's readings on them; what is not finite has no say.
        noise: standard deviation of each channel.

    Returns:
        Nothing of axes of which no simulation runs close, or where there is little beyond noise.
    """
    shares = {}
    runs = [_Run.of(plant, batch, i, predicted[i], noise) for i in range(len(batch.grids))]
    for axis in AXES:
        close = [run for run in runs if axis in run.measured.force and run.measured.blurred_like(run.own, axis)]
        tracks, by_noise = _missing(close, axis)
        total = sum(float(track.weight @ track.force**2) for track in tracks)
        share = 1.0 - by_noise / total if total > 0 else 0.0
        if share < _SEEN:
            continue
        alone = len(tracks) == 1
        if alone:
            tracks = quarters(tracks[0])
        foreseen = foreseen_by_few(tracks, features(tracks).each()) / share
        shares[axis] = float(np.clip(foreseen * (_QUARTERS if alone else 1.0), 0.0, 1.0))
    return shares


class _Run(NamedTuple):
    """Force balances of one recording."""

    measured: Balance
    own: Balance
    """Of the model's motion under the same input,"""
    noisy: Balance
    """and of that with noise added."""

    @classmethod
    def of(
        cls, plant: Plant, batch: Batch, index: int, predicted: NDArray[np.float64], noise: Mapping[str, float]
    ) -> "_Run":
        grid = batch.grids[index]
        own = balance(plant, as_played(grid, predicted))
        return cls(balance(plant, grid.recording), own, balance(plant, as_played(grid, predicted, noise, index)))


def _missing(runs: Sequence[_Run], axis: str) -> tuple[list[Track], float]:
    """What each balance has on an axis and the model's own motion has not, and the sum of squares of noise in it."""
    forces = [run.measured.less(run.own).force[axis] for run in runs]
    size = np.abs(np.concatenate([np.zeros(0), *forces]))
    known = np.isfinite(size)
    scale = max(float(np.median(size[known])), 1e-300) if known.any() else 1.0
    inputs = {name for run in runs for name in run.measured.u}
    tracks, by_noise = [], 0.0
    for (measured, own, noisy), force in zip(runs, forces, strict=True):
        # Two motions that are not quite the same differ most where each is blurred most.
        weight = np.where(np.isfinite(force), 1.0 / (1.0 + (own.force[axis] / scale) ** 2), 0.0)
        some = slice(None, None, max(1, round(_PERIOD / float(np.median(np.diff(measured.times))))))
        motion = ({name: part[some] for name, part in parts.items()} for parts in (measured.q, measured.v))
        u = {name: part[some] for name, part in measured.u.items()}
        force, weight = np.nan_to_num(force[some]), weight[some]
        tracks.append(Track.of(axis, measured.times[some], (next(motion), next(motion)), u, inputs, force, weight))
        noise = noisy.less(own).force[axis][some]
        both = np.isfinite(noise) & (weight > 0)
        if both.any():
            by_noise += float(np.average(noise[both] ** 2, weights=weight[both]) * weight.sum())
    return tracks, by_noise
