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
from ..summaries import UNITS, MoveSummary
from .ensemble import Course, Moves
from .knobs import AbstractKnobs, as_arrays
from .objectives import Goal, late_from

_ABREAST = 64
"""Rollouts that run abreast on one core: few enough that their states stay in its cache, measured."""


class Cost:
    """Mean of a goal over all bridges and moves of a course, as a function of a controller's free coordinates.

    Gradients come from one backward pass through each rollout; each period of the controller is computed anew there,
    so that memory holds one state per period.
    """

    def __init__(self, course: Course, knobs: AbstractKnobs, goal: Goal):
        self.course = course
        rows = np.repeat(course.rows, len(course.legs), axis=0)
        moves = jax.tree.map(lambda leaf: np.asarray(leaf).reshape(len(rows), *leaf.shape[2:]), course.moves)
        self.count = len(rows)
        """Rollouts of one evaluation."""
        size = min(_ABREAST, -(-self.count // _threads()))
        cuts = [slice(at, at + size) for at in range(0, self.count, size)]
        self._blocks = [
            (jnp.asarray(rows[cut]), jax.tree.map(lambda leaf, cut=cut: jnp.asarray(leaf[cut]), moves)) for cut in cuts
        ]

        self._knobs = knobs
        self._compiled: set[int] = set()

        def one(law: AbstractController, row: Array, move: Moves) -> Array:
            return goal(course.run(law, row, move, keep=False), move.leg)

        def smooth(z: Array, softness: Array, row: Array, move: Moves) -> Array:
            return one(knobs.set(z, softness), row, move)

        self._one = jax.jit(jax.vmap(one, in_axes=(None, 0, 0)))
        self._gradient = jax.jit(jax.vmap(jax.value_and_grad(smooth), in_axes=(None, None, 0, 0)))

    def of(self, law: AbstractController) -> float:
        """The cost of a controller of the same structure."""
        return float(np.mean(np.concatenate(self._each(self._one, as_arrays(law)))))

    def hard(self, z: NDArray[np.float64]) -> float:
        """The cost of the controller with the textbook's inference."""
        return self.of(self._knobs.set(jnp.asarray(z)))

    def smooth(self, z: NDArray[np.float64], softness: float) -> float:
        """The cost of the smooth controller."""
        return self.of(self._knobs.set(jnp.asarray(z), softness))

    def gradients(self, z: NDArray[np.float64], softness: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The smooth cost of every rollout, `(rollout,)`, and its gradient, `(rollout, knob)`."""
        found = self._each(self._gradient, jnp.asarray(z), jnp.asarray(float(softness)))
        values, slopes = zip(*found, strict=True)
        return np.concatenate(values), np.concatenate(slopes)

    def _each(self, program: Any, *given: Any) -> list[Any]:
        def one(block: tuple[Array, Moves]) -> Any:
            return jax.block_until_ready(program(*given, *block))

        begun = 0 if id(program) in self._compiled else 1
        found = [one(block) for block in self._blocks[:begun]]  # alone: the others find it compiled
        self._compiled.add(id(program))
        with ThreadPoolExecutor(_threads()) as pool:
            return [*found, *pool.map(one, self._blocks[begun:])]


def measure(course: Course, law: AbstractController) -> Mapping[str, NDArray[np.float64]]:
    """Numbers of every bridge and move under a controller, by name: `(bridge, move)`, units as in `summaries.UNITS`.

    Times of settling are nan where the position does not settle.
    """

    def one(law: AbstractController, row: Float[Array, " parameter"], move: Moves) -> dict[str, Array]:
        leg, period = move.leg, jnp.asarray(course.period)
        end = period * (course.count - 1)
        summary = MoveSummary(leg.goal, leg.goal - leg.start, late_from(leg.arrival, end), period)
        return course.run(law, row, move, collect=summary)

    over_moves = jax.vmap(one, in_axes=(None, None, 0))
    program = jax.jit(jax.vmap(over_moves, in_axes=(None, 0, 0)))
    found = program(law, jnp.asarray(course.rows), course.moves)
    return {name: np.asarray(found[name]) for name in UNITS}


def _threads() -> int:
    return os.cpu_count() or 1
