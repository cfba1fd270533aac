"""Measured and simulated signals and residual forces of two models, collected for plotting."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..model.plant import Plant
from .data.grid import Grid
from .evaluation.errors import Evaluation
from .residual_force import Balance, as_played, balance
from .result import Trace


def traces(before: tuple[Plant, Evaluation], after: tuple[Plant, Evaluation], role: str) -> tuple[Trace, ...]:
    """Each recording beside both models' free runs and the force that either leaves over.

    Args:
        before, after: two models, and how they meet the same recordings.
        role: of the recordings, `train` or `holdout`.
    """
    out = []
    grids = before[1].data.grids
    first = _balances(*before, grids)
    last = first if after is before else _balances(*after, grids)
    # What is compared must be of one kind: both models' on all recordings, or none.
    close = {
        axis for axis in AXES if all(axis not in b.force or b.blurred_like(own, axis) for b, own in (*first, *last))
    }
    for i, grid in enumerate(grids):
        points, recording = grid.intervals + 1, grid.recording
        measured: dict[str, NDArray[np.float64]] = {}
        runs: tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]] = ({}, {})
        for k, axis in enumerate(AXES):
            if getattr(recording, axis) is None:
                continue
            measured[axis] = np.where(grid.measured[:, k], grid.y[:, k], np.nan)
            for run, store in zip((before[1], after[1]), runs, strict=True):
                store[axis] = run.predicted[i][:points, k]
        inputs = {
            name: np.append(grid.u[:, column], grid.u[-1, column])
            for column, name in enumerate(("u_x", "u_l"))
            if getattr(recording, name) is not None
        }
        moved = first[i][0]
        near = np.clip(np.searchsorted(moved.times, grid.times), 0, len(moved.times) - 1)
        out.append(
            Trace(
                recording=recording.name,
                role=role,
                times=grid.times,
                inputs=inputs,
                measured=measured,
                before=runs[0],
                after=runs[1],
                coordinates=_at(near, moved.q),
                velocities=_at(near, moved.v),
                force_before=_at(near, _unexplained(*first[i], close)),
                force_after=_at(near, _unexplained(*last[i], close)),
            )
        )
    return tuple(out)


def _balances(plant: Plant, run: Evaluation, grids: Sequence[Grid]) -> list[tuple[Balance, Balance]]:
    """Every recording's force balance beside that of the model's own motion."""
    return [
        (balance(plant, grid.recording), balance(plant, as_played(grid, run.predicted[i])))
        for i, grid in enumerate(grids)
    ]


def _unexplained(measured: Balance, own: Balance, close: Collection[str]) -> dict[str, NDArray[np.float64]]:
    left = measured.less(own).force
    return {axis: left[axis] if axis in close else force for axis, force in measured.force.items()}


def _at(near: NDArray[np.int64], values: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    return {axis: value[near] for axis, value in values.items()}
