"""Does what a model lacks repeat? Asked of the force that is missing, without simulating anything again.

A simulation that has run away says little about what drove it off, and no linear screen can follow it. The force that
each recorded motion needs beyond the model's stays where it acts.

Smoothing blurs reversals, many times stronger than what is looked for, and the model's own motion under the same
input is blurred alike at the same moments: its force is taken off, and what blur is strong in counts for little.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.force_balance import Balance, balance, played
from ..identify.lanes import Batch
from ..model.plant import Plant
from .tracks import INPUT_OF, Track, features, foreseen_by_few, quarters

_SEEN = 0.1
"""Least share of the force's mean square beyond noise, from which it is asked."""


def repeating_share(
    plant: Plant,
    batch: Batch,
    predicted: NDArray[np.float64],
    noise: Mapping[str, float],
) -> dict[str, float]:
    """For each axis, the share of the missing force (of its mean square) that other recordings foresee.

    Args:
        plant: the fitted model.
        batch: whole recordings. Of a single one, quarters take the place of recordings.
        predicted: the model's readings on them.
        noise: standard deviation of each channel.
    """
    runs = list(zip(batch.grids, predicted[: len(batch.grids)], strict=True))
    measured = [balance(plant, grid.recording) for grid, _ in runs]
    plain = [balance(plant, played(grid, y)) for grid, y in runs]
    noisy = [balance(plant, played(grid, y, noise, seed)) for seed, (grid, y) in enumerate(runs)]
    shares = {}
    for axis in AXES:
        if not all(axis in b.force for b in measured):
            continue
        tracks, by_noise = _missing(measured, plain, axis), _missing(noisy, plain, axis)
        total = _power(tracks, tracks)
        share = 1.0 - _power(by_noise, tracks) / total if total > 0 else 0.0
        if share > _SEEN:
            if len(tracks) == 1:
                tracks = quarters(tracks[0])
            shares[axis] = float(np.clip(foreseen_by_few(tracks, features(tracks).each()) / share, 0.0, 1.0))
    return shares


def _missing(motions: Sequence[Balance], plain: Sequence[Balance], axis: str) -> list[Track]:
    """What each motion's balance has on an axis and the model's own motion, smoothed alike, has not."""
    forces = [m.less(p).force[axis] for m, p in zip(motions, plain, strict=True)]
    size = np.abs(np.concatenate(forces))
    known = np.isfinite(size)
    scale = max(float(np.median(size[known])), 1e-300) if known.any() else 1.0
    inputs = sorted({name for m in motions for name in m.u} - {INPUT_OF[axis]})
    tracks = []
    for m, p, force in zip(motions, plain, forces, strict=True):
        # Two motions that are not quite the same differ most where each is blurred most.
        weight = np.where(np.isfinite(force), 1.0 / (1.0 + (p.force[axis] / scale) ** 2), 0.0)
        none = np.zeros_like(m.times)
        others = {name: m.u.get(name, none) for name in inputs}
        for other in AXES:
            if other != axis:
                others |= {other: m.q[other], f"v_{other}": m.v[other]}
        own = m.u.get(INPUT_OF[axis], none)
        tracks.append(Track(m.times, m.q[axis], m.v[axis], own, others, np.nan_to_num(force), weight))
    return tracks


def _power(tracks: Sequence[Track], weights: Sequence[Track]) -> float:
    """Mean square of the force, with the weights of other tracks."""
    known = sum(float(np.sum(w.weight)) for w in weights)
    return sum(float(w.weight @ t.force**2) for t, w in zip(tracks, weights, strict=True)) / max(known, 1e-300)
