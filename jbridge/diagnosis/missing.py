"""The force that the model as given lacks: where it acts, how it goes, and what it is like."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.base import BaseFit
from ..identify.latent import Force, Latent, unknown_forces
from ..identify.result import Trace
from .describe import INPUT_OF, Track, describe
from .result import Likeness, MissingForce


def missing_forces(base: BaseFit, traces: Sequence[Trace], progress: Callable[[str], None]) -> Latent:
    """Smoothed unknown forces on all axes, and the evidence for one at each site.

    Args:
        base: the model as given, refitted.
        traces: the training recordings, in order, with the force balance of that model.
        progress: told what goes on.
    """
    progress("looking for the force that is missing")
    scale = np.zeros(3)
    for k, axis in enumerate(AXES):
        forces = [trace.force_before[axis] for trace in traces if axis in trace.force_before]
        known = np.concatenate(forces) if forces else np.zeros(0)
        known = known[np.isfinite(known)]
        scale[k] = float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
    return unknown_forces(base.engine.table, base.vector, base.free_run, base.fits.initial[0], scale)


def force_along(forces: Sequence[Force], traces: Sequence[Trace], axis: str) -> tuple[MissingForce, ...]:
    """That of one axis, by recording."""
    k = AXES.index(axis)
    return tuple(
        MissingForce(trace.recording, force.times, force.mean[:, k], force.std[:, k])
        for force, trace in zip(forces, traces, strict=True)
    )


def likeness_of(forces: Sequence[MissingForce], traces: Sequence[Trace], axis: str) -> Likeness:
    """What the force on an axis hangs on."""
    widest = max(float(force.std.max(initial=0.0)) for force in forces)
    tracks = [_track(force, trace, axis, widest) for force, trace in zip(forces, traces, strict=True)]
    return describe(tracks, axis)


def _track(force: MissingForce, trace: Trace, axis: str, widest: float) -> Track:
    def at(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(force.times, trace.times, values)

    others = {}
    for other in AXES:
        if other != axis and other in trace.coordinates:
            others[other] = at(trace.coordinates[other])
            others[f"v_{other}"] = at(trace.velocities[other])
    for name, values in trace.inputs.items():
        if name != INPUT_OF[axis]:
            others[name] = at(values)
    return Track(
        force.times,
        at(trace.coordinates[axis]),
        at(trace.velocities[axis]),
        at(trace.inputs.get(INPUT_OF[axis], np.zeros_like(trace.times))),
        others,
        force.mean,
        # Where friction holds the axis nothing is learned of the force, and it goes back to its prior.
        np.clip(1.0 - (force.std / max(widest, 1e-300)) ** 2, 0.0, 1.0),
    )
