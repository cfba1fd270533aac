"""Centroid defuzzification on a grid whose equal points are merged: their number and the sum of their places.

Where a set's degree is 0 its clipped form is 0 too, so a point needs only the sets that cover it. Points where the
same sets have the same degrees form one column, with their number and the sum of their places. For sets that overlap
only with their neighbours that is a fourth of the work of the plain grid, and the same to rounding. It takes sets whose
numbers are known while a program is traced.
"""

import functools
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .norms import AbstractNorm

_MOST = 256
"""Degrees in all columns above which the plain grid is better: a column is code of its own, and compiled."""


class Column(NamedTuple):
    """Points that are alike."""

    cover: tuple[tuple[int, float], ...]
    """The sets that cover them, and their degrees."""
    number: float
    """How many points there are."""
    lever: float
    """Sum of their distances from the grid's middle."""


def known(tree: Any) -> bool:
    """Whether all numbers of a tree are known while a program is traced."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def columns(shapes: Sequence[Any], grid: Any) -> list[Column] | None:
    """The columns of known shapes over a known grid, or None if there are too many.

    Args:
        shapes: of every set, its degrees at the points.
        grid: the points.
    """
    degrees, places = np.stack([np.asarray(shape) for shape in shapes]), np.asarray(grid, float)
    away = places - 0.5 * (places[0] + places[-1])
    # Mirrored points differ by rounding alone.
    keys = np.round(degrees.T / (8 * np.finfo(degrees.dtype).eps))
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    counts, levers = np.bincount(place.ravel()), np.bincount(place.ravel(), weights=away)
    covers = [tuple((int(k), float(degrees[k, at])) for k in np.flatnonzero(degrees[:, at])) for at in first]
    if sum(map(len, covers)) > _MOST:
        return None
    return [Column(*parts) for parts in zip(covers, counts.tolist(), levers.tolist(), strict=True) if parts[0]]


def nothing(weights: Sequence[Array]) -> Array:
    """0, unless a firing strength is no number: a choice among degrees may lose that, but not a sum that begins so."""
    return 0.0 * functools.reduce(operator.add, weights)


def area_and_moment(
    found: Sequence[Column], weights: Sequence[Array], implication: AbstractNorm, aggregation: AbstractNorm
) -> tuple[Array, Array]:
    """Sum of the degrees of the set that is put together, and of their moments about the grid's middle."""
    area = moment = nothing(weights)
    for column in found:
        parts = [implication.of_numbers(jnp.asarray(degree, area.dtype), weights[k]) for k, degree in column.cover]
        degree = functools.reduce(aggregation.of_numbers, parts)
        area, moment = area + column.number * degree, moment + column.lever * degree
    return area, moment


@eqx.filter_jit
def _evaluated(function: Any, arguments: Any) -> Any:
    return function(*arguments)


def evaluate(function: Any, *arguments: Any) -> Any:
    """A function of known arguments, computed now, also while a program is traced; its arrays are NumPy's."""
    with jax.ensure_compile_time_eval():
        return jax.tree.map(np.asarray, _evaluated(function, arguments))
