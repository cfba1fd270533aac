"""A recording's rows as grid points; a gap is bridged by further points without a measurement."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...recordings import Recording


@dataclasses.dataclass(frozen=True, kw_only=True)
class Grid:
    """One recording on the engine's grid, in plain NumPy."""

    recording: Recording
    times: NDArray[np.float64]
    """Grid points [s] from the recording's start."""
    u: NDArray[np.float64]
    """Inputs of cart and hoist, held over each interval."""
    dt_before: NDArray[np.float64]
    """Intervals [s] between the rows before the recording's start whose inputs are known,"""
    u_before: NDArray[np.float64]
    """and those inputs."""
    y: NDArray[np.float64]
    measured: NDArray[np.bool_]
    active: tuple[bool, bool, bool]
    """Whether cart, swing and hoist move."""
    length: float
    """A rope length for the parts that do not measure one [m]."""

    @property
    def intervals(self) -> int:
        return len(self.times) - 1


def grid(recording: Recording, step: float) -> Grid:
    """Puts a recording on grid points no farther apart than `step` [s], its own rows among them."""
    t = recording.times - recording.times[0]
    pieces = np.maximum(np.ceil(np.diff(t) / step - 1e-6).astype(int), 1)
    row_at = np.concatenate([[0], np.cumsum(pieces)])
    times = np.interp(np.arange(row_at[-1] + 1), row_at, t)
    held = np.repeat(np.arange(len(pieces)), pieces)
    earlier = recording.earlier
    dt_before = np.zeros(0) if earlier is None else np.diff([*earlier.times, recording.start])
    u, u_before = np.zeros((len(held), 2)), np.zeros((len(dt_before), 2))
    for k, name in enumerate(("u_x", "u_l")):
        if getattr(recording, name) is not None:
            u[:, k] = getattr(recording, name)[held]
            if earlier is not None:
                u_before[:, k] = getattr(earlier, name)
    y, measured = np.zeros((len(times), 3)), np.zeros((len(times), 3), bool)
    for k, axis in enumerate(AXES):
        values = getattr(recording, axis)
        if values is not None:
            y[row_at, k] = values
            measured[row_at, k] = recording.fresh[axis]
    length = recording.locked_length
    if length is None:
        length = 0.5 if recording.l is None else float(np.mean(recording.l))
    active = (recording.has_cart, recording.has_swing, recording.has_hoist)
    return Grid(
        recording=recording,
        times=times,
        u=u,
        dt_before=dt_before,
        u_before=u_before,
        y=y,
        measured=measured,
        active=active,
        length=length,
    )
