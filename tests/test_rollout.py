"""Time passing: energy, order of convergence, other engines, drives with memory, and lanes cut in different ways."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge._types import AXES
from jbridge.model.plant import Plant
from jbridge.rollout import MIDPOINT, RK4, Motions, drive_inputs, initial_motion, rollout
from tests.model.stick_slip import StickSlip
from tests.problems import (
    CART_ALONE,
    EVERY_AXIS,
    FIXED_CART,
    LOCKED_ROPE,
    LOSSLESS,
    NUMBERS,
    PERIOD,
    Everything,
    axes,
    lively_inputs,
    make_lane,
    make_plant,
    make_state,
    measure,
    paths,
    simulate,
)

M1, M2, JE, G = (NUMBERS[key] for key in ("cart_mass", "load_mass", "winch_mass", "gravity"))


def energy_of(motions: Motions, *, motor_mass: float = 0.0, hook_mass: float = M2, link: float = 0.0) -> np.ndarray:
    """Kinetic energy of every mass and the height of the load, at every sample [J].

    A mechanism's spring is not included.
    """
    q, v = (jax.tree.map(np.asarray, part) for part in (motions.q, motions.v))
    far, far_rate = (q.l, v.l) if q.loaded is None else (q.loaded, v.loaded)
    motor_rate = v.x if v.motor is None else v.motor
    across = v.x + far_rate * np.sin(q.psi) + far * v.psi * np.cos(q.psi)
    down = far_rate * np.cos(q.psi) - far * v.psi * np.sin(q.psi)
    depth = far * np.cos(q.psi)
    kinetic = (M1 - motor_mass) * v.x**2 + motor_mass * motor_rate**2 + JE * v.l**2
    kinetic += hook_mass * (across**2 + down**2)
    height = hook_mass * depth
    if q.phi is not None:
        across = across + link * v.phi * np.cos(q.phi)
        down = down - link * v.phi * np.sin(q.phi)
        kinetic += (M2 - hook_mass) * (across**2 + down**2)
        height += (M2 - hook_mass) * (depth + link * np.cos(q.phi))
    return kinetic / 2 - G * height


HOLDING = -1.02 * M2 * G / NUMBERS["hoist_gain"]
"""A hoist voltage that about carries the swinging load, so that the rope keeps its length for ten seconds."""


def held(count: int, u_x: float = 0.0, u_l: float = HOLDING) -> np.ndarray:
    return np.tile([u_x, u_l], (count, 1))


def work_of_drives(motions: Motions, u_x: float = 0.0, u_l: float = HOLDING) -> np.ndarray:
    """What constant drives have done on motor and winch since the start [J]."""
    q = motions.q
    x = np.asarray(q.x if q.motor is None else q.motor)
    l = np.asarray(q.l)
    return NUMBERS["cart_gain"] * u_x * (x - x[0]) + NUMBERS["hoist_gain"] * u_l * (l - l[0])


def test_energy_is_constant_without_losses():
    """Ten seconds of RK4 at the rig's 5 ms: drift 2e-9 of the energy that moves to and fro, here 0.09 J."""
    lane = make_lane(held(2000))
    start = make_state(0.0, psi=0.3, rates=(0.1, 0.5, 0.0))
    motions = simulate(make_plant(**LOSSLESS), start, lane, substeps=1, method=RK4)
    total = energy_of(motions) - work_of_drives(motions)
    assert np.ptp(np.asarray(motions.q.x)) > 0.5 and np.ptp(np.asarray(motions.q.l)) > 0.2
    assert np.ptp(total) < 1e-8 * 0.09


def test_energy_is_constant_with_springs():
    """A cable chain, cogging, a belt, an elastic rope and a hook at once; stiff, so 16 steps of RK4 in each 5 ms."""
    spring, belt, rope, hook = 12.0, 3000.0, 200.0, 0.05
    plant = make_plant(
        ("spring_force", "cart", {"stiffness": spring, "rest": 0.1}),
        ("periodic_force", "cart", {"amplitude": 0.3, "period": 0.2, "phase": 0.4}),
        ("belt_compliance", "cart", {"stiffness": belt, "damping": 0.0, "motor_mass": 1.1}),
        ("rope_elasticity", "hoist", {"stiffness": rope, "damping": 0.0}),
        ("double_pendulum", "swing", {"hook_mass": hook, "link": 0.12, "damping": 0.0}),
        **LOSSLESS,
    )
    start = make_state(0.0, psi=0.3, rates=(0.1, 0.5, 0.0), hidden=[1e-3, 0.0, 2e-3, 0.0, 0.1, 0.0])
    motions = simulate(plant, start, make_lane(held(2000)), substeps=16, method=RK4)
    q = jax.tree.map(np.asarray, motions.q)
    stored = spring * (q.x - 0.1) ** 2 / 2 + 0.3 * 0.2 / (2 * np.pi) * np.cos(2 * np.pi * q.x / 0.2 + 0.4)
    stored += belt * (q.motor - q.x) ** 2 / 2 + rope * (q.loaded - q.l) ** 2 / 2
    kept = energy_of(motions, motor_mass=1.1, hook_mass=hook, link=0.12) + stored - work_of_drives(motions)
    # Some 0.1 J move to and fro.
    assert np.ptp(stored) > 0.02
    assert np.ptp(kept) < 1e-8 * 0.1


@functools.cache
def everything() -> Everything:
    return Everything(**LOSSLESS)


@functools.cache
def run_everything():
    """The bridge with all effects but mechanisms, for four seconds of no cart drive and a hoist that holds the load."""
    lane, start = make_lane(held(800)), make_state(0.3, psi=0.5, rates=(0.4, 1.0, 0.15))
    return jax.jit(lambda vector: rollout(everything().table.unravel(vector), start, lane, substeps=1, method=RK4))


KNOTS = {"knots": [0.3, 0.5, 0.8]}
LOSSES = [
    ("coulomb_friction", "cart", {"level": 0.4}),
    ("coulomb_friction", "swing", {"level": 0.01}),
    ("coulomb_friction", "hoist", {"level": 0.3}),
    ("stribeck_friction", "cart", {"level": 0.3, "breakaway": 0.6, "velocity": 0.05}),
    ("stribeck_friction", "swing", {"level": 0.005, "breakaway": 0.02, "velocity": 0.5}),
    ("stribeck_friction", "hoist", {"level": 0.2, "breakaway": 0.4, "velocity": 0.03}),
    ("direction_dependent_friction", "cart", {"positive": 0.3, "negative": 0.6}),
    ("direction_dependent_friction", "hoist", {"positive": 0.2, "negative": 0.4}),
    ("position_dependent_friction", "cart", KNOTS | {"levels": [0.2, 0.6, 0.3]}),
    ("position_dependent_friction", "hoist", KNOTS | {"levels": [0.1, 0.4, 0.2]}),
    ("position_direction_friction", "cart", KNOTS | {"positive": [0.2, 0.6, 0.3], "negative": [0.6, 0.1, 0.4]}),
    ("position_direction_friction", "hoist", KNOTS | {"positive": [0.2, 0.3, 0.1], "negative": [0.4, 0.1, 0.2]}),
    ("presliding_friction", "cart", {"level": 0.5, "stiffness": 300.0}),
    ("friction_drift", "cart", {"level": 0.5, "rate": -0.2}),
    ("quadratic_drag", "cart", {"coefficient": 4.0}),
    ("quadratic_drag", "hoist", {"coefficient": 4.0}),
    ("length_dependent_damping", "swing", {"slope": 0.02, "length": 0.2}),
    ("load_drag", "swing", {"coefficient": 0.1}),
    ("end_stop", "cart", {"position": 0.45, "stiffness": 200.0, "damping": 5.0}),
]


@pytest.mark.parametrize("kind, site, values", LOSSES, ids=[f"{kind}@{site}" for kind, site, _ in LOSSES])
def test_losses_never_give_energy(kind, site, values):
    all_of = everything()
    motions = run_everything()(jnp.asarray(all_of.having(kind, site, values)))
    total = energy_of(motions) - work_of_drives(motions)
    x = np.asarray(motions.q.x)
    if kind == "presliding_friction":
        # Dahl's spring stores level^2/stiffness z^2/2.
        total += values["level"] ** 2 / values["stiffness"] * np.asarray(motions.z) ** 2 / 2
    if kind == "end_stop":
        total += values["stiffness"] * np.maximum(x - values["position"], 0.0) ** 2 / 2
        assert x.max() > values["position"]
    print(np.diff(total).max(), total[0] - total[-1])
    assert total[0] - total[-1] > 1e-3
    # Apart from a step's error.
    assert np.max(np.diff(total)) < 1e-6
