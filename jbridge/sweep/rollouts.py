"""One compiled program for all rollouts of a sweep: from rows of parameters to rows of summaries."""

import contextlib
import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float
from numpy.typing import NDArray

from ..control.base import AbstractController, Reference
from ..control.compensation import limits_of
from ..model.parameters import ParameterTable
from ..model.step_size import paces, substeps
from ..simulation.closed_loop import closed_loop, periods_remembered
from ..simulation.move_summary import UNITS, MoveSummary, is_sound, late_from
from ..trajectory import along, durations
from .spec import VARIED, Sweep

_ABREAST = 64
"""Rollouts that run abreast on one core: few enough that their states stay in its cache, measured."""


class Rollouts:
    """The rollouts of a sweep, ready to run in chunks."""

    def __init__(self, sweep: Sweep, threads: int | None = None):
        """Args:
        sweep: what is asked.
        threads: of a processor that compute side by side; by default as many as it has cores.
        """
        self.sweep = sweep
        self.names = (*UNITS, "sound")
        devices = jax.local_devices()
        self._sharding = NamedSharding(Mesh(np.array(devices), ("rollout",)), PartitionSpec("rollout"))
        on_cores = devices[0].platform == "cpu"
        whole = min(sweep.chunk, _ABREAST) if on_cores else sweep.chunk
        # Every device takes the same number of lanes; what is too much repeats the last one.
        self._lanes = len(devices) * math.ceil(whole / len(devices))
        self._threads = (threads or os.cpu_count() or 1) if on_cores else 1
        with self._precision():
            self._run = jax.jit(jax.vmap(_one(sweep)))

    def __call__(self, rows: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
        """Summaries of some rollouts, by name.

        Args:
            rows: parameter values in the order of the sweep's axes, `(rollout, axis)`.
        """
        pieces = [rows[start : start + self._lanes] for start in range(0, len(rows), self._lanes)]
        found = [self._piece(pieces[0])]  # alone: the others find its program compiled
        with ThreadPoolExecutor(self._threads) as pool:
            found += pool.map(self._piece, pieces[1:])
        return {name: np.concatenate([part[name] for part in found]) for name in self.names}

    def _piece(self, rows: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
        take = np.minimum(np.arange(self._lanes), len(rows) - 1)
        with self._precision():
            given = jax.device_put(np.asarray(rows[take], self.sweep.precision), self._sharding)
            found = jax.block_until_ready(self._run(given))
        return {name: np.asarray(found[name])[: len(rows)] for name in self.names}

    def _precision(self) -> contextlib.AbstractContextManager[Any]:
        return jax.enable_x64(self.sweep.precision == "float64")


def _one(sweep: Sweep) -> Callable[[Float[Array, " axis"]], dict[str, Array]]:
    """One rollout, from its parameter values."""
    plant, controller = sweep.model.plant, sweep.controller
    table = ParameterTable(plant)
    base = np.asarray(table.ravel(plant), sweep.precision)
    at = {axis.name: number for number, axis in enumerate(sweep.design.axes)}
    known = set(table.names())
    places = {name: table.positions(name) for name in at if name in known}
    period = controller.period
    count = math.ceil(sweep.seconds / period) + 1
    finer = _substeps(sweep, table, base, places)
    memory = _memory(sweep, table, base, places)
    # Known numbers, not arguments: an inference whose sets are known when it is compiled is several times faster.
    law = jax.tree.map(lambda leaf: jnp.asarray(leaf, sweep.precision), controller.law)

    def one(row: Float[Array, " axis"]) -> dict[str, Array]:
        dtype = row.dtype

        def chosen(name: str, default: float) -> Array:
            return row[at[name]] if name in at else jnp.asarray(default, dtype)

        vector = jnp.asarray(base)
        for name, where in places.items():
            vector = vector.at[np.asarray(where)].set(row[at[name]])
        start = jnp.asarray(sweep.start, dtype)
        goal = jnp.stack([chosen("reference.x", sweep.goal[0]), chosen("reference.l", sweep.goal[1])])
        speed = jnp.stack([chosen("reference.speed_x", sweep.speed[0]), chosen("reference.speed_l", sweep.speed[1])])
        points = jnp.stack([start, goal])
        times = jnp.arange(count, dtype=dtype) * period
        rest = chosen("reference.rest", sweep.rest)
        place, rate = along(points, speed, rest, times)
        arrival = durations(points, speed)[0]
        end = times[-1]
        late, limits = late_from(arrival, end).astype(dtype), limits_of(law).astype(dtype)
        summary = MoveSummary(goal, goal - start, late, jnp.asarray(period, dtype), limits)
        initial = jnp.zeros(plant.states, dtype).at[0].set(start[0]).at[2].set(start[1])
        found = closed_loop(
            table.unravel(vector),
            _with_controller(law, chosen, at),
            initial,
            Reference(place[:, 0], place[:, 1], rate[:, 0], rate[:, 1]),
            period=period,
            substeps=finer,
            memory=memory,
            collect=summary,
        )
        return found | {"sound": is_sound(found)}

    return one


def _with_controller(
    law: AbstractController, chosen: Callable[[str, float], Array], at: dict[str, int]
) -> AbstractController:
    for key, where in VARIED.items():
        if f"controller.{key}" in at:
            law = eqx.tree_at(where, law, chosen(f"controller.{key}", 0.0))
    return law


def _substeps(sweep: Sweep, table: ParameterTable, base: NDArray[Any], places: dict[str, list[int]]) -> int:
    """Integration steps in a period of the controller that every rollout can do with."""
    most, parts = 1, sum(map(len, paces(sweep.model.plant)))
    for part in range(parts):
        hardest = np.array(base, dtype=float)
        for axis in sweep.design.axes:
            if axis.name in places:
                # Each number makes a part faster or slower whatever the others are.
                tried = [hardest.copy() for _ in range(2)]
                for row, value in zip(tried, (axis.low, axis.high), strict=True):
                    row[places[axis.name]] = value
                plants = [table.unravel(jnp.asarray(row)) for row in tried]
                pace = [[*decided, *explicit][part] for decided, explicit in map(paces, plants)]
                hardest = tried[int(np.argmax(pace))]
        most = max(most, substeps(table.unravel(jnp.asarray(hardest)), sweep.controller.period))
    return most


def _memory(sweep: Sweep, table: ParameterTable, base: NDArray[Any], places: dict[str, list[int]]) -> int:
    """Periods that the longest delay of any rollout reaches back."""
    longest = np.array(base, dtype=float)
    for axis in sweep.design.axes:
        if axis.name in places and ".delay" in axis.name:
            longest[places[axis.name]] = axis.high
        elif axis.name in places and axis.name.startswith("clock_scale"):
            # By the slowest clock a delay lasts the most periods.
            longest[places[axis.name]] = axis.low
    return periods_remembered(table.unravel(jnp.asarray(longest)), sweep.controller.period)
