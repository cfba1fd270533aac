"""Speed loops over a whole step: against SciPy's stiff solver, in the limit of a stiff loop, at their force limit."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jbridge.model.effects.motors import UNLIMITED
from jbridge.model.parameters import ParameterTable
from jbridge.model.speed_loop import shares
from jbridge.model.step_size import substeps
from jbridge.simulation.runge_kutta import MIDPOINT
from tests.model.effects.test_gradients import START, check_forward, check_reverse, programs
from tests.problems import (
    LOCKED_ROPE,
    NUMBERS,
    PERIOD,
    lively_inputs,
    make_lane,
    make_plant,
    make_state,
    paths,
    simulate,
)

COUNT = 200
U = lively_inputs(COUNT, hold=25)
LANE = make_lane(U, active=LOCKED_ROPE)
LENGTH = 0.7
DRIVE = ("speed_drive", "cart_drive")
SPEED = 0.3
"""Speed per volt that the loops hold [m/s]."""


def moved(values: dict, rate: float, *others: tuple, kind=DRIVE, steps=1) -> np.ndarray:
    """Cart position and swing angle `(sample, 2)` of a cart with a load on a locked rope."""
    plant = make_plant((*kind, values), *others, cart_damping=rate, cart_gain=SPEED * rate)
    return paths(simulate(plant, make_state(l=LENGTH), LANE, substeps=steps, method=MIDPOINT))[0][:, :2]


def by_scipy(rate: float, lag: float, limit: float, share: float = 1.0) -> np.ndarray:
    """The same by an implicit solver of order 5 with error control, with the equations written out."""
    m1, m2, g, r = (NUMBERS[key] for key in ("cart_mass", "load_mass", "gravity", "swing_damping"))

    def slope(t, y, u):
        _, psi, v, w, s = y
        force = np.clip(SPEED * rate * s - share * rate * v, -limit, limit) - (1.0 - share) * rate * v
        sine, cosine = np.sin(psi), np.cos(psi)
        mass = np.array([[m1 + m2, m2 * LENGTH * cosine], [m2 * LENGTH * cosine, m2 * LENGTH**2]])
        right = [force + m2 * LENGTH * w * w * sine, -m2 * g * LENGTH * sine - r * w]
        return [v, w, *np.linalg.solve(mass, right), (u - s) / lag]

    y, found = np.array([0.3, 0.0, 0.0, 0.0, 0.0]), [[0.3, 0.0]]
    for k in range(0, COUNT, 25):
        at = PERIOD * np.arange(1, 26)
        run = solve_ivp(slope, (0.0, at[-1]), y, "Radau", at, args=(U[k, 0],), rtol=1e-8, atol=1e-10)
        y = run.y[:, -1]
        found += run.y[:2].T.tolist()
    return np.array(found)


@pytest.mark.parametrize("rate, lag", [(45.0, 0.05), (2e5, 0.05)])
def test_against_a_stiff_solver(rate, lag):
    """At the rigid bridge's steps of 5 ms, where the stiffer loop takes its speed in 30 microseconds."""
    apart = np.abs(moved({"time_constant": lag}, rate) - by_scipy(rate, lag, UNLIMITED)).max(axis=0)
    # Errors of order 2 in the step, a hundredth of what an encoder of 0.1 mm and 0.1 degrees sees.
    assert apart[0] < 1e-6 and apart[1] < 1e-5


@pytest.mark.parametrize("rate, lag, limit, share", [(2e5, 0.05, 12.0, 1.0), (300.0, 0.03, 8.0, 0.9)])
def test_a_limit_against_a_stiff_solver(rate, lag, limit, share):
    expected = by_scipy(rate, lag, limit, share)
    unlimited = np.abs(by_scipy(rate, lag, UNLIMITED, share) - expected).max(axis=0)
    for steps in (1, 4):
        ours = moved({"time_constant": lag, "limit": limit, "share": share}, rate, steps=steps)
        # A step from one limit to the other errs in speed by 2 limit h / m, over the time that the limit lasts then.
        most = 2.0 * limit * PERIOD / steps / NUMBERS["cart_mass"] * 40 * PERIOD
        apart = np.abs(ours - expected).max(axis=0)
        assert apart[0] < most < 0.1 * unlimited[0]
        assert apart[1] < most / LENGTH


def test_a_loop_needs_no_shorter_steps():
    stiff = {"cart_damping": 2e5, "cart_gain": 6e4}
    assert substeps(make_plant((*DRIVE, {"share": 1.0}), **stiff), PERIOD) == 1 < substeps(make_plant(**stiff), PERIOD)


def test_without_a_limit_it_is_a_lag_beside_damping():
    lag = {"time_constant": 0.05}
    theirs = moved(lag, 45.0, kind=("actuator_lag", "cart_drive"))
    np.testing.assert_allclose(moved(lag | {"share": 0.0}, 45.0), theirs, rtol=0, atol=1e-12)
    # The loop's own step is exact for damping where the midpoint rule is of order 2, so that both differ by that.
    fine = moved(lag, 45.0, kind=("actuator_lag", "cart_drive"), steps=8)
    np.testing.assert_allclose(moved(lag | {"share": 1.0}, 45.0, steps=8), fine, rtol=0, atol=1e-6)


def test_friction_holds_what_the_limit_does_not_move():
    """A stiff loop moves a cart as soon as its limit exceeds the friction, and else not at all."""
    rubs = ("coulomb_friction", "cart", {"level": 5.0})
    holding = moved({"limit": 4.9, "share": 1.0}, 2e5, rubs)
    np.testing.assert_allclose(holding[:, 0], 0.3, rtol=0, atol=1e-9)
    sliding = moved({"limit": 40.0, "share": 1.0}, 2e5, rubs)
    wanted = 0.3 + SPEED * PERIOD * np.concatenate([[0.0], np.cumsum(U[:, 0])])
    # What the limit takes of each of seven reversals: at most m (dv)^2 / (2 (limit - friction)).
    assert np.abs(sliding[:, 0] - wanted).max() < 7 * 5.7 * (2 * SPEED * 3.0) ** 2 / (2 * 35.0)
    free = moved({"share": 1.0}, 2e5, rubs)
    np.testing.assert_allclose(free[:, 0], wanted, rtol=0, atol=2e-4)


@pytest.mark.slow
def test_derivatives():
    plant = make_plant(
        (*DRIVE, {"time_constant": 0.03, "limit": 25.0, "share": 0.8}),
        ("speed_drive", "hoist_drive", {"time_constant": 0.02, "limit": 40.0, "share": 1.0}),
        ("coulomb_friction", "cart", {"level": 1.0}),
        hoist_damping=200.0,
    )
    table = ParameterTable(plant)
    names = [
        "cart_gain",
        "cart_damping",
        "hoist_damping",
        *(f"{DRIVE[0]}@{DRIVE[1]}.{k}" for k in ("time_constant", "limit")),
    ]
    places = [table.positions(name)[0] for name in [*names, "speed_drive@hoist_drive.time_constant"]]
    of, vector, start = programs(table), jnp.asarray(table.ravel(plant)), make_state(*START[:3], rates=START[3:])
    check_reverse(of, vector, start, check_forward(of, vector, start, places))


def test_shares_of_a_step():
    """By quadrature of `exp(-(1 - s) z) s^(k-1)/(k-1)!` over s from 0 to 1."""
    z = np.array([0.0, 1e-9, 1e-3, 0.199, 0.201, 1.0, 30.0])
    found = jax.vmap(shares)(jnp.asarray(z))
    s, weight = (0.5 * x for x in np.polynomial.legendre.leggauss(60))
    s = s + 0.5
    for k, own in enumerate(found, 1):
        expected = np.exp(-np.outer(z, 1 - s)) * s ** (k - 1) / math.factorial(k - 1) @ weight
        np.testing.assert_allclose(own, expected, rtol=1e-12)
    np.testing.assert_allclose(shares(jnp.asarray(1e6)), (1e-6, 1e-6, 0.5e-6), rtol=2e-6)
