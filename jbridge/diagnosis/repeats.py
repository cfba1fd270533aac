"""Does what a model lacks repeat? Asked of the force that is missing, without simulating anything again.

A simulation that has run away says little about what drove it off, and no linear screen can follow it. The force that
each recorded motion needs beyond the model's stays where it acts. A flexible force over place, direction, velocity,
input and rope length is fitted to it on all recordings but one, and must predict that one.

Smoothing blurs reversals, alike in every recording: the same is asked of recordings that the model itself plays, and
what repeats there is not counted.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.force_balance import Balance, balance
from ..identify.lanes import Batch
from ..model.plant import Plant
from ..recordings import Recording

_PLACES = 24
_VALUES = 10
_RIDGE = 0.1
"""Relative to the number of samples: keeps what was hardly visited near nothing."""

_SEEN = 0.1
"""Least share of the force's mean square beyond blur and noise, from which it is asked. Of less, the difference between
the blur of two motions that are nearly the same is no small part."""


def repeating_share(
    plant: Plant,
    recordings: Sequence[Recording],
    batch: Batch,
    predicted: NDArray[np.float64],
    noise: Mapping[str, float],
) -> dict[str, float]:
    """For each axis, the share of the missing force (of its mean square) that other recordings foresee.

    Args:
        plant: the fitted model.
        recordings: measured runs. Of a single one, quarters take the place of recordings.
        batch: whole recordings, in the same order.
        predicted: the model's readings on them.
        noise: standard deviation of each channel.
    """
    played = [_played(r, batch, i, predicted[i], noise) for i, r in enumerate(recordings)]
    measured = [balance(plant, r) for r in recordings]
    simulated = [balance(plant, r) for r in played]
    if len(recordings) == 1:
        measured, simulated = _quarters(measured[0]), _quarters(simulated[0])
    shares = {}
    for axis in AXES:
        if not all(axis in b.force for b in measured):
            continue
        total, foreseen = _foreseen(measured, axis)
        expected, blurred = _foreseen(simulated, axis)
        if total - expected > _SEEN * total:
            # Rougher motion is blurred more, in the proportion in which smooth motion is.
            blurred *= total / max(expected, 1e-300)
            shares[axis] = float(np.clip((foreseen - max(blurred, 0.0)) / (total - expected), 0.0, 1.0))
    return shares


def _played(
    recording: Recording, batch: Batch, index: int, predicted: NDArray[np.float64], noise: Mapping[str, float]
) -> Recording:
    """The recording as the model would have made it, noise included."""
    grid = batch.grids[index]
    rng = np.random.default_rng(index)
    times = recording.times - recording.times[0]
    changed = {}
    for k, axis in enumerate(AXES):
        if getattr(recording, axis) is not None:
            clean = np.interp(times, grid.times, predicted[: grid.intervals + 1, k])
            changed[axis] = clean + noise.get(axis, 0.0) * rng.standard_normal(len(times))
    return dataclasses.replace(recording, **changed)


def _quarters(b: Balance) -> list[Balance]:
    parts = []
    for rows in np.array_split(np.arange(len(b.times)), 4):
        q, v, force, u = ({name: values[rows] for name, values in part.items()} for part in (b.q, b.v, b.force, b.u))
        parts.append(Balance(b.times[rows], q, v, force, u))
    return parts


def _foreseen(balances: Sequence[Balance], axis: str) -> tuple[float, float]:
    """Sum of squares of an axis' force, and how much of it what was learned from the other recordings takes away."""
    edges = _edges(balances, axis)
    normal, right, forces, features = [], [], [], []
    for b in balances:
        known = np.isfinite(b.force[axis])
        table = _features(b, axis, edges)[known]
        force = b.force[axis][known]
        normal.append(table.T @ table)
        right.append(table.T @ force)
        forces.append(force)
        features.append(table)
    total, left = 0.0, 0.0
    for i, (force, table) in enumerate(zip(forces, features, strict=True)):
        rest = [j for j in range(len(balances)) if j != i]
        matrix = np.sum([normal[j] for j in rest], axis=0)
        count = max(sum(len(forces[j]) for j in rest), 1)
        ridge = _RIDGE * count / _PLACES * np.eye(len(matrix))
        learned = np.linalg.solve(matrix + ridge, np.sum([right[j] for j in rest], axis=0))
        total += float(force @ force)
        left += float(np.sum((force - table @ learned) ** 2))
    return total, total - left


def _edges(balances: Sequence[Balance], axis: str) -> dict[str, NDArray[np.float64]]:
    """Knots of every variable, over what the recordings cover."""
    out = {}
    for name, count in ((axis, _PLACES), (f"v_{axis}", _VALUES), ("l", _VALUES), (f"u_{axis}", _VALUES)):
        values = np.concatenate([_values(b, name) for b in balances])
        low, high = (float(edge) for edge in np.quantile(values, [0.002, 0.998]))
        # A variable that flickers once has a range, but no values to spread knots over.
        if high > low:
            out[name] = np.linspace(low, high, count)
    return out


def _values(b: Balance, name: str) -> NDArray[np.float64]:
    if name.startswith("v_"):
        return b.v[name[2:]]
    if name.startswith("u_"):
        return b.u.get(name, np.zeros_like(b.times))
    return b.q[name]


def _features(b: Balance, axis: str, edges: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Hat functions of every variable; of the place, also with the direction's sign."""
    parts = []
    for name, knots in edges.items():
        own = hats(_values(b, name), knots)
        parts.append(own)
        if name == axis:
            parts.append(own * np.sign(b.v[axis])[:, None])
    return np.concatenate(parts, axis=1)


def hats(values: NDArray[np.float64], knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hat functions of a variable over evenly spaced knots: `(value, knot)`; beyond its ends the last one stays 1."""
    at = np.clip((values - knots[0]) / (knots[1] - knots[0]), 0.0, len(knots) - 1.0)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(len(knots))))
