"""Recordings with fewer samples, for a search among many models; what is reported is judged on all samples."""

import dataclasses

import numpy as np

from ...recordings import Recording

PERIOD = 0.004
"""Time between samples [s] below which a bridge does nothing that a search would miss."""
_FRESH = 0.9
"""Least share of the rows taken that are measurements of every channel; a slower channel has fewer."""


def thinned(recording: Recording) -> Recording:
    """Every so many rows of a recording sampled faster than `PERIOD`, each with the mean input until the next.

    The mean has the impulse of the inputs that it stands for. Recordings with slower channels or uneven rows stay as
    they are.
    """
    times = recording.times
    factor = int(PERIOD / recording.period + 1e-6)
    even = np.ptp(np.diff(times)) < 0.5 * recording.period
    if factor < 2 or not even:
        return recording
    rows = np.arange(0, len(times) - factor + 1, factor)
    if any(fresh[rows].mean() < _FRESH for fresh in recording.fresh.values()):
        return recording

    def mean(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.add.reduceat(values[: rows[-1] + factor], rows) / factor

    def taken(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[rows]

    return dataclasses.replace(
        recording,
        times=times[rows],
        u_x=mean(recording.u_x),
        u_l=mean(recording.u_l),
        x=taken(recording.x),
        psi=taken(recording.psi),
        l=taken(recording.l),
        fresh={name: fresh[rows] for name, fresh in recording.fresh.items()},
        extras={name: values[rows] for name, values in recording.extras.items()},
    )
