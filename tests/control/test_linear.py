"""Linear laws by hand, and input shaping against an integrator of SciPy's."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jbridge import Axes, Path, Reference
from jbridge.control.compensation import Compensation
from jbridge.control.extended_rules import extended_controller
from jbridge.control.fuzzy import FuzzyController
from jbridge.control.linear import Pid, StateFeedback
from jbridge.control.paper_rules import hoist_system, paper_controller
from jbridge.control.shaping import shaped
from jbridge.fuzzy.check import outdone_rules
from jbridge.trajectory import smooth_path

AT = Axes(jnp.asarray(0.4), jnp.asarray(0.02), jnp.asarray(0.5))
WANTED = Reference(jnp.asarray(0.5), jnp.asarray(0.45), jnp.asarray(0.1), jnp.asarray(0.0))


def test_pid_by_hand():
    law = Pid(cart_p=10.0, cart_i=2.0, cart_d=1.0, hoist_p=20.0, hoist_i=0.0, hoist_d=0.5)
    command, state = law.command(law.start(AT), AT, WANTED, 0.02)
    np.testing.assert_allclose(command, [10 * 0.1 + 2 * 0.1 * 0.02 + 0.1, -20 * 0.05], rtol=1e-12)
    again, _ = law.command(state, AT, WANTED, 0.02)
    np.testing.assert_allclose(again[0] - command[0], 2 * 0.1 * 0.02, rtol=1e-9)


def test_integrals_stay_within_the_drives_limits():
    """1 V/(m s) of 0.1 m adds up to 5 V in 50 s, of which a drive has as many as its file says."""
    far = Reference(jnp.asarray(0.5), AT.l, jnp.asarray(0.0), jnp.asarray(0.0))
    for given, most in ((Compensation(), 3.0), (Compensation(cart_limit=24.0), 5.0)):
        law = Pid(cart_p=0.0, cart_i=1.0, cart_d=0.0, compensation=given)
        _, state = law.command(law.start(AT), AT, far, 50.0)
        np.testing.assert_allclose(state.sums[0], most, rtol=1e-9)


def test_a_fuzzy_command_ends_at_the_drives_limits_as_others_do():
    """The hoist's system, of 10 V, on a cart whose drive has 3 V; a file may say that it has more."""
    law = FuzzyController(hoist_system(), hoist_system())
    far = Reference(jnp.asarray(5.0), AT.l, jnp.asarray(0.0), jnp.asarray(0.0))
    command, _ = law.command(law.start(AT), AT, far, 0.02)
    assert command[0] == 3.0
    stronger = dataclasses.replace(law, compensation=Compensation(cart_limit=24.0))
    assert stronger.command(law.start(AT), AT, far, 0.02)[0][0] > 6.0


def test_state_feedback_by_hand_and_within_limits():
    gains = jnp.asarray([[10.0, 5.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 300.0, 0.0, 0.0, 0.0]])
    law = StateFeedback(gains)
    command, _ = law.command(law.start(AT), AT, WANTED, 0.02)
    # The rope is 5 cm too long: 15 V, of which the drive has 10.
    np.testing.assert_allclose(command, [10 * 0.1 - 5 * 0.02 + 0.1, -10.0], rtol=1e-12)


def test_what_friction_takes_is_given_back():
    give = Compensation(cart=0.3, hoist=1.0, hoist_bias=-0.5, blur=0.01)
    np.testing.assert_allclose(give(jnp.asarray([1.0, -2.0])), [1.3, -3.5], rtol=1e-9)
    np.testing.assert_allclose(give(jnp.zeros(2)), [0.0, -0.5], atol=1e-12)


def swing_after(path: Path, frequency: float, length: float = 0.5) -> float:
    """Amplitude of a linear pendulum's swing [rad] once its pivot has stopped."""
    acceleration = np.gradient(path.v_x, path.times)

    def rates(t, state):
        push = np.interp(t, path.times, acceleration)
        return [state[1], -(frequency**2) * state[0] - push / length]

    end = path.times[-1]
    found = solve_ivp(rates, (0.0, end), [0.0, 0.0], rtol=1e-9, atol=1e-12, max_step=0.01)
    return float(np.hypot(found.y[0, -1], found.y[1, -1] / frequency))


def test_shaping_leaves_no_swing():
    path = smooth_path(((0.0, 0.5), (0.6, 0.5)), speed=(0.8, 0.2), rest=1.0, period=0.005)
    frequency = np.sqrt(9.81 / 0.5)
    plain = swing_after(path, frequency)
    for kind in ("zv", "zvd"):
        found = shaped(path, frequency, kind=kind)
        assert found.x[-1] == pytest.approx(0.6, abs=1e-9) and found.v_x[-1] == pytest.approx(0.0, abs=1e-9)
        assert swing_after(found, frequency) < 0.02 * plain
    # If the rope is a fifth shorter than thought, ZVD forgives more than ZV.
    other = np.sqrt(9.81 / 0.4)
    left = {kind: swing_after(shaped(path, frequency, kind=kind), other) for kind in ("zv", "zvd")}
    assert left["zvd"] < 0.5 * left["zv"]
    with pytest.raises(ValueError, match="neither of zv, zvd"):
        shaped(path, frequency, kind="ei")
    for wrong, damping in ((0.0, 0.0), (np.nan, 0.0), (frequency, 1.0)):
        with pytest.raises(ValueError, match="give at least 0.01 rad/s"):
            shaped(path, wrong, damping)


def test_in_the_extended_rules_every_rule_can_matter():
    assert outdone_rules(paper_controller().cart) and not outdone_rules(extended_controller().cart)
    cart = extended_controller().cart
    rest = np.asarray(cart.infer(jnp.zeros(3)).output)[0]
    swung = np.asarray(cart.infer(jnp.asarray([0.0, 0.0, 10.0])).output)[0]
    fast = np.asarray(cart.infer(jnp.asarray([0.0, 0.3, 0.0])).output)[0]
    # The cart follows the load, and brakes.
    assert abs(rest) < 1e-9 and swung > 0.1 and fast < -0.1


def test_the_extended_rules_are_asked_with_the_speed_beyond_the_references():
    """At the reference's place and speed nothing is wanted but what holds the load; standing there, it is late."""
    give = Compensation(cart=0.3, hoist=1.0, hoist_bias=-0.5)
    law = extended_controller(give)
    there = Axes(jnp.asarray(0.5), jnp.asarray(0.0), jnp.asarray(0.45))
    moving = Axes(jnp.asarray(0.1), jnp.asarray(0.0), jnp.asarray(0.0))
    before = Axes(there.x - 0.02 * 0.1, there.psi, there.l)
    state = (before, moving)
    command, _ = law.command(state, there, WANTED, 0.02)
    np.testing.assert_allclose(command, [0.0, -0.5], atol=1e-9)
    late, _ = law.command(law.start(there), there, WANTED, 0.02)
    assert float(late[0]) > 0.3
    asked, _ = law.inputs(*(jax.tree.map(lambda leaf: leaf[None], tree) for tree in (there, WANTED)), 0.02)
    np.testing.assert_allclose(asked[0], [0.0, -0.1, 0.0], atol=1e-12)
