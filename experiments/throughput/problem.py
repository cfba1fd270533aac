"""What all engines are given: bridges, voltages, references. Nothing here knows an engine."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import jbridge

MODES = {"open": (0.005, 1), "closed": (0.02, 4)}
"""Held interval or sampling period [s], and steps in each."""
MODEL = {
    "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81, "cart_damping": 45.0,
    "swing_damping": 0.0015, "hoist_damping": 25.0, "cart_gain": 16.0, "hoist_gain": 3.0,
}  # fmt: skip
EFFECTS = {"cart friction": 4.0, "hoist friction": 3.0, "cart dead zone": 0.25, "hoist dead zone": 0.45, "lag": 0.06}
TOML = """
[[effect]]
kind = "coulomb_friction"
site = "cart"
level = {cart friction}
[[effect]]
kind = "coulomb_friction"
site = "hoist"
level = {hoist friction}
[[effect]]
kind = "dead_zone"
site = "cart_drive"
positive = {cart dead zone}
negative = {cart dead zone}
[[effect]]
kind = "dead_zone"
site = "hoist_drive"
positive = {hoist dead zone}
negative = {hoist dead zone}
[[effect]]
kind = "actuator_lag"
site = "hoist_drive"
time_constant = {lag}
"""


class Given(NamedTuple):
    """A batch: parameters and starts of every lane, and what all lanes are given over time."""

    rows: np.ndarray
    starts: np.ndarray
    """x, psi, l [m, rad, m]."""
    table: np.ndarray
    """Open: voltages of cart and hoist; closed: wanted x and l [m]; one row per period."""


def load_model(folder: Path) -> Any:
    """The full bridge, written to a folder and read from there."""
    path = folder / "model.toml"
    path.write_text("[bridge]\n" + "".join(f"{k} = {v}\n" for k, v in MODEL.items()) + TOML.format(**EFFECTS))
    return jbridge.load_model(path)


def batch(mode: str, lanes: int, seconds: float) -> Given:
    """Bridges that differ in load, friction and first angle."""
    key = np.random.default_rng(0)
    numbers = [*MODEL.values(), *EFFECTS.values(), 3.0, 3.0]
    rows = np.repeat(np.array([numbers]), lanes, axis=0)
    rows[:, 1], rows[:, 9] = key.uniform(0.1, 0.2, lanes), key.uniform(3.0, 5.0, lanes)
    begin = (0.3, 0.6) if mode == "open" else (0.0, 0.185)
    starts = np.stack([np.full(lanes, begin[0]), key.uniform(-0.1, 0.1, lanes), np.full(lanes, begin[1])], axis=1)
    count = round(seconds / MODES[mode][0])
    if mode == "open":
        held = key.uniform(-1, 1, (-(-count // 40), 2)) * [2.5, 3.0] + [0.0, -0.3]
        return Given(rows, starts, np.repeat(held, 40, axis=0)[:count])
    path = jbridge.smooth_path([(0.0, 0.185), (1.2, 0.6)], speed=(0.45, 0.3), rest=seconds, period=MODES[mode][0])
    return Given(rows, starts, np.stack([path.x, path.l], axis=1)[:count])


class Bare(NamedTuple):
    """A bridge without friction and drives, as every engine has it, under given forces."""

    numbers: dict[str, float]
    starts: np.ndarray
    forces: np.ndarray
    """Of cart and hoist [N], one row per step of `MODES["open"][0]`."""
    held: int
    """Steps for which a force stays the same."""


def bare(lanes: int, seconds: float, *, free_hoist: bool = False) -> Bare:
    """Lanes that differ in the first angle.

    Args:
        lanes: how many.
        seconds: of motion.
        free_hoist: whether winch and damping (but the cart's) are left out too.
    """
    key = np.random.default_rng(1)
    held = 40
    numbers = MODEL | {"cart_gain": 1.0, "hoist_gain": 1.0}
    if free_hoist:
        numbers |= {"winch_mass": 0.0, "swing_damping": 0.0, "hoist_damping": 0.0}
    count = round(seconds / MODES["open"][0])
    blocks = -(-count // held)
    weight = numbers["load_mass"] * numbers["gravity"]
    sway = 0.02 if free_hoist else 3.0
    turns = np.resize([1.0, -1.0, -1.0, 1.0], blocks)
    forces = np.stack([key.uniform(-1, 1, blocks) * 30.0, sway * turns - weight], axis=1)
    starts = np.stack([np.full(lanes, 0.3), key.uniform(-0.1, 0.1, lanes), np.full(lanes, 0.6)], axis=1)
    return Bare(numbers, starts, np.repeat(forces, held, axis=0)[:count], held)
