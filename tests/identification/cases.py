"""Recordings made for tests: by the engine itself with noise of an encoder's size, or from arrays."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jbridge.model.files import Model
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Plant
from jbridge.recordings import Recording
from jbridge.simulation.runge_kutta import RK4
from tests.problems import CART_ALONE, NUMBERS, make_lane, make_plant, make_state, measure, simulate

NOISE = {"x": 4e-5, "psi": 6.4e-4, "l": 4e-5}
"""Noise of the rig's encoders [m, rad, m]."""
TIMES = np.arange(400) * 0.01
FULL = {
    "u_x": np.sin(3 * TIMES),
    "u_l": np.cos(2 * TIMES),
    "x": 0.5 + 0.2 * np.sin(TIMES),
    "psi": 0.1 * np.sin(4 * TIMES),
    "l": 0.6 + 0.1 * np.cos(TIMES),
}
"""A whole bridge that moves on every axis, as formulas: what a recording has, and no dynamics."""
DRY = ("coulomb_friction", "cart", {"level": 3.5})


def make_recording(name: str, times: NDArray[np.float64], **channels: NDArray[np.float64]) -> Recording:
    """A recording from arrays, every row of which is a fresh sample."""
    measured = {key: channels[key] for key in ("x", "psi", "l") if key in channels}
    inputs = [key for key in ("u_x", "u_l") if key in channels]
    length = 0.7 if "psi" in channels and "l" not in channels else None
    return Recording(
        name=name,
        times=times,
        u_x=channels.get("u_x"),
        u_l=channels.get("u_l"),
        x=channels.get("x"),
        psi=channels.get("psi"),
        l=channels.get("l"),
        fresh={key: np.ones(len(times), bool) for key in measured},
        resolution=dict.fromkeys(measured, 0.0),
        units=dict.fromkeys(inputs, "V"),
        locked_length=length,
        override={},
        initial={},
        extras={},
        notes=(),
    )


def steps(count: int, seed: int, *, hold: int = 40, volts: float = 2.0) -> NDArray[np.float64]:
    """Voltages of a hand at a knob: held for a while, both ways, and now and then let go."""
    key = np.random.default_rng(seed)
    number = -(-count // hold)
    levels = key.uniform(0.4, 1.0, number) * volts * np.where(np.arange(number) % 2, -1.0, 1.0)
    levels[key.random(number) < 0.2] = 0.0
    return np.repeat(levels, hold)[:count]


def play(  # noqa: PLR0913
    plant: Plant,
    u: NDArray[np.float64],
    *,
    name: str = "run.csv",
    active: Sequence[float] = CART_ALONE,
    period: float = 0.01,
    start: Mapping[str, float] | None = None,
    seed: int = 0,
    noise: float = 1.0,
) -> Recording:
    """What the encoders would report of a plant under inputs, with noise.

    Args:
        plant: what moves.
        u: one row `(u_x, u_l)` [V] per interval.
        name: of the recording.
        active: which axes move; of the others nothing is recorded.
        period: length of an interval [s].
        start: `x`, `psi`, `l` at the start, at rest.
        seed: of the noise.
        noise: its size over that of the rig's encoders.
    """
    lane = make_lane(u, period, active=active)
    y = np.array(measure(plant, lane, simulate(plant, make_state(**(start or {})), lane, substeps=8, method=RK4)))
    key = np.random.default_rng(seed)
    times = np.arange(len(u) + 1) * period
    held = np.concatenate([u, u[-1:]])
    channels = {"u_x": held[:, 0]} if active[0] else {}
    if active[2]:
        channels["u_l"] = held[:, 1]
    for k, axis in enumerate(("x", "psi", "l")):
        if active[k]:
            channels[axis] = y[:, k] + noise * NOISE[axis] * key.standard_normal(len(times))
    return make_recording(name, times, **channels)


def cart_recordings(plant: Plant, count: int, *, seconds: float = 6.0, seed: int = 0) -> list[Recording]:
    """Runs of a cart alone, 100 samples a second."""
    found = []
    for i in range(count):
        u = steps(round(seconds / 0.01), seed + i)
        both = np.stack([u, np.zeros_like(u)], axis=1)
        found.append(play(plant, both, name=f"run-{i + 1}.csv", start={"x": 0.6}, seed=seed + i))
    return found


def cart_model(*effects: tuple[str, str, dict], known: Sequence[str] = (), **changes: float) -> Model:
    """A model of a cart alone, whose mass is known."""
    plant = make_plant(*effects, **changes)
    return Model(plant, frozenset(("cart_mass", "gravity", *known)), frozenset(NUMBERS), {}, "model.toml")


def scaled(model: Model, factors: Mapping[str, float]) -> Model:
    """A model with some numbers multiplied."""
    table = ParameterTable(model.plant)
    vector = np.array(table.ravel(model.plant))
    for name, factor in factors.items():
        vector[table.positions(name)] *= factor
    return Model(table.unravel(vector), model.known, model.given, model.uncertainty, model.source)


def values(plant: Plant) -> dict[str, float]:
    """Every number of a plant by name."""
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant))
    return {name: float(vector[table.positions(name)[0]]) for name in table.names()}


ROOT = Path(__file__).parents[2]
