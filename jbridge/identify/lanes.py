"""Recordings cut into lanes: arrays of equal length that one compiled program takes together.

A lane is a whole recording (a free run) or a window of it. Rows become grid points; a gap is bridged by further grid
points without a measurement, so that no step is longer than the engine's.
"""

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._types import AXES, Axes
from ..identification.data.grid import Grid, grid
from ..inputs import Lane
from ..recordings import Recording
from .begin import SPREAD, STILL, TOLD, first_state, moves, spread, under_way

HISTORY = 0.6
"""Time before a lane [s] whose inputs a delay or a lag still feels, unless a model has longer ones."""
_ANYWHERE = 1.0
"""One over the standard deviation [1/m, 1/rad] of an initial place that readings do not tell."""


class Lanes(eqx.Module):
    """A batch of lanes with what was measured on them."""

    lane: Lane
    y: Float[Array, "lane sample 3"]
    """Measurements; 0 where there is none."""
    weight: Float[Array, "lane sample 3"]
    """One over the noise's standard deviation; 0 where there is no measurement."""
    override_at: Float[Array, "lane parameter"]
    """1 where a recording sets a parameter of its own."""
    override_to: Float[Array, "lane parameter"]

    def own(self, vector: Float[Array, " parameter"]) -> Float[Array, " parameter"]:
        """Of one lane: the parameters common to all, with what its recording sets itself."""
        return overridden(vector, self.override_at, self.override_to)


def overridden(vector: Array, at: Array, to: Array) -> Array:
    """Parameters of which some (`at` above 0) are replaced."""
    return jnp.where(at > 0, to, vector)


@dataclasses.dataclass(frozen=True)
class Batch:
    """Lanes with where they come from."""

    lanes: Lanes
    initial: NDArray[np.float64]
    """First guess of each lane's state: `x, psi, l` and their velocities, then hidden deflections."""
    prior: NDArray[np.float64]
    """One over the standard deviation of each initial value about the first guess; infinite where it is fixed."""
    recording: NDArray[np.int64]
    """Index of each lane's recording; -1 for a lane without content, which only fills up the shape."""
    told: NDArray[np.float64]
    """How long from its beginning each lane tells of its initial state [s]."""
    grids: tuple[Grid, ...]
    substeps: int

    @property
    def count(self) -> int:
        return len(self.recording)


def make_batch(
    recordings: Sequence[Recording],
    sigma: Mapping[str, float],
    *,
    step: float = 0.005,
    window: float | None = None,
    size: int = 0,
    overrides: Sequence[Mapping[int, float]] = (),
    hidden: Sequence[str] = (),
    slack: float = 0.0,
    beat: float = 0.0,
    bounce: tuple[float, float] | None = None,
    substeps: int | None = None,
    history: float = HISTORY,
    altered: Collection[str] = (),
    late: Collection[str] = (),
    like: "Batch | None" = None,
) -> Batch:
    """Lanes of all recordings.

    Args:
        recordings: measured runs.
        sigma: noise of each channel [m, rad, m].
        step: longest integration step [s].
        window: length of a lane [s]; None takes whole recordings.
        size: number of parameters, for per-recording overrides.
        overrides: for each recording, parameter values by place in the parameter vector.
        hidden: names of the plant's hidden states.
        slack: way [m] after which the cart shows where a motor stood in its play, or how a presliding spring was bent.
        beat: time [s] after which a load shows how the hook that it hangs on swung.
        bounce: how far [m] a load stretches its rope at rest, and how fast [m/s] it moves if it swings by that.
        substeps: integration steps in each interval; by default from `step`.
        history: time before a lane [s] whose inputs still count.
        altered: axes whose sensors read something else than where a thing is, as far as the model knows.
        late: axes whose sensors read where a thing was: the same at rest alone.
        like: a batch whose shape to take if there is room in it, so that its program serves this one, too.
    """
    period = float(np.median([recording.period for recording in recordings]))
    if substeps is None:
        substeps = max(1, math.ceil(period / step - 1e-6))
    grids = tuple(grid(recording, max(1.5 * period, 1e-4)) for recording in recordings)
    cuts: list[tuple[int, int, int]] = []
    for r, g in enumerate(grids):
        if window is None:
            cuts.append((r, 0, g.intervals))
            continue
        starts_at = np.arange(0.0, max(g.times[-1] - 0.5 * window, 1e-9), window)
        edges = np.searchsorted(g.times, starts_at)
        stops = np.minimum([*edges[1:], np.searchsorted(g.times, g.times[edges[-1]] + window)], g.intervals)
        # What begins within a gap would be told of its state across it.
        rows = np.flatnonzero(g.measured.any(axis=1))
        begins = rows[np.minimum(np.searchsorted(rows, edges), len(rows) - 1)]
        cuts += [(r, int(a), int(b)) for a, b in zip(begins, stops, strict=True) if a < b]
    longest = _rounded(max(b - a for _, a, b in cuts))
    earlier = math.ceil(history / min(recording.period for recording in recordings))
    n = _filled(len(cuts))
    if like is not None:
        length, room = like.lanes.lane.dt.shape[1], like.count
        past = like.lanes.lane.before.shape[1]
        if longest <= length and earlier <= past and len(cuts) <= room and substeps == like.substeps:
            longest, n, earlier = length, room, past
    dt = np.zeros((n, longest))
    u = np.zeros((n, earlier + longest, 2))
    before = np.full((n, earlier), period)
    y, weight = np.zeros((n, longest + 1, 3)), np.zeros((n, longest + 1, 3))
    at, to = np.zeros((n, size)), np.zeros((n, size))
    size_of_state = 6 + sum(len(SPREAD[name]) for name in hidden)
    initial, prior = np.zeros((n, size_of_state)), np.zeros((n, size_of_state))
    told = np.full(n, TOLD)
    scale = np.array([1.0 / sigma[axis] if axis in sigma else 0.0 for axis in AXES])
    for i, (r, a, b) in enumerate(cuts):
        g = grids[r]
        dt[i, : b - a] = np.diff(g.times[a : b + 1])
        u[i, earlier : earlier + b - a] = g.u[a:b]
        near = max(a - earlier, 0)
        known = np.concatenate([g.u_before, g.u[near:a]])[-earlier:]
        if len(known):
            spans = np.concatenate([g.dt_before, np.diff(g.times[near : a + 1])])
            u[i, earlier - len(known) : earlier] = known
            before[i, earlier - len(known) :] = spans[-earlier:]
        y[i, : b - a + 1] = g.y[a : b + 1]
        weight[i, : b - a + 1] = g.measured[a : b + 1] * scale
        if overrides:
            for place, value in overrides[r].items():
                at[i, place], to[i, place] = 1.0, value
        initial[i, :6], prior[i, :6] = first_state(g, a, b, sigma)
        for place, name in enumerate(AXES):
            elsewhere = name in altered or (name in late and initial[i, place + 3] != 0.0)
            if elsewhere and np.isfinite(prior[i, place]):
                prior[i, place] = _ANYWHERE
        # Of a window shorter than a hook's period some is left to compare.
        told[i] = max(TOLD, min(beat, 0.5 * (g.times[b] - g.times[a])))
        if slack > 0.0:
            told[i] += moves(g, a, b, "x", slack + STILL * sigma.get("x", 0.0))
        if bounce is not None:
            # A winch that friction holds tells nothing of the load.
            told[i] += moves(g, a, b, "l", STILL * sigma.get("l", 0.0))
        if not len(known):
            for k, axis in ((0, 0), (1, 2)):
                if under_way(g, axis, initial[i, axis + 3]):
                    u[i, :earlier, k] = g.u[0, k]
        if hidden:
            prior[i, 6:] = 1.0 / np.concatenate([spread(name, g, a, b, bounce) for name in hidden])
    # Lanes without content stand still at the first lane's state.
    spare = n - len(cuts)
    initial[len(cuts) :, :6], prior[len(cuts) :] = initial[0, :6], np.inf
    cuts += [(-1, 0, 0)] * spare
    starts = np.array([recordings[r].begun + grids[r].times[a] if r >= 0 else 0.0 for r, a, _ in cuts])
    moving = [np.array([float(grids[max(r, 0)].active[k]) for r, _, _ in cuts]) for k in range(3)]
    # Put on the device as they are: every operation of JAX would be compiled for every shape.
    axes, timed, measured = jax.device_put((moving, [starts, dt, u, before], [y, weight, at, to]))
    lane = jax.vmap(Lane)(timed[0], timed[1], timed[2], timed[3], Axes(*axes))
    return Batch(
        Lanes(lane, *measured),
        initial,
        prior,
        np.array([r for r, _, _ in cuts]),
        told,
        grids,
        substeps,
    )


def refined(lanes: Lanes, substeps: int) -> Lanes:
    """The same lanes with every interval cut into its steps; what was measured stays at the samples."""

    if substeps == 1:
        return lanes
    spans, past = (jnp.repeat(span / substeps, substeps, axis=1) for span in (lanes.lane.dt, lanes.lane.before))
    inputs = jnp.repeat(lanes.lane.u, substeps, axis=1)
    return eqx.tree_at(lambda lanes: (lanes.lane.dt, lanes.lane.before, lanes.lane.u), lanes, (spans, past, inputs))


def _rounded(count: int) -> int:
    """A length a little above `count`, from a coarse list, so that programs are compiled for few lengths."""
    unit = max(1, 2 ** (count.bit_length() - 3))
    return -(-count // unit) * unit


def _filled(lanes: int) -> int:
    """A number of lanes from a coarse list, for the same reason."""
    unit = 2 if lanes <= 8 else 8
    return lanes if lanes == 1 else -(-lanes // unit) * unit
