"""Where a mismatch sits: along which variable, and when.

What a fit without it could make of a local force has pulled its friction, damping and gain, so the smoothed missing
force is nowhere nothing. Of every stretch of a variable it is asked how well these numbers, corrected, explain the
force outside the stretch; a local mismatch leaves next to nothing there and much inside.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..._types import EQUATIONS
from ...model.effects.base import MOMENTS
from ..result import Interval, NamedEffect, Region
from .missing_force import INPUT_OF, Track

_BINS = 24
_WIDEST = 0.5
"""A stretch counts as local up to this part of what was covered,"""
_REST = 0.3
"""if at least this part of what is known of the force was learned elsewhere,"""
_CONTRAST = 6.0
"""the mean square force inside is so many times that outside,"""
_CLEAR = 8.0
"""and two sizes of force are so much more likely than one (log likelihood of the bins)."""
_SHARE = 0.25
"""Least share of the missing force inside a region,"""
_VOTES = 0.6
"""and of the recordings in which it stands out as well."""
_MOST = 3
_CELL, _CELLS = 0.25, 128
"""Least length of a bin of time [s], and the largest number of them."""
_ALIKE = 0.5
"""Least overlap of the same interval in different recordings,"""
_BRIEF = (60.0, 100.0)
"""or log likelihood and contrast of an event that one recording may have alone."""
_SHORTEST = 0.02
"""Half of the least length of an interval that stands for one instant [s]."""


def regions(tracks: Sequence[Track], axis: str) -> tuple[Region, ...]:
    """Stretches of place, length, velocity and input that hold the missing force of an axis; the clearest first.

    Args:
        tracks: the recordings with that force.
        axis: `x`, `psi` or `l`.
    """
    if not tracks:
        return ()
    force, weight, speed, own = (_joined(tracks, name) for name in ("force", "weight", "v", "u"))
    base = _base(speed, own)
    variables = {axis: _joined(tracks, "q"), f"v_{axis}": speed, INPUT_OF[axis]: own}
    if axis != "l" and all("l" in track.others for track in tracks):
        variables["l"] = np.concatenate([track.others["l"] for track in tracks])
    found: list[tuple[float, Region]] = []
    for name, values in variables.items():
        low, high = (float(edge) for edge in np.quantile(values, [0.005, 0.995]))
        if not high > low:
            continue
        edges = np.linspace(low, high, _BINS + 1)
        place = np.clip(np.searchsorted(edges, values) - 1, 0, _BINS - 1)
        # Friction reverses with the velocity; beside its place its direction counts.
        cell = place if name == f"v_{axis}" else 2 * place + (speed > 0)
        of_cell = np.arange(_BINS) if name == f"v_{axis}" else np.arange(2 * _BINS) // 2
        best = _stretch(of_cell, *_means(cell, len(of_cell), force, base, weight, max(8.0, 1e-3 * weight.sum())))
        if best is None or best.clear < _CLEAR:
            continue
        inside = (place >= best.first) & (place < best.last)
        if _goes_on(force, base, 2 * (values - low) / (high - low) - 1, weight, inside):
            continue
        left = force - base @ best.numbers
        share = float(np.sum((weight * left**2)[inside]) / np.sum(weight * left**2))
        if share >= _SHARE and _votes(tracks, inside, left, weight):
            found.append((best.clear, Region(name, float(edges[best.first]), float(edges[best.last]), share)))
    found.sort(key=lambda item: -item[0])
    return tuple(region for _, region in found[:_MOST])


def intervals(tracks: Sequence[tuple[str, Track]]) -> tuple[Interval, ...]:
    """When the missing force acts, if it acts at the same time in all recordings, or is an event of one.

    Args:
        tracks: recordings by name, with the force of one axis.
    """
    found: list[tuple[str, _Stretch, float, float]] = []
    telling = 0
    for name, track in tracks:
        end, period = float(track.times[-1]), float(np.median(np.diff(track.times)))
        length = max(_CELL, 16 * period, end / _CELLS)
        cell = np.minimum((track.times / length).astype(int), max(math.ceil(end / length) - 1, 0))
        count = int(cell.max()) + 1
        known = np.bincount(cell, weights=track.weight, minlength=count)
        if not known.any():
            continue
        telling += 1
        least = 0.3 * float(np.median(known[known > 0]))
        base = _base(track.v, track.u)
        best = _stretch(np.arange(count), *_means(cell, count, track.force, base, track.weight, least))
        if best is not None and best.clear >= _CLEAR:
            found.append((name, best, best.first * length, min(best.last * length, end)))
    if not found:
        return ()
    middle = float(np.median([a for _, _, a, _ in found])), float(np.median([b for *_, b in found]))
    alike = [_overlap((a, b), middle) >= _ALIKE for _, _, a, b in found]
    often = telling > 1 and sum(alike) >= max(2.0, _VOTES * telling)
    likely, contrast = _BRIEF
    return tuple(
        Interval(name, a, b)
        for (name, best, a, b), same in zip(found, alike, strict=True)
        if (often and same) or (best.clear >= likely and best.contrast >= contrast)
    )


def times_of(effects: Sequence[NamedEffect], recordings: Sequence[tuple[str, float]]) -> tuple[Interval, ...]:
    """When named effects act that count time from the start of a recording: a push, a jump.

    Args:
        effects: what was named.
        recordings: names and durations [s].
    """
    spans: list[tuple[str | None, float, float]] = []
    for effect in effects:
        told = {key: estimate for key, estimate in effect.parameters.items() if key in MOMENTS}
        at = {key: estimate.value for key, estimate in told.items() if isinstance(estimate.value, float)}
        if "start" in at and "stop" in at:
            spans.append((effect.recording, min(at["start"], at["stop"]), max(at["start"], at["stop"])))
        elif "time" in at:
            edges = [edge for edge in (told["time"].low, told["time"].high) if isinstance(edge, float)]
            around = [*edges, at["time"] - _SHORTEST, at["time"] + _SHORTEST]
            spans.append((effect.recording, min(around), max(around)))
    found = []
    for name, duration in recordings:
        inside = [(max(a, 0.0), min(b, duration)) for own, a, b in spans if own in (None, name)]
        # What lasts from beginning to end is at no particular time.
        found += [Interval(name, a, b) for a, b in inside if a < b and b - a < 0.95 * duration]
    return tuple(found)


@dataclasses.dataclass(frozen=True, eq=False)
class _Stretch:
    """Neighbouring bins that hold a force."""

    first: int
    last: int
    """One beyond the last bin."""
    numbers: NDArray[np.float64]
    """How much of each base column explains what is outside."""
    clear: float
    """Log likelihood of two sizes of force over that of one."""
    contrast: float
    """Mean square inside over that outside."""


def _joined(tracks: Sequence[Track], name: str) -> NDArray[np.float64]:
    return np.concatenate([getattr(track, name) for track in tracks])


def _base(speed: NDArray[np.float64], own: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a wrong level of friction, damping and gain would do, each of unit size: `(time, column)`."""
    columns = [np.sign(speed), speed] + ([own] if np.ptp(own) > 0 else [])
    return np.stack([column / max(float(np.sqrt(np.mean(column**2))), 1e-300) for column in columns], axis=1)


def _means(
    cell: NDArray[np.int64],
    count: int,
    force: NDArray[np.float64],
    base: NDArray[np.float64],
    weight: NDArray[np.float64],
    least: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean force, mean columns and weight of every cell, 0 below the least; a mean takes away what is quick."""
    known = np.bincount(cell, weights=weight, minlength=count)
    size = np.maximum(known, 1e-300)
    columns = [force, *base.T]
    means = np.stack([np.bincount(cell, weights=weight * column, minlength=count) / size for column in columns], axis=1)
    return means[:, 0], means[:, 1:], np.where(known >= least, known, 0.0)


def _stretch(
    place: NDArray[np.int64], force: NDArray[np.float64], base: NDArray[np.float64], known: NDArray[np.float64]
) -> _Stretch | None:
    """The stretch of bins in which the force most likely has another size than outside.

    Args:
        place: bin of each cell.
        force, base, known: see `_means`.
    """
    seen = known > 0
    place, force, base, known = place[seen], force[seen], base[seen], known[seen]
    if len(force) < 8:
        return None
    bins, columns = int(place.max()) + 1, base.shape[1]
    overall = float(np.mean((force - base @ _numbers(base, force, known)) ** 2))
    if not overall > 0.0:
        return None
    best = None
    for width in range(1, int(_WIDEST * bins) + 1):
        for first in range(bins - width + 1):
            inside = (place >= first) & (place < first + width)
            outside = ~inside
            enough = known[outside].sum() >= _REST * known.sum() and outside.sum() >= columns + 4
            if not inside.any() or not enough:
                continue
            numbers = _numbers(base[outside], force[outside], known[outside])
            left = (force - base @ numbers) ** 2
            own, other = float(left[inside].mean()), max(float(left[outside].mean()), 1e-12 * overall)
            if own < _CONTRAST * other:
                continue
            clear = len(left) * math.log(overall) - inside.sum() * math.log(own) - outside.sum() * math.log(other)
            if best is None or clear > best.clear:
                best = _Stretch(first, first + width, numbers, float(clear), own / other)
    return best


def _numbers(base: NDArray[np.float64], force: NDArray[np.float64], known: NDArray[np.float64]) -> NDArray[np.float64]:
    root = np.sqrt(known)
    return np.asarray(np.linalg.lstsq(base * root[:, None], force * root, rcond=1e-6)[0], np.float64)


def _goes_on(
    force: NDArray[np.float64],
    base: NDArray[np.float64],
    along: NDArray[np.float64],
    weight: NDArray[np.float64],
    inside: NDArray[np.bool_],
) -> bool:
    """Whether more than half of what is inside a stretch comes of how the force changes along what is outside.

    A gain that changes with the place is small about the middle, and no more local for that.
    """
    columns = np.concatenate([base, base * along[:, None], np.ones((len(along), 1)), along[:, None]], axis=1)

    def left(columns: NDArray[np.float64]) -> float:
        numbers = _numbers(columns[~inside], force[~inside], weight[~inside])
        return float(weight[inside] @ (force[inside] - columns[inside] @ numbers) ** 2)

    return left(columns) < 0.5 * left(base)


def _votes(
    tracks: Sequence[Track], inside: NDArray[np.bool_], left: NDArray[np.float64], weight: NDArray[np.float64]
) -> bool:
    """Whether the force stands out in a region in most of the recordings that come there."""
    votes = []
    ends = np.cumsum([len(track.times) for track in tracks])
    for a, b in zip([0, *ends[:-1]], ends, strict=True):
        here, power, known = inside[a:b], left[a:b] ** 2, weight[a:b]
        if known[here].sum() < 20 or known[~here].sum() < 20:
            continue
        votes.append(
            np.average(power[here], weights=known[here]) > 2.0 * np.average(power[~here], weights=known[~here])
        )
    return bool(votes) and float(np.mean(votes)) >= _VOTES


def _overlap(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Length of what two intervals share over that of what they cover."""
    shared = min(a[1], b[1]) - max(a[0], b[0])
    return max(shared, 0.0) / max(max(a[1], b[1]) - min(a[0], b[0]), 1e-300)


def equation_of(axis: str | None) -> str:
    """The equation of motion of an axis."""
    return "none" if axis is None else EQUATIONS[axis]
