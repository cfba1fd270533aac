"""Force balances for the rivals: recordings smoothed into rows of one linear equation per axis.

A balance says: what the masses need = the drive, damping and dry friction that the model has, each with a
coefficient that is refitted, so that wrong numbers are not taken for missing physics. Known masses, gravity
and the geometry of the rope are used as they are. All columns pass the same filter as the measurements.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from jbridge import Model, Recording

EQUATION = {"x": "cart", "psi": "swing", "l": "hoist"}
CRAWL = {"x": 0.015, "l": 0.01}
"""Speed below which an axis with dry friction may be at rest [m/s]."""
Column = Callable[["Run"], np.ndarray]
"""A row for each sample; several columns stand side by side."""


@dataclass(frozen=True)
class Filter:
    """How rows are made; times in seconds."""

    smooth: float
    """Half width of the kernel that smooths and differentiates the measurements."""
    bump: dict[str, float]
    """By axis, half width of the test function that rows are weighed with; 0 takes the rows as they are."""
    step: float
    """From one row to the next."""

    def apart(self, axis: str) -> float:
        """Time between rows that do not share a measurement's noise [s]: what counts as one sample."""
        return max(self.smooth, self.bump[axis], self.step)


def kernel(half: float, period: float, derivative: int = 0) -> np.ndarray:
    """Weights of a bump (1 - s^2)^4 or of its derivatives, exact for polynomials up to their order."""
    n = max(round(half / period), derivative + 1)
    t = np.arange(-n, n + 1) * period
    bump = np.polynomial.Polynomial([1, 0, -1]) ** 4
    weights = bump.deriv(derivative)(t / ((n + 1) * period)) if derivative else bump(t / ((n + 1) * period))
    if derivative == 2:  # sampled, a kernel's lower moments are not quite 0
        weights = weights - weights.mean()
    elif derivative == 3:
        weights = weights - t * (weights @ t) / (t @ t)
    moment = np.sum(weights * t**derivative) / (1, 1, 2, 6)[derivative]
    return weights / moment


def averaged(signal: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted mean around each row; rows near the ends are not to be used."""
    return np.correlate(np.pad(signal, len(weights) // 2, mode="edge"), weights, "valid")


@dataclass
class Run:
    """One recording, smoothed: coordinates, velocities, accelerations and jerks by axis name."""

    t: np.ndarray
    u: dict[str, np.ndarray]
    period: float
    smooth: np.ndarray
    q: dict[str, np.ndarray] = field(default_factory=dict)
    v: dict[str, np.ndarray] = field(default_factory=dict)
    a: dict[str, np.ndarray] = field(default_factory=dict)
    jerk: dict[str, np.ndarray] = field(default_factory=dict)
    load: np.ndarray | None = None
    """Acceleration of the load relative to the cart, along the rail [m/s^2]."""

    def acted(self, volts: np.ndarray) -> np.ndarray:
        """A voltage held from row to row, filtered as the coordinates are; between two rows acts their mean."""
        return averaged(0.5 * (volts + np.concatenate([volts[:1], volts[:-1]])), self.smooth)


def run_of(recording: Recording, filter: Filter) -> Run:
    dt = recording.period
    u = {"x": recording.u_x, "l": recording.u_l}
    run = Run(recording.times - recording.start + recording.begun, {k: v for k, v in u.items() if v is not None},
              dt, kernel(filter.smooth, dt))  # fmt: skip
    rows = np.ones_like(recording.times)
    rope = recording.l if recording.has_hoist else rows * (recording.locked_length or 1.0)
    read = {"x": 0 * rows if recording.x is None else recording.x, "l": rope}
    read["psi"] = 0 * rows if recording.psi is None else recording.psi
    weights = [kernel(filter.smooth, dt, k) for k in range(4)]
    for name, signal in read.items():
        into = (run.q, run.v, run.a, run.jerk)
        for k, table in enumerate(into):
            table[name] = averaged(signal, weights[k])
    run.load = averaged(read["l"] * np.sin(read["psi"]), weights[2])
    return run


@dataclass
class Drive:
    """What is known of an axis' drive: the nonlinear numbers are found beside the coefficients."""

    axis: str
    dead: bool = False
    even: bool = True
    lag: bool = False

    def acting(self, run: Run, numbers: Sequence[float], late: float = 0.0, limit: float = np.inf) -> np.ndarray:
        """The voltage behind delay [s], saturation, dead zone and lag, filtered."""
        numbers = list(numbers)
        rows, part = divmod(late / run.period, 1.0)
        u = np.clip(run.u[self.axis], -limit, limit)
        if late:  # held values that come late by part of a period act in shares
            u = np.concatenate([np.zeros(int(rows) + 1), u])
            u = ((1.0 - part) * u[1:] + part * u[:-1])[: len(run.t)]
        if self.dead:
            low = high = abs(numbers.pop(0))
            if not self.even:
                low = abs(numbers.pop(0))
            u = u - np.clip(u, -low, high)
        return self.lagged(run, u, abs(numbers.pop(0))) if self.lag else run.acted(u)

    def lagged(self, run: Run, u: np.ndarray, time_constant: float) -> np.ndarray:
        """A first-order lag, exact for held inputs."""
        keep = np.exp(-run.period / max(time_constant, 1e-5))
        return averaged(lfilter([0.0, 1.0 - keep], [1.0, -keep], u), run.smooth)


class Balance:
    """Rows of one axis' equation over all recordings.

    Args:
        axis: "x", "psi" or "l".
        model: of its plant, structure and known masses are used; other numbers only to begin with.
        runs: smoothed recordings.
        filter: that made them.
    """

    def __init__(self, axis: str, model: Model, runs: list[Run], filter: Filter):
        self.axis, self.runs, self.filter = axis, runs, filter
        self.site = EQUATION[axis]
        self.bridge = {k: float(getattr(model.plant.bridge, k)) for k in ("cart_mass", "load_mass", "winch_mass")}
        self.gravity = float(model.plant.bridge.gravity)
        self.effects = {f"{e.kind} {e.site}": e for e in model.plant.effects}
        dead = self.effects.get(f"dead_zone {self.site}_drive")
        lag = self.effects.get(f"actuator_lag {self.site}_drive")
        self.start: list[float] = []
        even = dead is None or float(dead.positive) == float(dead.negative)
        if dead is not None:
            self.start += [float(dead.positive)] + ([] if even else [float(dead.negative)])
        if lag is not None:
            self.start += [float(lag.time_constant)]
        self.drive = Drive(axis, dead is not None, even, lag is not None) if axis != "psi" else None
        self.rows = [self._rows(run) for run in runs]
        self.needed = self.column(self._needed)[:, 0]
        self.samples = len(self.needed) * filter.step / filter.apart(axis)

    def _rows(self, run: Run) -> np.ndarray:
        """Rows that can be used: not near an end, not at rest, not reversing where dry friction acts."""
        reach = round((self.filter.smooth + self.filter.bump[self.axis]) / run.period) + 1
        good = np.ones(len(run.t), bool)
        if self.axis in CRAWL:
            near = np.ones(2 * reach + 1)
            slow = [np.convolve(way * run.v[self.axis] < CRAWL[self.axis], near, "same") for way in (1, -1)]
            good = np.minimum(*slow) < 0.5
        good[:reach] = good[-reach:] = False
        index = np.arange(0, len(run.t), max(round(self.filter.step / run.period), 1))
        return index[good[index]]

    def column(self, made: Column) -> np.ndarray:
        """A term's columns at the chosen rows of all runs, weighed with the test function."""
        half = self.filter.bump[self.axis]
        parts = []
        for run, rows in zip(self.runs, self.rows, strict=True):
            columns = np.atleast_2d(made(run))
            if half:
                weights = kernel(half, run.period)
                columns = np.array([averaged(c, weights) for c in columns])
            parts.append(columns[:, rows].T)
        return np.concatenate(parts)

    def _needed(self, run: Run) -> np.ndarray:
        """Force that the masses need [N]; for the swing over load and rope length [m/s^2]."""
        q, v, a, m2 = run.q, run.v, run.a, self.bridge["load_mass"]
        sine, cosine = np.sin(q["psi"]), np.cos(q["psi"])
        if self.axis == "x":
            swings = any(np.ptp(r.q["psi"]) > 0 for r in self.runs)
            mass = self.bridge["cart_mass"] + (m2 if swings else 0.0)
            return mass * a["x"] + (m2 * run.load if swings else 0.0)
        if self.axis == "psi":
            return q["l"] * a["psi"] + 2 * v["l"] * v["psi"] + cosine * a["x"] + self.gravity * sine
        return self.bridge["winch_mass"] * a["l"] + m2 * self.of_load(run)

    def of_load(self, run: Run) -> np.ndarray:
        """Acceleration that the load needs along the rope [m/s^2]."""
        q, v, a = run.q, run.v, run.a
        sine, cosine = np.sin(q["psi"]), np.cos(q["psi"])
        return a["l"] + sine * a["x"] - q["l"] * v["psi"] ** 2 - self.gravity * cosine

    def acting(self, run: Run) -> np.ndarray:
        """The drive's filtered voltage with the numbers found last."""
        return self.drive.acting(run, self.start)

    def refit(self, owned: np.ndarray, chosen: Sequence[np.ndarray] = ()) -> np.ndarray:
        """Finds dead zone and lag beside other columns; returns the base columns at the best numbers.

        Args:
            owned: columns of what the model has besides the drive.
            chosen: columns of effects that were selected; they are not returned.

        The last of them are the derivatives by these numbers: candidates compete with a shifted dead zone or lag.
        """
        if self.drive is None:
            return owned

        def columns(numbers: Sequence[float]) -> np.ndarray:
            return np.column_stack([self.column(lambda run: self.drive.acting(run, numbers)), owned])

        if self.start:
            scale = np.maximum(np.abs(self.start), 1e-3)
            size = np.linalg.norm(self.needed)

            def residual(z: np.ndarray) -> np.ndarray:
                return project(np.column_stack([columns(z * scale), *chosen]), self.needed) / size

            best = least_squares(residual, np.array(self.start) / scale, diff_step=1e-3, max_nfev=12, bounds=(0, 10))
            self.start = list(best.x * scale)
        base = columns(self.start)
        slopes = []
        for i, value in enumerate(self.start):
            away = 1e-2 * max(abs(value), 1e-2)
            moved = [*self.start[:i], value + away, *self.start[i + 1 :]]
            slopes.append((columns(moved)[:, 0] - base[:, 0]) / away)
        return np.column_stack([base, *slopes])


def basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span the same; what is dependent on the others is left out."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    u, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, sizes > 1e-8 * sizes[0]]


def project(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    """What a regression on `columns` leaves of `target`, itself one column or several."""
    span = basis(columns)
    return target - span @ (span.T @ target)
