"""How well a model meets recordings: free runs and windows, each from a state estimated over its first half second.

It is longer where what is hidden takes longer to tell: beside a play or a presliding spring until the cart has moved
enough, and for a second pendulum one of its periods.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identification.data.grid import Grid
from ..identification.problem import Setting
from ..model.plant import Plant
from ..recordings import Recording
from .base import WINDOW, channel_errors
from .finer import FINER, less_own_error
from .force_balance import Balance, as_played, balance
from .lanes import Batch, Lanes
from .linearise import Engine
from .result import Errors, Trace
from .setting import lanes_for
from .solve import solve


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

    def started(
        batch: Batch, initial: NDArray[np.float64], iterations: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        fits = solve(
            engine,
            dataclasses.replace(batch, lanes=early(batch)),
            vector[None],
            [np.zeros(0, np.int64)],
            initial=initial[None],
            columns=columns,
            iterations=iterations,
        )
        return fits.initial[0], fits.gram.predicted[0]

    # What is hidden is not guessed from first samples.
    initial, predicted = started(batch, batch.initial, 15 if plant.hidden else 4)
    if finer:
        corrected, _ = less_own_error(engine, vector, initial, batch, predicted)
        initial, _ = started(corrected, initial, 1)
        fine = np.asarray(engine.motions(vector, initial, batch, finer=FINER)[1])
        predicted = np.where(np.isfinite(fine), fine, predicted)
    return batch, predicted


def early(batch: Batch) -> Lanes:
    """A batch's lanes with what tells of their starts alone: nothing after that counts."""
    times = np.concatenate([np.zeros((batch.count, 1)), np.cumsum(np.asarray(batch.lanes.lane.dt), axis=1)], axis=1)
    weight = jnp.where((times <= batch.told[:, None])[:, :, None], batch.lanes.weight, 0.0)
    return eqx.tree_at(lambda lanes: lanes.weight, batch.lanes, weight)


def traces(
    before: tuple[Plant, Run],
    after: tuple[Plant, Run],
    recordings: Sequence[Recording],
    role: str,
) -> tuple[Trace, ...]:
    """Each recording beside both models' free runs and the force that either leaves over."""
    out = []
    grids = before[1].batch.grids
    first = _balances(*before, grids)
    last = first if after is before else _balances(*after, grids)
    # What is compared must be of one kind: both models' on all recordings, or none.
    close = {
        axis for axis in AXES if all(axis not in b.force or b.blurred_like(own, axis) for b, own in (*first, *last))
    }
    for i, (recording, grid) in enumerate(zip(recordings, grids, strict=True)):
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
        moved = first[i][0]
        near = np.clip(np.searchsorted(moved.times, grid.times), 0, len(moved.times) - 1)
        out.append(
            Trace(
                recording.name,
                role,
                grid.times,
                inputs,
                measured,
                runs[0],
                runs[1],
                _at(near, moved.q),
                _at(near, moved.v),
                *(_at(near, _unexplained(*pair[i], close)) for pair in (first, last)),
            )
        )
    return tuple(out)


def _balances(plant: Plant, run: Run, grids: Sequence[Grid]) -> list[tuple[Balance, Balance]]:
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
