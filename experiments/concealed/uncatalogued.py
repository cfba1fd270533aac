"""Physics that stands in no catalogue: here the honest verdict is "unknown", with the right equation.

Same interfaces as `effects.py` and `drives.py`. Each law repeats from recording to recording, so that it
could be learnt, and none is a sum of catalogued laws.
"""

import math
from collections.abc import Callable

from effects import Effect, ForceLaw, FrictionLaw, Layout, LoadLaw, Vector


def _brake_zone(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Magnetic brake along part of the rail: an eddy-current force that peaks at a critical speed."""

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        inside = math.exp(-(((at.cart(q) - e["centre"]) / e["width"]) ** 2))
        speed = at.cart(v) / e["critical"]
        at.push_cart(-2 * e["peak"] * inside * speed / (1 + speed**2), forces)

    return law


def _sagging_rail(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Rail that sags under way: a cubic restoring force that grows with speed squared."""

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        away = (at.cart(q) - e["rest"]) / 0.5
        at.push_cart(-e["level"] * away**3 * (1 + (at.cart(v) / e["velocity"]) ** 2), forces)

    return law


def _swing_guide(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Rope touching a cross beam beyond an angle, on one side only: stiffer there."""

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        forces[at.psi] -= e["stiffness"] * max(q[at.psi] - e["angle"], 0.0)

    return law


def _winch_ripple(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Drum out of round: a force along the rope, periodic in the length paid out."""

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        forces[at.l] += e["amplitude"] * math.sin(2 * math.pi * q[at.l] / e["period"] + e["phase"])

    return law


def _rope_layers(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Rope rubbing between layers: viscous damping that grows with the cube of the length wound up."""

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        wound = max(e["full"] - q[at.l], 0.0) / e["full"]
        forces[at.l] -= e["damping"] * wound**3 * v[at.l]

    return law


FORCES: dict[str, Callable[[Effect, Layout, float], ForceLaw]] = {
    "brake_zone": _brake_zone,
    "sagging_rail": _sagging_rail,
    "swing_guide": _swing_guide,
    "winch_ripple": _winch_ripple,
    "rope_layers": _rope_layers,
}


def _reversal_ripple(e: Effect) -> FrictionLaw:
    """Friction with a memory of place: its level ripples with the distance since the last reversal."""
    memory = {"sign": 0.0, "turn": 0.0}

    def law(t: float, q: float, v: float) -> tuple[float, float]:
        sign = math.copysign(1.0, v) if abs(v) > 1e-4 else memory["sign"]
        if sign != memory["sign"]:
            memory["sign"], memory["turn"] = sign, q
        level = e["level"] * math.sin(math.pi * (q - memory["turn"]) / e["period"]) ** 2
        return level, level

    return law


FRICTION: dict[str, Callable[[Effect], FrictionLaw]] = {"reversal_ripple": _reversal_ripple}


def _swing_friction(e: Effect, at: Layout) -> Callable[[Vector, Vector], float]:
    """Cart whose wheels are pinched when the load swings: Coulomb level proportional to the swing's speed."""
    return lambda q, v: e["slope"] * abs(v[at.psi])


COUPLED_FRICTION: dict[str, Callable[[Effect, Layout], Callable[[Vector, Vector], float]]] = {
    "swing_friction": _swing_friction
}


def _lift(e: Effect, at: Layout) -> LoadLaw:
    """A flat load that flies: lift from its speed along the rail, across the rope's pull."""

    def law(t: float, q: Vector, v: Vector) -> tuple[float, float]:
        along, _ = at.load_velocity(q, v)
        return 0.0, e["coefficient"] * along**2

    return law


LOAD: dict[str, Callable[[Effect, Layout], LoadLaw]] = {"lift": _lift}


def _cubic_gain(e: Effect, at: Layout, dt: float) -> Callable[[float, float, Vector, Vector], float]:
    """Amplifier that bends upwards: u (1 + (u / volts)^2)."""
    return lambda u, t, q, both: u * (1.0 + (u / e["volts"]) ** 2)


def _shared_supply(e: Effect, at: Layout, dt: float) -> Callable[[float, float, Vector, Vector], float]:
    """Supply shared by both motors: this drive weakens while the other pulls."""
    return lambda u, t, q, both: u / (1.0 + e["share"] * both[0] ** 2)


DRIVE_STAGES: dict[str, Callable[[Effect, Layout, float], Callable[[float, float, Vector, Vector], float]]] = {
    "cubic_gain": _cubic_gain,
    "shared_supply": _shared_supply,
}
KINDS = {*FORCES, *FRICTION, *COUPLED_FRICTION, *LOAD, *DRIVE_STAGES}
