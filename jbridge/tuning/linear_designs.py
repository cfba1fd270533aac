"""Linear laws to begin a tuning with: a PID, and LQR and LQG by a linearisation about the hanging equilibrium."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from .._types import Axes
from ..control.compensation import LIMITS, Compensation
from ..control.files import PERIOD, Controller
from ..control.linear import ObserverFeedback, Pid, StateFeedback
from ..model.files import Model, requires
from ..model.plant import Plant
from ..simulation.inputs import Lane
from ..simulation.rollout import timetable
from ..simulation.runge_kutta import RK4, advance
from ..simulation.state import start

_SUBSTEPS = 16
_SLOW = 1e-6
"""Speed at which the bridge counts as still and yet moves [m/s, rad/s]."""

LENGTH = 0.45
"""Length of the rope for which an LQR is designed where nothing else is said [m]: the middle of the paper's moves."""
_STATES = (0.01, np.radians(1.0), 0.01, 0.1, np.radians(5.0), 0.1)
_VOLTS = (1.0, 3.0)
"""Deviations of states [m, rad, m, m/s, rad/s, m/s] and voltages [V] that weigh alike in an LQR's design; of drives
with other limits than the paper's, the same shares of those."""
_UNFORESEEN = (0.01, np.radians(1.0), 0.01)
"""What disturbs velocities from one sample to the next [m/s, rad/s, m/s], in a Kalman filter's design: friction that
differs from what is compensated by 3 N does to the cart. At half of it the estimate follows the model more."""
_READ = (1e-4, np.radians(0.05), 1e-4)
"""Errors of encoder readings there [m, rad, m]: about a count of 0.1 mm, half a count of 4096 a turn."""


def linear_model(
    plant: Plant, length: float, period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The bridge alone, without its effects, about the load hanging still: `s' = A s + B (u - rest)`.

    Args:
        plant: whose bridge.
        length: of the rope [m].
        period: from one sample to the next, over which the voltages are held [s].

    Returns:
        `A` `(6, 6)` and `B` `(6, 2)` of the state `x, psi, l` and their velocities, and the voltages `rest` at which it
        stays.
    """
    bridge = Plant(plant.bridge)
    numbers = plant.bridge
    rest = np.array([0.0, -float(numbers.load_mass * numbers.gravity / numbers.hoist_gain)])
    one = jnp.ones(())
    moving = Axes(one, one, one)

    def after(state: jax.Array, volts: jax.Array) -> jax.Array:
        motions = start(bridge, state, jnp.zeros(2), moving)
        lane = Lane(jnp.zeros(()), jnp.asarray([period]), volts[None], jnp.zeros(0), moving)
        told, _ = timetable(bridge, lane, _SUBSTEPS)
        end = advance(bridge, motions, jax.tree.map(lambda leaf: leaf[0], told), moving, method=RK4)
        return jnp.stack([*end.q.axes, *end.v.axes])

    # Exactly at rest nothing moves, with friction or without, and nothing has a slope.
    still = jnp.full(6, _SLOW).at[:3].set(jnp.asarray([0.0, 0.0, length]))
    a, b = jax.jit(jax.jacfwd(after, (0, 1)))(still, jnp.asarray(rest))
    return np.asarray(a), np.asarray(b), rest


def pid_for(compensation: Compensation) -> Pid:
    """The usual PID controller, with gains in proportion to the drives' limits."""
    usual, (cart, hoist) = Pid(compensation=compensation), (compensation.limits / jnp.asarray(LIMITS)).tolist()
    gains = {name: getattr(usual, name) * (cart if name.startswith("cart") else hoist) for name in Pid.tunable}
    return dataclasses.replace(usual, **gains)


def lqr_controller(
    model: Model, compensation: Compensation | None = None, length: float = LENGTH, period: float = PERIOD
) -> Controller:
    """The linear-quadratic regulator of the bridge between two samples (Kwakernaak and Sivan 1972, section 6.4).

    It minimises the sum of squared deviations from the working point, each in parts of what weighs alike: 1 cm, 1
    degree, 1 cm, 10 cm/s, 5 degrees/s, 10 cm/s; 1 V of the cart, 3 V of the hoist. Velocities are
    those of `Differences`.

    Args:
        model: with all three axes.
        compensation: of what friction and dead zones take; `compensation_for` has a model's.
        length: of the rope at the working point [m].
        period: of sampling [s].

    Raises:
        InputError: the model lacks a part of the bridge.
    """
    requires(model, ("x", "psi", "l"))
    a, b, _ = linear_model(model.plant, length, period)
    given = compensation or Compensation()
    return Controller(StateFeedback(_regulator(a, b, given), compensation=given), period)


def lqg_controller(
    model: Model, compensation: Compensation | None = None, length: float = LENGTH, period: float = PERIOD
) -> Controller:
    """The same regulator on the state that a Kalman filter estimates (Kwakernaak and Sivan 1972, section 6.6).

    The filter foresees the bridge's motion from the voltages. From one sample to the next, what it does not foresee
    changes velocities by 1 cm/s, 1 degree/s and 1 cm/s; encoders err by 0.1 mm, 0.05 degrees and 0.1 mm.

    Args:
        model, compensation, length, period: as for `lqr_controller`.

    Raises:
        InputError: the model lacks a part of the bridge.
    """
    requires(model, ("x", "psi", "l"))
    a, b, _ = linear_model(model.plant, length, period)
    c = np.eye(3, 6)
    unforeseen, read = (np.diag(np.square(sizes)) for sizes in ((0.0, 0.0, 0.0, *_UNFORESEEN), _READ))
    p = solve_discrete_are(a.T, c.T, unforeseen, read)
    correction = p @ c.T @ np.linalg.inv(c @ p @ c.T + read)
    given = compensation or Compensation()
    law = ObserverFeedback(_regulator(a, b, given), jnp.asarray(a), jnp.asarray(b), jnp.asarray(correction), given)
    return Controller(law, period)


def _regulator(a: NDArray[np.float64], b: NDArray[np.float64], compensation: Compensation) -> jax.Array:
    """Gains `(2, 6)` of the linear-quadratic regulator."""
    commands = np.multiply(_VOLTS, np.asarray(compensation.limits) / LIMITS)
    q, r = (np.diag(1.0 / np.square(sizes)) for sizes in (_STATES, commands))
    p = solve_discrete_are(a, b, q, r)
    gains = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    # Cart and hoist are not coupled at rest; what rounding leaves there is no gain.
    gains[np.abs(gains) < 1e-9 * np.abs(gains).max()] = 0.0
    return jnp.asarray(gains)
