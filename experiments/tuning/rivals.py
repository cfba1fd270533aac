"""What the tuned controllers are compared with: an LQR's design, and a population method."""

from collections.abc import Callable

import cma
import control
import numpy as np

import jbridge

LENGTH = 0.45
"""Rope length of the design [m]: the middle of the paper's moves."""
_STATES = np.array([0.01, np.radians(1.0), 0.01, 0.1, np.radians(5.0), 0.1])
_VOLTS = np.array([1.0, 3.0])
"""What weighs as much in each state and input."""


def lqr_gains(plant: jbridge.Plant, period: float) -> Callable[[np.ndarray], np.ndarray]:
    """A function from logarithms of eight weights (six states, two inputs) to gains `(2, 6)`."""
    a, b, _ = jbridge.linear_model(plant, LENGTH, period)

    def gains(weights: np.ndarray) -> np.ndarray:
        q = np.diag(np.exp(weights[:6]) / _STATES**2)
        r = np.diag(np.exp(weights[6:8]) / _VOLTS**2)
        return np.asarray(control.dlqr(a, b, q, r)[0])

    return gains


def population(
    cost: Callable[[np.ndarray], float],
    begin: np.ndarray,
    spread: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    evaluations: int,
    seed: int,
    tell: Callable[[str], None],
) -> tuple[np.ndarray, np.ndarray]:
    """CMA-ES from a given point with a spread for each coordinate: the best point, and the best cost so far."""
    options = {
        "bounds": list(bounds), "CMA_stds": spread, "maxfevals": evaluations, "seed": seed + 1, "verbose": -9,
    }  # fmt: skip
    search = cma.CMAEvolutionStrategy(begin, 1.0, options)
    best, point = [cost(begin)], begin
    while not search.stop():
        points = [np.asarray(asked) for asked in search.ask()]
        # A rollout that runs away is the worst of all.
        values = [value if np.isfinite(value) else 1e6 for value in map(cost, points)]
        search.tell(points, values)
        for asked, value in zip(points, values, strict=True):
            point = asked if value < best[-1] else point
            best.append(min(best[-1], value))
        if search.countiter % 10 == 0:
            tell(f"CMA-ES, {search.countevals} of {evaluations} evaluations: {best[-1]:.4g}")
    return point, np.array(best)
