"""Coulomb friction on every axis of the bridge with its events located: a slow, exact oracle in NumPy and SciPy.

Each axis either slides, with friction at its level against the motion, or sticks, with its acceleration zero and
friction whatever that takes. An axis that comes to rest sticks if its level suffices; one that sticks breaks away
when it no longer does. Nothing of the package is used.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.integrate import solve_ivp

ROUNDING = 1e-11
"""What an event overshoots by [m/s, rad/s; N, N m], so that a phase does not end at the instant at which it begins."""


class StickSlip:
    """A bridge with viscous damping and Coulomb friction.

    Args:
        bridge: masses [kg], `gravity` [m/s^2], dampings and gains, as in a model file.
        levels: friction against positive and against negative motion of each axis, `(3, 2)` [N, N m, N].
        active: which axes move.
    """

    def __init__(
        self, bridge: Mapping[str, float], levels: Sequence[Sequence[float]], active: Sequence[float] = (1, 1, 1)
    ):
        self.bridge, self.levels = bridge, np.asarray(levels, dtype=float)
        self.active = np.asarray(active, dtype=bool)
        self.sticky = self.active & (np.max(self.levels, axis=1) > 0)

    def mass_and_force(self, q: np.ndarray, v: np.ndarray, volts: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """The mass matrix, and everything else but friction [N, N m, N]; the paper's, corrected."""
        b = self.bridge
        m1, m2, je, g = b["cart_mass"], b["load_mass"], b["winch_mass"], b["gravity"]
        s, c, l = np.sin(q[1]), np.cos(q[1]), q[2]
        if not (self.active[1] or self.active[2]):
            m2 = 0.0
        mass = np.array([[m1 + m2, m2 * l * c, m2 * s], [m2 * l * c, m2 * l * l, 0.0], [m2 * s, 0.0, m2 + je]])
        force = np.array(
            [
                b["cart_gain"] * volts[0]
                - b["cart_damping"] * v[0]
                - 2 * m2 * v[2] * v[1] * c
                + m2 * l * v[1] ** 2 * s,
                -b["swing_damping"] * v[1] - 2 * m2 * l * v[2] * v[1] - m2 * g * l * s,
                b["hoist_gain"] * volts[1] - b["hoist_damping"] * v[2] + m2 * l * v[1] ** 2 + m2 * g * c,
            ]
        )
        return mass, force

    def motion(
        self, q: np.ndarray, v: np.ndarray, volts: Sequence[float], mode: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations, and the friction that holds each axis that sticks (mode 0); mode is the sign of a slide."""
        mass, force = self.mass_and_force(q, v, volts)
        slides = (mode != 0) & self.active
        friction = np.where(mode > 0, -self.levels[:, 0], np.where(mode < 0, self.levels[:, 1], 0.0))
        a = np.zeros(3)
        where = np.ix_(slides, slides)
        a[slides] = np.linalg.solve(mass[where], (force + friction)[slides])
        friction = np.where(slides, friction, mass @ a - force)
        return a, np.where(self.active, friction, 0.0)

    def mode_at(self, q: np.ndarray, v: np.ndarray, volts: Sequence[float], loosened: Sequence[int] = ()) -> np.ndarray:
        """Which axes slide, and where to: those at rest break away one after the other until the rest holds.

        Args:
            q, v: positions and velocities.
            volts: inputs.
            loosened: axes whose friction has just reached its level.
        """
        resting = np.where(self.sticky, np.sign(v), 1.0)
        mode = resting.copy()
        for axis in loosened:
            mode[axis] = -np.sign(self.motion(q, v, volts, resting)[1][axis])
        for _ in range(3):
            friction = self.motion(q, v, volts, mode)[1]
            excess = np.maximum(friction - self.levels[:, 1], -friction - self.levels[:, 0])
            worst = int(np.argmax(np.where((mode == 0) & self.sticky, excess, -np.inf)))
            if mode[worst] or excess[worst] <= 0 or not self.sticky[worst]:
                break
            mode[worst] = -np.sign(friction[worst])
        return mode

    def trajectory(
        self, state: Sequence[float], pieces: Sequence[tuple[float, Sequence[float]]], times: np.ndarray
    ) -> np.ndarray:
        """Positions and velocities at the times, one row each.

        Args:
            state: x, psi, l and their rates at time 0.
            pieces: durations [s] with the inputs `(u_x, u_l)` held over them.
            times: wanted [s], within the pieces.
        """
        y, now, rows = np.array(state, dtype=float), 0.0, {}
        sticky = np.flatnonzero(self.sticky)
        for duration, volts in pieces:
            end, loosened, phases = now + duration, [], 0
            while now < end - 1e-12:
                phases += 1
                assert phases < 200, "the events pile up"
                mode = self.mode_at(y[:3], y[3:], volts, loosened)
                found = solve_ivp(
                    lambda _, y, mode=mode, volts=volts: np.concatenate(
                        [y[3:], self.motion(y[:3], y[3:], volts, mode)[0]]
                    ),
                    (now, end),
                    y,
                    method="DOP853",
                    rtol=1e-10,
                    atol=1e-12,
                    dense_output=True,
                    events=[self.event(i, volts, mode) for i in sticky],
                )
                for k in np.flatnonzero((times >= now) & (times <= found.t[-1] + 1e-12)):
                    rows[k] = found.sol(times[k])
                y, now = found.y[:, -1].copy(), found.t[-1]
                happened = [i for i, when in zip(sticky, found.t_events, strict=True) if len(when)]
                loosened = [i for i in happened if not mode[i]]
                y[3:][[i for i in sticky if not mode[i] or i in happened]] = 0.0
        return np.array([rows[k] for k in range(len(times))])

    def event(self, i: int, volts: Sequence[float], mode: np.ndarray):
        """Zero where axis `i` comes to rest, or where its friction no longer holds it."""

        def comes_to_rest(t, y):
            return y[3 + i] * mode[i] + ROUNDING

        def breaks_away(t, y):
            friction = self.motion(y[:3], y[3:], volts, mode)[1][i]
            return min(self.levels[i, 1] - friction, self.levels[i, 0] + friction) + ROUNDING

        event = comes_to_rest if mode[i] else breaks_away
        event.terminal, event.direction = True, -1
        return event
