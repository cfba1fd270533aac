"""A rod beside the load against Euler-Lagrange, and against the period of a compound pendulum."""

import jax.numpy as jnp
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from jbridge.simulation.runge_kutta import RK4
from tests.model.lagrange import accelerations, coordinates, euler_lagrange, t
from tests.problems import (
    EVERY_AXIS,
    FIXED_CART,
    LOCKED_ROPE,
    NUMBERS,
    accelerate,
    axes,
    make_lane,
    make_plant,
    make_state,
    motion,
    simulate,
)

M1, M2, JE, G = sp.symbols("M1 M2 JE G", positive=True)
R_X, R_PSI, R_L = sp.symbols("R_X R_PSI R_L")
MASS, CENTRE, INERTIA = sp.symbols("MASS CENTRE INERTIA", positive=True)
SYMBOLS = (M1, M2, JE, G, R_X, R_PSI, R_L, MASS, CENTRE, INERTIA)
ROD = {"mass": 0.4, "centre": 0.35, "inertia": 0.02}


def rod():
    """Cart, load at `l`, and a rod that turns about the pivot with the load."""
    x, psi, l = q = coordinates("x psi l")

    def speed_squared(*place):
        return sum(sp.diff(c, t) ** 2 for c in place)

    load = (x + l * sp.sin(psi), l * sp.cos(psi))
    middle = (x + CENTRE * sp.sin(psi), CENTRE * sp.cos(psi))
    kinetic = M1 * speed_squared(x) + M2 * speed_squared(*load) + JE * speed_squared(l)
    kinetic += MASS * speed_squared(*middle) + INERTIA * speed_squared(psi)
    potential = -G * (M2 * load[1] + MASS * middle[1])
    lost = R_X * speed_squared(x) + R_PSI * speed_squared(psi) + R_L * speed_squared(l)
    return euler_lagrange(kinetic / 2 - potential, lost / 2, q), q


@pytest.mark.parametrize("active", [EVERY_AXIS, LOCKED_ROPE, FIXED_CART], ids=["all axes", "locked rope", "fixed cart"])
def test_a_rod_against_euler_lagrange(active):
    equations, q = rod()
    held = [i for i in range(3) if not active[i]]
    free = [i for i in range(3) if active[i]]
    oracle = accelerations(
        [equations[i].subs({sp.diff(q[j], t): 0 for j in held}).doit() for i in free],
        [q[i] for i in free],
        (*SYMBOLS, *(q[j] for j in held)),
    )
    plant = make_plant(("rod_inertia", "swing", ROD))
    key = np.random.default_rng(0)
    for _ in range(6):
        at, rates = key.uniform([-1, -2, 0.3], [1, 2, 1.5]), key.uniform([-1, -4, -1], [1, 4, 1])
        rates[held] = 0.0
        volts = key.uniform(-3, 3, 2)
        force = np.array([16.0 * volts[0], 0.0, 3.0 * volts[1]])
        numbers = [*list(NUMBERS.values())[:7], *ROD.values(), *at[held]]
        expected = np.zeros(3)
        expected[free] = oracle(at[free], rates[free], numbers, force[free])
        ours = accelerate(plant, motion(*at), motion(*rates), axes(volts[0], 0, volts[1]), axes(*active))
        # A direct solution of three equations: rounding alone.
        np.testing.assert_allclose(np.array(ours.axes), expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("rod_inertia", ROD),
        ("wind", {"force": 0.5, "start": -1.0, "stop": 1.0}),
        ("load_drag", {"coefficient": 2.0}),
        ("double_pendulum", {"hook_mass": 0.05, "link": 0.1, "damping": 1e-4}),
    ],
)
def test_a_cart_alone_carries_nothing_of_the_load(kind, values):
    """Without a swing what acts on the load is as absent as the load."""
    q, v = (motion(*at)._replace(phi=jnp.asarray(phi)) for at, phi in (((0.2, 0.0, 0.7), 0.3), ((0.3, 0.0, 0.0), 2.0)))
    ours = accelerate(make_plant((kind, "swing", values)), q, v, axes(1.0, 0, 0), axes(1, 0, 0))
    assert float(ours.x) == pytest.approx((16.0 * 1.0 - 45.0 * 0.3) / 5.5, rel=1e-12)


def test_what_a_free_swing_and_a_driven_cart_determine():
    """A free swing sees the equivalent length alone; how hard the swing pulls at the cart tells a rod from a rope.

    Two rods of one equivalent length, one of them a mere load on another rope: the same swing on a fixed cart, and
    not the same on a free one (closed-form period of small swings of a pendulum on a free cart).
    """
    g, m1, m2, l = 9.81, NUMBERS["cart_mass"], NUMBERS["load_mass"], 0.7
    mass, centre, inertia = ROD.values()
    first, second = m2 * l + mass * centre, m2 * l * l + mass * centre**2 + inertia
    length = second / first
    lossless = {"cart_damping": 0.0, "swing_damping": 0.0, "hoist_damping": 0.0}
    rod, rope = make_plant(("rod_inertia", "swing", ROD), **lossless), make_plant(**lossless)

    def stiffness(plant, length, active):
        """Angular acceleration over the angle, near the rest [1/s^2]."""
        psi = 1e-4
        a = accelerate(plant, motion(0.2, psi, length), motion(0, 0, 0), axes(0, 0, 0), axes(*active))
        return -float(a.psi) / psi

    # The sine of 1e-4 rad is off its angle by 2e-9.
    assert stiffness(rod, l, (0, 1, 0)) == pytest.approx(g / length, rel=1e-8)
    assert stiffness(rope, length, (0, 1, 0)) == pytest.approx(g / length, rel=1e-8)
    on_cart = g * first / (second - first**2 / (m1 + m2 + mass))
    assert stiffness(rod, l, (1, 1, 0)) == pytest.approx(on_cart, rel=1e-7)
    assert abs(stiffness(rope, length, (1, 1, 0)) / on_cart - 1.0) > 0.01


def test_the_period_of_a_uniform_rod():
    """Wide swings of a rod with hardly a load, against SciPy's solution of `2/3 L psi'' = -g sin psi`."""
    length, g = 0.6, 9.81
    own = {"mass": 0.2, "centre": length / 2, "inertia": 0.2 * length**2 / 12}
    plant = make_plant(("rod_inertia", "swing", own), load_mass=1e-9, swing_damping=0.0)
    lane = make_lane(np.zeros((300, 2)), active=(0.0, 1.0, 0.0))
    ours = simulate(plant, make_state(psi=1.2), lane, substeps=1, method=RK4).q.psi
    times = np.arange(301) * 0.005

    def turning(_, y):
        return [y[1], -g * np.sin(y[0]) / (2 * length / 3)]

    # Short steps, since SciPy's interpolation between them is less exact than they are.
    exact = solve_ivp(turning, (0, 1.5), [1.2, 0.0], "DOP853", times, rtol=1e-11, atol=1e-12, max_step=0.02)
    # The method is of fourth order: (omega h)^4 of a turn or two.
    np.testing.assert_allclose(np.asarray(ours), exact.y[0], atol=1e-7)
