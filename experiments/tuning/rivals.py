"""What the tuned controllers are compared with: an LQR's design, and a population method."""

from collections.abc import Callable

import cma
import control
import jax
import jax.numpy as jnp
import numpy as np

from jbridge import Axes
from jbridge.inputs import Lane
from jbridge.model.plant import Plant
from jbridge.rollout import advance, start, timetable

LENGTH = 0.45
"""Rope length of the design [m]: the middle of the paper's moves."""
_LINEAR = ("actuator_lag",)
"""Effects that a linear design keeps; friction and dead zone are compensated for."""


def lqr_gains(plant: Plant, period: float) -> Callable[[np.ndarray], np.ndarray]:
    """A function from logarithms of eight weights (six states, two inputs) to gains `(2, 6)`.

    The model is linearised, as the controller sees it, over one period of sampling about the load hanging still.
    """
    linear = Plant(plant.bridge, tuple(e for e in plant.effects if e.kind in _LINEAR and e.site != "hoist_drive"))
    bias = -float(plant.bridge.load_mass * plant.bridge.gravity / plant.bridge.hoist_gain)
    one = jnp.ones(())
    moving = Axes(one, one, one)

    def after(state: jax.Array, volts: jax.Array) -> jax.Array:
        motions = start(linear, state, jnp.zeros(2), moving)
        lane = Lane(
            jnp.zeros(()), jnp.asarray([period]), (volts + jnp.asarray([0.0, bias]))[None], jnp.zeros(0), moving
        )
        told, _ = timetable(linear, lane, 4)
        interval = jax.tree.map(lambda leaf: leaf[0], told)
        end = advance(linear, motions, interval, moving)
        return jnp.stack([*end.q.axes, *end.v.axes])

    rest = jnp.asarray([0.0, 0.0, LENGTH, 0.0, 0.0, 0.0])
    a, b = (np.asarray(m) for m in jax.jit(jax.jacfwd(after, (0, 1)))(rest, jnp.zeros(2)))
    scale = np.array([0.01, np.radians(1.0), 0.01, 0.1, np.radians(5.0), 0.1])
    volts = np.array([1.0, 3.0])

    def gains(weights: np.ndarray) -> np.ndarray:
        q = np.diag(np.exp(weights[:6]) / scale**2)
        r = np.diag(np.exp(weights[6:8]) / volts**2)
        return np.asarray(control.dlqr(a, b, q, r)[0])

    return gains


def population(
    cost: Callable[[np.ndarray], float],
    low: np.ndarray,
    high: np.ndarray,
    evaluations: int,
    seed: int,
    tell: Callable[[str], None],
) -> tuple[np.ndarray, np.ndarray]:
    """CMA-ES from the middle of nothing changed (0, or the middle of the bounds), and the best cost so far."""
    begin = np.where((low < 0) & (high > 0), 0.0, 0.5 * (low + high))
    options = {"bounds": [low, high], "maxfevals": evaluations, "seed": seed + 1, "verbose": -9}
    search = cma.CMAEvolutionStrategy(begin, 0.5, options)
    best: list[float] = []
    while not search.stop():
        points = search.ask()
        values = [cost(np.asarray(point)) for point in points]
        # A rollout that runs away is the worst of all.
        search.tell(points, [value if np.isfinite(value) else 1e6 for value in values])
        best += [min([*best[-1:], *(v for v in values[: i + 1] if np.isfinite(v))]) for i in range(len(values))]
        if search.countiter % 10 == 0:
            tell(f"CMA-ES, {search.countevals} of {evaluations} evaluations: {best[-1]:.4g}")
    return np.asarray(search.result.xbest), np.array(best)
