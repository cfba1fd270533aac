"""The force that a recorded motion needs beyond what the model has, along one recording.

Measured coordinates are smoothed by local parabolas; the equations of motion turn position, velocity and acceleration
into the generalized force that must have acted, and the model's own forces, smoothed alike, are taken off. It needs
no simulation, so it cannot run away: a superb view of where a mismatch sits, and a poor judge of what it is.
"""

import dataclasses
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from .._types import AXES, Axes, Scalar
from ..compilation.programs import kept
from ..model.parameters import ParameterTable
from ..model.plant import Motion, Plant
from ..recordings import Recording
from ..simulation.inputs import Lane, drive_inputs
from .data.grid import Grid

_HALF_WIDTH = {"x": 0.06, "psi": 0.08, "l": 0.06}
"""Half of the smoothing window [s]: longer lets blur reversals, shorter lets noise into the acceleration."""

_PAST = 5.0
"""Time before a recording [s] whose inputs its drives may feel."""


@dataclasses.dataclass(frozen=True)
class Balance:
    """Residual force of one recording on an even grid."""

    times: NDArray[np.float64]
    q: Mapping[str, NDArray[np.float64]]
    v: Mapping[str, NDArray[np.float64]]
    force: Mapping[str, NDArray[np.float64]]
    """Missing force by axis [N, N m, N]; NaN where the axis rests or reverses, since friction may hold anything."""
    u: Mapping[str, NDArray[np.float64]]

    def less(self, own: "Balance") -> "Balance":
        """The same less the force of another motion under the same input, which is blurred alike."""
        return dataclasses.replace(self, force={axis: force - own.force[axis] for axis, force in self.force.items()})

    def blurred_like(self, own: "Balance", axis: str) -> bool:
        """Whether another motion under the same input runs so close that taking its force off leaves less."""
        force, left = self.force[axis], self.less(own).force[axis]
        known = np.isfinite(left)
        return bool(np.sum(left[known] ** 2) < np.sum(force[known] ** 2))


def balance(plant: Plant, recording: Recording) -> Balance:
    """Residual force of a recording under a plant; what the sensors do wrong is not undone.

    Args:
        plant: the model.
        recording: measured run, whose own parameter values take the place of the plant's.
    """
    if recording.override:
        table = ParameterTable(plant)
        vector = np.array(table.ravel(plant))
        for name, value in recording.override.items():
            vector[table.positions(name)] = value
        plant = table.unravel(vector)
    period = max(recording.period, 0.002)
    t = np.arange(0.0, recording.duration, period)
    rows = recording.times - recording.times[0]
    q, v, a = {}, {}, {}
    bridged = np.zeros(len(t), bool)
    for axis in AXES:
        values = getattr(recording, axis)
        if values is None:
            length = recording.locked_length if axis == "l" else None
            q[axis] = np.full_like(t, length if length is not None else (0.5 if axis == "l" else 0.0))
            v[axis], a[axis] = np.zeros_like(t), np.zeros_like(t)
            continue
        fresh = recording.fresh[axis]
        even = np.interp(t, rows[fresh], values[fresh])
        if not np.isfinite(even).all():  # a simulation that ran away
            q[axis] = v[axis] = a[axis] = np.full_like(t, np.nan)
            continue
        half = max(_HALF_WIDTH[axis], 4.0 * float(np.median(np.diff(rows[fresh]))))
        # What is smoothed across a gap is no motion that was measured.
        for i in np.flatnonzero(np.diff(rows[fresh]) > half):
            begin, end = rows[fresh][i : i + 2]
            bridged |= (t > begin - half) & (t < end + half)
        width = 2 * max(2, round(half / period)) + 1
        width = min(width, (len(t) - 1) // 2 * 2 - 1)
        q[axis], v[axis], a[axis] = (
            savgol_filter(even, width, 2, deriv=order, delta=period, mode="interp") for order in range(3)
        )
        if axis == "l" and not recording.has_hoist:
            v[axis], a[axis] = np.zeros_like(t), np.zeros_like(t)
    width = 2 * max(2, round(_HALF_WIDTH["x"] / period)) + 1
    commands = recording.commands
    given = commands.times - recording.start
    # Delays and lags feel what was commanded before.
    since = np.arange(-np.floor(min(-given[0], _PAST) / period), 0.0) * period
    played = np.concatenate([since, t])
    held = np.clip(np.searchsorted(given, played, side="right") - 1, 0, len(given) - 1)
    commanded = {name: part[held] for name in ("u_x", "u_l") if (part := getattr(commands, name)) is not None}
    inputs = np.stack([commanded.get(name, np.zeros_like(played)) for name in ("u_x", "u_l")], axis=1)
    scale = float(plant.time_scale())
    start, span = (scale * part for part in (float(played[0]) + recording.begun, period))
    behind = _behind_drives(plant, start, inputs, span)
    u, volts = ({name: values[len(since) :] for name, values in part.items()} for part in (commanded, behind))
    true_v, true_a = ({axis: y / scale**n for axis, y in part.items()} for n, part in ((1, v), (2, a)))
    force = _residual(plant, scale * (t + recording.begun), q, true_v, true_a, volts, recording)
    out = {}
    for axis in AXES:
        moves = {"x": recording.has_cart, "psi": recording.psi is not None, "l": recording.has_hoist}[axis]
        if not moves:
            continue
        values = force[axis]
        known = np.isfinite(values) & ~bridged
        filled = np.where(known, values, 0.0)
        weight = np.convolve(known, np.ones(width) / width, mode="same")
        smooth = np.convolve(filled, np.ones(width) / width, mode="same") / np.maximum(weight, 1e-9)
        out[axis] = np.where(known & (weight > 0.99), smooth, np.nan)
    return Balance(t, q, v, out, u)


def as_played(grid: Grid, predicted: NDArray[np.float64]) -> Recording:
    """A recording as a model would have made it.

    Smoothing blurs reversals, and what blur takes for a force is many times what is looked for. A model's own motion
    is blurred alike at the same moments, so its balance tells what of the recording's is blur.

    Args:
        grid: the measured run.
        predicted: the model's readings there: `(sample, 3)` [m, rad, m].
    """
    recording = grid.recording
    times = recording.times - recording.times[0]
    changed = {}
    for k, axis in enumerate(AXES):
        if getattr(recording, axis) is not None:
            changed[axis] = np.interp(times, grid.times, predicted[: grid.intervals + 1, k])
    return dataclasses.replace(recording, **changed)


@kept(once=True)
def _chain(
    plant: Plant, start: Scalar, dt: Float[Array, " time"], inputs: Float[Array, "time 2"]
) -> Float[Array, "time 2"]:
    one = jnp.ones(())
    lane = Lane(start, dt, inputs, jnp.zeros(0), Axes(one, one, one))
    return drive_inputs(plant, lane).mean[:, 0]


def _behind_drives(
    plant: Plant, start: float, inputs: NDArray[np.float64], period: float
) -> dict[str, NDArray[np.float64]]:
    chain = np.asarray(_chain(plant, np.asarray(start), np.full(len(inputs), period), inputs))
    constants = plant.time_constants()
    volts: dict[str, NDArray[np.float64]] = {}
    for k, axis in enumerate(("x", "l")):
        w = chain[:, k]
        constant = float(getattr(constants, axis))
        if constant > 0:
            keep, mean = float(np.exp(-period / constant)), float(-np.expm1(-period / constant)) * constant / period
            state, lagged = 0.0, np.empty_like(w)
            for i, value in enumerate(w):
                lagged[i] = value + (state - value) * mean
                state = value + (state - value) * keep
            w = lagged
        volts[axis] = w
    return volts


def _residual(
    plant: Plant,
    t: NDArray[np.float64],
    q: Mapping[str, NDArray[np.float64]],
    v: Mapping[str, NDArray[np.float64]],
    a: Mapping[str, NDArray[np.float64]],
    volts: Mapping[str, NDArray[np.float64]],
    recording: Recording,
) -> dict[str, NDArray[np.float64]]:
    """Needed force less the model's, before smoothing; mechanisms' hidden coordinates are taken as at rest."""
    loaded = recording.has_swing or recording.has_hoist
    motion = [[part[axis] for axis in AXES] for part in (q, v, a)]
    axes = [Axes(*part) for part in jax.device_put([*motion, [volts["x"], np.zeros(len(t)), volts["l"]]])]
    rest, up, down = _left_over(loaded, plant, t, *axes)
    out = {}
    for k, axis in enumerate(AXES):
        speed = v[axis]
        # An axis counts as moving above a speed at which the smoothing window sees no reversal.
        slow = 0.08 * max(float(np.quantile(np.abs(speed), 0.9)), 1e-6)
        friction = np.where(speed > 0, -np.asarray(up[k]), np.asarray(down[k]))
        out[axis] = np.where(np.abs(speed) > slow, np.asarray(rest[k]) - friction, np.nan)
    return out


@kept(static=(0,), once=True)
def _left_over(
    loaded: bool, plant: Plant, t: Float[Array, " time"], q: Axes, v: Axes, a: Axes, volts: Axes
) -> tuple[Axes, Axes, Axes]:
    """Forces that no part of the plant gives, and its friction levels up and down, at every time."""

    def at(t: Scalar, q: Axes, v: Axes, a: Axes, volts: Axes) -> tuple[Axes, Axes, Axes]:
        m, bias = plant.inertia(q, v, 1.0 if loaded else 0.0)
        needed = m @ a
        force, resistance = plant.smooth_forces(t, Motion(*q), Motion(*v), 1.0 if loaded else 0.0)
        drive = plant.drive_forces(volts._replace(l=volts.l * plant.drum_gain(q.l)), Motion(*q), Motion(*v))
        drive, resistance = plant.looped(drive, resistance, v)
        up, down = plant.friction_levels(t, q, v, plant.loads(q, v, drive))
        rest = Axes(*(n + c - f - r - d for n, c, f, r, d in zip(needed, bias, force, resistance, drive, strict=True)))
        return rest, up, down

    return jax.vmap(at)(t, q, v, a, volts)
