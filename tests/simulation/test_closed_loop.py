"""The closed loop: the engine's open loop with the same commands, and SciPy with the same law."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jbridge._types import Axes
from jbridge.control.base import AbstractController, Reference
from jbridge.simulation.closed_loop import closed_loop, periods_remembered
from jbridge.simulation.outputs import AbstractSummary, Every
from jbridge.simulation.runge_kutta import RK4
from tests.problems import (
    EVERY_AXIS,
    NUMBERS,
    axes,
    lively_inputs,
    make_lane,
    make_plant,
    make_state,
    measure,
    simulate,
)

PERIOD, SUBSTEPS = 0.02, 4
EFFECTS = [
    ("coulomb_friction", "cart", {"level": 4.0}),
    ("coulomb_friction", "hoist", {"level": 0.5}),
    ("dead_zone", "hoist_drive", {"positive": 0.1, "negative": 0.2}),
    ("actuator_lag", "hoist_drive", {"time_constant": 0.06}),
    ("input_delay", "cart_drive", {"delay": 0.033}),
    ("start_delay", "cart_drive", {"delay": 0.071}),
    ("start_delay", "hoist_drive", {"delay": 0.05}),
    ("sensor_delay", "psi_sensor", {"delay": 0.047}),
    ("sensor_scale", "l_sensor", {"scale": 1.02}),
]


class Script(AbstractController):
    """Plays a table and looks at nothing."""

    table: Any

    def start(self, measured):
        return jnp.asarray(0)

    def command(self, state, measured, reference, period):
        return self.table[state], state + 1


class Proportional(AbstractController):
    """Voltages in proportion to the errors, and against the load's weight."""

    gain: float
    hold: float

    def start(self, measured):
        return None

    def command(self, state, measured, reference, period):
        x, l = reference.x - measured.x, reference.l - measured.l
        return jnp.stack([self.gain * x, self.gain * l + self.hold]), None


class Largest(AbstractSummary):
    """The largest swing, and how many samples there were."""

    def start(self, sample):
        return jnp.zeros(sample.q.psi.shape), jnp.asarray(0)

    def update(self, numbers, sample):
        return jnp.maximum(numbers[0], jnp.abs(sample.q.psi)), numbers[1] + 1

    def finish(self, numbers):
        return numbers


play = eqx.filter_jit(closed_loop)


def resting(count, x=0.3, l=0.7):
    zero = jnp.zeros(count)
    return Reference(zero + x, zero + l, zero, zero)


@pytest.mark.parametrize("effects", [EFFECTS[:4], EFFECTS], ids=["without delays", "with delays"])
def test_a_script_moves_the_plant_as_held_inputs_do(effects):
    """Two routes to one answer: delays, lags, dead zones and sensors included."""
    plant, u, state = make_plant(*effects), lively_inputs(150), make_state(psi=0.1)
    memory = periods_remembered(plant, PERIOD)
    response = play(plant, Script(jnp.asarray(u)), state, resting(150), period=PERIOD, substeps=SUBSTEPS, memory=memory)
    lane = make_lane(u, PERIOD, history=np.zeros((memory, 2)))
    motions = simulate(plant, state, lane, substeps=SUBSTEPS, method=RK4)
    for found, wanted in zip(response.q.axes, motions.q.axes, strict=True):
        np.testing.assert_allclose(found, wanted[:-1], atol=1e-12)
    assert float(jnp.ptp(response.q.x)) > 0.1 and float(jnp.ptp(response.q.l)) > 0.02
    reading = measure(plant, lane, motions)[:-1]
    late = 0 if memory == 0 else memory  # before the first sample one continues the motion, the other rests
    for k, found in enumerate(response.measured):
        np.testing.assert_allclose(found[late:], reading[late:, k], atol=1e-12)


def test_a_sampled_law_agrees_with_scipy():
    """The smooth bridge under a sampled law, integrated by another library from its equations written out again."""
    plant, gain, hold = make_plant(), 8.0, -0.143 * 9.81 / NUMBERS["hoist_gain"]
    count, state = 100, np.array([0.0, 0.15, 0.7, 0.0, 0.0, 0.0])
    response = play(plant, Proportional(gain, hold), jnp.asarray(state), resting(count), period=PERIOD, substeps=16)
    m1, m2, je, g = (NUMBERS[k] for k in ("cart_mass", "load_mass", "winch_mass", "gravity"))

    def rate(t, s, u_x, u_l):
        x, psi, l, dx, dpsi, dl = s
        sin, cos = np.sin(psi), np.cos(psi)
        mass = np.array([[m1 + m2, m2 * l * cos, m2 * sin], [m2 * l * cos, m2 * l * l, 0.0], [m2 * sin, 0.0, m2 + je]])
        force = np.array(
            [
                16.0 * u_x - 45.0 * dx - 2 * m2 * dl * dpsi * cos + m2 * l * dpsi**2 * sin,
                -0.0015 * dpsi - 2 * m2 * l * dl * dpsi - m2 * g * l * sin,
                3.0 * u_l - 25.0 * dl + m2 * l * dpsi**2 + m2 * g * cos,
            ]
        )
        return [dx, dpsi, dl, *np.linalg.solve(mass, force)]

    for k in range(count):
        np.testing.assert_allclose([float(a[k]) for a in response.q.axes], state[:3], atol=1e-8)
        volts = gain * (0.3 - state[0]), gain * (0.7 - state[2]) + hold
        np.testing.assert_allclose(response.command[k], volts, atol=1e-6)
        state = solve_ivp(rate, (0, PERIOD), state, args=volts, rtol=1e-11, atol=1e-12).y[:, -1]


def test_a_delay_must_be_remembered():
    plant = make_plant(*EFFECTS)
    assert periods_remembered(plant, PERIOD) == 7 and periods_remembered(make_plant(), PERIOD) == 0
    with pytest.raises(ValueError, match="memory="):
        closed_loop(plant, Proportional(1.0, 0.0), make_state(), resting(3), period=PERIOD, substeps=2)


def test_a_locked_rope_stays():
    response = play(
        make_plant(), Proportional(8.0, 0.0), make_state(), resting(50, l=0.5), period=PERIOD, substeps=SUBSTEPS,
        active=axes(1.0, 1.0, 0.0),
    )  # fmt: skip
    assert isinstance(response.measured, Axes) and EVERY_AXIS
    np.testing.assert_array_equal(response.q.l, 0.7)


@functools.cache
def cost_and_slope(reverse=False):
    """What a gain costs and its derivative, compiled; `reverse` as in `closed_loop`."""
    plant, reference = make_plant(), resting(60, x=0.5)

    def cost(gain):
        law = Proportional(gain, -0.468)
        how = {"period": PERIOD, "substeps": SUBSTEPS, "reverse": reverse}
        response = closed_loop(plant, law, make_state(), reference, **how)
        return jnp.mean((response.q.x - reference.x) ** 2 + 0.1 * response.q.psi**2)

    return jax.jit(jax.value_and_grad(cost))


def test_the_gradient_of_a_closed_loop_agrees_with_differences():
    """Reverse mode through plant, law and sensors, against central differences."""
    step = 1e-4
    (ahead, _), (behind, _), (_, found) = (cost_and_slope()(gain) for gain in (8.0 + step, 8.0 - step, 8.0))
    assert float(found) == pytest.approx(float(ahead - behind) / (2 * step), rel=1e-6)


def test_forgetting_on_the_way_changes_no_gradient():
    kept, forgotten = (float(cost_and_slope(reverse)(8.0)[1]) for reverse in (False, True))
    assert kept == pytest.approx(forgotten, rel=1e-12)


@pytest.mark.slow
def test_what_is_kept_is_the_callers_choice():
    """Every fifth sample is a part of all of them, and a summary sees each of them once."""
    plant, law, reference = make_plant(), Proportional(8.0, -0.468), resting(53, x=0.6)
    args = (plant, law, make_state(psi=0.05), reference)
    every = play(*args, period=PERIOD, substeps=SUBSTEPS)
    fifth = play(*args, period=PERIOD, substeps=SUBSTEPS, collect=Every(5))
    np.testing.assert_array_equal(fifth.q.x, every.q.x[:50:5])
    largest, count = play(*args, period=PERIOD, substeps=SUBSTEPS, collect=Largest())
    assert float(largest) == float(jnp.max(jnp.abs(every.q.psi))) and int(count) == 53
