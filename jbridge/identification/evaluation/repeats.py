"""How far runs of one input differ: what no model of the rig can foresee."""

import math

import numpy as np

from ..._types import AXES
from ..data.windows import WHOLE, Data

_ALIKE = 0.01
"""Difference of two inputs over their range, and of two rope lengths over the longer one, up to which they are one."""


def scatter(data: Data, horizon: float) -> dict[str, float] | None:
    """How far repeated runs differ, by channel [m, rad, m]: rms difference over sqrt 2 of windows of one length.

    A window's difference is counted from what the two differ by at its beginning. None where no run was repeated: with
    the same input, parameters and rope length, from the same state but for the cart's place.

    Args:
        data: of the recordings, with the tilings of whole recordings.
        horizon: length of the windows [s].
    """
    pairs = [(i, j) for i in range(len(data.grids)) for j in range(i) if _same_run(data, i, j)]
    if not pairs:
        return None
    sums, counts = np.zeros(3), np.zeros(3)
    for i, j in pairs:
        n = min(data.grids[i].intervals, data.grids[j].intervals) + 1
        both = data.measured[i, :n] & data.measured[j, :n]
        apart = np.where(both, data.y[i, :n] - data.y[j, :n], 0.0)
        length = n if math.isinf(horizon) else max(int(round(horizon / data.period)), 2)
        for a in range(0, n - length + 1, length):
            own = apart[a : a + length]
            seen = both[a : a + length]
            head = max(min(int(round(0.02 / data.period)), length // 4), 1)
            begin = own[:head].sum(axis=0) / np.maximum(seen[:head].sum(axis=0), 1)
            sums += (((own - begin) ** 2) * seen).sum(axis=0)
            counts += seen.sum(axis=0)
    return {axis: float(np.sqrt(sums[k] / counts[k] / 2.0)) for k, axis in enumerate(AXES) if counts[k] > 0}


def _same_run(data: Data, i: int, j: int) -> bool:
    """Whether two recordings are of one experiment."""
    a, b = data.grids[i], data.grids[j]
    n = min(len(a.u), len(b.u))
    if n < 0.9 * max(len(a.u), len(b.u)) or a.active != b.active or a.recording.override != b.recording.override:
        return False
    size = np.ptp(a.u[:n], axis=0)
    if not size.any() or np.any(np.sqrt(np.mean((a.u[:n] - b.u[:n]) ** 2, axis=0)) > _ALIKE * size):
        return False
    one, other = (next(t for t in data.tilings if t.recording == k and t.horizon == WHOLE) for k in (i, j))
    apart = np.abs(one.states[0] - other.states[0])
    room = np.hypot(1.0 / one.precision[0], 1.0 / other.precision[0])
    room[2] += _ALIKE * max(one.states[0, 2], other.states[0, 2])
    return bool(np.all(apart[1:] <= room[1:]))
