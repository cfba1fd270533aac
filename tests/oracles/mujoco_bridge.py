"""The rigid bridge in another engine: slide, hinge, slide in MuJoCo, without friction, drives or sensors.

Import it behind `pytest.importorskip("mujoco")`.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

SCENE = """
<mujoco>
  <option timestep="{step}" integrator="RK4" gravity="0 0 -{gravity}"><flag contact="disable"/></option>
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0" damping="{cart_damping}"/>
      <inertial pos="0 0 0" mass="{cart_mass}" diaginertia="1e-9 1e-9 1e-9"/>
      <body name="load" pos="0 0 -{length}">
        <joint name="psi" type="hinge" axis="0 -1 0" pos="0 0 {length}" damping="{swing_damping}"/>
        <joint name="l" type="slide" axis="0 0 -1" ref="{length}"
               armature="{winch_mass}" damping="{hoist_damping}"/>
        <inertial pos="0 0 0" mass="{load_mass}" diaginertia="1e-12 1e-12 1e-12"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def trajectory(
    bridge: Mapping[str, float],
    state: Sequence[float],
    forces: np.ndarray,
    period: float,
    substeps: int = 10,
) -> np.ndarray:
    """Motion under generalised forces that are held over each period.

    Args:
        bridge: `cart_mass`, `load_mass`, `winch_mass` [kg], `gravity` [m/s^2], `cart_damping`, and
            `hoist_damping` [N s/m], `swing_damping` [N m s]; other keys are ignored.
        state: x [m], psi [rad], l [m] and their rates at the start.
        forces: one row (Q_x [N], Q_psi [N m], Q_l [N]) per period, without the damping (the engine adds it).
        period: how long each row is held [s].
        substeps: engine steps (fourth order) per period.

    Returns:
        One row (x, psi, l, x', psi', l') per period boundary, the start included.
    """
    model = mujoco.MjModel.from_xml_string(SCENE.format(**bridge, step=period / substeps, length=state[2]))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = state[:3], state[3:]
    rows = [np.concatenate([data.qpos, data.qvel])]
    for force in forces:
        data.qfrc_applied[:] = force
        mujoco.mj_step(model, data, substeps)
        rows.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(rows)
