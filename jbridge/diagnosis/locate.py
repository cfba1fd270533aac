"""Where a mismatch sits: along which variable, and when."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import EQUATIONS
from ..identify.result import Trace
from .result import Interval, Region

_BINS = 12
_LOCAL = 0.25
"""A region counts as local up to this part of what was covered."""
_SHARE = 0.6
"""Least share of the mismatch inside a region."""
_CLEAR = 0.3
"""Least excess of the mean square force over what the final model leaves, relative to that."""
_VOTES = 0.6
"""Least share of the recordings in which a region stands out as well."""
_BRIEF = 0.2
"""A mismatch counts as limited in time up to this part of a recording, in at most so many pieces."""
_FEW = 2
_SMOOTH = 0.25
"""Time over which the mismatch is averaged before intervals are cut [s]."""

_Pick = Callable[[Trace], NDArray[np.float64] | None]


def region(traces: Sequence[Trace], axis: str) -> tuple[Region, ...]:
    """Regions of place, velocity, input and length that hold most of the residual force of an axis."""
    force = _joined(traces, lambda trace: trace.force_before.get(axis))
    if force is None or not np.isfinite(force).any():
        return ()
    after = _joined(traces, lambda trace: trace.force_after.get(axis))
    # What noise and smoothing leave anyway is no mismatch; the final model tells how much that is.
    floor = float(np.nanmean(after**2)) if after is not None and np.isfinite(after).any() else 0.0
    if float(np.nanmean(force**2)) < (1 + _CLEAR) * floor:
        return ()
    # The axis' own place, speed and input, and the rope's length, on which everything hangs.
    picks: dict[str, _Pick] = {
        axis: lambda trace: trace.coordinates.get(axis),
        "l": lambda trace: trace.coordinates.get("l"),
        f"v_{axis}": lambda trace: trace.velocities.get(axis),
        f"u_{axis}": lambda trace: trace.inputs.get(f"u_{axis}"),
    }
    found = []
    for name, pick in picks.items():
        values = _joined(traces, pick)
        if values is None or not np.ptp(values[np.isfinite(values)]) > 0:
            continue
        best = _densest(values, force, floor)
        if best is not None and _repeats(traces, axis, pick, best, floor):
            found.append(Region(name, *best))
    found.sort(key=lambda r: -r.share)
    return tuple(found[:3])


def _repeats(traces: Sequence[Trace], axis: str, pick: _Pick, found: tuple[float, float, float], floor: float) -> bool:
    """Whether the force stands out in a region in most of the recordings that come there."""
    votes = []
    for trace in traces:
        values, force = pick(trace), trace.force_before.get(axis)
        if values is None or force is None:
            continue
        known = np.isfinite(values) & np.isfinite(force)
        inside = known & (values >= found[0]) & (values <= found[1])
        outside = known & ~inside
        if inside.sum() < 20 or outside.sum() < 20:
            continue
        own, other = (float(np.mean(force[part] ** 2)) - floor for part in (inside, outside))
        votes.append(own > 2.0 * max(other, 0.0))
    return bool(votes) and float(np.mean(votes)) >= _VOTES


def _joined(traces: Sequence[Trace], pick: _Pick) -> NDArray[np.float64] | None:
    found = [pick(trace) for trace in traces]
    parts = [part for part in found if part is not None]
    return np.concatenate(parts) if len(parts) == len(traces) and parts else None


def _densest(
    values: NDArray[np.float64], force: NDArray[np.float64], floor: float
) -> tuple[float, float, float] | None:
    """The shortest stretch of a variable with most of the mean square force, each bin counted alike."""
    known = np.isfinite(values) & np.isfinite(force)
    if known.sum() < 50 * _BINS:
        return None
    low, high = (float(edge) for edge in np.quantile(values[known], [0.005, 0.995]))
    edges = np.linspace(low, high, _BINS + 1)
    place = np.clip(np.searchsorted(edges, values[known]) - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    power = np.bincount(place, weights=force[known] ** 2, minlength=_BINS)
    mean = np.where(count >= max(20.0, 0.03 * known.sum()), power / np.maximum(count, 1) - floor, 0.0)
    mean = np.maximum(mean, 0.0)
    total = mean.sum()
    if total <= 0:
        return None
    for width in range(1, int(_LOCAL * _BINS) + 1):
        sums = np.convolve(mean, np.ones(width), mode="valid")
        at = int(np.argmax(sums))
        if sums[at] / total >= _SHARE:
            return float(edges[at]), float(edges[at + width]), float(sums[at] / total)
    return None


def intervals(traces: Sequence[Trace], axis: str, noise: Mapping[str, float]) -> tuple[Interval, ...]:
    """When, in each recording, the model as given drifts away: where its error changes fastest, if that is local."""
    found = []
    for trace in traces:
        measured, before, after = trace.measured.get(axis), trace.before.get(axis), trace.after.get(axis)
        if measured is None or before is None or after is None:
            continue
        period = float(np.median(np.diff(trace.times)))
        width = max(3, round(_SMOOTH / period))
        gap = before - after
        rate = np.abs(np.gradient(np.convolve(gap, np.ones(width) / width, mode="same"), trace.times))
        rate[:width], rate[-width:] = 0.0, 0.0
        total = float((rate**2).sum())
        if total <= 0 or float(np.max(np.abs(gap))) < 5 * noise[axis]:
            continue
        high = rate > 0.35 * rate.max()
        inside = float((rate[high] ** 2).sum()) / total
        runs = _runs(trace.times, high)
        if high.mean() < _BRIEF and inside > _SHARE and len(runs) <= _FEW:
            found += [Interval(trace.recording, a, b) for a, b in runs]
    return tuple(found[:12])


def _runs(times: NDArray[np.float64], flag: NDArray[np.bool_]) -> list[tuple[float, float]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flag.astype(int), [0]])))
    runs = [(float(times[a]), float(times[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    joined: list[tuple[float, float]] = []
    for start, stop in runs:
        if joined and start - joined[-1][1] < 0.3:
            joined[-1] = (joined[-1][0], stop)
        else:
            joined.append((start, stop))
    return sorted(joined, key=lambda r: r[0] - r[1])


def equation_of(axis: str | None) -> str:
    """The equation of motion of an axis."""
    return "none" if axis is None else EQUATIONS[axis]
