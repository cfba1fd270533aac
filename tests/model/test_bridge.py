"""The rigid bridge against Euler-Lagrange from its energies, its limits, and the paper's misprints."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy as sp

from jbridge.model.bridge import Symmetric, inverse
from jbridge.model.parameters import bridge_keys
from jbridge.recordings.sidecar import PARAMETERS
from tests.model.lagrange import accelerations, as_function, coordinates, euler_lagrange, mass_and_bias, t
from tests.problems import (
    CART_ALONE,
    EVERY_AXIS,
    FIXED_CART,
    LOCKED_ROPE,
    LOSSLESS,
    accelerate,
    axes,
    make_bridge,
    make_lane,
    make_plant,
    make_state,
    motion,
    paths,
    simulate,
)

m1, m2, J, r, g = sp.symbols("m1 m2 J r g", positive=True)
R_tr, R_psi, R_trl, F_p, T = sp.symbols("R_tr R_psi R_trl F_p T")
x, psi, l = Q = coordinates("x psi l")
dx, dpsi, dl = (sp.diff(c, t) for c in Q)
ddx, ddpsi, ddl = (sp.diff(c, t, 2) for c in Q)

# Energies from the positions of the load: horizontal x + l sin psi, depth l cos psi.
KINETIC = (
    m1 * dx**2 / 2
    + m2 * (sp.diff(x + l * sp.sin(psi), t) ** 2 + sp.diff(l * sp.cos(psi), t) ** 2) / 2
    + J * (dl / r) ** 2 / 2
)
POTENTIAL = -m2 * g * l * sp.cos(psi)
DISSIPATION = (R_tr * dx**2 + R_psi * dpsi**2 + R_trl * dl**2) / 2
EQUATIONS = euler_lagrange(KINETIC - POTENTIAL, DISSIPATION, Q)
SYMBOLS = (m1, m2, J, r, g, R_tr, R_psi, R_trl)

STATES = [np.random.default_rng(seed).uniform([-1, -2.5, 0.1, -2, -6, -2], [1, 2.5, 1.5, 2, 6, 2]) for seed in range(8)]
"""Random x, psi, l and their rates [m, rad, m, and per second]: far beyond what a rig does."""
RELATIVE = 1e-10
"""Two ways to solve a 3 by 3 system lose about its condition number, below 1e4 here, times 1e-16."""


def symbol_values(**changes: float) -> list[float]:
    """Numbers for `SYMBOLS`, with the winch's inertia along the rope split into J and r."""
    b = {key: float(getattr(make_bridge(**changes), key)) for key in bridge_keys()}
    radius = 0.03183
    winch = b["winch_mass"] * radius**2
    dampings = (b["cart_damping"], b["swing_damping"], b["hoist_damping"])
    return [b["cart_mass"], b["load_mass"], winch, radius, b["gravity"], *dampings]


def test_mass_matrix_bias_and_energy():
    """The hand-written terms are those of the energies."""
    values, b = symbol_values(**LOSSLESS), make_bridge()
    mass, bias = (as_function(part, Q, SYMBOLS) for part in mass_and_bias(EQUATIONS, Q))
    energy = as_function(KINETIC + POTENTIAL, Q, SYMBOLS)
    for state in STATES:
        q, v = axes(*state[:3]), axes(*state[3:])
        m = b.mass_matrix(q)
        ours = np.array([[m.xx, m.xp, m.xl], [m.xp, m.pp, m.pl], [m.xl, m.pl, m.ll]])
        # The only error is rounding: a few units in the last place of the largest term.
        np.testing.assert_allclose(ours, mass(state[:3], state[3:], values), rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(b.bias(q, v), bias(state[:3], state[3:], values).ravel(), rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(b.energy(q, v), energy(state[:3], state[3:], values), rtol=1e-12)


@pytest.mark.parametrize(
    "masses", [{}, {"cart_mass": 0.4, "load_mass": 3.0, "winch_mass": 0.01}], ids=["light load", "heavy load"]
)
def test_acceleration_against_euler_lagrange(masses):
    oracle, values, plant = accelerations(EQUATIONS, Q, SYMBOLS), symbol_values(**masses), make_plant(**masses)
    for seed, state in enumerate(STATES):
        volts = np.random.default_rng(100 + seed).uniform(-5, 5, 2)
        forces = [16.0 * volts[0], 0.0, 3.0 * volts[1]]
        expected = oracle(state[:3], state[3:], values, forces)
        ours = accelerate(plant, motion(*state[:3]), motion(*state[3:]), axes(volts[0], 0, volts[1]), axes(*EVERY_AXIS))
        np.testing.assert_allclose(ours.axes, expected, rtol=RELATIVE, atol=RELATIVE * np.max(np.abs(expected)))


def locked(axis_values: dict) -> list[sp.Expr]:
    """The equations that remain when coordinates are constants from the start."""
    fixed = {c: value for c, value in axis_values.items()}
    free = [c for c in Q if c not in fixed]
    lagrangian = (KINETIC - POTENTIAL).subs(fixed).doit()
    return euler_lagrange(lagrangian, DISSIPATION.subs(fixed).doit(), free)


L0, X0 = sp.symbols("L0 X0", positive=True)


@pytest.mark.parametrize(
    "active, fixed, moving",
    [(LOCKED_ROPE, {l: L0}, (0, 1)), (FIXED_CART, {x: X0}, (1, 2)), ((0.0, 1.0, 0.0), {x: X0, l: L0}, (1,))],
    ids=["locked rope", "fixed cart", "pendulum"],
)
def test_locked_axes(active, fixed, moving):
    """A locked axis is a constant in the energies, not a force that happens to vanish."""
    coordinates_left = [Q[i] for i in moving]
    oracle = accelerations(locked(fixed), coordinates_left, (*SYMBOLS, L0, X0))
    plant, still = make_plant(), [i for i in range(3) if i not in moving]
    for state in STATES:
        at, rates = state[:3], state[3:].copy()
        rates[still] = 0.0
        volts = np.array([1.5, 0.0, -2.0])
        forces = (np.array([16.0, 0.0, 3.0]) * volts)[list(moving)]
        expected = oracle(at[list(moving)], rates[list(moving)], [*symbol_values(), at[2], at[0]], forces)
        ours = np.array(accelerate(plant, motion(*at), motion(*rates), axes(*volts), axes(*active)).axes)
        np.testing.assert_allclose(ours[list(moving)], expected, rtol=RELATIVE)
        assert np.all(ours[still] == 0.0)


def test_cart_alone_carries_no_load():
    """`(cart_mass) x'' = K_x u - R_tr x'`, whatever the load mass in the file."""
    plant = make_plant(load_mass=2.0)
    ours = accelerate(plant, motion(0.2, 0.0, 0.7), motion(0.3, 0.0, 0.0), axes(1.5, 0, 0), axes(*CART_ALONE))
    np.testing.assert_allclose(ours.axes, [(16.0 * 1.5 - 45.0 * 0.3) / 5.5, 0.0, 0.0], rtol=1e-14)


def test_hoist_alone_on_a_fixed_cart():
    """Straight down, `(m2 + Je) l'' = m2 g + K_l u - R_trl l'`: gravity pays rope out."""
    plant = make_plant()
    ours = accelerate(plant, motion(0.2, 0.0, 0.7), motion(0, 0, 0.1), axes(0, 0, -1.0), axes(0, 0, 1))
    np.testing.assert_allclose(ours.l, (0.143 * 9.81 - 3.0 - 2.5) / 0.243, rtol=1e-14)


@pytest.mark.parametrize("mask", [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)], ids=str)
def test_inverse_against_numpy(mask):
    for state in STATES:
        m = make_bridge(cart_mass=0.3).mass_matrix(axes(*state[:3]))
        full = np.array([[m.xx, m.xp, m.xl], [m.xp, m.pp, m.pl], [m.xl, m.pl, m.ll]])
        moving = np.flatnonzero(mask)
        expected = np.zeros((3, 3))
        expected[np.ix_(moving, moving)] = np.linalg.inv(full[np.ix_(moving, moving)])
        i = inverse(m, axes(*mask))
        ours = np.array([[i.xx, i.xp, i.xl], [i.xp, i.pp, i.pl], [i.xl, i.pl, i.ll]])
        np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-11 * np.max(np.abs(expected)))


def test_symmetric_times_vector():
    full = np.array([[2.0, -1.0, 0.5], [-1.0, 3.0, 0.25], [0.5, 0.25, 4.0]])
    ours = Symmetric(*(jnp.asarray(full[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))))
    np.testing.assert_allclose(ours @ axes(1.0, -2.0, 3.0), full @ [1.0, -2.0, 3.0], rtol=1e-15)


def test_small_swing_has_the_pendulums_period():
    """On a fixed cart, `2 pi sqrt(l/g)`, longer by the square of the amplitude over 16."""
    amplitude, length = 0.02, 0.7
    period = 2 * math.pi * math.sqrt(length / 9.81) * (1 + amplitude**2 / 16)
    lane = make_lane(np.zeros((400, 2)), period / 400, active=(0, 1, 0))
    q, v = paths(simulate(make_plant(**LOSSLESS), make_state(0, amplitude, length), lane, substeps=1))
    # The next term of the series is 11/3072 of the amplitude's fourth power, 6e-10 of a period.
    np.testing.assert_allclose(q[-1, 1], amplitude, rtol=1e-9)
    np.testing.assert_allclose(v[-1, 1], 0.0, atol=1e-8)


def test_energy_is_the_integral_of_power():
    """`dE/dt` along the equations of motion is the motors' power less what the dampings take."""
    plant = make_plant()
    for state in STATES:
        q, v = axes(*state[:3]), axes(*state[3:])
        volts = axes(1.0, 0.0, -2.0)
        a = accelerate(plant, motion(*state[:3]), motion(*state[3:]), volts, axes(*EVERY_AXIS)).axes
        _, rate = jax.jvp(plant.bridge.energy, (q, v), (v, a))
        taken = 45.0 * v.x**2 + 0.0015 * v.psi**2 + 25.0 * v.l**2
        np.testing.assert_allclose(rate, 16.0 * v.x - 6.0 * v.l - taken, rtol=1e-9, atol=1e-9)


# What the paper prints, as it prints it.
CORRECTED_4 = (
    dx**2 * (m1 + m2) / 2
    + dpsi**2 * l**2 * m2 / 2
    + dl**2 * m2 / 2
    + dx * dl * m2 * sp.sin(psi)
    + dx * dpsi * l * m2 * sp.cos(psi)
    + J * (dl / r) ** 2 / 2
    + m2 * g * l * sp.cos(psi)
)
PRINTED_4 = CORRECTED_4 - dx * dl * m2 * sp.sin(psi) + dx * l * m2 * sp.sin(psi)


def rest_of_8(inertial, coriolis):
    """Equation (8), both sides on one: `(m1 + m2) x'' - [...]`, with its second and third term as given."""
    others = -ddpsi * l * m2 * sp.cos(psi) + dpsi**2 * l * m2 * sp.sin(psi)
    return (m1 + m2) * ddx - (F_p - R_tr * dx - inertial - coriolis + others)


def rest_of_9(damping):
    return l * ddpsi - (-ddx * sp.cos(psi) - g * sp.sin(psi) - 2 * dpsi * dl - damping)


def rest_of_10(force):
    gravity = m2 * g * sp.cos(psi)
    return (m2 + J / r**2) * ddl - (force - R_trl * dl - ddx * m2 * sp.sin(psi) + dpsi**2 * l * m2 + gravity)


def is_zero(expression) -> bool:
    return sp.simplify(sp.expand(expression)) == 0


def test_equation_4():
    assert is_zero(KINETIC - POTENTIAL - CORRECTED_4)
    assert not is_zero(KINETIC - POTENTIAL - PRINTED_4)


def test_equations_5_to_7_need_minus():
    """With `+ dL/dq` as printed the load would fall upwards; (1) has the minus."""
    lagrangian = KINETIC - POTENTIAL
    for c, equation in zip(Q, EQUATIONS, strict=True):
        printed = sp.diff(lagrangian, sp.diff(c, t), t) + sp.diff(lagrangian, c)
        printed += sp.diff(DISSIPATION, sp.diff(c, t))
        # x does not occur in L, so (5) is right either way.
        assert is_zero(printed - equation) == (c == x)


@pytest.mark.parametrize(
    "inertial, coriolis, right",
    [
        (ddl * m2 * sp.sin(psi), 2 * dpsi * dl * m2 * sp.cos(psi), True),
        (dl * m2 * sp.sin(psi), 2 * dpsi * dl * m2 * sp.cos(psi), False),
        # A rate of the constant m2 is zero, which is how the printed term reads.
        (ddl * m2 * sp.sin(psi), 2 * dpsi * l * sp.diff(m2, t) * sp.cos(psi), False),
    ],
    ids=["corrected", "l' for l''", "m2' for l' m2"],
)
def test_equation_8(inertial, coriolis, right):
    assert is_zero(EQUATIONS[0] - F_p - rest_of_8(inertial, coriolis)) == right


@pytest.mark.parametrize(
    "damping, right", [(R_psi * dpsi / (m2 * l), True), (R_psi * dpsi, False)], ids=["corrected", "printed"]
)
def test_equation_9(damping, right):
    """(9) is the swing's equation divided by `m2 l`, and the damping with it."""
    assert is_zero(EQUATIONS[1] / (m2 * l) - rest_of_9(damping)) == right


@pytest.mark.parametrize("force, right", [(T / r, True), (T, False)], ids=["corrected", "printed"])
def test_equation_10(force, right):
    """The torque T turns the drum by `dl/r`, so its virtual work along the rope is `T/r dl`."""
    work = T * sp.diff(dl / r, dl)
    assert is_zero(EQUATIONS[2] - work - rest_of_10(force)) == right


def test_printed_radius_is_a_circumference_of_two_metres():
    assert 2 * math.pi * 0.3183 == pytest.approx(2.0, rel=1e-4)


def test_sidecars_may_set_every_number_of_the_bridge():
    assert set(PARAMETERS) == set(bridge_keys())
