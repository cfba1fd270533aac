"""The force that the model as given lacks: where it acts, how it goes, and what it is like."""

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..identify.base import BaseFit
from ..identify.latent import Force, Latent, unknown_forces
from ..identify.result import Trace
from ..model.effects.base import AXIS_OF_SITE
from .result import MissingForce
from .tracks import Track

_LEAD = 10.0
"""Least log probability by which an unknown force or signal must be better than none, and than another equation's."""
_FAR = 3.0
"""Error over noise of whole recordings above which numbers are taken from windows."""


def missing_forces(base: BaseFit, in_windows: bool, traces: Sequence[Trace], progress: Callable[[str], None]) -> Latent:
    """Smoothed unknown forces on all axes, and the evidence for one at each site.

    Args:
        base: the model as given, refitted.
        in_windows: whether windows were compared, since whole recordings drift too far.
        traces: the training recordings, in order, with the force that this model leaves over.
        progress: told what goes on.
    """
    progress("looking for the force that is missing")
    scale = np.zeros(3)
    for k, axis in enumerate(AXES):
        forces = [trace.force_before[axis] for trace in traces if axis in trace.force_before]
        known = np.concatenate(forces) if forces else np.zeros(0)
        known = known[np.isfinite(known)]
        scale[k] = float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
    # Within windows a missing force pulls the model's numbers less far away.
    vector = base.window_vector if in_windows or base.chi > _FAR else base.vector
    return unknown_forces(base.engine.table, vector, base.free_run, base.fits.initial[0], scale)


def leading_site(evidence: Mapping[str, float]) -> str | None:
    """The site whose unknown force or signal explains most, if no other equation's comes near; else None."""
    best = max(evidence, key=lambda site: evidence[site], default=None)
    if best is None:
        return None
    others = [value for site, value in evidence.items() if AXIS_OF_SITE[site] != AXIS_OF_SITE[best]]
    return best if evidence[best] - max([0.0, *others]) > _LEAD else None


def force_along(forces: Sequence[Force], traces: Sequence[Trace], axis: str) -> tuple[MissingForce, ...]:
    """That of one axis, by recording; none where none was looked for."""
    k = AXES.index(axis)
    return tuple(
        MissingForce(trace.recording, force.times, force.mean[:, k], force.std[:, k])
        for force, trace in zip(forces, traces[: len(forces)], strict=True)
        if len(force.times) > 1 and np.isfinite(force.mean[:, k]).all()
    )


def tracks_of(forces: Sequence[MissingForce], traces: Sequence[Trace], axis: str) -> list[tuple[str, Track]]:
    """The recordings' names, and the force on an axis beside what it may hang on.

    Args:
        forces: in the order of the traces; of some recordings there may be none.
        traces: the training recordings.
        axis: `x`, `psi` or `l`.
    """
    if not forces:
        return []
    widest = max(float(force.std.max()) for force in forces)
    inputs = {name for trace in traces for name in trace.inputs}
    left, found = iter(traces), []
    for force in forces:
        # Files of different folders may have one name.
        trace = next(trace for trace in left if trace.recording == force.recording)
        found.append((force.recording, _track(force, trace, axis, widest, inputs)))
    return found


def _track(force: MissingForce, trace: Trace, axis: str, widest: float, inputs: Collection[str]) -> Track:
    def at(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(force.times, trace.times, values)

    motion = tuple({name: at(part) for name, part in parts.items()} for parts in (trace.coordinates, trace.velocities))
    # Where friction holds the axis nothing is learned of the force, and it goes back to its prior.
    known = np.clip(1.0 - (force.std / max(widest, 1e-300)) ** 2, 0.0, 1.0)
    u = {name: at(part) for name, part in trace.inputs.items()}
    return Track.of(axis, force.times, (motion[0], motion[1]), u, inputs, force.mean, known)
