"""Small forces that every real rig has and no catalogue lists; several act at once beside what is concealed.

Same interfaces as `effects.py` and `drives.py`. A case with clutter is scored by what is concealed alone: each piece of
clutter leaves a tenth of the concealed effect's error or less.
"""

import math
from collections.abc import Callable

import numpy as np

import recorded
from effects import Effect, ForceLaw, Layout, Vector


def _waves(e: Effect) -> Callable[[float], float]:
    """Five sine waves in time of unit variance together, between two frequencies [Hz], drawn from the effect's seed."""
    key = np.random.default_rng(int(e["seed"]))
    rates = 2 * math.pi * key.uniform(e["slowest"], e["fastest"], 5)
    phases = key.uniform(0.0, 2 * math.pi, 5)
    pairs = list(zip(rates.tolist(), phases.tolist(), strict=True))
    return lambda t: math.sqrt(2 / 5) * sum(math.sin(rate * t + phase) for rate, phase in pairs)


def _bumps(e: Effect, low: float, high: float) -> Callable[[float], float]:
    """Six bumps of either sign between two places [m], 8 to 40 mm wide."""
    key = np.random.default_rng(int(e["seed"]))
    places, widths, signs = key.uniform(low, high, 6), key.uniform(0.008, 0.04, 6), key.choice([-1.0, 1.0], 6)
    made = list(zip(places.tolist(), widths.tolist(), signs.tolist(), strict=True))
    return lambda q: sum(sign * math.exp(-(((q - place) / width) ** 2)) for place, width, sign in made)


def _rail_joints(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Joints of the rail, each a bump that pushes one way."""
    profile = _bumps(e, 0.1, 1.4)
    return lambda t, q, v, forces: at.push_cart(e["level"] * profile(at.cart(q)), forces)


def _cable_bundle(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Cables that pull towards a place with a force that does not grow far from it."""
    return lambda t, q, v, forces: at.push_cart(-e["level"] * math.tanh((at.cart(q) - e["rest"]) / 0.15), forces)


def _skewed_wheels(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Wheels that pinch away from a place: damping that grows with the distance."""
    return lambda t, q, v, forces: at.push_cart(-e["level"] * abs(at.cart(q) - e["rest"]) * at.cart(v), forces)


def _warming_grease(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Damping that fades as the grease warms."""
    return lambda t, q, v, forces: at.push_cart(-e["level"] * math.exp(-t / 5.0) * at.cart(v), forces)


def _floor_shaking(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """Shaking of the floor."""
    wave = _waves(e)
    return lambda t, q, v, forces: at.push_cart(e["level"] * wave(t), forces)


def _on(joint: str, law: Callable[[Effect], Callable[[float, float, float], float]]) -> Callable[..., ForceLaw]:
    """A law of one joint: force from time, coordinate and velocity."""

    def made(e: Effect, at: Layout, dt: float) -> ForceLaw:
        place, force = getattr(at, joint), law(e)

        def push(t: float, q: Vector, v: Vector, forces: Vector) -> None:
            forces[place] += force(t, q[place], v[place])

        return push

    return made


def _room_draught(e: Effect) -> Callable[[float, float, float], float]:
    wave = _waves(e)
    return lambda t, q, v: e["level"] * wave(t)


def _drum_seams(e: Effect) -> Callable[[float, float, float], float]:
    profile = _bumps(e, 0.3, 1.2)
    return lambda t, q, v: e["level"] * profile(q)


def _recorded_force(e: Effect, at: Layout, dt: float) -> ForceLaw:
    """What the recordings of a real rig leave, in stretches, whatever this rig does."""
    push = recorded.force(e["rig"], e["site"], int(e["seed"]))
    if e["site"] == "cart":
        return lambda t, q, v, forces: at.push_cart(e["level"] * push(t), forces)
    joint = {"swing": at.psi, "hoist": at.l}[e["site"]]

    def law(t: float, q: Vector, v: Vector, forces: Vector) -> None:
        forces[joint] += e["level"] * push(t)

    return law


FORCES: dict[str, Callable[[Effect, Layout, float], ForceLaw]] = {
    "rail_joints": _rail_joints,
    "cable_bundle": _cable_bundle,
    "skewed_wheels": _skewed_wheels,
    "warming_grease": _warming_grease,
    "floor_shaking": _floor_shaking,
    "worn_hinge": _on("psi", lambda e: lambda t, q, v: -e["level"] * math.tanh(v / 0.05) * abs(q)),
    "rope_twist": _on("psi", lambda e: lambda t, q, v: -e["level"] * q**3),
    "room_draught": _on("psi", _room_draught),
    "drum_seams": _on("l", _drum_seams),
    "motor_hum": _on("l", _room_draught),
    "dry_bearing": _on("l", lambda e: lambda t, q, v: -e["level"] * math.copysign(math.sqrt(abs(v)), v)),
    "recorded_force": _recorded_force,
}


def _mains_ripple(e: Effect, at: Layout, dt: float) -> Callable[[float, float, Vector, Vector], float]:
    """A supply that is not quite smooth."""
    wave = _waves(e)
    return lambda u, t, q, both: u * (1.0 + e["level"] * wave(t))


DRIVE_STAGES = {"mains_ripple": _mains_ripple}
KINDS = {*FORCES, *DRIVE_STAGES}
