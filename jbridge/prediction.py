"""`simulate`: what the encoders would read, for a model and a recording's inputs."""

import math

import jax.numpy as jnp
import numpy as np
from jax import jit

from ._types import AXES, Axes
from .errors import InputError
from .identify.lanes import grid
from .inputs import Lane
from .model.files import Model, requires
from .model.parameters import ParameterTable
from .model.steps import substeps
from .recordings import Recording
from .rollout import RK4, readings, rollout

_STEP = 0.0025
"""Longest step of a rigid bridge [s]."""


def simulate(model: Model, recording: Recording) -> dict[str, np.ndarray]:
    """Plays a recording's inputs to a model.

    The parts come from the recording's channels; where it has inputs alone, from the model and the initial values in
    its sidecar. The run starts from the first measured sample (or `[initial]`), at rest, with drives that felt what was
    commanded before.

    Args:
        model: what moves.
        recording: inputs, and where they begin.

    Returns:
        Columns by name: `t` [s] as in the recording, its inputs, and `x` [m], `psi` [rad], `l` [m] as the sensors
        read them, without noise or rounding.

    Raises:
        InputError: the model lacks a part that the recording has, or runs away.
    """
    parts = _parts(model, recording)
    requires(model, [axis for axis in AXES if parts[axis]])
    plant = model.plant
    initial = np.zeros(6 + 2 * len(plant.mechanisms))
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
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant), dtype=float)
    for name, value in recording.override.items():
        vector[table.positions(name)] = value
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

    y = np.asarray(run(jnp.asarray(vector), jnp.asarray(initial), lane))[row_at]
    lost = np.flatnonzero(~np.isfinite(y).all(axis=1))
    if len(lost):
        raise InputError(
            f"{model.source or 'the model'}: played the inputs of {recording.name}, it runs away "
            f"{recording.times[lost[0]] - recording.times[0]:.3g} s after the start; see whether a mass is too small, "
            "or a stiffness or damping too large, in SI units"
        )
    out = {"t": recording.times}
    for name in ("u_x", "u_l"):
        if getattr(recording, name) is not None:
            out[name] = getattr(recording, name)
    for k, axis in enumerate(AXES):
        if parts[axis] or (axis == "l" and parts["psi"]):
            out[axis] = y[:, k]
    return out


def _parts(model: Model, recording: Recording) -> dict[str, bool]:
    if any(getattr(recording, axis) is not None for axis in AXES):
        return {"x": recording.has_cart, "psi": recording.has_swing, "l": recording.has_hoist}
    loaded = "load_mass" in model.given
    return {
        "x": "cart_mass" in model.given and recording.u_x is not None,
        "psi": loaded,
        "l": loaded and "hoist_gain" in model.given and recording.u_l is not None,
    }
