"""On a graphics processor rollouts, gradients and sweeps give what they give on a processor."""

import dataclasses
import json
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jbridge
from jbridge.simulation.outputs import Every
from tests.problems import lively_inputs, make_plant


def device(platform):
    try:
        return jax.devices(platform)[0]
    except RuntimeError:
        return None


GPU, CPU = device("gpu"), device("cpu")
pytestmark = pytest.mark.skipif(GPU is None or CPU is None, reason="JAX sees no graphics processor")

PERIOD, COUNT, LANES = 0.005, 200, 64
SEED = np.random.default_rng(0)
STARTS = np.zeros((LANES, 6))
STARTS[:, :3] = [0.3, 0.0, 0.6] + SEED.uniform(-0.1, 0.1, (LANES, 3))


def on_both(function, *args):
    """What a function returns on either device, as NumPy arrays."""
    found = []
    for place in (GPU, CPU):
        with jax.default_device(place):
            found.append(jax.tree.map(np.asarray, jax.jit(function)(*jax.device_put(args, place))))
    return found


@pytest.mark.parametrize(
    "effects",
    [
        (
            ("position_direction_friction", "cart",
             {"knots": [0.2, 0.35, 0.6], "positive": [3.0, 4.0, 5.0], "negative": [5.0, 4.0, 3.0]}),
            ("coulomb_friction", "hoist", {"level": 2.0}),
        ),
        (
            ("backlash", "cart", {"gap": 0.004, "motor_mass": 1.5}),
            ("input_delay", "hoist_drive", {"delay": 0.013}),
            ("actuator_lag", "hoist_drive", {"time_constant": 0.05}),
        ),
    ],
    ids=["friction", "drives"],
)  # fmt: skip
def test_rollouts_agree(effects):
    plant, volts = make_plant(*effects), lively_inputs(COUNT)

    def batch(plant, starts, volts):
        def one(start):
            whole = jnp.zeros(plant.states).at[:6].set(start)
            run = jbridge.play(plant, whole, volts, period=PERIOD, substeps=2, collect=Every(20))
            return jnp.stack(run.q.axes)

        return jax.vmap(one)(starts)

    on_gpu, on_cpu = on_both(batch, plant, STARTS, volts)
    assert np.ptp(on_cpu, axis=-1).max() > 0.01
    np.testing.assert_allclose(on_gpu, on_cpu, atol=1e-9)


def closed_cost(controller, damping, starts):
    """Mean square of a move's errors under fuzzy controllers, over a batch."""
    plant = jbridge.with_values(make_plant(("coulomb_friction", "cart", {"level": 4.0})), {"cart_damping": damping})
    count = 100
    still = jnp.zeros(count)
    reference = jbridge.Reference(jnp.full(count, 0.5), jnp.full(count, 0.6), still, still)

    def one(start):
        run = jbridge.closed_loop(plant, controller, start, reference, period=0.02, substeps=4, reverse=True)
        return jnp.mean((run.q.x - 0.5) ** 2 + run.q.psi**2)

    return jnp.mean(jax.vmap(one)(starts))


def test_gradients_of_closed_loops_agree():
    """By numbers at which the cost is smooth: a breakpoint on a node of the output's grid has two slopes."""
    controller = dataclasses.replace(jbridge.paper_controller(), softness=0.05)

    def cost(damping, scale, weights, starts):
        law = eqx.tree_at(lambda c: c.cart_scale, controller, scale)
        law = eqx.tree_at(lambda c: [rule.weight for rule in c.cart.rules], law, list(weights))
        return closed_cost(law, damping, starts)

    numbers = jnp.asarray(45.0), controller.cart_scale, jnp.array([rule.weight for rule in controller.cart.rules])
    on_gpu, on_cpu = on_both(jax.value_and_grad(cost, argnums=(0, 1, 2)), *numbers, STARTS)
    assert all(np.abs(slope).max() > 1e-6 for slope in on_cpu[1])
    for one, other in zip(jax.tree.leaves(on_gpu), jax.tree.leaves(on_cpu), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-12)


def test_a_sweep_gives_the_same_table(tmp_path):
    (tmp_path / "model.toml").write_text(
        "[bridge]\ncart_mass = 5.5\nload_mass = 0.143\ncart_gain = 16.0\nhoist_gain = 3.0\nwinch_mass = 0.1\n"
        "cart_damping = 45.0\nswing_damping = 0.0015\nhoist_damping = 25.0\n"
    )
    (tmp_path / "spec.toml").write_text(
        'model = "model.toml"\nchunk = 32\n[reference]\nstart = [0.0, 0.4]\ngoal = [0.3, 0.5]\nrest = 2.0\n'
        '[sample]\nkind = "latin"\ncount = 64\nseed = 5\n[[vary]]\nname = "cart_damping"\nlow = 30.0\nhigh = 60.0\n'
    )
    jbridge.run_sweep(jbridge.load_sweep(tmp_path / "spec.toml"), tmp_path / "cpu")
    command = [sys.executable, "-m", "jbridge", "sweep", tmp_path / "spec.toml", "--gpu", "--out", tmp_path / "gpu"]
    subprocess.run(command, check=True)
    assert json.loads((tmp_path / "gpu.sweep.json").read_text())["device"] == GPU.device_kind
    on_gpu, on_cpu = (jbridge.read_sweep(tmp_path / name) for name in ("gpu", "cpu"))
    for name in on_cpu:
        np.testing.assert_allclose(on_gpu[name], on_cpu[name], rtol=1e-6, atol=1e-8, err_msg=name)
