"""What is known of the levels of a map beforehand: neighbours are alike.

The penalty on differences is that of P-splines (Eilers and Marx, Statistical Science 11, 1996), here on the values at
the knots of a piecewise linear curve.
"""

import numpy as np
from numpy.typing import NDArray

from ..model.parameters import ParameterTable

LOOSE = 1e-6
"""Strength of ties that counts for nothing at places which were visited; one that was not takes the level of those
beside it, where otherwise it would cost nothing wherever it is put, and a step that is meant for others would carry it
along."""


def ties(
    table: ParameterTable, free: NDArray[np.int64], products: NDArray[np.float64], strength: float
) -> NDArray[np.float64]:
    """Precision `(free, free)` of the differences between neighbours in each vector of levels.

    Args:
        table: of the model.
        free: places of the parameters that are estimated.
        products: Gram matrices by lane, those of the free parameters first.
        strength: over what the recordings say about the level that they tell most of.
    """
    information = np.einsum("lii->i", products[:, : len(free), : len(free)])
    precision = np.zeros((len(free), len(free)))
    for members in table.vectors(free):
        most = float(information[members].max())
        precision[np.ix_(members, members)] = strength * most * differences(len(members))
    return precision


def differences(count: int) -> NDArray[np.float64]:
    """Matrix `D` of the sum of squares `v' D v` of the differences between neighbours in a vector."""
    step = np.diff(np.eye(count), axis=0)
    return step.T @ step
