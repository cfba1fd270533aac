"""What is known of parameters before any recording tells of them: part of the criterion that fits minimise.

The bridge's masses in a model file are right to within a factor. Where recordings say how heavy something is, that
counts for next to nothing. Where they do not, as behind a drive that imposes its speed, whatever the mass, the guess
stands, and no mass runs away for the little that an infinite one gains.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..model.parameters import ParameterTable

_FACTOR = 3.0
"""By what factor a mass of a model file is off, as one standard deviation of its logarithm."""
_TIES = 1e-6
"""Strength of ties between neighbouring levels of a map over what the recordings say of the level that they tell most
of: nothing where a place was visited; one that was not takes the level of those beside it (P-splines, Eilers and Marx,
Statistical Science 11, 1996)."""


@dataclasses.dataclass(frozen=True)
class Prior:
    """Guesses of masses, that neighbours in a map are alike, and that what repeats does so within what was recorded."""

    masses: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Those of the bridge as the model file has them [kg], by name."""
    largest: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Periods [m, rad] and widths [input unit] above which recordings show no difference, by the parameter's name."""

    def bounds(self, table: ParameterTable) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper bounds of all parameters."""
        low, high = table.bounds()
        for name in self.largest.keys() & set(table.names()):
            high[table.positions(name)] = self.largest[name]
        return low, high

    def cost(self, table: ParameterTable, vector: NDArray[np.float64]) -> float:
        """What masses cost that are not as they were guessed [nat]."""
        return 0.5 * sum(self._away(name, vector[place]) ** 2 for name, place in self._places(table))

    def terms(
        self,
        table: ParameterTable,
        free: NDArray[np.int64],
        vector: NDArray[np.float64],
        information: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Precision and gradient that the normal equations of some parameters gain.

        Args:
            table: of the parameters.
            free: places of those parameters.
            vector: all parameters.
            information: diagonal of the normal equations.
        """
        precision = np.zeros((len(free), len(free)))
        for members in table.vectors(free):
            step = np.diff(np.eye(len(members)), axis=0)
            precision[np.ix_(members, members)] = _TIES * float(information[members].max()) * step.T @ step
        gradient = precision @ vector[free]
        column = {int(place): i for i, place in enumerate(free)}
        for name, place in self._places(table):
            if place in column:
                slope, i = 1.0 / (math.log(_FACTOR) * vector[place]), column[place]
                precision[i, i] += slope**2
                gradient[i] += slope * self._away(name, vector[place])
        return precision, gradient

    def _places(self, table: ParameterTable) -> list[tuple[str, int]]:
        return [(name, table.positions(name)[0]) for name in self.masses]

    def _away(self, name: str, value: float) -> float:
        """How far a mass is from its guess, in standard deviations."""
        return math.log(value / self.masses[name]) / math.log(_FACTOR)
