"""The rivals' library: what of the catalogue can be written as a column of one axis' balance.

Where a law has a number that is not linear (a delay, a knot, a period), it comes in variants, one for each
value of a grid. Backlash, belts, elastic ropes, double pendulums and counts that were missed have no column.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from balance import Balance, Column, Run


@dataclass(frozen=True)
class Term:
    """A candidate: one group of columns under the label of an effect."""

    label: str
    variants: tuple[Column, ...]
    positive: bool = False
    """Whether the first column's coefficient must be positive: friction brakes, a delay is late."""


def hats(q: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Piecewise linear shares of the knots."""
    return np.array([np.interp(q, knots, row) for row in np.eye(len(knots))])


def dry(run: Run, axis: str) -> np.ndarray:
    return -np.sign(run.v[axis])


def _range(balance: Balance, axis: str) -> np.ndarray:
    return np.concatenate([run.q[axis][rows] for run, rows in zip(balance.runs, balance.rows, strict=True)])


def frictions(balance: Balance) -> Iterator[Term]:
    """Laws of the cart's or the hoist's own coordinate and velocity."""
    axis, site = balance.axis, balance.site
    places = _range(balance, axis)
    knots = np.linspace(*np.quantile(places, (0.01, 0.99)), 6)
    if f"coulomb_friction {site}" not in balance.effects:
        yield Term(f"coulomb_friction {site}", (partial(dry, axis=axis),), positive=True)

    def stribeck(speed: float) -> Column:
        return lambda run: dry(run, axis) * np.exp(-((run.v[axis] / speed) ** 2))

    def by_place(run: Run) -> np.ndarray:
        return hats(run.q[axis], knots)[1:] * dry(run, axis)

    def by_both(run: Run) -> np.ndarray:
        shares, v = hats(run.q[axis], knots), run.v[axis]
        return np.concatenate([-shares[1:] * (v > 0), shares * (v < 0)])

    yield Term(f"stribeck_friction {site}", tuple(map(stribeck, (0.02, 0.035, 0.05, 0.08, 0.12))), positive=True)
    yield Term(f"position_dependent_friction {site}", (by_place,))
    yield Term(f"position_direction_friction {site}", (by_both,))
    yield Term(f"quadratic_drag {site}", (lambda run: dry(run, axis) * run.v[axis] ** 2,), positive=True)
    # While sliding, a constant force is friction that differs by direction; only the cart has the former.
    name = "constant_force" if axis == "x" else "direction_dependent_friction"
    yield Term(f"{name} {site}", (lambda run: np.ones_like(run.t),))


def cart_forces(balance: Balance) -> Iterator[Term]:
    places = _range(balance, "x")
    low, high = np.quantile(places, (0.01, 0.99))

    def wave(turns: float) -> Column:
        return lambda run: np.array([f(2 * np.pi * turns * run.q["x"]) for f in (np.sin, np.cos)])

    def stop(place: float, way: float) -> Column:
        def column(run: Run) -> np.ndarray:
            depth = np.maximum(way * (run.q["x"] - place), 0.0)
            return np.array([-way * depth, -run.v["x"] * (depth > 0)])

        return column

    yield Term("friction_drift cart", (lambda run: run.t * dry(run, "x"),))
    yield Term("spring_force cart", (lambda run: np.array([-run.q["x"], np.ones_like(run.t)]),), positive=True)
    # Two waves are told apart that differ by a third of a turn over the rail.
    yield Term("periodic_force cart", tuple(map(wave, np.arange(3.0, 20.0, 0.33 / max(high - low, 0.1)))))
    ends = (0.8, 0.85, 0.9, 0.94, 0.97)
    stops = [stop(float(np.quantile(places, share)), 1.0) for share in ends]
    stops += [stop(float(np.quantile(places, 1.0 - share)), -1.0) for share in ends]
    yield Term("end_stop cart", tuple(stops), positive=True)


def drives(balance: Balance) -> Iterator[Term]:
    """Laws of the voltage; each column is what the law adds to the voltage that acts."""
    axis, site, drive = balance.axis, f"{balance.site}_drive", balance.drive
    acting, numbers = balance.acting, list(balance.start)
    largest = max(np.abs(run.u[axis]).max() for run in balance.runs)

    def late(delay: float) -> Column:
        return lambda run: drive.acting(run, numbers, late=delay) - acting(run)

    def limited(limit: float) -> Column:
        return lambda run: drive.acting(run, numbers, limit=limit) - acting(run)

    def lag(time_constant: float) -> Column:
        def column(run: Run) -> np.ndarray:
            width = abs(numbers[0]) if drive.dead else 0.0
            u = run.u[axis] - np.clip(run.u[axis], -(abs(numbers[1]) if not drive.even else width), width)
            return drive.lagged(run, u, time_constant) - acting(run)

        return column

    def dead(width: float) -> Column:
        return lambda run: -run.acted(np.clip(run.u[axis], -width, width))

    delays = (*np.arange(0.001, 0.02, 0.001), *np.arange(0.02, 0.06, 0.003))
    yield Term(f"input_delay {site}", tuple(map(late, delays)), positive=True)
    yield Term(f"gain_asymmetry {site}", (lambda run: np.abs(acting(run)),))
    if axis == "x":
        yield Term(f"gain_drift {site}", (lambda run: run.t * acting(run),))
    yield Term(f"saturation {site}", tuple(map(limited, largest * np.arange(0.4, 0.95, 0.05))), positive=True)
    if not drive.dead:
        yield Term(f"dead_zone {site}", tuple(map(dead, largest * np.arange(0.02, 0.4, 0.02))), positive=True)
    if not drive.lag:
        yield Term(f"actuator_lag {site}", tuple(map(lag, np.geomspace(0.003, 0.12, 20))), positive=True)


def hoist_forces(balance: Balance) -> Iterator[Term]:
    middle = float(np.mean(_range(balance, "l")))
    yield Term("drum_radius_change hoist_drive", (lambda run: (run.q["l"] - middle) * balance.acting(run),))
    if any(np.ptp(run.q["psi"]) > 0 for run in balance.runs):
        # Without the rope's own acceleration: its noise is that of the balance and would be taken for a mass.
        yield Term("wrong_value load_mass", (lambda run: run.a["l"] - balance.of_load(run),))


def swing_forces(balance: Balance, wound: bool, driven: bool) -> Iterator[Term]:
    """Torques over load mass and rope length [m/s^2], and sensors as far as they enter like a torque."""
    cosine: Column = lambda run: np.cos(run.q["psi"])  # noqa: E731

    def drag(run: Run) -> np.ndarray:
        q, v = run.q, run.v
        sine, cos = np.sin(q["psi"]), np.cos(q["psi"])
        across = v["x"] + v["l"] * sine + q["l"] * v["psi"] * cos
        down = v["l"] * cos - q["l"] * v["psi"] * sine
        return -np.hypot(across, down) * (across * cos - down * sine)

    def stribeck(speed: float) -> Column:
        return lambda run: dry(run, "psi") * np.exp(-((run.v["psi"] / speed) ** 2)) / run.q["l"]

    def wind(start: float, stop: float) -> Column:
        return lambda run: cosine(run) * ((run.t >= start) & (run.t < stop))

    longest = max(run.t[-1] for run in balance.runs)
    spans = [(a, a + b) for a in np.arange(0.5, longest - 1, 0.25) for b in np.arange(1.0, 8.1, 0.5) if a + b < longest]
    if "coulomb_friction swing" not in balance.effects:
        yield Term("coulomb_friction swing", (lambda run: dry(run, "psi") / run.q["l"],), positive=True)
    yield Term("stribeck_friction swing", tuple(map(stribeck, (0.05, 0.1, 0.2, 0.4))), positive=True)
    yield Term("load_drag swing", (drag,), positive=True)
    yield Term("wind swing", tuple(wind(*span) for span in spans))
    yield Term("sensor_offset psi_sensor", (cosine,))
    if driven:
        yield Term("sensor_scale psi_sensor", (lambda run: run.a["x"] * cosine(run),))
        yield Term("sensor_delay psi_sensor", (lambda run: run.jerk["x"] * cosine(run),), positive=True)
        yield Term("sensor_delay x_sensor", (lambda run: -run.jerk["x"] * cosine(run),), positive=True)

    def turned(run: Run) -> np.ndarray:
        """Length times angular acceleration as the balance has it: measured, it brings the balance's own noise."""
        pull = balance.gravity * np.sin(run.q["psi"]) + run.a["x"] * cosine(run)
        return -pull - 2 * run.v["l"] * run.v["psi"]

    lengths = _range(balance, "l")
    middle = float(np.mean(lengths))
    if np.ptp(lengths) > 0:  # also where the rope is locked at another length in each recording
        yield Term("length_dependent_damping swing",
                   (lambda run: -(run.q["l"] - middle) * run.v["psi"] / run.q["l"],))  # fmt: skip
    if wound:
        yield Term("sensor_offset l_sensor", (lambda run: turned(run) / run.q["l"],))
        yield Term("sensor_scale l_sensor", (lambda run: turned(run) + 2 * run.v["l"] * run.v["psi"],))


LAWS: dict[str, tuple[Callable[[Balance], Iterator[Term]], ...]] = {
    "x": (frictions, cart_forces, drives),
    "l": (frictions, drives, hoist_forces),
}


def library(balance: Balance) -> list[Term]:
    """All candidates of an axis that its model does not have."""
    if balance.axis == "psi":
        wound = any(np.ptp(run.q["l"]) > 0 for run in balance.runs)
        terms = list(swing_forces(balance, wound, any(np.ptp(run.q["x"]) > 0 for run in balance.runs)))
    else:
        terms = [term for law in LAWS[balance.axis] for term in law(balance)]
    return [term for term in terms if term.label not in balance.effects]


def owned(balance: Balance) -> list[Column]:
    """Damping and Coulomb friction; the models of the concealed cases have nothing else beside their drives."""
    axis = balance.axis
    length = (lambda run: run.q["l"]) if axis == "psi" else (lambda run: 1.0)
    columns: list[Column] = [lambda run: -run.v[axis] / length(run)]
    if f"coulomb_friction {balance.site}" in balance.effects:
        columns.append(lambda run: dry(run, axis) / length(run))
    return columns
