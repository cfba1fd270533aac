"""How far runs of one input differ: what no model of the rig can foresee."""

import math

import numpy as np

from ..._types import AXES
from ..data.grid import Grid
from ..data.windows import Data


def scatter(data: Data, horizon: float) -> dict[str, float] | None:
    """How far runs of one input differ, by channel [m, rad, m]: rms difference over sqrt 2 of windows of one length.

    A window's difference is counted from what the two differ by at its beginning. None where no input was recorded
    twice.
    """
    pairs = [(i, j) for i in range(len(data.grids)) for j in range(i) if _same_input(data.grids[i], data.grids[j])]
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


def _same_input(a: Grid, b: Grid) -> bool:
    n = min(len(a.u), len(b.u))
    if n < 0.9 * max(len(a.u), len(b.u)):
        return False
    size = float(np.ptp(a.u[:n]))
    return size > 0 and float(np.sqrt(np.mean((a.u[:n] - b.u[:n]) ** 2))) < 0.01 * size
