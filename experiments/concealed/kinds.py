"""How large each concealed effect is drawn, one entry per kind and site.

Beside a Coulomb friction that the model already has, an added friction is written with its smallest level
at 0. Delays are whole engine steps. The size factor is the case's entry in `sizes.json` (see
`severity.py`).
"""

import numpy as np

import recorded
from scene import DT


class Draw:
    """Random numbers with short names."""

    def __init__(self, key: np.random.Generator):
        self.key = key

    def u(self, low: float, high: float) -> float:
        """Uniform, to four significant digits, so that truths read well."""
        return float(f"{self.key.uniform(low, high):.4g}")

    def sign(self) -> float:
        return 1.0 if self.key.random() < 0.5 else -1.0

    def steps(self, low: float, high: float, size: float) -> float:
        """A delay in whole engine steps [s]."""
        return float(f"{max(round(size * self.key.uniform(low, high) / DT), 1) * DT:.4g}")

    def profile(self, count: int, top: float, size: float) -> list[float]:
        """Levels at knots, smallest 0, largest about `top`."""
        levels = self.key.uniform(0.0, 1.0, count)
        levels = (levels - levels.min()) / (levels.max() - levels.min())
        return [round(float(size * top * level), 4) for level in levels]


def _one_sided(d: Draw, low: float, high: float, s: float) -> dict:
    level = s * d.u(low, high)
    return {"positive": level, "negative": 0.0} if d.sign() > 0 else {"positive": 0.0, "negative": level}


def _lookup(d: Draw, s: float) -> dict:
    both = d.profile(10, 0.4, s)
    return {"knots": RAIL[5], "positive": both[:5], "negative": both[5:]}


def _rail(d: Draw, s: float) -> dict:
    """Forces about a mean of 0, since a constant one would be a `constant_force`."""
    levels = np.array(d.profile(6, 0.4, s))
    return {"knots": RAIL[6], "forces": [round(float(level), 4) for level in levels - levels.mean()]}


def _wind(d: Draw, s: float) -> dict:
    start = d.u(3.0, 5.0)
    return {"force": s * d.sign() * d.u(0.008, 0.02), "start": start, "stop": round(start + d.u(3.0, 6.0), 3)}


def _waves(d: Draw, level: float, slowest: float, fastest: float) -> dict:
    return {"level": level, "slowest": slowest, "fastest": fastest, "seed": int(d.key.integers(1, 2**31))}


def _recorded(d: Draw, axis: str, level: float) -> dict:
    return {"level": level, "rig": str(d.key.choice(recorded.SOURCES[axis])), "seed": int(d.key.integers(1, 2**31))}


def _jump(d: Draw, low: float, high: float, count: float, s: float) -> dict:
    return {"jump": d.sign() * count * max(round(s * d.u(low, high) / count), 1), "time": d.u(4.0, 9.0)}


RAIL = {n: [round(float(x), 3) for x in np.linspace(0.1, 1.4, n)] for n in (5, 6)}
ROPE = [round(float(x), 3) for x in np.linspace(0.35, 1.15, 5)]

KINDS = {
    ("stribeck_friction", "cart"): lambda d, s: {
        "level": 0.0, "breakaway": s * d.u(0.4, 0.8), "velocity": d.u(0.03, 0.08)},
    ("direction_dependent_friction", "cart"): lambda d, s: _one_sided(d, 0.1, 0.2, s),
    ("position_dependent_friction", "cart"): lambda d, s: {"knots": RAIL[6], "levels": d.profile(6, 0.4, s)},
    ("position_direction_friction", "cart"): _lookup,
    ("load_dependent_friction", "cart"): lambda d, s: {"level": 0.0, "share": s * d.u(0.02, 0.05)},
    ("presliding_friction", "cart"): lambda d, s: {"level": d.u(2.5, 4.0), "stiffness": d.u(2000, 4000) / s},
    ("quadratic_drag", "cart"): lambda d, s: {"coefficient": s * d.u(2.0, 4.0)},
    ("friction_drift", "cart"): lambda d, s: {"level": 0.0, "rate": s * d.u(0.01, 0.02)},
    ("constant_force", "cart"): lambda d, s: {"level": s * d.sign() * d.u(0.1, 0.2)},
    ("rail_inclination", "cart"): _rail,
    ("spring_force", "cart"): lambda d, s: {"stiffness": s * d.u(0.3, 0.6), "rest": d.u(0.5, 1.0)},
    ("cable_drag", "cart"): lambda d, s: {
        "stiffness": s * d.u(0.3, 0.6), "rest": d.u(0.5, 1.0), "level": s * d.u(0.1, 0.2), "travel": d.u(0.02, 0.08)},
    ("periodic_force", "cart"): lambda d, s: {
        "amplitude": s * d.u(0.2, 0.4), "period": d.u(0.06, 0.15), "phase": d.u(-3.0, 3.0)},
    ("end_stop", "cart"): lambda d, s: {
        "position": d.u(1.05, 1.2), "stiffness": d.u(1500, 4000), "damping": d.u(20, 60)},
    ("belt_compliance", "cart"): lambda d, s: {
        "stiffness": d.u(3000, 6000) / s, "damping": d.u(8, 20), "motor_mass": d.u(1.0, 2.0)},
    ("backlash", "cart"): lambda d, s: {"gap": s * d.u(1e-3, 2e-3), "motor_mass": d.u(1.0, 2.0)},
    ("coulomb_friction", "swing"): lambda d, s: {"level": s * d.u(0.001, 0.002)},
    ("load_dependent_friction", "swing"): lambda d, s: {"level": 0.0, "share": s * d.u(5e-4, 1e-3)},
    ("load_drag", "swing"): lambda d, s: {"coefficient": s * d.u(0.02, 0.05)},
    ("wind", "swing"): _wind,
    ("length_dependent_damping", "swing"): lambda d, s: {"slope": s * d.u(0.0025, 0.004), "length": 0.7},
    ("rod_inertia", "swing"): lambda d, s: {
        "mass": s * d.u(0.02, 0.05), "centre": d.u(0.15, 0.4), "inertia": s * d.u(0.001, 0.003)},
    ("constant_force", "swing"): lambda d, s: {"level": s * d.sign() * d.u(0.004, 0.008)},
    ("power_law_damping", "swing"): lambda d, s: {"coefficient": s * d.u(0.002, 0.004), "exponent": d.u(0.5, 2.5)},
    ("double_pendulum", "swing"): lambda d, s: {
        "hook_mass": d.u(0.05, 0.08), "link": s * d.u(0.08, 0.15), "damping": d.u(1e-4, 4e-4)},
    ("direction_dependent_friction", "hoist"): lambda d, s: _one_sided(d, 0.15, 0.3, s),
    ("position_dependent_friction", "hoist"): lambda d, s: {"knots": ROPE, "levels": d.profile(5, 0.4, s)},
    ("load_dependent_friction", "hoist"): lambda d, s: {"level": 0.0, "share": s * d.u(0.03, 0.06)},
    ("quadratic_drag", "hoist"): lambda d, s: {"coefficient": s * d.u(15, 30)},
    ("stribeck_friction", "hoist"): lambda d, s: {
        "level": 0.0, "breakaway": s * d.u(0.5, 1.0), "velocity": d.u(0.02, 0.05)},
    ("constant_force", "hoist"): lambda d, s: {"level": s * d.sign() * d.u(0.1, 0.3)},
    ("rope_elasticity", "hoist"): lambda d, s: {"stiffness": d.u(80, 140) / s, "damping": d.u(0.3, 0.6)},
    ("hoist_backlash", "hoist"): lambda d, s: {"gap": s * d.u(2e-3, 5e-3), "motor_mass": d.u(0.04, 0.06)},
    ("saturation", "cart_drive"): lambda d, s: {"limit": d.u(2.2, 2.6)},
    ("input_delay", "cart_drive"): lambda d, s: {"delay": d.steps(0.010, 0.025, s)},
    ("start_delay", "cart_drive"): lambda d, s: {"delay": d.steps(0.02, 0.05, s)},
    ("start_delay", "hoist_drive"): lambda d, s: {"delay": d.steps(0.03, 0.06, s)},
    ("actuator_lag", "cart_drive"): lambda d, s: {"time_constant": s * d.u(0.015, 0.03)},
    ("gain_asymmetry", "cart_drive"): lambda d, s: {"ratio": s * d.sign() * d.u(0.01, 0.02)},
    ("gain_drift", "cart_drive"): lambda d, s: {"rate": s * d.sign() * d.u(0.001, 0.002)},
    ("torque_ripple", "cart_drive"): lambda d, s: {
        "amplitude": s * d.u(0.03, 0.06), "period": d.u(0.06, 0.15), "phase": d.u(-3.0, 3.0)},
    ("torque_ripple", "hoist_drive"): lambda d, s: {
        "amplitude": s * d.u(0.05, 0.1), "period": d.u(0.06, 0.12), "phase": d.u(-3.0, 3.0)},
    ("force_limit", "cart_drive"): lambda d, s: {"limit": d.u(32, 38)},
    ("force_limit", "hoist_drive"): lambda d, s: {"limit": d.u(9, 11)},
    ("freewheeling", "cart_drive"): lambda d, s: {"constant": s * d.u(0.6, 1.2), "width": d.u(0.05, 0.3)},
    ("freewheeling", "hoist_drive"): lambda d, s: {"constant": s * d.u(1.6, 3.2), "width": d.u(0.05, 0.3)},
    ("speed_drive", "cart_drive"): lambda d, s: {
        "time_constant": d.u(0.02, 0.05), "limit": d.u(12, 20), "share": 1.0},
    ("speed_drive", "hoist_drive"): lambda d, s: {
        "time_constant": d.u(0.05, 0.08), "limit": d.u(5, 7), "share": 1.0},
    ("saturation", "hoist_drive"): lambda d, s: {"limit": d.u(4.6, 5.2)},
    ("input_delay", "hoist_drive"): lambda d, s: {"delay": d.steps(0.015, 0.03, s)},
    ("gain_asymmetry", "hoist_drive"): lambda d, s: {"ratio": s * d.sign() * d.u(0.02, 0.04)},
    ("drum_radius_change", "hoist_drive"): lambda d, s: {
        "slope": s * d.sign() * d.u(0.1, 0.2), "length": 0.7},
    ("sensor_scale", "x_sensor"): lambda d, s: {"scale": 1 + s * d.sign() * d.u(0.02, 0.04)},
    ("sensor_delay", "x_sensor"): lambda d, s: {"delay": d.steps(0.008, 0.02, s)},
    ("missed_counts", "x_sensor"): lambda d, s: _jump(d, 1e-3, 2e-3, 1e-4, s),
    ("sensor_eccentricity", "x_sensor"): lambda d, s: {
        "amplitude": s * d.u(4e-4, 8e-4), "period": d.u(0.1, 0.3), "phase": d.u(-3.0, 3.0)},
    ("sensor_offset", "psi_sensor"): lambda d, s: {"offset": s * d.sign() * d.u(0.006, 0.012)},
    ("sensor_scale", "psi_sensor"): lambda d, s: {"scale": 1 + s * d.sign() * d.u(0.03, 0.06)},
    ("sensor_delay", "psi_sensor"): lambda d, s: {"delay": d.steps(0.01, 0.02, s)},
    ("sensor_offset", "l_sensor"): lambda d, s: {"offset": s * d.sign() * d.u(0.015, 0.03)},
    ("sensor_scale", "l_sensor"): lambda d, s: {"scale": 1 + s * d.sign() * d.u(0.03, 0.05)},
    ("clock_scale", "clock"): lambda d, s: {"scale": 1 + s * d.sign() * d.u(0.01, 0.03)},
    ("brake_zone", "cart"): lambda d, s: {
        "centre": d.u(0.6, 0.9), "width": d.u(0.1, 0.2), "peak": s * d.u(1.0, 2.0),
        "critical": d.u(0.1, 0.2)},
    ("sagging_rail", "cart"): lambda d, s: {
        "level": s * d.u(0.5, 1.0), "rest": d.u(0.65, 0.85), "velocity": 0.2},
    ("swing_guide", "swing"): lambda d, s: {"stiffness": s * d.u(0.2, 0.4), "angle": d.u(0.04, 0.07)},
    ("winch_ripple", "hoist"): lambda d, s: {
        "amplitude": s * d.u(0.2, 0.4), "period": d.u(0.08, 0.12), "phase": d.u(-3.0, 3.0)},
    ("rope_layers", "hoist"): lambda d, s: {"damping": s * d.u(15, 30), "full": d.u(1.1, 1.3)},
    ("reversal_ripple", "cart"): lambda d, s: {"level": s * d.u(0.8, 1.6), "period": d.u(0.08, 0.15)},
    ("swing_friction", "cart"): lambda d, s: {"slope": s * d.u(0.5, 1.0)},
    ("lift", "swing"): lambda d, s: {"coefficient": s * d.u(0.3, 0.6)},
    ("cubic_gain", "cart_drive"): lambda d, s: {"volts": d.u(7.0, 10.0) / s},
    ("shared_supply", "hoist_drive"): lambda d, s: {"share": s * d.u(0.05, 0.1)},
    ("rail_joints", "cart"): lambda d, s: {"level": s * 0.3, "seed": int(d.key.integers(1, 2**31))},
    ("cable_bundle", "cart"): lambda d, s: {"level": s * 0.1, "rest": d.u(0.6, 0.9)},
    ("skewed_wheels", "cart"): lambda d, s: {"level": s * 1.0, "rest": d.u(0.5, 1.0)},
    ("warming_grease", "cart"): lambda d, s: {"level": s * 0.5},
    ("floor_shaking", "cart"): lambda d, s: _waves(d, s * 0.1, 0.3, 4.0),
    ("worn_hinge", "swing"): lambda d, s: {"level": s * 0.002},
    ("rope_twist", "swing"): lambda d, s: {"level": s * 0.05},
    ("room_draught", "swing"): lambda d, s: _waves(d, s * 5e-4, 0.05, 0.5),
    ("drum_seams", "hoist"): lambda d, s: {"level": s * 0.2, "seed": int(d.key.integers(1, 2**31))},
    ("motor_hum", "hoist"): lambda d, s: _waves(d, s * 0.1, 0.3, 4.0),
    ("dry_bearing", "hoist"): lambda d, s: {"level": s * 0.3},
    ("recorded_force", "cart"): lambda d, s: _recorded(d, "cart", s * 0.3),
    ("recorded_force", "swing"): lambda d, s: _recorded(d, "swing", s * 1e-3),
    ("recorded_force", "hoist"): lambda d, s: _recorded(d, "hoist", s * 0.2),
    ("mains_ripple", "cart_drive"): lambda d, s: _waves(d, s * 0.01, 0.3, 3.0),
    ("mains_ripple", "hoist_drive"): lambda d, s: _waves(d, s * 0.02, 0.3, 3.0),
}  # fmt: skip

NOT_PLAYED = {
    "back_emf": "beside a damping that is estimated it is a damping, and all of these rigs' are",
}
"""Kinds of the catalogue of which no case can conceal one. (Plain friction, dead zones and lags, which most rigs'
owners know of, are drawn with the rig: see `OWNED` in `cases.py`.)"""


def draw(kind: str, site: str, key: np.random.Generator, size: float = 1.0) -> dict:
    """An effect's table with random parameters."""
    numbers = KINDS[kind, site](Draw(key), size)
    return {"kind": kind, "site": site} | {
        k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in numbers.items()
    }
