"""The laws of every catalogued effect as the concealed rig plays them, independent of what is under test.

Three sorts of law, each built once per recording from an effect's table (`{"kind": ..., "site": ..., ...}`,
SI units): a friction law gives the two Coulomb levels of its axis, a force law adds to the generalised
forces of the joints, and a load law gives a force on the load point. Effects that are mechanics (backlash,
belt, elastic rope, second pendulum) are joints of the engine and live in `scene.py`; drives and sensors
live in `drives.py` and `sensors.py`.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

Effect = dict
Vector = list[float]
FrictionLaw = Callable[[float, float, float], tuple[float, float]]
"""(time [s], coordinate, velocity) -> Coulomb levels for positive and negative velocity [N or N m]."""
ForceLaw = Callable[[float, Vector, Vector, Vector], None]
"""(time, joint positions, joint velocities, generalised forces to add to)."""
LoadLaw = Callable[[float, Vector, Vector], tuple[float, float]]
"""(time, joint positions, joint velocities) -> force on the load: along the rail and upwards [N]."""


@dataclass(frozen=True)
class Layout:
    """Where each joint sits in the engine's vectors; -1 for a joint that this rig does not have."""

    x: int = -1
    """Slide of the driven side: the cart, or the motor where a belt or backlash parts the two."""
    play: int = -1
    """Slide of the cart relative to the motor."""
    psi: int = -1
    l: int = -1
    stretch: int = -1
    """Slide of the elastic rope beyond the length paid out."""
    link: int = -1
    """Hinge of the load below the hook, relative to the rope."""
    rope: float = 0.7
    """Length of a locked rope [m]."""
    link_length: float = 0.0
    """Hook to load [m]."""

    def cart(self, q: Vector) -> float:
        """Cart position [m], or its velocity from joint velocities; 0 on a fixed cart."""
        if self.x < 0:
            return 0.0
        return q[self.x] + (q[self.play] if self.play >= 0 else 0.0)

    def length(self, q: Vector) -> float:
        """Rope length paid out [m]."""
        return q[self.l] if self.l >= 0 else self.rope

    def push_cart(self, force: float, forces: Vector) -> None:
        """Applies a force to the cart's body: both joints that carry it feel it."""
        forces[self.x] += force
        if self.play >= 0:
            forces[self.play] += force

    def load_velocity(self, q: Vector, v: Vector) -> tuple[float, float]:
        """Absolute velocity of the load: along the rail and upwards [m/s]."""
        radius, rate = self.length(q), v[self.l] if self.l >= 0 else 0.0
        if self.stretch >= 0:
            radius, rate = radius + q[self.stretch], rate + v[self.stretch]
        sine, cosine, spin = math.sin(q[self.psi]), math.cos(q[self.psi]), v[self.psi]
        along = self.cart(v) + rate * sine + radius * spin * cosine
        up = -rate * cosine + radius * spin * sine
        if self.link >= 0:
            angle, spin = q[self.psi] + q[self.link], spin + v[self.link]
            along += self.link_length * spin * math.cos(angle)
            up += self.link_length * spin * math.sin(angle)
        return along, up


def interpolate(x: float, knots: Vector, values: Vector) -> float:
    """Piecewise linear, held beyond the ends."""
    if x <= knots[0]:
        return values[0]
    if x >= knots[-1]:
        return values[-1]
    i = bisect_right(knots, x)
    share = (x - knots[i - 1]) / (knots[i] - knots[i - 1])
    return values[i - 1] + share * (values[i] - values[i - 1])


def _coulomb(e: Effect) -> FrictionLaw:
    return lambda t, q, v: (e["level"], e["level"])


def _stribeck(e: Effect) -> FrictionLaw:
    level, extra, velocity = e["level"], e["breakaway"] - e["level"], e["velocity"]

    def law(t: float, q: float, v: float) -> tuple[float, float]:
        now = level + extra * math.exp(-((v / velocity) ** 2))
        return now, now

    return law


def _by_direction(e: Effect) -> FrictionLaw:
    return lambda t, q, v: (e["positive"], e["negative"])


def _by_place(e: Effect) -> FrictionLaw:
    def law(t: float, q: float, v: float) -> tuple[float, float]:
        level = interpolate(q, e["knots"], e["levels"])
        return level, level

    return law


def _by_place_and_direction(e: Effect) -> FrictionLaw:
    return lambda t, q, v: (
        interpolate(q, e["knots"], e["positive"]),
        interpolate(q, e["knots"], e["negative"]),
    )


def _drifting(e: Effect) -> FrictionLaw:
    def law(t: float, q: float, v: float) -> tuple[float, float]:
        level = max(e["level"] + e["rate"] * t, 0.0)
        return level, level

    return law


FRICTION: dict[str, Callable[[Effect], FrictionLaw]] = {
    "coulomb_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "direction_dependent_friction": _by_direction,
    "position_dependent_friction": _by_place,
    "position_direction_friction": _by_place_and_direction,
    "friction_drift": _drifting,
}


LoadedLaw = Callable[[float], float]
"""Load on the axis [N] -> Coulomb level."""


def _load_dependent(e: Effect) -> LoadedLaw:
    return lambda load: e["level"] + e["share"] * load


LOADED_FRICTION: dict[str, Callable[[Effect], LoadedLaw]] = {"load_dependent_friction": _load_dependent}
"""Friction by the size of the drive's force, at the swing by the pull on the pivot."""


def _presliding(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Dahl: z' = v (1 - stiffness z sign(v) / level) for the spring's stretch z, exact over a step."""
    slip = e["level"] / e["stiffness"]
    stretch = [0.0]

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        limit = math.copysign(slip, v[at.x])
        stretch[0] = limit + (stretch[0] - limit) * math.exp(-abs(v[at.x]) * dt / slip)
        forces[at.x] -= e["stiffness"] * stretch[0]

    return law


def _cable_drag(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """A spring to a place of rest beside Dahl's loop: z' = v / travel (1 - z sign(v)), exact over a step."""
    loop = _presliding({"level": e["level"], "stiffness": e["level"] / e["travel"]}, at, dt)

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        loop(t, q, v, forces)
        forces[at.x] -= e["stiffness"] * (q[at.x] - e["rest"])

    return law


def _quadratic_drag(e: Effect, at: Layout, dt: float) -> ForceLaw:
    joint = at.x if e["site"] == "cart" else at.l

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        forces[joint] -= e["coefficient"] * v[joint] * abs(v[joint])

    return law


def _constant_force(e: Effect, at: Layout, dt: float) -> ForceLaw:
    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        if e["site"] == "cart":
            at.push_cart(e["level"], forces)
        else:
            forces[at.psi if e["site"] == "swing" else at.l] += e["level"]

    return law


def _rail_inclination(e: Effect, at: Layout, dt: float) -> ForceLaw:
    return lambda t, q, v, forces: at.push_cart(interpolate(at.cart(q), e["knots"], e["forces"]), forces)


def _spring_force(e: Effect, at: Layout, dt: float) -> ForceLaw:
    return lambda t, q, v, forces: at.push_cart(-e["stiffness"] * (at.cart(q) - e["rest"]), forces)


def _periodic_force(e: Effect, at: Layout, dt: float) -> ForceLaw:
    wave = 2 * math.pi / e["period"]
    return lambda t, q, v, forces: at.push_cart(e["amplitude"] * math.sin(wave * at.cart(q) + e["phase"]), forces)


def _end_stop(e: Effect, at: Layout, dt: float) -> ForceLaw:
    side = -1.0 if e.get("end", "high") == "low" else 1.0

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        depth = at.cart(q) - e["position"]
        if side * depth > 0.0:
            at.push_cart(-e["stiffness"] * depth - e["damping"] * at.cart(v), forces)

    return law


def _length_dependent_damping(e: Effect, at: Layout, dt: float) -> ForceLaw:
    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        forces[at.psi] -= e["slope"] * (at.length(q) - e["length"]) * v[at.psi]

    return law


def _power_law_damping(e: Effect, at: Layout, dt: float) -> ForceLaw:
    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        forces[at.psi] -= math.copysign(e["coefficient"] * abs(v[at.psi]) ** e["exponent"], v[at.psi])

    return law


FORCES: dict[str, Callable[[Effect, Layout, float], ForceLaw]] = {
    "presliding_friction": _presliding,
    "cable_drag": _cable_drag,
    "quadratic_drag": _quadratic_drag,
    "constant_force": _constant_force,
    "rail_inclination": _rail_inclination,
    "spring_force": _spring_force,
    "periodic_force": _periodic_force,
    "end_stop": _end_stop,
    "power_law_damping": _power_law_damping,
    "length_dependent_damping": _length_dependent_damping,
}


def _load_drag(e: Effect, at: Layout) -> LoadLaw:
    def law(t: float, q: Vector, v: Vector) -> tuple[float, float]:
        along, up = at.load_velocity(q, v)
        factor = -e["coefficient"] * math.hypot(along, up)
        return factor * along, factor * up

    return law


def _wind(e: Effect, at: Layout) -> LoadLaw:
    return lambda t, q, v: (e["force"] if e["start"] <= t < e["stop"] else 0.0, 0.0)


LOAD: dict[str, Callable[[Effect, Layout], LoadLaw]] = {"load_drag": _load_drag, "wind": _wind}
