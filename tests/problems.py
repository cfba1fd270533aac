"""Cases that several tests share: a laboratory bridge, lanes of held inputs, and the engine compiled at its edge."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from jbridge._types import Axes
from jbridge.model.bridge import Bridge
from jbridge.model.effects.base import AXIS_OF_SITE, AbstractEffect, AbstractMechanism
from jbridge.model.effects.cable import CableDrag
from jbridge.model.effects.catalogue import KINDS, make_effect
from jbridge.model.effects.motors import SpeedDrive
from jbridge.model.equations import Stage, Step, accelerations
from jbridge.model.fields import options_of, parameters_of
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Motion, Plant
from jbridge.simulation.inputs import Lane
from jbridge.simulation.measurement import readings
from jbridge.simulation.rollout import rollout

PERIOD = 0.005
"""Sampling period of the rig [s]."""

NUMBERS = {
    "cart_mass": 5.5,
    "load_mass": 0.143,
    "winch_mass": 0.1,
    "gravity": 9.81,
    "cart_damping": 45.0,
    "swing_damping": 0.0015,
    "hoist_damping": 25.0,
    "cart_gain": 16.0,
    "hoist_gain": 3.0,
}
"""The paper's bridge with the assumed values of what the paper does not give, SI and volts."""


def model_text(*effects: tuple[str, str, dict]) -> str:
    """A model file of this bridge with effects, each as `(kind, site, parameters)`."""
    lines = ["[bridge]", *(f"{key} = {value}" for key, value in NUMBERS.items())]
    for kind, site, values in effects:
        numbers = (f"{key} = {value}" for key, value in values.items())
        lines += ["[[effect]]", f'kind = "{kind}"', f'site = "{site}"', *numbers]
    return "\n".join([*lines, ""])


LOSSLESS = {"cart_damping": 0.0, "swing_damping": 0.0, "hoist_damping": 0.0}

EVERY_AXIS = (1.0, 1.0, 1.0)
LOCKED_ROPE = (1.0, 1.0, 0.0)
CART_ALONE = (1.0, 0.0, 0.0)
FIXED_CART = (0.0, 1.0, 1.0)


def make_bridge(**changes: float) -> Bridge:
    return Bridge(**(NUMBERS | changes))


def make_plant(*effects: tuple[str, str, dict] | AbstractEffect, **changes: float) -> Plant:
    """The laboratory bridge with effects, each as `(kind, site, parameters)`, and with some numbers changed."""
    built = (effect if isinstance(effect, AbstractEffect) else make_effect(*effect) for effect in effects)
    return Plant(make_bridge(**changes), tuple(built))


def make_lane(
    u: ArrayLike,
    period: float | Sequence[float] = PERIOD,
    *,
    active: Sequence[float] = EVERY_AXIS,
    start: float = 0.0,
    history: ArrayLike = (),
) -> Lane:
    """A lane of held inputs.

    Args:
        u: one row `(u_x, u_l)` [V] per interval.
        period: length of every interval, or of each [s].
        active: which axes move.
        start: time of the first sample [s].
        history: rows of inputs before the lane, at the first interval's length.
    """
    rows = np.asarray(u, dtype=float)
    dt = np.broadcast_to(np.asarray(period, dtype=float), len(rows))
    past = np.asarray(history, dtype=float).reshape(-1, 2)
    return Lane(
        jnp.asarray(start),
        jnp.asarray(dt),
        jnp.asarray(np.concatenate([past, rows])),
        jnp.full(len(past), dt[0]),
        Axes(*(jnp.asarray(float(flag)) for flag in active)),
    )


def make_state(
    x: float = 0.3,
    psi: float = 0.0,
    l: float = 0.7,
    rates: Sequence[float] = (0.0, 0.0, 0.0),
    hidden: Sequence[float] = (),
) -> jnp.ndarray:
    """An initial-state vector [m, rad, m] with its rates, then each hidden deflection and its rate."""
    return jnp.asarray([x, psi, l, *rates, *hidden], dtype=float)


def lively_inputs(count: int, *, hold: int = 20, seed: int = 0) -> np.ndarray:
    """Voltages that change every `hold` intervals and move both drives, as `(count, 2)` [V]."""
    key = np.random.default_rng(seed)
    steps = key.uniform(-1.0, 1.0, (-(-count // hold), 2)) * [3.0, 1.2] + [0.0, -0.4]
    return np.repeat(steps, hold, axis=0)[:count]


simulate = eqx.filter_jit(rollout)
"""The engine, compiled."""


@eqx.filter_jit
def measure(plant: Plant, lane: Lane, motions):
    """What the encoders report, compiled."""
    return readings(plant, lane, motions)


@eqx.filter_jit
def accelerate(plant: Plant, q: Motion, v: Motion, volts: Axes, active: Axes, t=0.0, z=None, h=1e-9) -> Motion:  # noqa: PLR0913
    """The plant's accelerations at one instant, friction judged from the velocities there."""
    time, step = jnp.asarray(t, dtype=float), jnp.asarray(h, dtype=float)
    return accelerations(plant, Stage(time, q, v, volts, z), Step(q, v, step, active, jnp.asarray(True)))


def motion(*values: float) -> Motion:
    """Positions or velocities `x, psi, l` and, in this order, `motor, loaded, phi` where they are not None."""
    return Motion(*(None if value is None else jnp.asarray(float(value)) for value in values))


def axes(*values: float) -> Axes:
    return Axes(*(jnp.asarray(float(value)) for value in values))


def paths(motions) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of the axes at the samples, as NumPy `(sample, 3)`."""
    return np.stack(motions.q.axes, axis=1), np.stack(motions.v.axes, axis=1)


_SHAPES = {"knots": [0.2, 0.35, 0.6], "places": [0.2, 0.35, 0.6], "speeds": [-0.2, 0.1, 0.4]}
"""Knots over what `make_state` and the lively inputs cover."""


def null_effect(kind: str, site: str) -> AbstractEffect:
    """An effect at the values at which it does nothing."""
    values: dict = {}
    for key, info in parameters_of(KINDS[kind]).items():
        if info.vector:
            values[key] = _SHAPES[key] if key in _SHAPES else [info.null] * 3
        elif key == "length":
            values[key] = 0.65
    return make_effect(kind, site, values)


_APART = (AbstractMechanism, CableDrag, SpeedDrive)
PLACES = [(kind, site) for kind, cls in KINDS.items() for site in cls.sites if not issubclass(cls, _APART)]
"""Every kind at every site, but for mechanisms and speed loops, and of two hidden springs but the one."""


class Everything:
    """The bridge with every effect but the mechanisms, as a vector of parameters: one program serves them all.

    `Everything().having(kind, site, values)` is that vector with one effect at its values and the others at null.
    """

    def __init__(self, **changes: float):
        self.plant = make_plant(*(null_effect(kind, site) for kind, site in PLACES), **changes)
        self.table = ParameterTable(self.plant)
        self.null = np.array(self.table.ravel(self.plant))

    def having(self, kind: str, site: str, values: Mapping) -> np.ndarray:
        vector = self.null.copy()
        for key, value in values.items():
            words = options_of(KINDS[kind]).get(key)
            if words is None:
                vector[self.table.positions(f"{kind}@{site}.{key}")] = value
            else:
                vector[self.table.option_place(f"{kind}@{site}.{key}")] = words.index(value)
        return vector


FORCE = {"x": 1.0, "psi": 1e-3, "l": 1.0}
"""Size of friction that slows each axis without stopping it [N, N m, N]."""
KNOTS = {"x": [0.25, 0.36, 0.47], "psi": [-0.2, 0.03, 0.2], "l": [0.6, 0.713, 0.9]}
SPEED = {"x": 0.3, "psi": 1.0, "l": 0.1}


def example(kind: str, site: str) -> dict:
    """Parameters at which an effect shows, of the size that its site asks for."""
    axis = AXIS_OF_SITE[site]
    f, v = FORCE[axis], SPEED[axis]
    return {
        "coulomb_friction": {"level": f},
        "stribeck_friction": {"level": 0.5 * f, "breakaway": f, "velocity": v},
        "direction_dependent_friction": {"positive": f, "negative": 0.7 * f},
        "position_dependent_friction": {"knots": KNOTS[axis], "levels": [0.5 * f, f, 0.3 * f]},
        "position_direction_friction": {
            "knots": KNOTS[axis],
            "positive": [0.5 * f, f, 0.3 * f],
            "negative": [0.2 * f, 0.4 * f, f],
        },
        "load_dependent_friction": {"level": 0.4 * f, "share": 0.05 * f},
        "presliding_friction": {"level": 2.0, "stiffness": 300.0},
        "quadratic_drag": {"coefficient": 4.0},
        "friction_drift": {"level": 0.5, "rate": 0.8},
        "constant_force": {"level": f},
        "rail_inclination": {"knots": KNOTS[axis], "forces": [0.5, -0.6, 0.3]},
        "spring_force": {"stiffness": 9.0, "rest": 0.1},
        "periodic_force": {"amplitude": 0.8, "period": 0.07, "phase": 0.5},
        "end_stop": {"position": 0.36, "stiffness": 600.0, "damping": 8.0},
        "load_drag": {"coefficient": 0.05},
        "wind": {"force": 0.2, "start": 0.2713, "stop": 0.4127},
        "length_dependent_damping": {"slope": 0.01, "length": 0.5},
        "power_law_damping": {"coefficient": 0.004, "exponent": 1.4},
        "rod_inertia": {"mass": 0.05, "centre": 0.3, "inertia": 0.004},
        "residual_force": {
            "places": KNOTS[axis],
            "by_place": [0.5 * f, -f, 0.3 * f],
            "speeds": [-v, 0.5 * v, 2.0 * v],
            "by_speed": [0.2 * f, -0.3 * f, 0.6 * f],
        },
        "dead_zone": {"positive": 0.3, "negative": 0.2},
        "saturation": {"limit": 2.0},
        "input_delay": {"delay": 0.0123},
        "start_delay": {"delay": 0.0123},
        "actuator_lag": {"time_constant": 0.04},
        "force_limit": {"limit": {"x": 20.0, "psi": 0.0, "l": 2.0}[axis]},
        "back_emf": {"constant": 0.7},
        "freewheeling": {"constant": 0.7, "width": 0.5},
        "gain_asymmetry": {"ratio": 0.1},
        "gain_drift": {"rate": -0.05},
        "drum_radius_change": {"slope": 0.2, "length": 0.65},
        "torque_ripple": {"amplitude": 0.1, "period": 0.06, "phase": 0.4},
        "sensor_offset": {"offset": 0.01},
        "sensor_scale": {"scale": 1.02},
        "sensor_delay": {"delay": 0.0117},
        "missed_counts": {"jump": 0.02, "time": 0.3513},
        "sensor_eccentricity": {"amplitude": 0.004, "period": 0.15, "phase": 0.4},
        "clock_scale": {"scale": 1.02},
    }[kind]


MECHANISMS = {
    "compliances": [
        ("belt_compliance", "cart", {"stiffness": 3000.0, "damping": 12.0, "motor_mass": 1.1, "encoder": "motor"}),
        ("rope_elasticity", "hoist", {"stiffness": 200.0, "damping": 0.5}),
        ("double_pendulum", "swing", {"hook_mass": 0.05, "link": 0.12, "damping": 1e-3}),
    ],
    "play": [
        ("backlash", "cart", {"gap": 2e-3, "motor_mass": 1.1}),
        ("cable_drag", "cart", {"stiffness": 5.0, "rest": 0.2, "level": 2.0, "travel": 0.01}),
    ],
    "play at the winch": [("hoist_backlash", "hoist", {"gap": 4e-3, "motor_mass": 0.06})],
}
