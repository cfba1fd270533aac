"""How well a model meets recordings: free runs and windows, each from a state estimated over its first half second."""

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..model.plant import Plant
from ..recordings import Recording
from .base import WINDOW, channel_errors
from .finer import FINER, less_own_error
from .force_balance import balance, played
from .lanes import Batch, Grid
from .linearise import Engine
from .result import Errors, Trace
from .setting import Setting, lanes_for
from .solve import solve

START = 0.5
"""Time from which an initial state is estimated [s]."""


@dataclasses.dataclass(frozen=True)
class Run:
    """Free runs of one model over recordings."""

    batch: Batch
    predicted: NDArray[np.float64]
    """Recording, sample, channel."""
    errors: Errors


def evaluate(
    plant: Plant,
    setting: Setting,
    recordings: Sequence[Recording],
    columns: int = 8,
    like: tuple[Batch | None, Batch | None] = (None, None),
    windows: bool = True,
    finer: bool = False,
) -> Run:
    """Free-run and window errors of a model, its parameters held.

    Args:
        plant: the model.
        setting: noise and units.
        recordings: what to meet.
        columns: width of a program that is compiled anyway.
        like: batches of whole recordings and of windows whose programs are compiled anyway.
        windows: whether windows are wanted.
        finer: whether to simulate with the finer steps of `identify.finer`.
    """
    engine = Engine(plant)
    vector = np.array(engine.table.ravel(plant), dtype=float)
    batch, predicted = _simulate(engine, plant, vector, setting, recordings, None, columns, like[0], finer)
    within: dict[str, float] = {}
    if windows:
        cut, runs = _simulate(engine, plant, vector, setting, recordings, WINDOW, columns, like[1], finer)
        within = channel_errors(cut, runs)
    return Run(batch, predicted, Errors(channel_errors(batch, predicted), within))


def _simulate(
    engine: Engine,
    plant: Plant,
    vector: NDArray[np.float64],
    setting: Setting,
    recordings: Sequence[Recording],
    window: float | None,
    columns: int,
    like: Batch | None,
    finer: bool,
) -> tuple[Batch, NDArray[np.float64]]:
    batch = lanes_for(engine.table, plant, setting, recordings, window, like)
    times = np.concatenate([np.zeros((batch.count, 1)), np.cumsum(np.asarray(batch.lanes.lane.dt), axis=1)], axis=1)
    early = (times <= START)[:, :, None]

    def started(
        batch: Batch, initial: NDArray[np.float64], iterations: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        lanes = eqx.tree_at(lambda lanes: lanes.weight, batch.lanes, jnp.where(early, batch.lanes.weight, 0.0))
        fits = solve(
            engine,
            dataclasses.replace(batch, lanes=lanes),
            vector[None],
            [np.zeros(0, np.int64)],
            initial=initial[None],
            columns=columns,
            iterations=iterations,
        )
        return fits.initial[0], fits.gram.predicted[0]

    initial, predicted = started(batch, batch.initial, 4)
    if finer:
        corrected, _ = less_own_error(engine, vector, initial, batch, predicted)
        initial, _ = started(corrected, initial, 1)
        fine = np.asarray(engine.motions(vector, initial, batch, finer=FINER)[1])
        predicted = np.where(np.isfinite(fine), fine, predicted)
    return batch, predicted


def traces(
    before: tuple[Plant, Run],
    after: tuple[Plant, Run],
    recordings: Sequence[Recording],
    role: str,
) -> tuple[Trace, ...]:
    """Each recording beside both models' free runs and the force that either leaves over."""
    out = []
    for i, recording in enumerate(recordings):
        grid = before[1].batch.grids[i]
        points = grid.intervals + 1
        measured: dict[str, NDArray[np.float64]] = {}
        runs: tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]] = ({}, {})
        for k, axis in enumerate(AXES):
            if getattr(recording, axis) is None:
                continue
            measured[axis] = np.where(grid.measured[:, k], grid.y[:, k], np.nan)
            for run, store in zip((before[1], after[1]), runs, strict=True):
                store[axis] = run.predicted[i, :points, k]
        inputs = {}
        for column, name in enumerate(("u_x", "u_l")):
            if getattr(recording, name) is not None:
                inputs[name] = np.append(grid.u[:, column], grid.u[-1, column])
        first = balance(before[0], recording)
        forces = [_unexplained(plant, grid, run.predicted[i]) for plant, run in (before, after)]
        near = np.clip(np.searchsorted(first.times, grid.times), 0, len(first.times) - 1)
        out.append(
            Trace(
                recording.name,
                role,
                grid.times,
                inputs,
                measured,
                runs[0],
                runs[1],
                _at(near, first.q),
                _at(near, first.v),
                *(_at(near, force) for force in forces),
            )
        )
    return tuple(out)


def _unexplained(plant: Plant, grid: Grid, predicted: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
    """A recording's force balance by axis, less the model's own where that runs close enough to be blurred alike."""
    whole = balance(plant, grid.recording)
    if not np.isfinite(predicted).all():
        return whole.force
    left = whole.less(balance(plant, played(grid, predicted))).force

    def size(force: NDArray[np.float64]) -> float:
        known = np.abs(force[np.isfinite(force)])
        return float(np.median(known)) if len(known) else np.inf

    return {axis: left[axis] if size(left[axis]) < size(force) else force for axis, force in whole.force.items()}


def _at(near: NDArray[np.int64], values: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    return {axis: value[near] for axis, value in values.items()}
