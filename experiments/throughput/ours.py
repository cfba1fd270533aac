"""The problem in jbridge: batches as one compiled function, run in blocks that fit a core's cache."""

import contextlib
import dataclasses
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jbridge
from problem import MODES, Bare, Given

ABREAST = 64
"""Bridges that run abreast on one core."""
REPEATS = 5


class Last(jbridge.AbstractSummary):
    """The latest positions."""

    def start(self, sample):
        return jnp.zeros(3, sample.q.x.dtype)

    def update(self, numbers, sample):
        return jnp.stack([sample.q.x, sample.q.psi, sample.q.l])

    def finish(self, numbers):
        return numbers


class Squares(jbridge.AbstractSummary):
    """Mean square of tracking errors [m^2] and swing [rad^2]: a cost that has a gradient."""

    def start(self, sample):
        return jnp.zeros(2, sample.q.x.dtype)

    def update(self, numbers, sample):
        away = (sample.q.x - sample.reference.x) ** 2 + (sample.q.l - sample.reference.l) ** 2 + sample.q.psi**2
        return numbers + jnp.stack([away, jnp.ones_like(away)])

    def finish(self, numbers):
        return numbers[0] / numbers[1]


def precise(precision: str) -> contextlib.AbstractContextManager[Any]:
    """Double precision or not; it holds for one thread."""
    return jax.enable_x64(precision == "float64")


def law(dtype: Any, softness: float | None = None) -> Any:
    """The paper's controllers in some precision."""
    controller = dataclasses.replace(jbridge.paper_controller(), softness=softness)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), controller)


def lane(mode: str, given: Given, model: Any, *, collect: Any = None, reverse: bool = False) -> Callable:
    """One bridge, from its load, its friction level, its start and (closed loop) its controller."""
    period, substeps = MODES[mode]
    collect = Last() if collect is None else collect

    def one(load_mass, friction, start, controller):
        plant = jbridge.with_values(model.plant, {"load_mass": load_mass, "coulomb_friction@cart.level": friction})
        initial = jnp.concatenate([start, jnp.zeros(3, start.dtype)])
        table = jnp.asarray(given.table, start.dtype)
        options = {"period": period, "substeps": substeps, "collect": collect, "reverse": reverse}
        if mode == "open":
            return jbridge.play(plant, initial, table, **options)
        still = jnp.zeros(len(table), start.dtype)
        reference = jbridge.Reference(table[:, 0], table[:, 1], still, still)
        return jbridge.closed_loop(plant, controller, initial, reference, **options)

    return one


def forward(mode: str, given: Given, model: Any, dtype: Any, softness: float | None = None) -> Callable:
    """A batch of bridges; the controller's numbers are known when it is compiled."""
    one, controller = lane(mode, given, model), law(dtype, softness)
    return jax.jit(jax.vmap(lambda load_mass, friction, start: one(load_mass, friction, start, controller)))


def cost(given: Given, model: Any, *, reverse: bool = False) -> Callable:
    """Mean cost of a batch under a controller whose numbers are arguments."""
    one = lane("closed", given, model, collect=Squares(), reverse=reverse)

    def mean(controller, load_mass, friction, starts):
        return jnp.mean(jax.vmap(one, in_axes=(0, 0, 0, None))(load_mass, friction, starts, controller))

    return mean


def lanes_of(given: Given, precision: str) -> list[np.ndarray]:
    """What `forward` takes."""
    return [np.asarray(a, precision) for a in (given.rows[:, 1], given.rows[:, 9], given.starts)]


def timed(run: Callable, numbers: list[np.ndarray], precision: str) -> tuple[float, float, np.ndarray]:
    """Seconds of the first call, seconds of a later one (the best), and what a batch returns."""
    lanes = len(numbers[0])
    # On a core, as many bridges abreast as its cache holds; on another device, all of them.
    pieces = -(-lanes // ABREAST) if jax.devices()[0].platform == "cpu" else 1
    with precise(precision):
        parts = list(zip(*(map(jnp.asarray, np.array_split(a, pieces)) for a in numbers), strict=True))
        begun = time.perf_counter()
        jax.block_until_ready(run(*parts[0]))
        first = time.perf_counter() - begun
    best = np.inf

    def one(part: tuple) -> Any:
        with precise(precision):
            return jax.block_until_ready(run(*part))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for _ in range(REPEATS):
            begun = time.perf_counter()
            found = list(pool.map(one, parts))
            best = min(best, time.perf_counter() - begun)
    return first, best, np.concatenate([np.asarray(part) for part in found])


def bare_forward(given: Bare) -> Callable:
    """Final positions of bare bridges, one step after the last force."""
    bridge = jbridge.Bridge(**given.numbers)
    forces = np.concatenate([given.forces, given.forces[-1:]])

    def one(start):
        initial = jnp.concatenate([start, jnp.zeros(3)])
        return jbridge.play(
            jbridge.Plant(bridge), initial, jnp.asarray(forces), period=MODES["open"][0], substeps=1, collect=Last()
        )

    return jax.jit(jax.vmap(one))


def bare_gradient(given: Bare) -> Callable[[], Any]:
    """The gradient of the final positions' squares by the forces."""
    bridge, starts = jbridge.Bridge(**given.numbers), jnp.asarray(given.starts)

    def total(forces):
        def one(start):
            initial, period = jnp.concatenate([start, jnp.zeros(3)]), MODES["open"][0]
            options = {"period": period, "substeps": 1, "collect": Last(), "reverse": True}
            return jbridge.play(jbridge.Plant(bridge), initial, forces, **options)

        return jnp.sum(jax.vmap(one)(starts) ** 2)

    run, forces = jax.jit(jax.grad(total)), jnp.asarray(np.concatenate([given.forces, given.forces[-1:]]))
    return lambda: jax.block_until_ready(run(forces))
