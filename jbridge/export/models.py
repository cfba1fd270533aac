"""Models for MuJoCo, for linear control design in Python, and for MATLAB.

Other programs have the rigid bridge with its viscous damping and its gains. Of the effects MuJoCo has constant dry
friction alone, the linear system has none; each text names in a comment what it leaves out.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import AXIS_OF_EQUATION, Axes
from ..model.bridge import Bridge, inverse
from ..model.effects.base import AbstractEffect, unit_at
from ..model.effects.friction import CoulombFriction
from ..model.fields import options_of, parameters_of
from ..model.files import HOIST, Model

_UNITS = {"x": "m", "psi": "rad", "l": "m"}


def mujoco_xml(model: Model, rope: float) -> str:
    """The bridge in MuJoCo's XML (MJCF): joints `x`, `psi`, `l`, and a motor for each voltage.

    A locked rope has no joint. Positions of joints are the coordinates of jbridge, and controls are the inputs.
    Constant dry friction is a `frictionloss`, which MuJoCo softens: a joint that should hold creeps.

    Args:
        model: with a cart and a load.
        rope: length of the rope at the start [m].
    """
    bridge = model.plant.bridge
    number = {name: repr(float(getattr(bridge, name))) for name in parameters_of(Bridge)}
    dry = {
        joint: repr(sum(float(e.level) for e in model.plant.all(CoulombFriction, site)))
        for site, joint in AXIS_OF_EQUATION.items()
    }
    left_out = _names([e for e in model.plant.effects if not isinstance(e, CoulombFriction)])
    comment = f"\n  <!-- Without {left_out}, for which MuJoCo has no element. -->" if left_out else ""
    length = repr(rope)
    winch = f"""
        <joint name="l" type="slide" axis="0 0 -1" ref="{length}" armature="{number["winch_mass"]}"
               damping="{number["hoist_damping"]}" frictionloss="{dry["l"]}"/>"""
    motor = f"""
    <motor name="u_l" joint="l" gear="{number["hoist_gain"]}"/>"""
    encoder = """
    <jointpos name="l" joint="l"/>"""
    if not model.has_hoist:
        winch = motor = encoder = ""
    return f"""\
<mujoco model="bridge">{comment}
  <!-- Coordinates: {_coordinates(model)}. Controls: {_inputs(model)}. {_held(model, rope)}. -->
  <option timestep="0.001" integrator="RK4" gravity="0 0 -{number["gravity"]}">
    <flag contact="disable"/>
  </option>
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0" damping="{number["cart_damping"]}" frictionloss="{dry["x"]}"/>
      <inertial pos="0 0 0" mass="{number["cart_mass"]}" diaginertia="1e-9 1e-9 1e-9"/>
      <geom type="box" size="0.1 0.05 0.04" contype="0" conaffinity="0"/>
      <body name="load" pos="0 0 -{length}">
        <joint name="psi" type="hinge" axis="0 -1 0" pos="0 0 {length}" damping="{number["swing_damping"]}"
               frictionloss="{dry["psi"]}"/>{winch}
        <inertial pos="0 0 0" mass="{number["load_mass"]}" diaginertia="1e-12 1e-12 1e-12"/>
        <geom type="sphere" size="0.04" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="u_x" joint="x" gear="{number["cart_gain"]}"/>{motor}
  </actuator>
  <sensor>
    <jointpos name="x" joint="x"/>
    <jointpos name="psi" joint="psi"/>{encoder}
  </sensor>
</mujoco>
"""


def state_space(
    bridge: Bridge, rope: float, axes: Sequence[str] = ("x", "psi", "l")
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The bridge about the load hanging still: `s' = A s + B (u - rest)`, in continuous time.

    Args:
        bridge: its numbers.
        rope: length of the rope at the working point [m].
        axes: those that move; without `l` the rope is locked.

    Returns:
        `A` `(6, 6)` and `B` `(6, 2)`, of the axes' positions and their rates less the working point; `(4, 4)` and
        `(4, 1)` where the rope is locked.
    """
    moving = Axes(*(jnp.asarray(float(axis in axes)) for axis in _UNITS))

    def rates(state: jax.Array, volts: jax.Array) -> jax.Array:
        q, v = Axes(*state[:3]), Axes(*state[3:])
        drive = Axes(bridge.cart_gain * volts[0], jnp.zeros(()), bridge.hoist_gain * volts[1])
        force = Axes(*(d + f - b for d, f, b in zip(drive, bridge.viscous(v), bridge.bias(q, v), strict=True)))
        return jnp.stack([*v, *(inverse(bridge.mass_matrix(q), moving) @ force)])

    still = jnp.zeros(6).at[2].set(rope)
    a, b = jax.jit(jax.jacfwd(rates, (0, 1)))(still, jnp.asarray(_rest(bridge)))
    kept = [k for k, axis in enumerate((*_UNITS, *_UNITS)) if axis in axes]
    driven = [k for k, axis in enumerate(("x", "l")) if axis in axes]
    return np.asarray(a)[np.ix_(kept, kept)], np.asarray(b)[np.ix_(kept, driven)]


def _drives(model: Model) -> tuple[str, ...]:
    return ("u_x", "u_l") if model.has_hoist else ("u_x",)


def _inputs(model: Model) -> str:
    """The inputs with their units."""
    return ", ".join(f"{name} [{model.units.get(name, 'V')}]" for name in _drives(model))


def _coordinates(model: Model) -> str:
    """The axes that move, with their units."""
    return ", ".join(f"{axis} [{_UNITS[axis]}]" for axis in model.axes)


def _states(model: Model) -> list[str]:
    """Of the linear system: positions and their rates."""
    return [*model.axes, *(f"v_{axis}" for axis in model.axes)]


def _rest(bridge: Bridge) -> tuple[float, float]:
    """Inputs at which the load hangs still, in the unit of the gains."""
    return 0.0, -float(bridge.load_mass * bridge.gravity / bridge.hoist_gain)


def _at_rest(model: Model, rope: float) -> dict[str, float]:
    """The working point."""
    inputs = dict(zip(_drives(model), _rest(model.plant.bridge), strict=False))
    return {"x": 0.0, "psi": 0.0, "l": rope, **inputs}


def _held(model: Model, rope: float) -> str:
    """What holds the load."""
    if not model.has_hoist:
        return f"The rope is locked at {rope!r} m"
    return f"At rest u_l is {_rest(model.plant.bridge)[1]:.6g}"


def state_space_module(model: Model, rope: float) -> str:
    """A Python module with the matrices of `state_space`, and a function that gives them as `control.StateSpace`."""
    a, b = state_space(model.plant.bridge, rope, model.axes)
    axes = list(model.axes)
    left_out = _names(model.plant.effects)
    without = f"\n\nWithout {left_out}, which a linear system does not have." if left_out else ""
    return f'''"""A loading bridge, linearised about the load hanging still on {rope!r} m of rope, in continuous time.

States: {_coordinates(model)} and their rates, less the working point. Inputs: {_inputs(model)}, less those at rest.
Outputs: {", ".join(axes)}, less the working point. {_held(model, rope)}.{without}
"""

import numpy as np

A = np.array({_rows(a, ",")})
B = np.array({_rows(b, ",")})
C = np.eye({len(axes)}, {2 * len(axes)})
D = np.zeros(({len(axes)}, {len(_drives(model))}))
AT_REST = {_at_rest(model, rope)!r}


def system():
    """The same for the package python-control."""
    import control

    states = {_states(model)!r}
    return control.ss(A, B, C, D, inputs={list(_drives(model))!r}, outputs={axes!r}, states=states)
'''


def matlab_function(model: Model, name: str, rope: float) -> str:
    """A MATLAB function that returns the model's numbers, and its linear system about the load hanging still.

    Args:
        model: with a cart and a load.
        name: of the function and its file.
        rope: length of the rope at the working point [m].
    """
    bridge, axes = model.plant.bridge, model.axes
    lines = [
        f"function model = {name}()",
        "% A loading bridge, written by jbridge. SI units, angles in rad.",
        "% model.A, B, C, D: the bridge without its effects about the load hanging still, continuous time;",
        f"% states {', '.join(axes)} and their rates, inputs {_inputs(model)}, outputs {', '.join(axes)}, all less",
        f"% model.at_rest. {_held(model, rope)}.",
    ]
    for key, info in parameters_of(Bridge).items():
        if key in HOIST and not model.has_hoist:
            continue
        unit = info.unit.format(**({"u_x": "V", "u_l": "V"} | dict(model.units)))
        lines.append(f"model.{key} = {float(getattr(bridge, key))!r}; % [{unit}] {info.doc}")
    for number, effect in enumerate(model.plant.effects, start=1):
        lines.append(f"model.effect{{{number}}}.kind = '{effect.kind}';")
        lines.append(f"model.effect{{{number}}}.site = '{effect.site}';")
        for key, info in parameters_of(type(effect)).items():
            value = np.asarray(getattr(effect, info.name), float)
            unit = unit_at(info.unit, effect.site, model.units)
            lines.append(f"model.effect{{{number}}}.{key} = {_matlab(value)}; % [{unit}] {info.doc}")
        for key, choices in options_of(type(effect)).items():
            lines.append(f"model.effect{{{number}}}.{key} = '{choices[round(float(getattr(effect, key)))]}';")
    a, b = state_space(bridge, rope, axes)
    for key, matrix in (("A", a), ("B", b), ("C", np.eye(len(axes), len(a))), ("D", np.zeros((len(axes), b.shape[1])))):
        lines.append(f"model.{key} = {_rows(matrix, ';')};")
    place = ", ".join(f"'{key}', {value!r}" for key, value in _at_rest(model, rope).items())
    lines.append(f"model.at_rest = struct({place});")
    return "\n".join([*lines, "end", ""])


def _matlab(value: NDArray[np.float64]) -> str:
    texts = [repr(float(each)).replace("nan", "NaN").replace("inf", "Inf") for each in np.atleast_1d(value)]
    return texts[0] if value.ndim == 0 else f"[{', '.join(texts)}]"


def _rows(matrix: NDArray[np.float64], end: str) -> str:
    """A matrix in Python's notation (`,` between rows) or MATLAB's (`;`)."""
    rows = [", ".join(repr(float(value) + 0.0) for value in row) for row in matrix]
    if end == ";":
        return "[" + ";\n    ".join(rows) + "]"
    return "[" + "".join(f"\n    [{row}]," for row in rows) + "\n]"


def _names(effects: Sequence[AbstractEffect]) -> str:
    return ", ".join(f"{effect.kind} at {effect.site}" for effect in effects).replace("--", "-")
