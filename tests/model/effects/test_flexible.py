"""Mechanisms with a hidden coordinate against Euler-Lagrange, and a play's contact against its limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import sympy as sp

from jbridge.model.drive_train import _vibration
from jbridge.simulation.rollout import rollout
from jbridge.simulation.runge_kutta import MIDPOINT, RK4
from jbridge.simulation.state import initial_motion
from tests.model.lagrange import accelerations, coordinates, euler_lagrange, t
from tests.problems import (
    CART_ALONE,
    EVERY_AXIS,
    FIXED_CART,
    LOCKED_ROPE,
    LOSSLESS,
    NUMBERS,
    PERIOD,
    accelerate,
    axes,
    lively_inputs,
    make_lane,
    make_plant,
    make_state,
    measure,
    motion,
    simulate,
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
        given = (motion(*hidden_q), motion(*hidden_v), axes(volts[0], 0, volts[1]), axes(*active))
        a = accelerate(plant, *given, h=1e-13)  # a belt's thrust is its mean over a step
        ours = np.array([*a.axes, getattr(a, slot)])
        np.testing.assert_allclose(ours, expected, rtol=RELATIVE, atol=RELATIVE * np.max(np.abs(expected)))


GAP, MOTOR = 2e-3, 1.1
CART = NUMBERS["cart_mass"] - MOTOR
PLAY = ("backlash", "cart", {"gap": GAP, "motor_mass": MOTOR})


def run_play(*, u_x=0.0, count=100, active=CART_ALONE, encoder="cart", state=(), **changes):
    """A cart behind a motor with play: places and rates of cart, motor and swing, and what the encoders read.

    Four RK4 steps in 5 ms; every lane is padded to one length, so that one program serves all.
    """
    lane = make_lane(np.tile([u_x, 0.0], (400, 1)), np.where(np.arange(400) < count, PERIOD, 0.0), active=active)
    plant = make_plant((*PLAY[:2], PLAY[2] | {"encoder": encoder}), **changes)
    motions = simulate(plant, make_state(**state), lane, substeps=4, method=RK4)
    return jax.tree.map(
        lambda part: np.asarray(part)[: count + 1], (motions.q, motions.v, measure(plant, lane, motions))
    )


def test_within_the_play_motor_and_cart_know_nothing_of_each_other():
    """The motor runs up alone, with its own mass, drive and damping; the cart goes on at its speed."""
    force, damping, speed = 16.0 * 0.05, 4.0, 0.1
    q, v, _ = run_play(
        u_x=0.05, count=10, state={"x": 0.0, "rates": (speed, 0, 0), "hidden": (0.4 * GAP, -0.1)}, cart_damping=damping
    )
    t = np.arange(11) * PERIOD
    final = force / damping
    expected = final * (1 - np.exp(-damping / MOTOR * t))
    met = np.argmax(v.x < speed - 1e-12)
    assert met >= 3
    assert np.all(np.abs(q.motor - q.x) <= GAP / 2 + 1e-12)
    np.testing.assert_allclose(v.motor[:met], expected[:met], rtol=0, atol=1e-9)
    np.testing.assert_allclose(v.x[:met], speed, rtol=1e-15)


def test_in_contact_motor_and_cart_move_as_one_mass():
    """Pushed against one side and kept there, the pair moves like a rigid cart, `gap/2` behind the motor."""
    q, v, _ = run_play(u_x=3.0, count=200, state={"x": 0.0, "hidden": (GAP / 2, 0.0)})
    lane = make_lane(np.tile([3.0, 0.0], (200, 1)), active=CART_ALONE)
    rigid = simulate(make_plant(), make_state(0.0), lane, substeps=4, method=RK4)
    np.testing.assert_allclose(q.x, rigid.q.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(q.motor - GAP / 2, rigid.q.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(v.x, rigid.v.x, rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", [pytest.param(RK4, id="RK4"), pytest.param(MIDPOINT, id="MIDPOINT")])
def test_impact_is_inelastic_and_keeps_the_momentum(method):
    """From anywhere in the play and at any speed, motor and cart go on together."""
    lane = make_lane(np.zeros((100, 2)), active=CART_ALONE)
    plant = make_plant(PLAY, **LOSSLESS)
    offsets, speeds = np.meshgrid(np.linspace(-0.45, 0.45, 31) * GAP, [0.03, 0.1, -0.3, 0.5])
    states = np.zeros((offsets.size, 8))
    states[:, 2], states[:, 6], states[:, 7] = 0.7, offsets.ravel(), speeds.ravel()

    @jax.jit
    def run(states):
        return jax.vmap(lambda state: rollout(plant, state, lane, substeps=4, method=method))(states)

    motions = run(jnp.asarray(states))
    motor, cart = np.asarray(motions.v.motor), np.asarray(motions.v.x)
    start = motor[:, :1]
    np.testing.assert_allclose((MOTOR * motor + CART * cart) / (MOTOR * start), 1.0, rtol=1e-12)
    relative = (motor - cart) / start
    assert np.all(relative[:, 0] == 1.0)
    np.testing.assert_allclose(relative[:, -1], 0.0, rtol=0, atol=1e-12, err_msg="they have met")
    assert relative.min() > -1e-12, "nothing bounces"
    depth = np.abs(motions.q.motor - motions.q.x) - GAP / 2
    assert np.max(depth) < 1e-12, "nothing sinks in"
    # Positions are those of the instant at which they met, wherever in a step that was.
    side = np.where(start[:, 0] > 0, GAP / 2, -GAP / 2)
    met = (side - states[:, 6]) / start[:, 0]
    together = MOTOR / (MOTOR + CART) * start[:, 0]
    np.testing.assert_allclose(motions.q.x[:, -1], together * (100 * PERIOD - met), rtol=0, atol=1e-12)


def knocked_about(forces, times, x, motor, masses=(CART, MOTOR), pull=0.0):
    """Cart and motor under forces on the motor that are constant by pieces, from event to event in closed form.

    `masses` are those of cart and motor, or of what the winch carries and its motor; `pull` is a force on the former.
    """
    (x, v), (m, w), half, (cart, driven) = x, motor, GAP / 2, masses
    places, joined = [(x, m)], False
    for force, span in zip(forces, times, strict=True):
        left = span
        while left > 0:
            coasting = pull / cart
            free = force / driven - coasting
            if joined:
                # Together while what pulls them apart presses on the side where the motor is.
                if free * (m - x) >= 0:
                    a = (force + pull) / (driven + cart)
                    x, m, v = x + v * left + a * left**2 / 2, m + v * left + a * left**2 / 2, v + a * left
                    w = v
                    break
                joined = False
            gap, rate = m - x, w - v
            roots = [
                root.real
                for side in (half, -half)
                for root in np.roots([free / 2, rate, gap - side])
                if abs(root.imag) < 1e-12 and 1e-9 < root.real <= left and (rate + free * root.real) * side > 0
            ]
            step = min(roots, default=left)
            x, v = x + v * step + coasting * step**2 / 2, v + coasting * step
            m, w = m + w * step + force / driven * step**2 / 2, w + force / driven * step
            left -= step
            if roots:
                v = w = (cart * v + driven * w) / (cart + driven)
                joined = True
        places.append((x, m))
    return np.array(places)


@pytest.mark.parametrize("substeps", [1, 4])
def test_play_against_its_events_in_closed_form(substeps):
    """A dozen impacts and partings at no multiple of a step: under steady forces a step is exact."""
    key = np.random.default_rng(5)
    volts = np.repeat(key.uniform(-1, 1, 40), 10)
    lane = make_lane(np.stack([volts, np.zeros(400)], axis=1), active=CART_ALONE)
    plant = make_plant(PLAY, **LOSSLESS)
    state = make_state(x=0.0, hidden=(0.3 * GAP, 0.05))
    motions = simulate(plant, state, lane, substeps=substeps, method=MIDPOINT)
    places = knocked_about(16.0 * volts, np.full(400, PERIOD), (0.0, 0.0), (0.3 * GAP, 0.05))
    apart = np.abs(places[:, 1] - places[:, 0])
    assert np.sum((apart[1:] > 0.999 * GAP / 2) & (apart[:-1] < 0.999 * GAP / 2)) >= 12, "impacts"
    ours = np.stack([motions.q.x, motions.q.motor], axis=1)
    np.testing.assert_allclose(ours, places, rtol=0, atol=1e-12)


def test_a_contact_never_pulls():
    """The motor brakes at once; the cart runs on freely until it has crossed the play, and is then held back alone."""
    q, v, _ = run_play(u_x=-1.0, count=60, state={"x": 0.0, "rates": (0.3, 0, 0), "hidden": (GAP / 2, 0.0)}, **LOSSLESS)
    change = np.diff(v.x)
    assert np.all(change <= 1e-15), "the motor would have to pull the cart forwards"
    crossing = (q.motor - q.x)[1:] > -0.49 * GAP
    assert crossing[0] and np.all(change[crossing & (np.arange(60) < 2)] == 0.0)
    # Later both brake as one.
    np.testing.assert_allclose(change[-10:], -16.0 * PERIOD / (MOTOR + CART), rtol=0.02)


def test_play_loses_energy_and_keeps_momentum_under_a_swinging_load():
    """Without a drive the horizontal momentum of motor, cart and load is constant, and impacts only lose energy."""
    q, v, _ = run_play(
        count=400,
        active=LOCKED_ROPE,
        state={"x": 0.0, "psi": 0.5, "rates": (0.2, 1.0, 0.0), "hidden": (0.0, 0.3)},
        **LOSSLESS,
    )
    m2, g, l = NUMBERS["load_mass"], NUMBERS["gravity"], 0.7
    across, down = v.x + l * v.psi * np.cos(q.psi), -l * v.psi * np.sin(q.psi)
    momentum = CART * v.x + MOTOR * v.motor + m2 * across
    energy = (CART * v.x**2 + MOTOR * v.motor**2 + m2 * (across**2 + down**2)) / 2 - m2 * g * l * np.cos(q.psi)
    # RK4 keeps a momentum that is not linear in its state to its own order.
    assert np.ptp(momentum) < 1e-6 * momentum[0]
    assert energy[0] - energy[-1] > 0.03
    assert np.max(np.diff(energy)) < 1e-6 * (energy[0] - energy[-1])


BELTS = {
    "rings": (68146.0, 12.0),
    "rings within a step": (2e6, 60.0),
    "creeps": (2000.0, 900.0),
    "creeps at once": (2000.0, 1e5),
}


@pytest.mark.parametrize("method", [pytest.param(RK4, id="RK4"), pytest.param(MIDPOINT, id="MIDPOINT")])
@pytest.mark.parametrize("name", BELTS)
def test_belt_in_closed_form(name, method):
    """Motor and cart on a belt of any stiffness, one step in 5 ms, against the equations' matrix exponential."""
    stiffness, damping = BELTS[name]
    pull = np.array([[-1.0, 1.0], [1.0, -1.0]]) / np.array([[CART], [MOTOR]])
    system = np.zeros((5, 5))  # cart, motor, their speeds, and the force
    system[:2, 2:4] = np.eye(2)
    system[2:4, :2], system[2:4, 2:4] = stiffness * pull, damping * pull
    system[3, 4] = 1.0 / MOTOR
    onward = scipy.linalg.expm(system * PERIOD)
    volts = np.repeat(np.random.default_rng(3).uniform(-2, 2, 20), 10)
    at = np.array([0.0, 4e-4, 0.1, 0.15, 0.0])
    expected = [at[:2]]
    for u in volts:
        at[4] = 16.0 * u
        at = onward @ at
        expected.append(at[:2])
    belt = ("belt_compliance", "cart", {"stiffness": stiffness, "damping": damping, "motor_mass": MOTOR})
    lane = make_lane(np.stack([volts, np.zeros(200)], axis=1), active=CART_ALONE)
    state = make_state(x=0.0, rates=(0.1, 0, 0), hidden=(4e-4, 0.05))
    motions = simulate(make_plant(belt, **LOSSLESS), state, lane, substeps=1, method=method)
    ours = np.stack([motions.q.x, motions.q.motor], axis=1)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9)


def test_encoder_behind_a_play():
    for encoder in ("cart", "motor"):
        state = {"x": 0.0, "hidden": (GAP / 4, 0.1)}
        q, _, read = run_play(u_x=1.0, count=50, encoder=encoder, state=state)
        assert np.ptp(q.motor - q.x) > 1e-4
        np.testing.assert_allclose(read[:, 0], q.x if encoder == "cart" else q.motor, rtol=0, atol=1e-15)


def test_encoder_behind_a_belt():
    belt = {"stiffness": 2000.0, "damping": 5.0, "motor_mass": MOTOR}
    lane, start = make_lane(lively_inputs(50)), make_state(psi=0.1, hidden=(5e-4, 0.0))
    for encoder in ("cart", "motor"):
        plant = make_plant(("belt_compliance", "cart", belt | {"encoder": encoder}))
        motions = simulate(plant, start, lane, substeps=4, method=RK4)
        expected = motions.q.x if encoder == "cart" else motions.q.motor
        np.testing.assert_allclose(measure(plant, lane, motions)[:, 0], expected, rtol=1e-14)
        assert np.ptp(motions.q.motor - motions.q.x) > 1e-4


def test_an_elastic_rope_hangs_stretched():
    """With the winch locked and nothing moving, the load rests `m2 g/stiffness` below the rope's unstretched length."""
    plant = make_plant(("rope_elasticity", "hoist", {"stiffness": 150.0, "damping": 0.2}))
    lane = make_lane(np.zeros((200, 2)), active=LOCKED_ROPE)
    motions = simulate(plant, make_state(l=0.7, hidden=(0.0, 0.0)), lane, substeps=2, method=RK4)
    hanging = 0.7 + NUMBERS["load_mass"] * NUMBERS["gravity"] / 150.0
    np.testing.assert_allclose(motions.q.loaded, hanging, rtol=1e-13)
    np.testing.assert_array_equal(motions.q.l, 0.7)
    # Pulled down, it bounces about there at its natural period.
    period = 2 * np.pi * np.sqrt(NUMBERS["load_mass"] / 150.0)
    lane = make_lane(np.zeros((200, 2)), period / 200, active=LOCKED_ROPE)
    free = make_plant(("rope_elasticity", "hoist", {"stiffness": 150.0, "damping": 0.0}), **LOSSLESS)
    motions = simulate(free, make_state(l=0.7, hidden=(0.01, 0.0)), lane, substeps=2, method=RK4)
    np.testing.assert_allclose(
        motions.q.loaded[jnp.array([0, 50, 100, 200])] - hanging, [0.01, 0.0, -0.01, 0.01], atol=1e-9
    )


def test_a_short_link_is_a_single_pendulum():
    """A hook all but at the load, at rest against it, swings like a load at their common centre."""
    link, hook = 0.006, 0.07
    plant = make_plant(("double_pendulum", "swing", {"hook_mass": hook, "link": link, "damping": 1e-3}), **LOSSLESS)
    lane = make_lane(np.zeros((200, 2)), active=(0, 1, 0))
    motions = simulate(plant, make_state(psi=0.3, hidden=(0.0, 0.0)), lane, substeps=8, method=RK4)
    total = NUMBERS["load_mass"]
    centre = 0.7 + link * (total - hook) / total
    single = simulate(make_plant(**LOSSLESS), make_state(psi=0.3, l=centre), lane, substeps=8, method=RK4)
    # The spread of the masses about their centre lengthens the period by 1e-4, and the link lags a little.
    np.testing.assert_allclose(motions.q.psi, single.q.psi, atol=2e-3)


def test_hidden_states_come_in_one_order():
    """Motor, loaded rope, link: whatever the order of the effects in a file."""
    effects = [
        ("double_pendulum", "swing", MECHANISMS["double_pendulum"][2]),
        ("rope_elasticity", "hoist", {"stiffness": 140.283, "damping": 0.4}),
        ("belt_compliance", "cart", MECHANISMS["belt_compliance"][2]),
    ]
    state = make_state(0.3, 0.1, 0.7, (0.4, 0.5, 0.6), hidden=(1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3))
    stretch = 0.143 * 9.81 / 140.283
    for listed in (effects, effects[::-1]):
        plant = make_plant(*listed)
        assert len(plant.mechanisms) == 3
        q, v = initial_motion(plant, state, axes(*EVERY_AXIS))
        np.testing.assert_allclose([q.motor, q.loaded, q.phi], [0.301, 0.703 + stretch, 0.105], rtol=1e-14)
        np.testing.assert_allclose([v.motor, v.loaded, v.phi], [0.402, 0.604, 0.506], rtol=1e-14)


WINCH = ("hoist_backlash", "hoist", {"gap": GAP, "motor_mass": 0.06})
HOIST_ALONE = (0.0, 0.0, 1.0)


@pytest.mark.parametrize("substeps", [1, 4])
def test_play_at_the_winch_against_its_events_in_closed_form(substeps):
    """The motor pays out faster than the load falls, waits for it, and hauls it up again."""
    volts = np.repeat(np.random.default_rng(8).uniform(-1.5, 0.9, 40), 10)
    lane = make_lane(np.stack([np.zeros(400), volts], axis=1), active=HOIST_ALONE)
    motions = simulate(
        make_plant(WINCH, **LOSSLESS),
        make_state(hidden=(-0.2 * GAP, -0.05)),
        lane,
        substeps=substeps,
        method=MIDPOINT,
    )
    weight, motor = NUMBERS["load_mass"] * NUMBERS["gravity"], WINCH[2]["motor_mass"]
    carried = NUMBERS["load_mass"] + NUMBERS["winch_mass"] - motor
    start = (0.7 + 0.3 * GAP, -0.05), (0.7, 0.0)
    places = knocked_about(3.0 * volts, np.full(400, PERIOD), *start, (carried, motor), weight)
    apart = np.abs(places[:, 1] - places[:, 0])
    assert np.sum((apart[1:] > 0.999 * GAP / 2) & (apart[:-1] < 0.999 * GAP / 2)) >= 3, "impacts"
    ours = np.stack([motions.q.loaded, motions.q.l], axis=1)
    np.testing.assert_allclose(ours, places, rtol=0, atol=1e-11)


def test_a_load_hangs_at_the_end_of_the_play():
    """With the winch locked the load rests half the gap below, which an encoder at the drum tells."""
    lane = make_lane(np.zeros((100, 2)), active=LOCKED_ROPE)
    for encoder, length in (("motor", 0.7), ("drum", 0.7 + GAP / 2)):
        plant = make_plant((*WINCH[:2], WINCH[2] | {"encoder": encoder}))
        motions = simulate(plant, make_state(psi=0.2), lane, substeps=2, method=RK4)
        np.testing.assert_allclose(motions.q.loaded, 0.7 + GAP / 2, rtol=0, atol=1e-12)
        np.testing.assert_allclose(measure(plant, lane, motions)[:, 2], length, rtol=0, atol=1e-12)


def test_one_of_a_kind():
    for other in (PLAY, ("rope_elasticity", "hoist", MECHANISMS["rope_elasticity"][2])):
        with pytest.raises(ValueError, match="hoist_backlash.*keep one"):
            make_plant(WINCH, other).rope_end
    with pytest.raises(ValueError, match="at most one backlash"):
        make_plant(PLAY, PLAY).drive_train
    with pytest.raises(ValueError, match="keep one"):
        make_plant(PLAY, ("belt_compliance", "cart", MECHANISMS["belt_compliance"][2])).drive_train


def test_a_motor_that_friction_holds_stops_the_cart():
    """Driven one way but held, it is on the other side that the coasting cart comes up against it."""
    gap, friction, drive = 2e-4, 12.0, 10.0
    play = ("backlash", "cart", {"gap": gap, "motor_mass": 0.3})
    plant = make_plant(play, ("coulomb_friction", "cart", {"level": friction}), **LOSSLESS)
    start = make_state(0.0, rates=(0.02, 0.0, 0.0), hidden=(0.0, -0.02))
    volts = np.tile([drive / NUMBERS["cart_gain"], 0.0], (40, 1))
    ends = []
    for substeps in (2, 64):
        motions = simulate(plant, start, make_lane(volts, active=CART_ALONE), substeps=substeps, method=MIDPOINT)
        assert np.max(np.abs(np.asarray(motions.q.motor - motions.q.x))) < gap / 2 + 1e-9, "nothing sinks in"
        ends.append(float(motions.q.x[-1]))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=5e-6)


def test_sides_that_part_and_are_driven_together_again_meet():
    """At contact, moving apart, under a drive that closes the play at once: from then on one body."""
    _, v, _ = run_play(u_x=3.0, count=4, state={"x": 0.0, "hidden": (GAP / 2, -0.01)})
    np.testing.assert_allclose(v.motor[1:], v.x[1:], rtol=0, atol=1e-9)


VIBRATION_SLOPES = [
    jax.jit(jacobian(lambda z: jnp.stack(_vibration(z[0], z[1])))) for jacobian in (jax.jacfwd, jax.jacrev)
]


@pytest.mark.parametrize(
    ("fading", "squared"), [(400.0, 1.5e5), (2000.0, 3.9e6), (1.0, 6.4e5), (0.3, 0.2), (0.3, -0.05), (0.3, 1e-9)]
)
def test_a_vibration_has_gradients(fading, squared):
    """However fast it fades or rings, in both directions of differentiation, on both branches."""
    for sign in (1.0, -1.0):
        for slopes in VIBRATION_SLOPES:
            assert np.all(np.isfinite(slopes(jnp.array([fading, sign * squared]))))
