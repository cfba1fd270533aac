"""Recordings with fewer samples, for a search among many models; what is reported is judged on all samples."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from ...recordings import Recording
from ...recordings.recording import Commands

PERIOD = 0.004
"""Time between samples [s] below which a bridge does nothing that a search would miss."""
_FRESH = 0.9
"""Least share of the rows taken that are measurements of every channel; a slower channel has fewer."""


def thinned(recording: Recording) -> Recording:
    """The first row of every few milliseconds of a recording sampled faster than `PERIOD`, each with the mean input
    until the next; the inputs before its first row as well.

    The mean has the impulse of the inputs that it stands for. Recordings with slower channels stay as they are.
    """
    times, period = recording.times, recording.period
    factor = int(PERIOD / period + 1e-6)
    if factor < 2:
        return recording
    width, end = factor * period, recording.start + recording.duration + period
    # Cells begin between rows, so that none falls into another one for a stamp that is a little early.
    rows = _firsts(np.floor((times - times[0]) / width + 0.5 / factor))
    if end - times[rows[-1]] < width - 0.5 * period:
        rows, end = rows[:-1], times[rows[-1]]
    if any(fresh[rows].mean() < _FRESH for fresh in recording.fresh.values()):
        return recording

    def taken(values: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        return None if values is None else values[rows]

    earlier = recording.earlier
    if earlier is not None:
        # Counted back from the first row, so that the last of these times reaches to it.
        before = _firsts(-np.ceil((times[0] - earlier.times) / width - 0.5 / factor))
        earlier = Commands(earlier.times[before], *_means(earlier, before, recording.start))
    u_x, u_l = _means(Commands(times, recording.u_x, recording.u_l), rows, end)
    return dataclasses.replace(
        recording,
        times=times[rows],
        u_x=u_x,
        u_l=u_l,
        x=taken(recording.x),
        psi=taken(recording.psi),
        l=taken(recording.l),
        earlier=earlier,
        fresh={name: fresh[rows] for name, fresh in recording.fresh.items()},
        extras={name: values[rows] for name, values in recording.extras.items()},
    )


def _firsts(cells: NDArray[np.float64]) -> NDArray[np.intp]:
    """The first row of each cell, given every row's cell in increasing order."""
    return np.flatnonzero(np.diff(cells, prepend=-math.inf) > 0)


def _means(
    commands: Commands, rows: NDArray[np.intp], end: float
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """Mean of each input, held between rows, from each of some rows to the next or to the end [s]."""
    spans = np.diff(np.append(commands.times, end))
    spans = np.where(commands.times < end, spans, 0.0)

    def mean(values: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
        if values is None:
            return None
        return np.add.reduceat(values * spans, rows) / np.add.reduceat(spans, rows)

    return mean(commands.u_x), mean(commands.u_l)
