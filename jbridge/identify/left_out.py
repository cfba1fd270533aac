"""What recordings left out in turn would say of a fit, from the normal equations at hand."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..model.parameters import ParameterTable
from .lanes import Batch
from .neighbours import differences, ties
from .solve import bounded_step, reduce


def cross_validated(
    products: NDArray[np.float64],
    count: int,
    columns: int,
    initial: NDArray[np.float64],
    batch: Batch,
    groups: NDArray[np.int64],
    smooth: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> float:
    """Cost of each recording under the parameters that the others give, from one Gauss-Newton step.

    At an optimum, leaving a recording out moves the parameters by a small step, which the Gram matrices at hand give
    without a further simulation. What is known beforehand (`smoothness`) goes in with the others, so that knots of a
    map to which none of them goes follow their neighbours.
    """
    prior, pull = smooth
    reduced = reduce(products, count, columns, initial, batch.initial, batch.prior)
    total = 0.0
    among = np.unique(groups[groups >= 0])
    if len(among) < 2:
        return float(products[groups >= 0, -1, -1].sum())  # nothing is left to learn from
    for r in among:
        inside = groups == r
        matrix = reduced.by_lane[~inside].sum(axis=0) + prior
        gradient = reduced.gradient_by_lane[~inside].sum(axis=0) + pull
        # Of knots that no recording passes only what is known beforehand says anything.
        scale = np.sqrt(np.maximum(np.diag(reduced.matrix + prior), 1e-300))
        scaled = matrix / np.outer(scale, scale)
        step = -np.linalg.solve(scaled + 1e-7 * np.eye(count), gradient / scale) / scale if count else np.zeros(0)
        own = products[inside, -1, -1].sum()
        change = 2 * reduced.gradient_by_lane[inside].sum(0) @ step + step @ reduced.by_lane[inside].sum(0) @ step
        # A step that leaves the region where the model is linear says only that the parameter is not determined.
        total += own + float(np.clip(change, -0.5 * own, 3.0 * own))
    return total


def smoothness(
    table: ParameterTable, vector: NDArray[np.float64], free: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What is known beforehand of the free numbers: neighbours in a map differ about as much as they do in this one.

    Returns:
        Precision `(free, free)`, and its gradient where the numbers are now, `(free,)`.
    """
    precision = np.zeros((len(free), len(free)))
    for members in table.vectors(free):
        matrix, levels = differences(len(members)), vector[free[members]]
        scale = float(levels @ matrix @ levels) / max(len(members) - 1, 1)
        precision[np.ix_(members, members)] = matrix / max(scale, 1e-300)
    return precision, precision @ vector[free]


def folds(batch: Batch) -> NDArray[np.int64]:
    """Recordings to leave out in turn; the lanes themselves where there is only one recording."""
    return batch.recording if batch.recording.max() > 0 else np.where(batch.recording < 0, -1, np.arange(batch.count))


def several(batch: Batch) -> bool:
    """Whether there is more than one part to leave out in turn."""
    return len(np.unique(folds(batch)[batch.recording >= 0])) > 1


def costs_left_out(
    table: ParameterTable,
    vector: NDArray[np.float64],
    free: NDArray[np.int64],
    products: NDArray[np.float64],
    columns: int,
    initial: NDArray[np.float64],
    batch: Batch,
    strengths: Sequence[float],
) -> dict[float, float]:
    """Cost of each recording under the parameters that the others give with ties of each strength, all added up.

    Unlike `cross_validated` it believes the linear model however far the step goes. Levels of friction act linearly as
    long as the motion does not change much, and with a model that leaves much more than noise it is the levels which
    the others do not know that matter.

    Args:
        table: of the model.
        vector: its parameters, `(parameter,)`.
        free: places of those that are estimated, levels of maps among them.
        products: Gram matrices of the fit by lane.
        columns: columns of its program.
        initial: initial states, `(lane, state)`.
        batch: the lanes, of several recordings.
        strengths: of the ties between neighbouring levels, see `solve`.
    """
    reduced = reduce(products, len(free), columns, initial, batch.initial, batch.prior)
    low, high = (bound[free] for bound in table.bounds())
    groups = folds(batch)
    out = {}
    for strength in strengths:
        prior = ties(table, free, products, strength)
        diagonal = reduced.diagonal + np.diag(prior)
        total = 0.0
        for r in np.unique(groups[groups >= 0]):
            inside = groups == r
            matrix = reduced.by_lane[~inside].sum(axis=0) + prior
            gradient = reduced.gradient_by_lane[~inside].sum(axis=0) + prior @ vector[free]
            others = dataclasses.replace(reduced, matrix=matrix, gradient=gradient, diagonal=diagonal)
            step = bounded_step(others, vector[free], low, high, 0.0)
            change = 2 * reduced.gradient_by_lane[inside].sum(0) @ step + step @ reduced.by_lane[inside].sum(0) @ step
            total += float(products[inside, -1, -1].sum() + change)
        out[strength] = total
    return out
