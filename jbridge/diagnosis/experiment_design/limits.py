"""The room of an experiment: voltages, rail, rope and swing as far as recordings went, and what sets an axis going."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from ..._types import AXES, Axes
from ...identification.operating_range import scene_of
from ...identification.setting import Setting
from ...model.effects.base import AbstractHysteresis
from ...model.effects.drives import DeadZone
from ...model.effects.friction import LoadDependentFriction
from ...model.plant import Plant

_MARGIN = 0.02
"""Share of the recorded span that is kept free at each end of rail and rope."""
_LEAST_SWING = 0.1
"""Swing that is allowed whatever was recorded [rad]."""
_LONGEST = 20.0
"""Longest experiment [s]."""


@dataclasses.dataclass(frozen=True)
class Volts:
    """Three voltages of a drive, each for positive and for negative motion, in the input's unit."""

    rest: float
    """What holds the axis still."""
    least: tuple[float, float]
    """What just sets it in motion, as the rivals have it on average."""
    most: tuple[float, float]
    """The largest that was recorded, in either direction."""


@dataclasses.dataclass(frozen=True)
class Reach:
    """The room of an experiment."""

    period: float
    """Of its rows [s]."""
    seconds: float
    low: Mapping[str, float]
    """Least allowed reading of every axis that moves [m, rad, m]."""
    high: Mapping[str, float]
    speed: Mapping[str, float]
    """How fast each axis went at large voltages [m/s, rad/s, m/s]."""
    drives: Mapping[str, Volts]
    """By input, `u_x` and `u_l`, as far as the rig has them."""


def reach_of(setting: Setting, plants: Sequence[Plant]) -> Reach:
    """The room that training recordings have shown to be safe.

    Args:
        setting: recordings.
        plants: the rivals.
    """
    scene = scene_of(setting, plants[0])
    low, high = dict(scene.low), dict(scene.high)
    for axis in ("x", "l"):
        margin = _MARGIN * (high[axis] - low[axis])
        low[axis], high[axis] = low[axis] + margin, high[axis] - margin
    swing = max(abs(low["psi"]), abs(high["psi"]), _LEAST_SWING)
    low["psi"], high["psi"] = -swing, swing
    middle = {axis: 0.5 * (low[axis] + high[axis]) for axis in AXES}
    middle["l"] = middle["l"] or setting.length
    drives = {}
    for name, axis in (("u_x", "x"), ("u_l", "l")):
        if all(getattr(r, name) is None for r in setting.recordings) or axis not in setting.axes:
            continue
        # A drive gives backwards what it gives forwards.
        largest = max(abs(scene.high[name]), abs(scene.low[name]))
        most = largest, -largest
        starts = [_starts(plant, axis, middle) for plant in plants]
        up, down = (float(np.mean([start[k] for start in starts])) for k in range(2))
        rest = 0.0 if up >= 0.0 >= down else 0.5 * (up + down)
        least = float(np.clip(up, rest, most[0])), float(np.clip(down, most[1], rest))
        drives[name] = Volts(rest, least, most)
    return Reach(
        float(np.round(np.median([r.period for r in setting.recordings]), 6)),
        min(max(r.duration for r in setting.recordings), _LONGEST),
        low,
        high,
        scene.speed,
        drives,
    )


def _starts(plant: Plant, axis: str, middle: Mapping[str, float]) -> tuple[float, float]:
    """Inputs from which on an axis at rest moves forwards, and backwards."""
    q = Axes(*(jnp.asarray(middle[name]) for name in AXES))
    rest = Axes(*(jnp.zeros(()) for _ in AXES))
    up, down = plant.friction_levels(jnp.zeros(()), q, rest, rest)
    site = "cart" if axis == "x" else "hoist"
    share = sum(float(e.share) for e in plant.all(LoadDependentFriction, site))
    hidden = sum((float(e.level) for e in plant.all(AbstractHysteresis, site)), start=0.0)
    bridge = plant.bridge
    gain = float(bridge.cart_gain if axis == "x" else bridge.hoist_gain)
    weight = 0.0 if axis == "x" else float(bridge.load_mass * bridge.gravity)
    dead = list(plant.all(DeadZone, "cart_drive" if axis == "x" else "hoist_drive"))
    width = sum(float(e.positive) for e in dead), sum(float(e.negative) for e in dead)
    forwards = (float(getattr(up, axis)) + hidden - weight) / gain
    backwards = -(float(getattr(down, axis)) + hidden + weight) / gain
    # Friction that grows with the drive's force takes a share of it, either way.
    forwards, backwards = forwards / (1.0 - math.copysign(share, forwards)), backwards / (1.0 - share)
    # Where weight alone pays the rope out, the winch must hold it back, from behind the other end of the dead zone.
    return forwards + width[0] if forwards >= 0 else forwards - width[1], backwards - width[1]
