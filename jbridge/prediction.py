"""`simulate`: what the encoders would read, for a model and a recording's inputs."""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jax import jit, jvp

from ._display import Displayed
from ._types import AXES, Axes
from .compilation.threads import one_thread_each
from .errors import InputError
from .identification.data.grid import grid
from .identification.evaluation.judge import free_run
from .identification.setting import resolve
from .model.files import Model, requires
from .model.parameters import ParameterTable
from .model.plant import Motion, Plant
from .model.step_size import substeps
from .recordings import Recording, as_recordings
from .simulation.inputs import Lane
from .simulation.measurement import read, readings
from .simulation.rollout import rollout
from .simulation.runge_kutta import RK4

_STEP = 0.0025
"""Longest step of a rigid bridge [s]."""
_NEWTON = 6
"""Steps that bring a start's readings to rounding errors: sensors are nearly linear."""
_WOUND_IN = 0.02
"""Rope [m] with which no swing is left."""
_LOST = 900.0
"""Reading [m, rad] that no bridge reaches; simulations from an estimated state stop a little farther on."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Simulation(Displayed, Mapping[str, np.ndarray]):
    """What the sensors would read: columns by name, like a dictionary."""

    columns: Mapping[str, np.ndarray]
    """`t` [s] as in the recording, its inputs, and `x` [m], `psi` [rad], `l` [m], each of shape `(time,)`."""
    recording: Recording

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def errors(self) -> dict[str, float]:
        """Root mean square error by measured channel [m, rad, m], over the rows that bring a new sample."""
        out = {}
        for axis in AXES:
            measured = getattr(self.recording, axis)
            if measured is not None and axis in self.columns:
                left = (self.columns[axis] - measured)[self.recording.fresh[axis]]
                out[axis] = float(np.sqrt(np.mean(left**2)))
        return out


@one_thread_each
def simulate(
    model: Model, recording: Recording, initial: Literal["estimated", "first-row"] = "estimated"
) -> Simulation:
    """Plays a recording's inputs to a model.

    The parts come from the recording's channels; where it has inputs alone, from the model and the initial values in
    its sidecar. Drives have felt what was commanded before.

    Args:
        model: what moves.
        recording: inputs, and where they begin.
        initial: where a recording with measurements begins. `estimated`: in the state, velocities included, that its
            first 0.5 s tells best, so that errors are those of a report. `first-row`: at rest where the sensors would
            read the first sample, or at `[initial]` of the sidecar. A recording of inputs alone begins at `[initial]`.

    Returns:
        Columns by name: `t` [s] as in the recording, its inputs, and `x` [m], `psi` [rad], `l` [m] as the sensors
        read them, without noise or rounding.

    Raises:
        InputError: the model lacks a part that the recording has, or runs away.
    """
    if initial not in ("estimated", "first-row"):
        raise ValueError(f"initial is 'estimated' or 'first-row', not {initial!r}")
    [recording] = as_recordings([recording])
    parts = _parts(model, recording)
    requires(model, [axis for axis in AXES if parts[axis]])
    measured = any(getattr(recording, axis) is not None for axis in AXES)
    if initial == "estimated" and measured and any(parts.values()):
        y = free_run(model.plant, recording)
    else:
        y = _from_rest(model, recording, parts)
    lost = np.flatnonzero(~(np.abs(y) < _LOST).all(axis=1) | ((y[:, 2] < _WOUND_IN) & parts["psi"] & parts["l"]))
    if len(lost):
        raise InputError(_runs_away(model, recording, y, int(lost[0])))
    out = {"t": recording.times}
    for name in ("u_x", "u_l"):
        if getattr(recording, name) is not None:
            out[name] = getattr(recording, name)
    for k, axis in enumerate(AXES):
        if parts[axis] or (axis == "l" and parts["psi"]):
            out[axis] = y[:, k]
    return Simulation(out, recording)


def _from_rest(model: Model, recording: Recording, parts: dict[str, bool]) -> np.ndarray:
    """Readings at the rows, `(row, 3)`, of a run that begins at rest."""
    plant = model.plant
    initial = np.zeros(plant.states)
    for k, axis in enumerate(AXES):
        measured = getattr(recording, axis)
        if axis in recording.initial:
            initial[k] = recording.initial[axis]
        elif measured is not None:
            initial[k] = measured[0]
        elif axis == "l":
            initial[k] = recording.locked_length if recording.locked_length is not None else math.nan
    if math.isnan(initial[2]):
        if parts["psi"] or parts["l"]:
            raise InputError(
                f"{recording.name}: no rope length to start from; add an l column or [initial] l = 0.7 to its sidecar"
            )
        initial[2] = 0.5
    plant = resolve(plant, float(initial[2]))
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant), dtype=float)
    for name, value in recording.override.items():
        vector[table.positions(name)] = value
    seen = [k for k, axis in enumerate(AXES) if getattr(recording, axis) is not None and axis not in recording.initial]
    initial[seen] = _behind_sensors(table.unravel(jnp.asarray(vector)), recording.begun, initial[:3])[seen]
    on = grid(recording, max(recording.period, 1e-4))
    row_at = np.searchsorted(on.times, recording.times - recording.start)
    finer = substeps(plant, recording.period, _STEP)
    lane = Lane(
        jnp.asarray(recording.begun),
        jnp.asarray(np.diff(on.times)),
        jnp.asarray(np.concatenate([on.u_before, on.u])),
        jnp.asarray(on.dt_before),
        Axes(*(jnp.asarray(float(parts[axis])) for axis in AXES)),
    )

    @jit
    def run(vector: jnp.ndarray, initial: jnp.ndarray, lane: Lane) -> jnp.ndarray:
        known = table.unravel(vector)
        return readings(known, lane, rollout(known, initial, lane, substeps=finer, method=RK4))

    return np.asarray(run(jnp.asarray(vector), jnp.asarray(initial), lane))[row_at]


def _behind_sensors(plant: Plant, time: float, reading: np.ndarray) -> np.ndarray:
    """Positions `x`, `psi`, `l` at rest of which the sensors would read this: a few steps of Newton's method."""
    times, rest = jnp.array([time, time + 1.0]), Motion(*(jnp.zeros(2) for _ in range(6)))

    def readings_at(q: jnp.ndarray) -> jnp.ndarray:
        x, psi, l = (jnp.full(2, value) for value in q)
        return read(plant, times, Motion(x, psi, l, motor=x, loaded=l, phi=psi), rest)[0]

    q = jnp.asarray(reading)
    for _ in range(_NEWTON):
        found, slope = jvp(readings_at, (q,), (jnp.ones(3),))  # each sensor reads its own axis
        q = q - (found - reading) / slope
    return np.asarray(q)


def _runs_away(model: Model, recording: Recording, y: np.ndarray, row: int) -> str:
    whose, after = model.source or "the model", f"{recording.times[row] - recording.times[0]:.3g} s after the start"
    if (y[: row + 1, 2] < _WOUND_IN).any():
        fate, remedy = "has no rope left", "correct hoist_gain, or what holds the winch"
    else:
        fate, remedy = "runs away", "see whether a mass is too small, or a stiffness or damping too large, in SI units"
    return f"{whose}: with the inputs of {recording.name} it {fate} {after}; {remedy}"


def _parts(model: Model, recording: Recording) -> dict[str, bool]:
    if any(getattr(recording, axis) is not None for axis in AXES):
        return {"x": recording.has_cart, "psi": recording.has_swing, "l": recording.has_hoist}
    loaded = "load_mass" in model.given
    return {
        "x": "cart_mass" in model.given and recording.u_x is not None,
        "psi": loaded,
        "l": loaded and "hoist_gain" in model.given and recording.u_l is not None,
    }
