"""Rollouts: energy, order of convergence, other engines, drives with memory, and lanes cut in different ways."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from jbridge._types import AXES
from jbridge.model.parameters import ParameterTable, with_values
from jbridge.model.plant import Plant
from jbridge.simulation.inputs import drive_inputs
from jbridge.simulation.rollout import play, rollout
from jbridge.simulation.runge_kutta import MIDPOINT, RK4
from jbridge.simulation.state import Motions, initial_motion
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
    assert total[0] - total[-1] > 1e-3
    # Within a step in which the winch stops, its place is off by micrometres, and with it the drive's work.
    assert np.max(np.diff(total)) < 1e-6


def test_a_swing_keeps_its_phase_over_a_recording():
    """16 s of swings beside a pendulum's solution in elliptic integrals, within half a hundredth of a degree."""
    amplitude, length = 0.2, 0.7
    state = make_state(psi=amplitude, l=length)
    lane = make_lane(np.zeros((3200, 2)), active=(0.0, 1.0, 0.0))
    motions = simulate(make_plant(**LOSSLESS), state, lane, substeps=1, method=MIDPOINT)
    k = np.sin(amplitude / 2) ** 2
    sn, *_ = ellipj(ellipk(k) - np.sqrt(G / length) * PERIOD * np.arange(3201), k)
    np.testing.assert_allclose(motions.q.psi, 2 * np.arcsin(np.sqrt(k) * sn), atol=1e-4)


def test_a_clock_that_runs_slow():
    """A swing and a pushed cart in closed form, at times that the stamps understate by 3 %."""
    scale, amplitude, length, count = 1.03, 0.2, 0.7, 800
    plant = make_plant(("clock_scale", "clock", {"scale": scale}), **LOSSLESS)
    times = scale * PERIOD * np.arange(count + 1)
    swing = simulate(
        plant,
        make_state(psi=amplitude, l=length),
        make_lane(np.zeros((count, 2)), active=FIXED_CART[:2] + (0.0,)),
        substeps=1,
    )
    k = np.sin(amplitude / 2) ** 2
    sn, *_ = ellipj(ellipk(k) - np.sqrt(G / length) * times, k)
    np.testing.assert_allclose(swing.q.psi, 2 * np.arcsin(np.sqrt(k) * sn), atol=1e-6)
    volts = np.repeat([[1.0, 0.0], [0.0, 0.0]], count // 2, axis=0)
    cart = simulate(plant, make_state(x=0.0), make_lane(volts, active=CART_ALONE), substeps=1)
    pushed, rate = times[count // 2], NUMBERS["cart_gain"] / M1
    x = rate * np.where(times < pushed, times**2 / 2, pushed * (times - pushed / 2))
    np.testing.assert_allclose(cart.q.x, x, atol=1e-9)


@pytest.mark.parametrize("method, order", [(RK4, 4), (MIDPOINT, 2)], ids=["RK4", "MIDPOINT"])
def test_order_of_convergence(method, order):
    """The driven bridge with a lag in each drive: error over step size, against an adaptive method of order 8."""
    lag, volts, duration = 0.05, (2.5, -1.0), 0.8
    # With its own damping the winch settles in 0.01 s, and steps of that size are beyond the asymptote.
    soft = {"hoist_damping": 5.0}

    def field(t, y, numbers):
        s = 1.0 - jnp.exp(-t / lag)
        return equations_of_motion(
            y, numbers["cart_gain"] * volts[0] * s, numbers["hoist_gain"] * volts[1] * s, numbers
        )

    start = make_state(0.3, psi=0.4, rates=(0.2, 1.0, -0.1))
    exact = integrate(field, start, duration, **soft)
    plant = make_plant(
        ("actuator_lag", "cart_drive", {"time_constant": lag}),
        ("actuator_lag", "hoist_drive", {"time_constant": lag}),
        **soft,
    )
    counts, errors = np.array([40, 80, 160, 320]), []
    for count in counts:
        # What is left of the lane is padding, which leaves everything as it is, so that one program serves all steps.
        dt = np.where(np.arange(320) < count, duration / count, 0.0)
        motions = simulate(plant, start, make_lane(np.tile(volts, (320, 1)), dt), substeps=1, method=method)
        q, v = paths(motions)
        np.testing.assert_array_equal(q[count:], np.tile(q[count], (321 - count, 1)))
        errors.append(np.max(np.abs(np.concatenate([q[-1], v[-1]]) - exact)))
    slopes = np.diff(np.log(errors)) / np.diff(np.log(1 / counts))
    np.testing.assert_allclose(slopes, order, atol=0.25)


def equations_of_motion(y, force_x, force_l, numbers):
    """Rates of `x, psi, l` and their rates, from physics.md's equations solved as a 3 by 3 system."""
    m1, m2, je, g = (numbers[key] for key in ("cart_mass", "load_mass", "winch_mass", "gravity"))
    _, psi, l, dx, dpsi, dl = y
    s, c = jnp.sin(psi), jnp.cos(psi)
    mass = jnp.array([[m1 + m2, m2 * l * c, m2 * s], [m2 * l * c, m2 * l * l, 0.0], [m2 * s, 0.0, m2 + je]])
    right = jnp.array(
        [
            force_x - numbers["cart_damping"] * dx - 2 * m2 * dl * dpsi * c + m2 * l * dpsi**2 * s,
            -numbers["swing_damping"] * dpsi - 2 * m2 * l * dl * dpsi - m2 * g * l * s,
            force_l - numbers["hoist_damping"] * dl + m2 * l * dpsi**2 + m2 * g * c,
        ]
    )
    return jnp.concatenate([y[3:], jnp.linalg.solve(mass, right)])


def integrate(field, start, duration, *, saveat=None, jumps=None, **changes):
    """The state at the end (or at times) by diffrax, to about 1e-12."""
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field),
        diffrax.Dopri8(),
        0.0,
        duration,
        1e-3,
        start,
        args={key: jnp.asarray(value) for key, value in (NUMBERS | changes).items()},
        saveat=diffrax.SaveAt(t1=True) if saveat is None else diffrax.SaveAt(ts=jnp.asarray(saveat)),
        stepsize_controller=diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=1e-11, atol=1e-12), jump_ts=None if jumps is None else jnp.asarray(jumps)
        ),
        max_steps=20_000,
    )
    return np.array(solution.ys[-1] if saveat is None else solution.ys)


def test_against_diffrax():
    """The smooth bridge under inputs that change every 0.1 s, against an adaptive method told of the changes."""
    u = lively_inputs(400)
    volts = jnp.asarray(u[::20])

    def field(t, y, numbers):
        now = volts[jnp.clip(jnp.floor(t / (20 * PERIOD)).astype(int), 0, 19)]
        return equations_of_motion(y, numbers["cart_gain"] * now[0], numbers["hoist_gain"] * now[1], numbers)

    times = np.arange(401) * PERIOD
    start = make_state(0.3, psi=0.4, rates=(0.2, 1.0, -0.1))
    exact = integrate(field, start, times[-1], saveat=times, jumps=times[20:-1:20])
    q, v = paths(simulate(make_plant(), start, make_lane(u), substeps=1, method=RK4))
    # The rates of cart and winch decay within 0.12 and 0.01 s: at 5 ms, RK4 is good for 2e-6 of the winch's motion.
    np.testing.assert_allclose(q, exact[:, :3], rtol=0, atol=2e-6)
    np.testing.assert_allclose(v, exact[:, 3:], rtol=0, atol=5e-4)
    q, v = paths(simulate(make_plant(), start, make_lane(u), substeps=8, method=RK4))
    np.testing.assert_allclose(q, exact[:, :3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(v, exact[:, 3:], rtol=0, atol=1e-7)


@pytest.mark.parametrize("active", [EVERY_AXIS, LOCKED_ROPE], ids=["all axes", "locked rope"])
def test_against_mujoco(active):
    """Five driven seconds in another engine: within 0.2 mm and 0.3 mrad, and in truth far closer."""
    oracle = pytest.importorskip("tests.oracles.mujoco_bridge")
    u = lively_inputs(1000, seed=2)
    start = make_state(0.3, psi=0.5, rates=(0.0, 0.5, 0.0))
    forces = np.stack([NUMBERS["cart_gain"] * u[:, 0], 0 * u[:, 0], NUMBERS["hoist_gain"] * u[:, 1]], axis=1)
    numbers = dict(NUMBERS)
    if not active[2]:
        # That engine has no lock for the rope: a winch of a million tonnes hardly moves.
        numbers["winch_mass"], forces[:, 2] = 1e9, 0.0
    theirs = oracle.trajectory(numbers, list(map(float, start)), forces, PERIOD)
    q, v = paths(simulate(make_plant(), start, make_lane(u, active=active), substeps=1, method=RK4))
    assert np.ptp(theirs[:, 0]) > 0.3 and np.ptp(theirs[:, 1]) > 0.5
    assert np.all(np.max(np.abs(q - theirs[:, :3]), axis=0) < [2e-4, 3e-4, 2e-4])
    assert np.all(np.max(np.abs(q - theirs[:, :3]), axis=0) < [1e-6, 1e-5, 2e-5])


DRIVE_CHAIN = {
    "saturation": {"limit": 2.0},
    "dead_zone": {"positive": 0.3, "negative": 0.5},
    "gain_asymmetry": {"ratio": 0.1},
    "gain_drift": {"rate": -0.05},
}


def chain(u: np.ndarray, t: np.ndarray, drift: float = -0.05) -> np.ndarray:
    """Saturation, then dead zone, then asymmetry and drift of the gain, in plain NumPy."""
    u = np.clip(u, -2.0, 2.0)
    u = u - np.clip(u, -0.5, 0.3)
    return u * np.where(u > 0, 1.1, 0.9) * (1 + drift * t)


@pytest.mark.parametrize("site", ["cart_drive", "hoist_drive"])
def test_order_of_a_drives_chain(site):
    """However the effects are listed, saturation comes before the dead zone, and that before the gain."""
    effects = [(kind, site, values) for kind, values in DRIVE_CHAIN.items()]
    column = 0 if site == "cart_drive" else 1
    u = np.random.default_rng(0).uniform(-3, 3, (50, 2))
    expected = u.copy()
    expected[:, column] = chain(u[:, column], 1.0 + (np.arange(50) + 0.5) * PERIOD)
    for listed in (effects, effects[::-1]):
        ours = drive_inputs(make_plant(*listed), make_lane(u, start=1.0)).mean[:, 0]
        np.testing.assert_allclose(ours, expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    "drift",
    [
        0.0,
        -0.05,
    ],
    ids=["steady gain", "drifting gain"],
)
def test_delay_comes_before_the_rest_of_the_chain(drift):
    """What the chain sees is the late input; a gain that drifts has the value of the moment at which it acts."""
    late = 4
    told = DRIVE_CHAIN | {"gain_drift": {"rate": drift}}
    effects = [(kind, "cart_drive", values) for kind, values in told.items()]
    u = np.random.default_rng(0).uniform(-3, 3, (50, 2))
    ours = drive_inputs(
        make_plant(*effects, ("input_delay", "cart_drive", {"delay": late * PERIOD})), make_lane(u)
    ).mean[:, 0]
    delayed = np.concatenate([np.zeros(late), u[:-late, 0]])
    np.testing.assert_allclose(
        ours[:, 0], chain(delayed, (np.arange(50) + 0.5) * PERIOD, drift), rtol=1e-12, atol=1e-13
    )
    np.testing.assert_array_equal(ours[:, 1], u[:, 1])


@pytest.mark.parametrize("delay", [0.0, 0.0123, 0.04], ids=str)
def test_delay_keeps_the_impulse(delay):
    """Each interval has the mean of the late input over it, so that nothing is lost, and nothing early."""
    dt = np.random.default_rng(1).uniform(0.003, 0.007, 60)
    u = np.random.default_rng(2).uniform(-3, 3, (60, 2))
    edges = np.concatenate([[0.0], np.cumsum(dt)])

    def integral(t):
        """Of the late input from the start to `t` [V s]."""
        return np.interp(t - delay, edges, np.concatenate([[0.0], np.cumsum(u[:, 1] * dt)]))

    ours = drive_inputs(make_plant(("input_delay", "hoist_drive", {"delay": delay})), make_lane(u, dt)).mean[:, 0]
    np.testing.assert_allclose(ours[:, 1], np.diff(integral(edges)) / dt, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(ours[edges[1:] <= delay, 1], 0.0, atol=1e-15)
    np.testing.assert_array_equal(ours[:, 0], u[:, 0])


RUNS = (0.0, 0.0, 3.0, 3.0, -2.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, -1.0, 2.0, 2.0)
"""Inputs of one interval each: a start and a reversal, a stop of one interval and another start, and one more."""


@pytest.mark.parametrize("late", [0.0, 0.0123], ids=["", "and a dead time"])
@pytest.mark.parametrize("delay", [0.0, 0.004, 0.0123, 0.035], ids=str)
def test_a_start_comes_late_and_nothing_else(delay, late):
    """What an input asks for in the first moments after zero is lost; a dead time shifts what is left."""
    dt = np.random.default_rng(1).uniform(0.006, 0.014, len(RUNS))
    edges = np.concatenate([[0.0], np.cumsum(dt)])
    u = np.array(RUNS)
    begins = [max(k for k in range(i + 1) if k == 0 or u[k - 1] == 0.0) for i in range(len(u))]
    acts = np.maximum(edges[:-1], edges[begins] + delay)
    times = np.linspace(0.0, edges[-1], 400_001)
    at = np.clip(np.searchsorted(edges, times - late, side="right") - 1, 0, len(u) - 1)
    value = np.where((times >= late) & (times - late >= acts[at]), u[at], 0.0)
    integral = np.concatenate([[0.0], np.cumsum(value[:-1] * np.diff(times))])
    effects = [("start_delay", "cart_drive", {"delay": delay})]
    effects += [("input_delay", "cart_drive", {"delay": late})] if late else []
    ours = drive_inputs(make_plant(*effects), make_lane(np.stack([u, u], axis=1), dt)).mean[:, 0]
    expected = np.diff(np.interp(edges, times, integral)) / dt
    np.testing.assert_allclose(ours[:, 0], expected, atol=2e-3)
    np.testing.assert_array_equal(ours[:, 1], u)


def test_zero_is_what_the_dead_zone_leaves():
    """A measured voltage is never quite zero: a start is where it leaves the dead zone."""
    u = np.array([0.05, -0.08, 0.02, 1.0, 1.0, 1.0, 0.04, 1.0, 1.0])
    effects = [("dead_zone", "cart_drive", {"positive": 0.1, "negative": 0.1})]
    delay = ("start_delay", "cart_drive", {"delay": 2 * PERIOD})
    ours = drive_inputs(make_plant(*effects, delay), make_lane(np.stack([u, u], axis=1))).mean[:, 0, 0]
    np.testing.assert_allclose(ours, [0, 0, 0, 0, 0, 0.9, 0, 0, 0], atol=1e-12)
    ours = drive_inputs(make_plant(delay), make_lane(np.stack([u, u], axis=1))).mean[:, 0, 0]
    np.testing.assert_allclose(ours, [0, 0, *u[2:]], atol=1e-12)


def test_a_delayed_run_is_a_shifted_run():
    u = lively_inputs(200, hold=7)
    late = np.concatenate([np.zeros((6, 2)), u[:-6]])
    start = make_state(psi=0.1)
    plant = make_plant(
        ("input_delay", "cart_drive", {"delay": 6 * PERIOD}), ("input_delay", "hoist_drive", {"delay": 6 * PERIOD})
    )
    q, _ = paths(simulate(plant, start, make_lane(u), substeps=1, method=RK4))
    expected, _ = paths(simulate(make_plant(), start, make_lane(late), substeps=1, method=RK4))
    np.testing.assert_allclose(q, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "kinds", [("input_delay",), ("start_delay",), ("input_delay", "start_delay")], ids=" and ".join
)
@pytest.mark.parametrize("method, substeps", [(MIDPOINT, 1), (MIDPOINT, 3), (RK4, 1)], ids=["1", "3", "RK4"])
def test_a_step_that_arrives_within_a_step(method, substeps, kinds):
    """A cart with viscous damping, in closed form: where the cart goes depends on when within a step the voltage comes.

    With the delay's mean over a step alone the cart would be 34 um off; here it is as exact as for a whole delay.
    """
    settle, final = M1 / NUMBERS["cart_damping"], NUMBERS["cart_gain"] * 4.0 / NUMBERS["cart_damping"]
    lane = make_lane(held(200, 4.0, 0.0), active=CART_ALONE)

    def error(delay: float) -> float:
        plant = make_plant(*((kind, "cart_drive", {"delay": delay / len(kinds)}) for kind in kinds))
        x = np.asarray(simulate(plant, make_state(0.0), lane, substeps=substeps, method=method).q.x)
        since = np.maximum(np.arange(201) * PERIOD - delay, 0.0)
        return np.max(np.abs(x - final * (since - settle * (1 - np.exp(-since / settle)))))

    assert error(2.48 * PERIOD) < error(2 * PERIOD) + 1e-6


@pytest.mark.parametrize("lag", [0.001, 0.06, 2.0], ids=str)
def test_lag_in_closed_form(lag):
    """A step of voltage through a lag onto a cart with viscous damping."""
    plant = make_plant(("actuator_lag", "cart_drive", {"time_constant": lag}))
    motions = simulate(
        plant, make_state(0.0), make_lane(held(300, 2.0, 0.0), active=CART_ALONE), substeps=1, method=RK4
    )
    t = np.arange(301) * PERIOD
    s = 2.0 * (1 - np.exp(-t / lag))
    np.testing.assert_allclose(np.asarray(motions.lag.x), s, rtol=1e-12, atol=1e-14)
    settle, final = M1 / NUMBERS["cart_damping"], NUMBERS["cart_gain"] * 2.0 / NUMBERS["cart_damping"]
    v = final * (1 - (lag * np.exp(-t / lag) - settle * np.exp(-t / settle)) / (lag - settle))
    # RK4's error where the lag is resolved; where it is shorter than a step, only its means over steps are exact.
    tolerance = 1e-7 if lag > PERIOD else 4e-5
    np.testing.assert_allclose(np.asarray(motions.v.x), v, rtol=0, atol=tolerance)


@pytest.mark.parametrize("method", [MIDPOINT, RK4], ids=["MIDPOINT", "RK4"])
@pytest.mark.parametrize("lag", [0.0002, 0.001, 0.004], ids=str)
def test_a_lag_shorter_than_a_step_is_not_lost_between_stages(lag, method):
    """A cart that lags lies behind by the lag times its speed: within a hundredth of the lag, as without one."""
    settle, final = M1 / NUMBERS["cart_damping"], NUMBERS["cart_gain"] * 2.0 / NUMBERS["cart_damping"]

    def lies_behind(lag: float) -> float:
        plant = make_plant(("actuator_lag", "cart_drive", {"time_constant": lag}))
        lane = make_lane(held(300, 2.0, 0.0), active=CART_ALONE)
        x = np.asarray(simulate(plant, make_state(0.0), lane, substeps=1, method=method).q.x)
        return float(final * 300 * PERIOD - x[-1]) / final - settle

    assert lies_behind(lag) - lies_behind(0.0) == pytest.approx(lag, rel=0.01)


def test_drum_radius_scales_the_hoists_input():
    """Gain `1 + slope (l - length)` at the rope's length now, before the lag."""
    slope, length = 0.4, 0.5
    plant = make_plant(("drum_radius_change", "hoist_drive", {"slope": slope, "length": length}))
    u = lively_inputs(100)
    motions = simulate(plant, make_state(), make_lane(u), substeps=1, method=RK4)
    l = np.asarray(motions.q.l)
    np.testing.assert_allclose(motions.lag.l[1:], u[:, 1] * (1 + slope * (l[:-1] - length)), rtol=1e-13)
    # The length is that of each step's beginning: the error falls with the step.
    fine = simulate(plant, make_state(), make_lane(u), substeps=8, method=RK4)
    assert np.max(np.abs(l - np.asarray(fine.q.l))) < 2e-5


def test_a_lane_begun_later_goes_on_alike():
    """A lane that starts within a recording, with the inputs before it, repeats the rest of the recording's run."""
    effects = [
        ("input_delay", "cart_drive", {"delay": 0.0123}),
        ("input_delay", "hoist_drive", {"delay": 0.031}),
        ("start_delay", "hoist_drive", {"delay": 0.024}),
        ("actuator_lag", "cart_drive", {"time_constant": 0.05}),
        ("actuator_lag", "hoist_drive", {"time_constant": 0.02}),
        ("gain_drift", "hoist_drive", {"rate": 0.2}),
        ("wind", "swing", {"force": 0.1, "start": 0.4, "stop": 0.9}),
        ("coulomb_friction", "cart", {"level": 3.0}),
    ]
    plant, u, cut = make_plant(*effects), lively_inputs(240, hold=9), 120
    whole = simulate(plant, make_state(psi=0.2), make_lane(u), substeps=1, method=RK4)
    q, v = paths(whole)
    lane = make_lane(u[cut:], start=cut * PERIOD, history=u[:cut])
    rest = simulate(plant, jnp.asarray(np.concatenate([q[cut], v[cut]])), lane, substeps=1, method=RK4)
    np.testing.assert_allclose(rest.lag.x, whole.lag.x[cut:], rtol=1e-12)
    np.testing.assert_allclose(rest.lag.l, whole.lag.l[cut:], rtol=1e-12)
    for ours, expected in zip(paths(rest), (q[cut:], v[cut:]), strict=True):
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)


def test_a_batch_is_its_members():
    """`vmap` over inputs, states and parts of the rig gives what single runs give."""
    plant = make_plant(("coulomb_friction", "cart", {"level": 3.0}), ("coulomb_friction", "hoist", {"level": 2.0}))
    lanes = [
        make_lane(lively_inputs(80, seed=k), active=active)
        for k, active in enumerate((EVERY_AXIS, LOCKED_ROPE, FIXED_CART))
    ]
    states = [make_state(psi=0.1 * k) for k in range(3)]
    stacked = jax.tree.map(lambda *parts: jnp.stack(parts), *lanes)

    @jax.jit
    def batch(plant: Plant, states, lanes):
        return jax.vmap(lambda state, lane: rollout(plant, state, lane, substeps=1, method=RK4))(states, lanes)

    together = batch(plant, jnp.stack(states), stacked)
    for k, (state, lane) in enumerate(zip(states, lanes, strict=True)):
        alone = simulate(plant, state, lane, substeps=1, method=RK4)
        for ours, expected in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            # A batch is compiled into other instructions, which round differently.
            np.testing.assert_allclose(ours[k], expected, rtol=1e-11, atol=1e-13)


def test_no_mechanism_has_no_hidden_motion():
    q, v = initial_motion(make_plant(), make_state(0.1, 0.2, 0.3, (0.4, 0.5, 0.6)), axes(*EVERY_AXIS))
    assert q.motor is q.loaded is q.phi is v.motor is v.loaded is v.phi is None
    assert tuple(map(float, (*q.axes, *v.axes))) == (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


def test_a_locked_ropes_length_is_what_the_sensor_reads():
    """The state's length is a reading: with a wrong scale and an offset the true length is another one."""
    plant = make_plant(
        ("sensor_offset", "l_sensor", {"offset": 0.02}),
        ("sensor_scale", "l_sensor", {"scale": 0.9}),
        **LOSSLESS,
    )
    count, true_length = 320, (0.7 - 0.02) / 0.9
    period = 2 * np.pi * np.sqrt(true_length / G)
    lane = make_lane(np.zeros((count, 2)), period / count, active=(0, 1, 0))
    motions = simulate(plant, make_state(l=0.7, psi=0.01), lane, substeps=1, method=RK4)
    np.testing.assert_allclose(measure(plant, lane, motions)[:, 2], 0.7, rtol=1e-14)
    # Swinging at the true length, the load is back after that length's period.
    np.testing.assert_allclose(motions.q.psi[-1], 0.01, rtol=1e-6)
    # A driven hoist starts where the state says.
    q, _ = initial_motion(plant, make_state(l=0.7), axes(*EVERY_AXIS))
    assert float(q.l) == 0.7


def test_readings_are_in_the_order_of_the_axes():
    motions = simulate(make_plant(), make_state(0.1, 0.2, 0.3), make_lane(np.zeros((1, 2))), substeps=1, method=RK4)
    read = measure(make_plant(), make_lane(np.zeros((1, 2))), motions)
    assert AXES == ("x", "psi", "l")
    np.testing.assert_array_equal(read[0], [0.1, 0.2, 0.3])


def test_play_keeps_what_rollout_gives():
    """Two routes to one answer: positions at the beginning of every period."""
    plant = make_plant(
        ("coulomb_friction", "cart", {"level": 3.0}), ("actuator_lag", "hoist_drive", {"time_constant": 0.05})
    )
    u, state = lively_inputs(60), make_state(psi=0.1)
    motions = simulate(plant, state, make_lane(u, 0.01), substeps=3, method=RK4)
    played = play(plant, state, jnp.asarray(u), period=0.01, substeps=3)
    for found, wanted in zip(played.q.axes, motions.q.axes, strict=True):
        np.testing.assert_allclose(found, wanted[:-1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(played.times, 0.01 * np.arange(60), atol=1e-12)


@pytest.mark.parametrize("method", [pytest.param(RK4, marks=pytest.mark.slow), MIDPOINT])
def test_stages_as_a_loop_change_neither_motion_nor_gradient(method):
    """With a hidden coordinate, a presliding spring and a lag, which every stage takes along."""
    plant = make_plant(
        ("presliding_friction", "cart", {"level": 3.0, "stiffness": 3000.0}),
        ("rope_elasticity", "hoist", {"stiffness": 400.0, "damping": 2.0}),
        ("actuator_lag", "cart_drive", {"time_constant": 0.03}),
    )
    u, state = jnp.asarray(lively_inputs(40)), make_state(psi=0.1, hidden=(0.0, 0.0))

    def last(u, reverse):
        run = play(plant, state, u, period=0.01, substeps=2, method=method, reverse=reverse)
        return run.q.x[-1] + run.q.psi[-1] + run.q.loaded[-1]

    both = [jax.jit(jax.value_and_grad(functools.partial(last, reverse=reverse)))(u) for reverse in (False, True)]
    np.testing.assert_allclose(both[1][0], both[0][0], rtol=1e-13)
    np.testing.assert_allclose(both[1][1], both[0][1], rtol=1e-9, atol=1e-14)
    assert np.abs(both[0][1]).max() > 1e-6


def test_values_are_replaced_by_name():
    plant = make_plant(("position_dependent_friction", "cart", {"knots": [0.2, 0.8], "levels": [3.0, 4.0]}))
    changed = with_values(plant, {"load_mass": 0.2, "position_dependent_friction@cart.levels": 5.0})
    assert float(changed.bridge.load_mass) == 0.2 and float(plant.bridge.load_mass) == NUMBERS["load_mass"]
    np.testing.assert_array_equal(changed.effects[0].levels_at, [5.0, 5.0])
    np.testing.assert_array_equal(changed.effects[0].knots, [0.2, 0.8])
    with pytest.raises(KeyError):
        with_values(plant, {"weight": 1.0})


def test_a_lag_pushes_no_axis_beyond_its_target():
    """A cart that friction just holds at the input's full strength, behind a lag that is shorter than a step."""
    level = 3.0
    volts = 0.97 * level / NUMBERS["cart_gain"]
    u = held(200, volts, 0.0) * np.where(np.arange(200) % 20 < 10, 1.0, -1.0)[:, None]
    for lag in (0.0005, 0.001, 0.003):
        plant = make_plant(
            ("actuator_lag", "cart_drive", {"time_constant": lag}), ("coulomb_friction", "cart", {"level": level})
        )
        motions = simulate(plant, make_state(0.5), make_lane(u, active=CART_ALONE), substeps=1, method=RK4)
        np.testing.assert_array_equal(np.asarray(motions.q.x), 0.5)


def test_a_lag_of_nothing_has_a_slope():
    """At its bound, too, a fit can see that a lag would help: the cart lies behind by its speed times the lag."""
    plant = make_plant(("actuator_lag", "cart_drive", {"time_constant": 0.0}))
    table = ParameterTable(plant)
    vector, (place,) = jnp.asarray(table.ravel(plant)), table.positions("actuator_lag@cart_drive.time_constant")
    lane = make_lane(held(300, 2.0, 0.0), active=CART_ALONE)

    def last(lag):
        found = rollout(table.unravel(vector.at[place].set(lag)), make_state(0.0), lane, substeps=1, method=MIDPOINT)
        return found.q.x[-1]

    final, slope = NUMBERS["cart_gain"] * 2.0 / NUMBERS["cart_damping"], jax.jit(jax.jacfwd(last))
    assert slope(0.0) == pytest.approx(-final, rel=0.02)
    assert slope(0.02) == pytest.approx(-final, rel=0.02)
