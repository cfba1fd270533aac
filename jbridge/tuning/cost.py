"""What a controller costs on a course of bridges and moves, with its gradient, and how it does there in the end."""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from ..control.base import AbstractController
from ..control.compensation import LIMITS, limits_of
from ..simulation.move_summary import UNITS, MoveSummary, late_from
from .ensemble import Course, Moves
from .objectives import Goal
from .tunable_parameters import AbstractKnobs, as_arrays

_ABREAST = 64
"""Rollouts that run abreast on one core: few enough that their states stay in its cache, measured."""


class Blocks:
    """The bridges and moves of a course in blocks that run abreast, one on each core."""

    def __init__(self, course: Course):
        rows = np.repeat(course.rows, len(course.legs), axis=0)
        moves = jax.tree.map(lambda leaf: np.asarray(leaf).reshape(len(rows), *leaf.shape[2:]), course.moves)
        self.count = len(rows)
        """Rollouts of one evaluation, bridge by bridge."""
        size = min(_ABREAST, -(-self.count // _threads()))
        # All of one size, so that one program serves them; what is too much repeats the last rollout.
        takes = [np.minimum(np.arange(at, at + size), self.count - 1) for at in range(0, self.count, size)]
        self._blocks = [
            (jnp.asarray(rows[take]), jax.tree.map(lambda leaf, take=take: jnp.asarray(leaf[take]), moves))
            for take in takes
        ]
        self._compiled: set[tuple[int, Any]] = set()

    def each(self, program: Any, *given: Any) -> Any:
        """What a program gives for every rollout, as arrays with a leading axis of rollouts.

        Args:
            program: compiled; takes what is given, and a block's parameters and moves.
            given: the same for all.
        """

        def one(block: tuple[Array, Moves]) -> Any:
            return jax.block_until_ready(program(*given, *block))

        key = id(program), jax.tree.structure(given)
        begun = 0 if key in self._compiled else 1
        found = [one(block) for block in self._blocks[:begun]]  # alone: the others find it compiled
        self._compiled.add(key)
        with ThreadPoolExecutor(_threads()) as pool:
            found += pool.map(one, self._blocks[begun:])
        return jax.tree.map(lambda *parts: np.concatenate(parts)[: self.count], *found)


class Cost:
    """Mean of a goal over all bridges and moves of a course, as a function of a controller's free coordinates.

    Gradients come from one backward pass through each rollout.
    """

    def __init__(self, course: Course, goal: Goal, knobs: AbstractKnobs | None = None):
        """
        Args:
            course: the bridges and moves.
            goal: what is to be small.
            knobs: the free coordinates; without any, whole controllers are judged by `of`.
        """
        self.course = course
        self._knobs = knobs
        self._blocks = Blocks(course)
        self.count = self._blocks.count
        """Rollouts of one evaluation."""

        def one(law: AbstractController, row: Array, move: Moves, reverse: bool = False) -> Array:
            response = course.run(law, row, move, reverse=reverse)
            # A goal weighs volts of the paper's drives: commands in another unit count by their share of the limits.
            command = response.command * (jnp.asarray(LIMITS) / limits_of(law))[None]
            return goal(response._replace(command=command), move.leg)

        def smooth(z: Array, softness: Array, row: Array, move: Moves) -> Array:
            return one(self._set(z, softness), row, move, reverse=True)

        self._one = jax.jit(jax.vmap(one, in_axes=(None, 0, 0)))
        self._gradient = jax.jit(jax.vmap(jax.value_and_grad(smooth), in_axes=(None, None, 0, 0)))

    def _set(self, z: Array | NDArray[np.float64], softness: Array | float | None = None) -> AbstractController:
        if self._knobs is None:
            raise ValueError("this cost has no free coordinates; give it knobs")
        return self._knobs.set(jnp.asarray(z), softness)

    def of(self, law: AbstractController) -> float:
        """The cost of a controller of the same structure."""
        return float(np.mean(self._blocks.each(self._one, as_arrays(law))))

    def hard(self, z: NDArray[np.float64]) -> float:
        """The cost of the controller with the textbook's inference."""
        return self.of(self._set(z))

    def smooth(self, z: NDArray[np.float64], softness: float) -> float:
        """The cost of the smooth controller."""
        return self.of(self._set(z, softness))

    def gradients(self, z: NDArray[np.float64], softness: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The smooth cost of every rollout, `(rollout,)`, and its gradient, `(rollout, knob)`."""
        values, slopes = self._blocks.each(self._gradient, jnp.asarray(z), jnp.asarray(float(softness)))
        return values, slopes


class Measure:
    """How controllers do on a course, in the end; its program serves all of the same structure."""

    def __init__(self, course: Course):
        def one(law: AbstractController, row: Float[Array, " parameter"], move: Moves) -> dict[str, Array]:
            leg, period = move.leg, jnp.asarray(course.period)
            end = period * (course.count - 1)
            limits = limits_of(law)
            summary = MoveSummary(leg.goal, leg.goal - leg.start, late_from(leg.arrival, end), period, limits)
            return course.run(law, row, move, collect=summary)

        self._blocks = Blocks(course)
        self._shape = len(course.rows), len(course.legs)
        self._program = jax.jit(jax.vmap(one, in_axes=(None, 0, 0)))

    def __call__(self, law: AbstractController) -> Mapping[str, NDArray[np.float64]]:
        """Numbers of every bridge and move, by name: `(bridge, move)`, units as in `move_summary.UNITS`.

        Times of settling are nan where the position does not settle.
        """
        found = self._blocks.each(self._program, as_arrays(law))
        return {name: found[name].reshape(self._shape) for name in UNITS}


def measure(course: Course, law: AbstractController) -> Mapping[str, NDArray[np.float64]]:
    """What `Measure` gives, for one controller."""
    return Measure(course)(law)


def _threads() -> int:
    return os.cpu_count() or 1
