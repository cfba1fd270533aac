"""Other engines on the bare bridge: MuJoCo, plain diffrax, SciPy, and the crane of torch-fis where that is installed.

Each gives the final positions x, psi, l of every lane, and is a function without arguments, so that it can be timed.
"""

import os
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jbridge
from problem import MODES, Bare

STEP = MODES["open"][0]
AGREE = {"mujoco": 1e-6, "diffrax": 1e-4, "scipy": 1e-5, "torch-fis": 1e-6}
"""Largest difference of final positions from jbridge's [m, rad]: MuJoCo and torch-fis have the same method and step,
diffrax a method of order 3, SciPy its own steps."""
SCENE = """
<mujoco>
  <option timestep="{step}" integrator="RK4" gravity="0 0 -{gravity}"><flag contact="disable"/></option>
  <worldbody>
    <body>
      <joint name="x" type="slide" axis="1 0 0" damping="{cart_damping}"/>
      <inertial pos="0 0 0" mass="{cart_mass}" diaginertia="1e-9 1e-9 1e-9"/>
      <body pos="0 0 -{length}">
        <joint name="psi" type="hinge" axis="0 -1 0" pos="0 0 {length}" damping="{swing_damping}"/>
        <joint name="l" type="slide" axis="0 0 -1" ref="{length}" armature="{winch_mass}" damping="{hoist_damping}"/>
        <inertial pos="0 0 0" mass="{load_mass}" diaginertia="1e-12 1e-12 1e-12"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="x"/><motor joint="l"/></actuator>
</mujoco>
"""


def mujoco_batch(given: Bare) -> Callable[[], np.ndarray]:
    """MuJoCo's threaded rollout."""
    import mujoco
    from mujoco import rollout

    model = mujoco.MjModel.from_xml_string(SCENE.format(**given.numbers, step=STEP, length=given.starts[0, 2]))
    threads = os.cpu_count() or 1
    data = [mujoco.MjData(model) for _ in range(threads)]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    first = np.zeros((len(given.starts), size))
    first[:, 1:4] = given.starts  # behind the time
    models = [model] * len(given.starts)

    def run() -> np.ndarray:
        with rollout.Rollout(nthread=threads) as pool:
            states, _ = pool.rollout(models, data, first, given.forces[None])
        return states[:, -1, 1:4]

    return run


def accelerations(bridge: Any, q: Any, v: Any, force: Any) -> list[Any]:
    """The bare bridge's accelerations from its mass matrix, an arrow."""
    m, bias, viscous = bridge.mass_matrix(q), bridge.bias(q, v), bridge.viscous(v)
    x, psi, hoist = (force[0] + viscous.x - bias.x, viscous.psi - bias.psi, force[1] + viscous.l - bias.l)
    a = (x - m.xp / m.pp * psi - m.xl / m.ll * hoist) / (m.xx - m.xp**2 / m.pp - m.xl**2 / m.ll)
    return [a, (psi - m.xp * a) / m.pp, (hoist - m.xl * a) / m.ll]


def diffrax_batch(given: Bare) -> Callable[[], np.ndarray]:
    """`diffeqsolve` with a constant step, a batch by `vmap`."""
    import diffrax

    bridge, forces = jbridge.Bridge(**given.numbers), jnp.asarray(given.forces)

    def field(t: Any, state: Any, args: Any) -> Any:
        # What follows a change counts: the last stage of a step is the first of the next.
        force = forces[jnp.clip(((t - args) / STEP).astype(int), 0, len(forces) - 1)]
        q, v = jbridge.Axes(*state[:3]), jbridge.Axes(*state[3:])
        return jnp.stack([*v, *accelerations(bridge, q, v, force)])

    def one(start: Any) -> Any:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Bosh3(),
            0.0,
            STEP * len(given.forces),
            STEP,
            jnp.concatenate([start, jnp.zeros(3)]),
            args=-1e-9,
            saveat=diffrax.SaveAt(t1=True),
            stepsize_controller=diffrax.ConstantStepSize(),
            max_steps=len(given.forces) + 1,
        )
        return found.ys[0, :3]

    batch, starts = jax.jit(jax.vmap(one)), jnp.asarray(given.starts)
    return lambda: np.asarray(batch(starts))


def scipy_batch(given: Bare) -> Callable[[], np.ndarray]:
    """`solve_ivp` on one lane after the other, anew wherever the forces change."""
    from scipy.integrate import solve_ivp

    n = given.numbers
    mass, carts = n["load_mass"], n["cart_mass"] + n["load_mass"]

    def field(t: float, y: np.ndarray, force: np.ndarray) -> list[float]:
        _, psi, length, vx, rate, vl = y
        s, c = np.sin(psi), np.cos(psi)
        xp, xl, pp, ll = mass * length * c, mass * s, mass * length**2, mass + n["winch_mass"]
        x = force[0] - n["cart_damping"] * vx - mass * (2 * vl * rate * c - length * rate**2 * s)
        p = -n["swing_damping"] * rate - mass * length * (2 * vl * rate + n["gravity"] * s)
        h = force[1] - n["hoist_damping"] * vl + mass * (length * rate**2 + n["gravity"] * c)
        a = (x - xp / pp * p - xl / ll * h) / (carts - xp**2 / pp - xl**2 / ll)
        return [vx, rate, vl, a, (p - xp * a) / pp, (h - xl * a) / ll]

    def run() -> np.ndarray:
        final = []
        for start in given.starts:
            state = np.concatenate([start, np.zeros(3)])
            for begin in range(0, len(given.forces), given.held):
                span = STEP * min(given.held, len(given.forces) - begin)
                force = given.forces[begin]
                state = solve_ivp(field, (0.0, span), state, args=(force,), rtol=1e-6, atol=1e-9).y[:, -1]
            final.append(state[:3])
        return np.array(final)

    return run


def torch_crane(given: Bare) -> tuple[Callable[[], np.ndarray], Callable[[], Any]]:
    """torch-fis' crane with a hoist (no winch, damping of the cart alone): forward, and with a gradient by the forces.

    Raises:
        ImportError: it is not installed.
    """
    import torch
    from fuzzy_torch.envs.core.integrate import rk4_step
    from fuzzy_torch.envs.plants.crane import CranePlant

    n = given.numbers
    crane = CranePlant(
        trolley_mass=n["cart_mass"],
        payload_mass=n["load_mass"],
        gravity=n["gravity"],
        trolley_damping=n["cart_damping"],
        hoist=True,
    ).double()
    # Its constructor rounds numbers to single precision.
    for own, name in (("M", "cart_mass"), ("m", "load_mass"), ("g", "gravity"), ("b_x", "cart_damping")):
        setattr(crane, own, torch.tensor(n[name], dtype=torch.float64))
    start = torch.zeros((len(given.starts), 6), dtype=torch.float64)
    start[:, [0, 2, 4]] = torch.from_numpy(given.starts)

    def motion(forces: Any) -> Any:
        state = start
        for force in forces:
            state = rk4_step(crane.derivatives, state, force, STEP)
        return state[:, [0, 2, 4]]

    def run() -> np.ndarray:
        with torch.no_grad():
            return motion(torch.from_numpy(given.forces)).numpy()

    def gradient() -> Any:
        forces = torch.from_numpy(given.forces).requires_grad_()
        (motion(forces) ** 2).sum().backward()
        return forces.grad

    return run, gradient
