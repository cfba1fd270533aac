"""Mechanisms with a hidden coordinate against Euler-Lagrange, and a play's contact against its limits."""

import numpy as np
import pytest
import sympy as sp

from tests.model.lagrange import accelerations, coordinates, euler_lagrange, t
from tests.problems import (
    EVERY_AXIS,
    FIXED_CART,
    LOCKED_ROPE,
    NUMBERS,
    accelerate,
    axes,
    make_plant,
    motion,
)

M1, M2, JE, G = sp.symbols("M1 M2 JE G", positive=True)
R_X, R_PSI, R_L = sp.symbols("R_X R_PSI R_L")
STIFFNESS, DAMPING, MASS, LINK = sp.symbols("STIFFNESS DAMPING MASS LINK", positive=True)
SYMBOLS = (M1, M2, JE, G, R_X, R_PSI, R_L, STIFFNESS, DAMPING, MASS, LINK)
BRIDGE_VALUES = list(NUMBERS.values())[:7]

RELATIVE = 1e-9
"""A hook lighter than its load makes the mass matrix worse conditioned, up to 1e5, than the rigid bridge's."""


def speed_squared(*place: sp.Expr) -> sp.Expr:
    return sum((sp.diff(c, t) ** 2 for c in place), sp.Integer(0))


def double_pendulum():
    """Hook at the rope's end, the load a rigid, massless link below it; `M2` is the sum of both."""
    x, psi, l, phi = q = coordinates("x psi l phi")
    hook = (x + l * sp.sin(psi), l * sp.cos(psi))
    load = (hook[0] + LINK * sp.sin(phi), hook[1] + LINK * sp.cos(phi))
    kinetic = M1 * speed_squared(x) + MASS * speed_squared(*hook) + (M2 - MASS) * speed_squared(*load)
    kinetic = (kinetic + JE * speed_squared(l)) / 2
    potential = -G * (MASS * hook[1] + (M2 - MASS) * load[1])
    relative = sp.diff(phi, t) - sp.diff(psi, t)
    lost = R_X * speed_squared(x) + R_PSI * speed_squared(psi) + R_L * speed_squared(l) + DAMPING * relative**2
    return euler_lagrange(kinetic - potential, lost / 2, q), q


def rope_elasticity():
    """The winch pays out `l`, the load hangs at `far`; winch and its damping move with `l` alone."""
    x, psi, l, far = q = coordinates("x psi l far")
    load = (x + far * sp.sin(psi), far * sp.cos(psi))
    kinetic = (M1 * speed_squared(x) + M2 * speed_squared(*load) + JE * speed_squared(l)) / 2
    potential = -G * M2 * load[1] + STIFFNESS * (far - l) ** 2 / 2
    relative = sp.diff(far, t) - sp.diff(l, t)
    lost = R_X * speed_squared(x) + R_PSI * speed_squared(psi) + R_L * speed_squared(l) + DAMPING * relative**2
    return euler_lagrange(kinetic - potential, lost / 2, q), q


def belt_compliance():
    """The motor's mass is part of `M1`, and the viscous damping acts on the motor."""
    x, psi, l, motor = q = coordinates("x psi l motor")
    load = (x + l * sp.sin(psi), l * sp.cos(psi))
    kinetic = (M1 - MASS) * speed_squared(x) + MASS * speed_squared(motor) + M2 * speed_squared(*load)
    kinetic = (kinetic + JE * speed_squared(l)) / 2
    potential = -G * M2 * load[1] + STIFFNESS * (motor - x) ** 2 / 2
    relative = sp.diff(motor, t) - sp.diff(x, t)
    lost = R_X * speed_squared(motor) + R_PSI * speed_squared(psi) + R_L * speed_squared(l) + DAMPING * relative**2
    return euler_lagrange(kinetic - potential, lost / 2, q), q


MECHANISMS = {
    # derivation, site, parameters, slot of the hidden coordinate in `Motion`, whose drive acts on it
    "double_pendulum": (
        double_pendulum,
        "swing",
        {"hook_mass": 0.04, "link": 0.15, "damping": 2e-3},
        "phi",
        None,
    ),
    "rope_elasticity": (rope_elasticity, "hoist", {"stiffness": 300.0, "damping": 0.4}, "loaded", None),
    "belt_compliance": (
        belt_compliance,
        "cart",
        {"stiffness": 2000.0, "damping": 10.0, "motor_mass": 1.1},
        "motor",
        "cart",
    ),
}


@pytest.mark.parametrize("active", [EVERY_AXIS, LOCKED_ROPE, FIXED_CART], ids=["all axes", "locked rope", "fixed cart"])
@pytest.mark.parametrize("kind", MECHANISMS)
def test_mechanism_against_euler_lagrange(kind, active):
    derive, site, parameters, slot, moved = MECHANISMS[kind]
    equations, q = derive()
    told = {"stiffness": 0.0, "damping": 0.0, "hook_mass": 0.0, "motor_mass": 0.0, "link": 0.0} | parameters
    mass = told["hook_mass"] + told["motor_mass"]
    values = [*BRIDGE_VALUES, told["stiffness"], told["damping"], mass, told["link"]]
    plant = make_plant((kind, site, parameters))
    # A locked rope locks the winch, not the rope's far end; a fixed cart has its motor fixed with it.
    held = [i for i in range(3) if not active[i]] + ([3] if moved == "cart" and not active[0] else [])
    free = [i for i in range(4) if i not in held]
    # What is locked does not accelerate, so its rows and columns leave the system.
    oracle = accelerations(
        [equations[i].subs({sp.diff(q[j], t): 0 for j in held}).doit() for i in free],
        [q[i] for i in free],
        (*SYMBOLS, *(q[j] for j in held)),
    )
    for seed in range(6):
        key = np.random.default_rng(seed)
        at = key.uniform([-1, -2, 0.3, -2], [1, 2, 1.5, 2])
        rates = key.uniform([-1, -4, -1, -4], [1, 4, 1, 4])
        # Compliances move a little from where their other end is.
        if slot in ("loaded", "motor"):
            near = 2 if slot == "loaded" else 0
            at[3], rates[3] = at[near] + key.uniform(-0.02, 0.02), rates[near] + key.uniform(-0.3, 0.3)
        rates[held] = 0.0
        volts = key.uniform(-3, 3, 2)
        force = np.array([16.0 * volts[0], 0.0, 3.0 * volts[1], 0.0])
        if moved == "cart":
            force = force[[3, 1, 2, 0]]
        expected = np.zeros(4)
        expected[free] = oracle(at[free], rates[free], [*values, *at[held]], force[free])
        places = {"motor": 3, "loaded": 4, "phi": 5}
        hidden_q: list = [*at[:3], None, None, None]
        hidden_v: list = [*rates[:3], None, None, None]
        hidden_q[places[slot]], hidden_v[places[slot]] = at[3], rates[3]
        a = accelerate(plant, motion(*hidden_q), motion(*hidden_v), axes(volts[0], 0, volts[1]), axes(*active))
        ours = np.array([*a.axes, getattr(a, slot)])
        np.testing.assert_allclose(ours, expected, rtol=RELATIVE, atol=RELATIVE * np.max(np.abs(expected)))
