"""A missing force along recordings, beside what it may hang on, and how much of it other recordings foresee.

Whatever repeats depends on something: on place, velocity and input, on the other axes, on the time since the start, on
how far or how long back the last reversal is. Flexible functions of these are fitted to the force on all recordings
but one, and must predict that one.
"""

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES

INPUT_OF = {"x": "u_x", "psi": "u_x", "l": "u_l"}
"""The drive that moves each axis; a swing is driven by the cart."""
_PLACES, _VALUES = 24, 10
_RIDGE = 0.02
"""Relative to the samples: keeps what was hardly visited near nothing."""
_WORTH = 0.02
"""Share more that a further variable must foresee to be taken."""
_SINCE = (0.0, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, *(float(x) for x in np.linspace(0.02, 1.0, 50)))
"""Distances since the last reversal at which memory is looked for, over the span of the axis,"""
_FOR = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.2, 3.3, 5.0, 10.0)
"""and times since then [s]."""

Table: TypeAlias = list[NDArray[np.float64]]
"""Features of every recording: `(time, feature)` each."""


@dataclasses.dataclass(frozen=True)
class Track:
    """One recording with the force that its model lacks on one axis."""

    times: NDArray[np.float64]
    q: NDArray[np.float64]
    v: NDArray[np.float64]
    u: NDArray[np.float64]
    others: Mapping[str, NDArray[np.float64]]
    """What else it may hang on: the other axes' `x`, `v_x` and so on, and their inputs."""
    force: NDArray[np.float64]
    weight: NDArray[np.float64]
    """How well the force is known, 0 to 1."""

    @classmethod
    def of(
        cls,
        axis: str,
        times: NDArray[np.float64],
        motion: tuple[Mapping[str, NDArray[np.float64]], Mapping[str, NDArray[np.float64]]],
        u: Mapping[str, NDArray[np.float64]],
        inputs: Collection[str],
        force: NDArray[np.float64],
        weight: NDArray[np.float64],
    ) -> "Track":
        """A track from all that moved.

        Args:
            axis: on which the force acts.
            times: of the samples [s].
            motion: coordinates and velocities by axis.
            u: the inputs there are.
            inputs: those that any recording has; a rope that is locked in one has no drive there.
            force: see `Track`.
            weight: see `Track`.
        """
        q, v = motion
        others = {name: u.get(name, np.zeros_like(times)) for name in sorted(inputs) if name != INPUT_OF[axis]}
        for other in AXES:
            if other != axis and other in q:
                others |= {other: q[other], f"v_{other}": v[other]}
        return cls(times, q[axis], v[axis], u.get(INPUT_OF[axis], np.zeros_like(times)), others, force, weight)


def quarters(track: Track) -> list[Track]:
    """Four recordings of one."""
    return [
        Track(
            track.times[rows],
            track.q[rows],
            track.v[rows],
            track.u[rows],
            {name: values[rows] for name, values in track.others.items()},
            track.force[rows],
            track.weight[rows],
        )
        for rows in np.array_split(np.arange(len(track.times)), 4)
    ]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Features:
    """Hat functions of what a force may hang on."""

    span: tuple[float, float]
    """Between which places the axis moved."""
    place: Table
    turned: Table
    """The same, each with the sign of the velocity."""
    velocity: Table
    inputs: Table
    clock: Table
    others: Mapping[str, tuple[Table, Table]]
    """Of the other axes and their inputs: alike in both directions of motion, and turning round with it."""
    since: Table
    """Of the distance since the last reversal, with the sign of the velocity,"""
    lasting: Table
    """and of the time since then, likewise."""

    @property
    def both(self) -> Table:
        """The place in either direction."""
        return beside(self.place, self.turned)

    def each(self) -> list[Table]:
        """All of them, by what they hang on."""
        others = (table for pair in self.others.values() for table in pair)
        return [self.place, self.turned, self.velocity, self.inputs, self.clock, *others, self.since, self.lasting]


def features(tracks: Sequence[Track]) -> Features:
    """All of them, over what the tracks cover."""
    low, high = _span(tracks, lambda t: t.q)
    top = max(float(np.quantile(np.abs(np.concatenate([t.v for t in tracks])), 0.98)), 1e-9)
    place = _hats(tracks, lambda t: t.q, low, high, _PLACES)
    reversals = [_since_reversal(t, high - low) for t in tracks]
    return Features(
        span=(low, high),
        place=place,
        turned=_turned(place, tracks),
        velocity=_hats(tracks, lambda t: t.v, -top, top, _VALUES),
        inputs=_hats(tracks, lambda t: t.u, *_span(tracks, lambda t: t.u), _VALUES),
        clock=_hats(tracks, lambda t: t.times, 0.0, max(t.times[-1] for t in tracks), _PLACES),
        others={name: _either_way(tracks, name) for name in tracks[0].others},
        since=[distance for distance, _ in reversals],
        lasting=[time for _, time in reversals],
    )


def beside(*tables: Table) -> Table:
    """Features of several tables as one."""
    return [np.concatenate(parts, axis=1) for parts in zip(*tables, strict=True)]


def learn(tracks: Sequence[Track], table: Table) -> NDArray[np.float64]:
    """What the force is per feature."""
    return _Products.of(tracks, table).learn(np.arange(table[0].shape[1]))


def foreseen(tracks: Sequence[Track], table: Table) -> float:
    """Share of the force's mean square that what was learned from the other recordings takes away.

    Where nothing repeats it is below nothing, since a force that was learned from scatter makes matters worse.
    """
    return _Products.of(tracks, table).foreseen(np.arange(table[0].shape[1]))


def foreseen_by_few(tracks: Sequence[Track], tables: Sequence[Table]) -> float:
    """The same of the few tables that together foresee most, found one after the other.

    All of them at once would learn more from scatter than a weak law can make up for.
    """
    products = _Products.of(tracks, beside(*tables))
    ends = np.cumsum([table[0].shape[1] for table in tables])
    left = [np.arange(end - table[0].shape[1], end) for table, end in zip(tables, ends, strict=True)]
    most, taken = 0.0, np.zeros(0, np.int64)
    while left:
        shares = [products.foreseen(np.concatenate([taken, columns])) for columns in left]
        best = int(np.argmax(shares))
        if shares[best] < most + _WORTH:
            break
        most, taken = shares[best], np.concatenate([taken, left.pop(best)])
    return most


@dataclasses.dataclass(frozen=True)
class _Products:
    """Of every recording: features with features, features with the force, the force's square, and its weight."""

    matrix: NDArray[np.float64]
    right: NDArray[np.float64]
    square: NDArray[np.float64]
    weight: NDArray[np.float64]
    matrices: NDArray[np.float64]
    """Of all recordings together,"""
    rights: NDArray[np.float64]
    """likewise."""

    @classmethod
    def of(cls, tracks: Sequence[Track], table: Table) -> "_Products":
        matrix, right = [], []
        for own, track in zip(table, tracks, strict=True):
            weighted = own * track.weight[:, None]
            matrix.append(weighted.T @ own)
            right.append(weighted.T @ track.force)
        square = np.array([t.weight @ t.force**2 for t in tracks])
        weight = np.array([t.weight.sum() for t in tracks])
        return cls(np.stack(matrix), np.stack(right), square, weight, np.sum(matrix, axis=0), np.sum(right, axis=0))

    def learn(self, columns: NDArray[np.int64], without: int | None = None) -> NDArray[np.float64]:
        """What the force is per feature, by all recordings or all but one."""
        block = np.ix_(columns, columns)
        matrix, right, weight = self.matrices[block], self.rights[columns], float(self.weight.sum())
        if without is not None:
            matrix = matrix - self.matrix[without][block]
            right = right - self.right[without][columns]
            weight -= float(self.weight[without])
        ridge = _RIDGE * max(weight, 1.0) / _PLACES
        return np.asarray(np.linalg.solve(matrix + ridge * np.eye(len(columns)), right), np.float64)

    def foreseen(self, columns: NDArray[np.int64]) -> float:
        total = float(self.square.sum())
        if not len(columns) or not total > 0:
            return 0.0
        gained = 0.0
        for i, (matrix, right) in enumerate(zip(self.matrix, self.right, strict=True)):
            learned = self.learn(columns, i)
            gained += float(2 * learned @ right[columns] - learned @ matrix[np.ix_(columns, columns)] @ learned)
        return gained / total


def _hat_functions(values: NDArray[np.float64], knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hat functions of a variable over evenly spaced knots: `(value, knot)`; beyond its ends the last one stays 1."""
    at = np.clip((values - knots[0]) / (knots[1] - knots[0]), 0.0, len(knots) - 1.0)
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - np.arange(len(knots))))


def _span(tracks: Sequence[Track], pick: Callable[[Track], NDArray[np.float64]]) -> tuple[float, float]:
    low, high = (float(x) for x in np.quantile(np.concatenate([pick(t) for t in tracks]), [0.002, 0.998]))
    return low, high


def _hats(
    tracks: Sequence[Track], pick: Callable[[Track], NDArray[np.float64]], low: float, high: float, count: int
) -> Table:
    """Hat functions of a variable; none where it does not change, be it that it flickers once."""
    if not high > low:
        return [np.zeros((len(t.times), 0)) for t in tracks]
    return [_hat_functions(pick(t), np.linspace(low, high, count)) for t in tracks]


def _either_way(tracks: Sequence[Track], name: str) -> tuple[Table, Table]:
    def pick(track: Track) -> NDArray[np.float64]:
        return track.others[name]

    even = _hats(tracks, pick, *_span(tracks, pick), _VALUES)
    return even, _turned(even, tracks)


def _turned(even: Table, tracks: Sequence[Track]) -> Table:
    return [part * np.sign(t.v)[:, None] for part, t in zip(even, tracks, strict=True)]


def _since_reversal(track: Track, span: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Hat functions of distance and time since the velocity last changed sign, each with the sign of the velocity."""
    sign = np.sign(track.v)
    turned = np.flatnonzero(np.diff(sign) != 0) + 1
    last = np.concatenate([[0], turned])[np.searchsorted(turned, np.arange(len(sign)), side="right")]
    away = np.abs(track.q - track.q[last]) / max(span, 1e-12)
    found = []
    for values, knots in ((away, _SINCE), (track.times - track.times[last], _FOR)):
        places = np.arange(len(knots), dtype=float)  # uneven knots, taken to even ones
        found.append(_hat_functions(np.interp(values, np.array(knots), places), places) * sign[:, None])
    return found[0], found[1]
