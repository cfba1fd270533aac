"""Where a mismatch is: shares of the gain by site, and where the missing force acts along the recordings."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...identification.result import Trace
from ..result import Location, MissingForce, NamedEffect
from ..selection.search import Search
from ..structures.candidates import SITE_OF_NUMBER
from ..structures.space import Name
from .missing_force import Track
from .regions import equation_of, intervals, regions, times_of
from .symmetries import describe


def location(search: Search, effects: Sequence[NamedEffect], traces: Sequence[Trace]) -> Location:
    """Where the mismatch is, of a model that does not meet the recordings.

    Args:
        search: what was held and tried.
        effects: what was named.
        traces: the training recordings beside the model as given.
    """
    sites = shares(search)
    at = next(iter(sites), None)
    if effects:
        at = SITE_OF_NUMBER.get(effects[0].site, effects[0].site)
    axis = search.problem.setting.axis_of(at) if at is not None else None
    found = [] if axis is None else tracks(traces, axis)
    when = times_of(effects, [(t.recording, float(t.times[-1])) for t in traces]) or intervals(found)
    alone = [track for _, track in found]
    drawn = bool(alone) and at is not None and not at.endswith("_sensor") and axis is not None
    where = regions(alone, axis) if drawn and axis is not None else ()
    likeness = describe(alone, axis) if drawn and axis is not None else None
    forces = (
        tuple(MissingForce(name, t.times, np.where(t.weight > 0, t.force, np.nan)) for name, t in found)
        if drawn
        else ()
    )
    return Location(at, equation_of(axis), sites, where, when, forces, likeness)


def shares(search: Search) -> dict[str, float]:
    """Share of the criterion's gain by site, the largest first; of what was tried where nothing was taken."""
    gains: dict[str, float] = {}
    for before, after in zip(search.held, search.held[1:], strict=False):
        for name in set(after.names) - set(before.names):
            gains[_site(name)] = gains.get(_site(name), 0.0) + max(before.value - after.value, 0.0)
    if not gains and search.tried:
        base = search.held[0]
        for structure in search.tried[0]:
            for name in set(structure.names) - set(base.names):
                gain = max(base.point.value - structure.point.value, 0.0)
                gains[_site(name)] = max(gains.get(_site(name), 0.0), gain)
    total = sum(gains.values())
    ranked = sorted(gains.items(), key=lambda item: -item[1])
    return {site: gain / total for site, gain in ranked if gain > 1e-4 * total} if total > 0.0 else {}


def _site(name: Name) -> str:
    return SITE_OF_NUMBER.get(name[1], name[1])


def tracks(traces: Sequence[Trace], axis: str, after: bool = False) -> list[tuple[str, Track]]:
    """The force that a model lacks on one axis beside what it may hang on, by recording."""
    inputs = {name for trace in traces for name in trace.inputs}
    out = []
    for trace in traces:
        force = (trace.force_after if after else trace.force_before).get(axis)
        if force is None or np.isfinite(force).sum() < 8:
            continue
        known = np.isfinite(force)
        filled: NDArray[np.float64] = np.where(known, force, 0.0)
        motion = (trace.coordinates, trace.velocities)
        out.append(
            (trace.recording, Track.of(axis, trace.times, motion, trace.inputs, inputs, filled, known.astype(float)))
        )
    return out


def repeatable(traces: Sequence[Trace], axis: str | None, after: bool) -> float | None:
    """Share of the missing force on one axis that a flexible force learned on other recordings predicts."""
    found = [] if axis is None else [track for _, track in tracks(traces, axis, after)]
    return describe(found, axis).foreseen if found and axis is not None else None
