"""Where to begin looking for an effect that may be anywhere: a push at any time, a wave of any period.

What an effect adds to a reading is compared with what a model leaves, on an axis that is taken as linear.
"""

import cmath
import dataclasses
import functools
import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...identification.data.grid import Grid
from ...identification.estimation import Problem
from ...identification.setting import Setting
from ...model.bridge import Bridge
from ...model.effects.base import AXIS_OF_SITE, MOMENTS
from ...recordings import Recording
from ..structures.candidates import Candidate
from ..structures.space import Name

_MOST_STARTS = 3
"""Places to start one effect from that are kept, beside one that bisection finds."""
_HALVINGS = 12
"""Times that the distance between places to start is halved, about each of these."""
_GROWTH = 300.0
"""Logarithm of numbers whose square is far from the largest ones."""


def promising(
    problem: Problem, left: Sequence[NDArray[np.float64]], bridge: Bridge, every: Sequence[Candidate]
) -> list[Candidate]:
    """Of effects with many places to start, those few at which a plain regression explains most of what is left, and
    the one near them at which it explains most: the time of a step has a gradient only within one sample of the true
    one. The others as they are.

    Args:
        problem: recordings.
        left: what the model leaves, over the noise, by tiling.
        bridge: the model's numbers.
        every: all places to start, of all effects.
    """
    many: dict[Name, list[Candidate]] = {}
    for candidate in every:
        many.setdefault(candidate.name, []).append(candidate)
    out = [c for own in many.values() if len(own) <= _MOST_STARTS for c in own]
    crowded = [own for own in many.values() if len(own) > _MOST_STARTS]
    stretches = {site: _stretches(problem, left, bridge, site) for site in {own[0].site for own in crowded}}
    for own in crowded:
        explained = functools.partial(_regressed, problem.setting, stretches[own[0].site])
        shares = explained(own)
        # Two places may be one and the same, as a push and the pause after it are.
        _, first = np.unique(np.round(-shares, 9), return_index=True)
        best: list[int] = []
        counts = Counter[Recording | None]()
        # What may have happened in all recordings or in one of them is looked for in each case: at first places are far
        # apart, and which is the better one shows when what is near has been tried.
        scopes = [_recording(problem.setting, candidate) for candidate in own]
        most = _MOST_STARTS if len(set(scopes)) == 1 else 1
        for i in map(int, first):
            if counts[scopes[i]] < most and shares[i] > 0.0:
                counts[scopes[i]] += 1
                best.append(i)
        best = best or [int(first[0])]
        near = max((_nearby(float(shares[i]), own[i], own, explained) for i in best), key=lambda place: place[0])
        out += [own[i] for i in best]
        out += [near[1]] if near[0] > shares.max() else []
    return out


def _recording(setting: Setting, candidate: Candidate) -> Recording | None:
    """The one recording in which an effect would happen, None for all."""
    moments = MOMENTS & set(candidate.values)
    return setting.when(float(candidate.values[min(moments)]))[0] if moments else None


def _nearby(
    most: float,
    best: Candidate,
    own: Sequence[Candidate],
    explained: Callable[[Sequence[Candidate]], NDArray[np.float64]],
) -> tuple[float, Candidate]:
    """The place to start near one of them that explains most, by bisection of each free number in which they differ."""
    reach = {}
    for key, value in best.values.items():
        if key in best.free and isinstance(value, float):
            apart = np.abs([float(other.values[key]) - value for other in own])
            if np.any(apart > 0.0):
                reach[key] = float(apart[apart > 0.0].min())
    for halving in range(1, _HALVINGS + 1):
        for key, distance in reach.items():
            values = [best.values[key] + way * 0.5**halving * distance for way in (-1.0, 1.0)]
            tried = [dataclasses.replace(best, values={**best.values, key: value}) for value in values]
            shares = explained(tried)
            if shares.max() > most:
                most, best = float(shares.max()), tried[int(np.argmax(shares))]
    return most, best


@dataclasses.dataclass(frozen=True)
class _Stretch:
    """The samples of one of the longest windows at which an axis was measured."""

    axis: "_LinearAxis"
    y: NDArray[np.float64]
    """Readings [m, rad],"""
    u: NDArray[np.float64]
    """and the input of the axis' drive, where effects at the drive are looked for."""
    taken: NDArray[np.float64]
    """Orthonormal columns of what another start and a constant force would make up for."""
    left: NDArray[np.float64]
    """What the model leaves, over the noise, without that."""
    recording: Recording


def _stretches(problem: Problem, left: Sequence[NDArray[np.float64]], bridge: Bridge, site: str) -> list[_Stretch]:
    """The longest screened windows as an effect at a site is seen in them.

    Args:
        problem: recordings.
        left: what the model leaves, by tiling.
        bridge: the model's numbers.
        site: of the effect.
    """
    data, found = problem.data, []
    name = AXIS_OF_SITE[site]
    k = AXES.index(name)
    numbers = {field.name: float(getattr(bridge, field.name)) for field in dataclasses.fields(bridge)}
    for tiling, residual in zip(data.tilings, left, strict=True):
        if tiling.horizon != data.horizons[-1]:
            continue
        grid = data.grids[tiling.recording]
        own = {key: grid.recording.override.get(key, value) for key, value in numbers.items()}
        for begin, stop in zip(tiling.begins, tiling.stops, strict=True):
            rows = np.flatnonzero(data.measured[tiling.recording, begin:stop, k]) + begin
            if len(rows) < 8:
                continue
            axis = _LinearAxis.of(name, own, grid, grid.recording.begun + grid.times[rows])
            u = np.zeros(len(rows))
            if site.endswith("_drive"):
                u = grid.u[np.minimum(rows, grid.intervals - 1), 0 if name == "x" else 1]
            q, _ = np.linalg.qr(np.stack([*axis.free_motion(), axis.response(np.ones(len(rows)))], axis=1))
            r = residual[rows, k]
            found.append(_Stretch(axis, data.y[tiling.recording, rows, k], u, q, r - q @ (q.T @ r), grid.recording))
    return found


def _regressed(setting: Setting, stretches: Sequence[_Stretch], own: Sequence[Candidate]) -> NDArray[np.float64]:
    """Share of what is left that one effect's shapes explain with the same amplitudes in all stretches, by place to
    start."""
    return np.array([_explained(setting, stretches, candidate) for candidate in own])


def _explained(setting: Setting, stretches: Sequence[_Stretch], candidate: Candidate) -> float:
    moments = {key: setting.when(float(candidate.values[key])) for key in MOMENTS & set(candidate.values)}
    gram, right = np.zeros((1, 1)), np.zeros(1)
    for stretch in stretches:
        if any(where not in (None, stretch.recording) for where, _ in moments.values()):
            continue
        q, r = stretch.taken, stretch.left
        s = _shapes(candidate, stretch, {key: moment for key, (_, moment) in moments.items()})
        s = s - (s @ q) @ q.T
        # Each stretch weighs alike, however much is left in it.
        energy = max(float(r @ r), 1e-12)
        gram, right = gram + s @ s.T / energy, right + s @ r / energy
    size = np.sqrt(np.maximum(np.diag(gram), 1e-18))
    matrix, right = gram / np.outer(size, size) + 1e-6 * np.eye(len(size)), right / size
    return float(right @ np.linalg.solve(matrix, right))


@dataclasses.dataclass(frozen=True)
class _LinearAxis:
    """An axis as a mass with viscous damping, on a spring where it swings; the rope has its mean length."""

    t: NDArray[np.float64]
    """Sampling times [s]."""
    roots: tuple[complex, complex]
    """Of its characteristic equation [1/s]."""
    modes: tuple["_Mode", "_Mode"]
    """Its motion in either, at these times."""

    @classmethod
    def of(cls, axis: str, bridge: Mapping[str, float], grid: Grid, t: NDArray[np.float64]) -> "_LinearAxis":
        """An axis of a bridge, given by its numbers, in a recording."""
        length = grid.length
        damping, mass = {
            "x": (bridge["cart_damping"], bridge["cart_mass"]),
            "psi": (bridge["swing_damping"], bridge["load_mass"] * length**2),
            "l": (bridge["hoist_damping"], bridge["winch_mass"] + bridge["load_mass"]),
        }[axis]
        half, stiffness = 0.5 * damping / mass, 0.0
        if axis == "psi":
            stiffness = bridge["gravity"] / length
            if grid.recording.has_cart:
                # A cart that its damping does not hold is swung by its load.
                held = (bridge["cart_damping"] / bridge["cart_mass"]) ** 2 / stiffness
                stiffness *= 1.0 + bridge["load_mass"] / bridge["cart_mass"] / (1.0 + held)
        apart = cmath.sqrt(half**2 - stiffness)
        # The formulas divide by the distance of the roots.
        apart = apart if abs(apart) > 1e-4 else complex(1e-4)
        roots = -half + apart, -half - apart
        return cls(t, roots, (_Mode.of(roots[0], t), _Mode.of(roots[1], t)))

    def free_motion(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """How it moves without a force, from two independent initial states."""
        first, second = (np.exp(root * (self.t - self.t[0])) for root in self.roots)
        return (first + second).real, ((first - second) / (self.roots[0] - self.roots[1])).real

    def response(self, force: NDArray[np.float64]) -> NDArray[np.float64]:
        """How it moves under a force that is held from sample to sample, from rest, in any unit."""
        first, second = (mode.followed(force) for mode in self.modes)
        return ((first - second) / (self.roots[0] - self.roots[1])).real


@dataclasses.dataclass(frozen=True)
class _Mode:
    """The solution of `y' = root y + force` from 0, of a force that is held from sample to sample."""

    gains: NDArray[np.complex128]
    """What a force of one adds from one sample to the next."""
    blocks: tuple[tuple[int, int, NDArray[np.complex128]], ...]
    """Samples between which a sum of what has grown since is exact, and what the later ones keep of the first."""

    @classmethod
    def of(cls, root: complex, t: NDArray[np.float64]) -> "_Mode":
        """A mode at sampling times [s]."""
        z = root * np.diff(t)
        small = np.abs(z) < 1e-6
        gains = np.diff(t) * np.where(small, 1.0 + 0.5 * z, np.expm1(z) / np.where(small, 1.0, z))
        ends = np.flatnonzero(np.diff(np.floor(-root.real * (t - t[0]) / _GROWTH))) + 1
        blocks = []
        for a, b in itertools.pairwise([0, *(int(end) for end in ends), len(t) - 1]):
            since = t[a + 1 : b + 1] - t[a]
            blocks.append((a, b, np.exp(np.maximum(root.real * since, -2.0 * _GROWTH) + 1j * root.imag * since)))
        return cls(np.asarray(gains, np.complex128), tuple(blocks))

    def followed(self, force: NDArray[np.float64]) -> NDArray[np.complex128]:
        gained = self.gains * force[:-1]
        out = np.zeros(len(force), complex)
        for a, b, fade in self.blocks:
            out[a + 1 : b + 1] = fade * (out[a] + np.cumsum(gained[a:b] / fade))
        return out


def _shapes(candidate: Candidate, stretch: _Stretch, moments: Mapping[str, float]) -> NDArray[np.float64]:
    """What an effect adds to a reading, in any unit, `(shape, sample)`; its moments are times since the start."""
    values, axis, y = candidate.values, stretch.axis, stretch.y
    if "time" in moments:
        return (axis.t >= moments["time"]).astype(float)[None]
    if "start" in moments:
        return axis.response(((axis.t >= moments["start"]) & (axis.t < moments["stop"])).astype(float))[None]
    if "end" in values:
        beyond = y - float(values["position"])
        return axis.response(np.maximum(beyond if values["end"] == "high" else -beyond, 0.0))[None]
    angle = 2 * np.pi * y / float(values["period"])
    shapes = np.stack([np.sin(angle), np.cos(angle)])
    if candidate.site.endswith("_drive"):
        shapes = shapes * stretch.u
    return shapes if candidate.site.endswith("sensor") else np.stack([axis.response(s) for s in shapes])
