"""Dry friction in motion: stuck is stuck, sliding is exactly Coulomb, and events come when they should."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jbridge.model.dry_friction import Rows, friction
from jbridge.model.effects.catalogue import make_effect
from jbridge.simulation.runge_kutta import MIDPOINT, RK4
from tests.model.stick_slip import StickSlip
from tests.problems import (
    CART_ALONE,
    EVERY_AXIS,
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

MASS, GAIN = NUMBERS["cart_mass"], NUMBERS["cart_gain"]
COULOMB_ON_EVERY_AXIS = [
    ("coulomb_friction", "cart", {"level": 3.5}),
    ("coulomb_friction", "swing", {"level": 0.004}),
    ("coulomb_friction", "hoist", {"level": 3.0}),
]
"""The winch's friction exceeds the load's weight of 1.4 N."""


def held(volts: float, seconds: float) -> np.ndarray:
    """The cart's drive at a voltage, the hoist's at 0, for some time."""
    return np.tile([volts, 0.0], (round(seconds / PERIOD), 1))


def cart(
    *effects, u: np.ndarray, v: float = 0.0, substeps: int = 1, start: float = 0.0, **changes: float
) -> np.ndarray:
    """Position [m] and velocity [m/s] of a cart alone without viscous damping, one row per sample."""
    plant = make_plant(*effects, cart_damping=0.0, **changes)
    lane = make_lane(u, active=CART_ALONE, start=start)
    places, rates = paths(simulate(plant, make_state(0.0, rates=(v, 0.0, 0.0)), lane, substeps=substeps))
    return np.stack([places[:, 0], rates[:, 0]], axis=1)


def test_axes_without_friction_have_none():
    """Whatever their levels say; the others resist what moves them."""
    one, zero = jnp.asarray(1.0), jnp.asarray(0.0)
    inverse_masses = [[one if i == j else zero for j in range(3)] for i in range(3)]
    rows = Rows([one, one, -one], inverse_masses, [one, one, -one], [2.0 * one] * 3, [3.0 * one] * 3)
    found = friction(rows, [True, False, True], jnp.asarray(0.01), jnp.asarray(True))
    np.testing.assert_allclose(np.array(found), [-2.0, 0.0, 3.0])


@pytest.mark.parametrize("method", [RK4, MIDPOINT], ids=["RK4", "MIDPOINT"])
@pytest.mark.parametrize(
    "volts", [(0.0, 0.0), (0.15, 0.4), (-0.15, -0.9)], ids=["no drive", "paying out", "hauling up"]
)
def test_stuck_is_stuck(volts, method):
    """Cart and winch hold against drives below their levels, gravity and the pull of a swinging load."""
    plant = make_plant(*COULOMB_ON_EVERY_AXIS[::2])
    q, _ = paths(simulate(plant, make_state(psi=0.4), make_lane(np.tile(volts, (1000, 1))), substeps=1, method=method))
    assert np.ptp(q[:, 1]) > 0.7, "the load does swing"
    assert np.ptp(q[:, 0]) < 1e-6 and np.ptp(q[:, 2]) < 1e-6


def test_a_pendulum_sticks_off_the_vertical():
    """Within `level/(m2 g l)` of the vertical a swing with dry friction comes to rest, and stays there."""
    plant = make_plant(*COULOMB_ON_EVERY_AXIS, swing_damping=0.01)
    q, v = paths(simulate(plant, make_state(psi=0.3), make_lane(np.zeros((5000, 2))), substeps=1))
    assert abs(q[-1, 1]) <= 0.004 / (0.143 * 9.81 * 0.7)
    assert np.ptp(q[-800:, 1]) < 1e-6 and abs(v[-1, 1]) < 1e-6


def test_cart_in_closed_form():
    """Constant drive, coasting to a stop, rest, and breaking away backwards."""
    level, drive, back = 4.0, 1.0, -0.5
    u = np.concatenate([held(drive, 0.5), held(0.0, 0.75), held(back, 0.75)])
    path = cart(("coulomb_friction", "cart", {"level": level}), u=u)
    t = np.arange(len(u) + 1) * PERIOD
    faster, slower, reverse = (GAIN * drive - level) / MASS, level / MASS, (GAIN * back + level) / MASS
    top = faster * 0.5
    stop = 0.5 + top / slower
    assert stop == pytest.approx(2.0), "the cart is still moving when the drive reverses"
    until_rest = top - slower * 0.75
    turn = 1.25 + until_rest / (slower - GAIN * back / MASS)
    v = np.select(
        [t <= 0.5, t <= 1.25, t <= turn],
        [faster * t, top - slower * (t - 0.5), until_rest - (slower - GAIN * back / MASS) * (t - 1.25)],
        reverse * (t - turn),
    )
    # Velocities are exact but for rounding, also across the step in which the cart turns round.
    np.testing.assert_allclose(path[:, 1], v, rtol=0, atol=1e-13)
    # Within the step of the turn the velocity is a broken line, the engine's a straight one: the area between them.
    most = (slower - GAIN * back / MASS + abs(reverse)) * PERIOD**2 / 8
    x = np.concatenate([[0.0], np.cumsum(np.diff(t) * (v[1:] + v[:-1]) / 2)])
    np.testing.assert_allclose(path[:, 0], x, rtol=0, atol=2 * most)


def test_time_to_stop_and_hold():
    """A cart that coasts needs `v/(level/m)` and `v^2/2/(level/m)`, and then stands."""
    slowing = 4.0 / MASS
    path = cart(("coulomb_friction", "cart", {"level": 4.0}), u=held(0.0, 1.0), v=0.4123)
    stop = 0.4123 / slowing
    k = int(np.ceil(stop / PERIOD))
    assert path[k - 1, 1] > 0 and np.all(np.abs(path[k:, 1]) < 1e-15)
    # Half a step at the last velocity is the most that the straight line within the last step adds.
    assert path[-1, 0] == pytest.approx(0.4123**2 / 2 / slowing, abs=slowing * PERIOD**2 / 2)
    assert np.ptp(path[k:, 0]) < 1e-15


def test_break_away_just_above_the_level():
    level = 4.0
    plain, loaded = ("coulomb_friction", {"level": level}), ("load_dependent_friction", {"level": 3.0, "share": 0.25})
    for share, moves in ((0.999, False), (1.001, True), (-0.999, False), (-1.001, True)):
        # Of 4 N that the drive gives a quarter rubs, and 3 N rub besides; of what it gives beyond, three quarters act.
        for (kind, values), left in ((plain, 1.0), (loaded, 0.75)):
            path = cart((kind, "cart", values), u=held(share * level / GAIN, 1.0))
            expected = left * np.sign(share) * (abs(share) - 1.0) * level / MASS if moves else 0.0
            np.testing.assert_allclose(path[-1], [expected / 2, expected], atol=1e-12)


CASES = {
    "rig": (NUMBERS, ((3.5, 3.5), (0.004, 0.004), (3.0, 3.0)), EVERY_AXIS, (0.3, 0.2, 0.7)),
    # The load's pull breaks the cart away, and the levels differ between the two directions.
    "heavy load": (
        NUMBERS | {"cart_mass": 0.8, "load_mass": 0.6, "cart_damping": 4.0, "cart_gain": 4.0, "hoist_gain": 8.0},
        ((1.5, 2.5), (0.01, 0.01), (9.0, 7.0)),
        EVERY_AXIS,
        (0.0, -0.8, 0.5),
    ),
    "locked rope": (
        NUMBERS | {"cart_mass": 0.8, "cart_damping": 2.0},
        ((1.0, 1.0), (0.0, 0.0), (0.0, 0.0)),
        LOCKED_ROPE,
        (0.0, 1.0, 0.7),
    ),
}


@pytest.mark.parametrize("method", [pytest.param(RK4, marks=pytest.mark.slow), MIDPOINT], ids=["RK4", "MIDPOINT"])
@pytest.mark.parametrize("case", CASES)
def test_against_located_events(case, method):
    """Stops, reversals and breakaways on all axes at once, driven and swinging, against an event-driven integration."""
    numbers, levels, active, place = CASES[case]
    u = lively_inputs(600, hold=40, seed=3) * [1.0, 4.0]
    times = np.arange(601) * PERIOD
    exact = StickSlip(numbers, levels, active).trajectory(
        [*place, 0, 0, 0], [(40 * PERIOD, row) for row in u[::40]], times
    )
    stuck = np.abs(exact[:, 3:]) < 1e-12
    assert np.sum(np.diff(stuck.astype(int), axis=0) != 0) + np.sum(np.diff(np.sign(exact[:, 3:]), axis=0) != 0) > 10

    frictions = [
        ("direction_dependent_friction", "cart", {"positive": levels[0][0], "negative": levels[0][1]}),
        ("coulomb_friction", "swing", {"level": levels[1][0]}),
        ("direction_dependent_friction", "hoist", {"positive": levels[2][0], "negative": levels[2][1]}),
    ]
    plant, lane = make_plant(*frictions, **numbers), make_lane(u, active=active)
    errors = []
    for substeps in (1, 8):
        q, _ = paths(simulate(plant, make_state(*place), lane, substeps=substeps, method=method))
        errors.append(np.max(np.abs(q - exact[:, :3]), axis=0))
    if case == "rig":
        # At the rig's sampling period the error stays near a count of the encoders.
        assert np.all(errors[0] < [1e-4, 1.5e-3, 2e-4])
    assert np.all(errors[1] < [1.5e-4, 1.5e-3, 2e-5])
    # Each event costs the square of the step: 64 for steps 8 times shorter, or less where the coarse ones had luck.
    assert np.all(errors[1] < errors[0] / 20 + 1e-9)


SLIDING = {
    # effect, its level [N] at (t, x, |v|), drive [V]
    "coulomb": (("coulomb_friction", "cart", {"level": 2.5}), lambda t, x, v: 2.5, 0.6),
    "stribeck": (
        ("stribeck_friction", "cart", {"level": 3.0, "breakaway": 5.0, "velocity": 0.08}),
        lambda t, x, v: 3.0 + 2.0 * np.exp(-((v / 0.08) ** 2)),
        0.35,
    ),
    "drift": (
        ("friction_drift", "cart", {"level": 2.0, "rate": 1.0}),
        lambda t, x, v: 2.0 + t,
        0.35,
    ),
    "by place": (
        ("position_dependent_friction", "cart", {"knots": [0.0, 0.05, 0.2], "levels": [1.0, 4.0, 2.0]}),
        lambda t, x, v: np.interp(x, [0.0, 0.05, 0.2], [1.0, 4.0, 2.0]),
        0.4,
    ),
    "by place and direction": (
        (
            "position_direction_friction",
            "cart",
            {"knots": [0.0, 0.05, 0.2], "positive": [1.0, 4.0, 2.0], "negative": [9.0, 9.0, 9.0]},
        ),
        lambda t, x, v: np.interp(x, [0.0, 0.05, 0.2], [1.0, 4.0, 2.0]),
        0.4,
    ),
}


@pytest.mark.parametrize("name", SLIDING)
def test_sliding_and_stopping(name):
    """A drive for half a second and a coast to rest, with a level that varies, against an integration to that event."""
    effect, level, volts = SLIDING[name]
    start = 1.0
    u = np.concatenate([held(volts, 0.5), held(0.0, 1.5)])
    path = cart(effect, u=u, start=start)
    times = start + np.arange(len(u) + 1) * PERIOD

    def rates(force):
        return lambda t, y: [y[1], (force - level(t, y[0], abs(y[1]))) / MASS]

    rest = lambda t, y: y[1]  # noqa: E731
    rest.terminal, rest.direction = True, -1
    told = dict(rtol=1e-10, atol=1e-12, dense_output=True, max_step=0.01)
    driven = solve_ivp(rates(GAIN * volts), (start, start + 0.5), [0.0, 0.0], **told)
    coast = solve_ivp(rates(0.0), (start + 0.5, start + 3.0), driven.y[:, -1], events=rest, **told)
    exact = np.where(times <= start + 0.5, driven.sol(times), coast.sol(np.minimum(times, coast.t[-1]))).T
    assert coast.t[-1] < times[-1] and exact[-1, 0] > 0.01
    # The kinks of the levels over place, time and speed, and the stop, cost the square of the step each.
    np.testing.assert_allclose(path, exact, rtol=0, atol=5e-5)


def test_levels_add():
    """Two frictions on one axis are one with the sum of their levels."""
    u = lively_inputs(200)
    both = cart(("coulomb_friction", "cart", {"level": 1.0}), ("friction_drift", "cart", {"level": 2.0}), u=u)
    np.testing.assert_allclose(both, cart(("coulomb_friction", "cart", {"level": 3.0}), u=u), rtol=0, atol=1e-14)


def test_constant_force_is_friction_by_direction():
    """A force c beside friction F is friction F - c forwards and F + c backwards, sliding and stuck."""
    u = lively_inputs(600, hold=40, seed=5) * 0.4
    u.reshape(15, 40, 2)[2::3] = 0.0
    pushed = cart(("coulomb_friction", "cart", {"level": 3.0}), ("constant_force", "cart", {"level": 0.7}), u=u)
    split = cart(("direction_dependent_friction", "cart", {"positive": 2.3, "negative": 3.7}), u=u)
    assert np.sum(np.abs(pushed[:, 1]) < 1e-12) > 20, "the cart sticks at times"
    np.testing.assert_allclose(pushed, split, rtol=0, atol=1e-12)


def test_stiction_breaks_away_at_its_own_level():
    """At rest the breakaway level holds; once in motion the sliding level is what is left."""
    effect = ("stribeck_friction", "cart", {"level": 3.0, "breakaway": 5.0, "velocity": 0.02})
    assert np.ptp(cart(effect, u=held(4.99 / GAIN, 1.0))[:, 0]) == 0.0
    assert cart(effect, u=held(5.2 / GAIN, 1.0))[-1, 1] > 0.2
    # The same drive keeps a cart going that already slides.
    assert cart(effect, u=held(4.0 / GAIN, 1.0), v=0.1)[-1, 1] > 0.2


SPRINGS = {
    # an effect, with the elastic stiffness, the place of rest, the level and the travel that it stands for
    "soft": (("presliding_friction", "cart", {"level": 3.0, "stiffness": 800.0}), (0.0, 0.0, 3.0, 3.0 / 800.0)),
    "stiff": (("presliding_friction", "cart", {"level": 3.0, "stiffness": 8000.0}), (0.0, 0.0, 3.0, 3.0 / 8000.0)),
    "cable": (
        ("cable_drag", "cart", {"stiffness": 4.0, "rest": 0.15, "level": 3.0, "travel": 0.01}),
        (4.0, 0.15, 3.0, 0.01),
    ),
}


@pytest.mark.parametrize("name", SPRINGS)
def test_hidden_springs_against_dahls_equations(name):
    """Reversals below and above the level: `m x'' = F - k (x - rest) - level z`, `travel z' = x' (1 - z sign x')`."""
    effect, (elastic, rest, level, travel) = SPRINGS[name]
    force = np.repeat([2.0, -2.0, 2.5, -1.0, 4.5, -6.0], 50)
    usual, fine = (cart(effect, u=np.stack([force / GAIN, 0 * force], axis=1), substeps=n)[:, 0] for n in (1, 4))

    exact, y = [[0.0, 0.0]], np.zeros(3)
    for push in force:
        piece = solve_ivp(
            lambda t, y, push=push: [
                y[1],
                (push - elastic * (y[0] - rest) - level * y[2]) / MASS,
                y[1] / travel * (1 - y[2] * np.sign(y[1])),
            ],
            (0.0, PERIOD),
            y,
            rtol=1e-9,
            atol=1e-12,
            max_step=PERIOD / 20,
        )
        y = piece.y[:, -1]
        exact.append(y[:2])
    told = np.array(exact)[:, 0]
    # Below the level the cart is on a spring; what a step loses where the cart turns round would creep up.
    assert np.max(np.abs(told[:100])) < 6 * travel
    np.testing.assert_allclose(usual, told, rtol=0, atol=1e-6)
    np.testing.assert_allclose(fine, told, rtol=0, atol=1e-8)


def test_presliding_deflection_stays_within_one():
    """However far the cart moves in a step, the spring slips rather than stretches."""
    spring = make_effect("presliding_friction", "cart", {"level": 2.0, "stiffness": 1e4})
    z = jnp.asarray(0.0)
    for v in np.random.default_rng(0).normal(0, 3, 200):
        z = spring.deflection(z, jnp.asarray(0.005 * v))
        assert abs(z) <= 1.0
    # From -1 at a steady velocity, `1 - 2 exp(-stiffness/level x)`.
    reached = spring.deflection(jnp.asarray(-1.0), jnp.asarray(1e-4))
    np.testing.assert_allclose(reached, 1 - 2 * np.exp(-1e4 / 2.0 * 1e-4), rtol=1e-14)
