"""What recordings cover: the ranges from which an effect proposes where to start looking for it."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..model.effects.base import CART, HOIST, SITES, SWING, Scene
from ..model.effects.friction import CoulombFriction
from ..model.plant import Plant
from .setting import Setting


def scene_of(setting: Setting, plant: Plant) -> Scene:
    """What the training recordings cover."""
    low, high, speed, acceleration = {}, {}, {}, {}
    for name in (*AXES, "u_x", "u_l"):
        parts = [getattr(r, name) for r in setting.recordings if getattr(r, name) is not None]
        values = np.concatenate(parts) if parts else np.zeros(1)
        low[name], high[name] = float(values.min()), float(values.max())
    for axis in AXES:
        rates, bends = [], []
        for r in setting.recordings:
            values = getattr(r, axis)
            if values is not None:
                fresh = r.fresh[axis]
                t, y = r.times[fresh], values[fresh]
                k = max(1, int(0.05 / max(np.median(np.diff(t)), 1e-6)))
                rates.append((y[k:] - y[:-k]) / (t[k:] - t[:-k]))
                bends.append((rates[-1][k:] - rates[-1][:-k]) / (0.5 * (t[2 * k :] - t[: -2 * k])))
        speed[axis], acceleration[axis] = _high(rates, 0.95), _high(bends, 0.99)
    friction = dict.fromkeys(SITES, 0.0)
    for site in (CART, SWING, HOIST):
        for effect in plant.all(CoulombFriction, site):
            # A level that the fit has brought to zero still takes what is common to an added law.
            friction[site] += max(float(effect.level), 1e-9)
    return Scene(
        low=low,
        high=high,
        speed=speed,
        acceleration=acceleration,
        recorded=_union([(r.begun, r.begun + r.duration) for r in setting.recordings]),
        runs=tuple(
            (start + r.begun, start + r.begun + r.duration)
            for r in setting.recordings
            for start in [setting.starts(r)]
            if math.isfinite(start)
        ),
        period=float(np.median([r.period for r in setting.recordings])),
        length=setting.length,
        bridge={
            "cart_mass": float(plant.bridge.cart_mass),
            "load_mass": float(plant.bridge.load_mass),
            "winch_mass": float(plant.bridge.winch_mass),
            "gravity": float(plant.bridge.gravity),
            "cart_gain": float(plant.bridge.cart_gain),
            "hoist_gain": float(plant.bridge.hoist_gain),
        },
        friction=friction,
    )


def _high(found: Sequence[NDArray[np.float64]], share: float) -> float:
    """A quantile of the sizes of all values; 0.1 where there are none."""
    sizes = np.abs(np.concatenate([np.zeros(0), *found]))
    return float(np.quantile(sizes, share)) if sizes.size else 0.1


def _union(spans: Iterable[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Spans as those that they cover together, in order."""
    found: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if found and begin <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((begin, end))
    return tuple(found)
