"""Which equation or sensor fails: one smooth unknown force or signal at each place in turn, and the evidence for each.

Beside the bridge's own linearised motion a Kalman filter gives the probability of the recordings with an unknown force
on an axis, and a smoother the force, also where the axis reverses (latent force models: Alvarez, Luengo and Lawrence,
AISTATS 2009). A sensor's unknown signal adds to its reading and moves nothing.

The bridge is linearised along the motion that was measured: smoothed forces on all axes, put into the simulation, keep
it there, however far it would run away by itself.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .._programs import kept, returned
from .._types import AXES
from ..model.effects.base import CART, HOIST, L_SENSOR, PSI_SENSOR, SWING, X_SENSOR
from ..model.parameters import ParameterTable
from ..rollout import Motions, initial_motion, readings
from .kalman import Prior, Steps, smooth, weigh
from .lanes import Batch, Lanes, refined
from .respond import FORCES, Along, linearise

_ROUNDS = 3
"""Times that the bridge is linearised along the motion with the forces found so far."""
_PERIOD = 0.0095
"""Least time between readings that the filter takes in [s]: forces are slower, and filters of every reading cost more
than they tell."""
_SPANS = (0.05, 0.3, 2.0, 20.0)
"""Times within which a force or signal changes [s]; the last is as good as never."""
_FORCES = (1.0, 1 / 4, 1 / 16, 1 / 64)
"""Standard deviations of a force, over that of the force balance, which noise makes too large."""
_SIGNALS = (64.0, 16.0, 4.0)
"""Standard deviations of a sensor's signal, over its noise."""
_QUICK = 0.15
"""Time within which the forces change that keep the simulation on its track [s]."""
_NOTHING = 1e-9
_FORCE_SITES = (CART, SWING, HOIST)
_SIGNAL_SITES = (X_SENSOR, PSI_SENSOR, L_SENSOR)


@returned
class Seen(NamedTuple):
    """Readings of a linearised trajectory, and how they change with its state."""

    predicted: Float[Array, "lane sample 3"]
    to_state: Float[Array, "lane sample 3 state"]


@kept(static=(0,), once=True)
def _seen(table: ParameterTable, vector: Float[Array, " parameter"], lanes: Lanes, along: Along) -> Seen:
    def one(lanes: Lanes, along: Along) -> Seen:
        plant = table.unravel(lanes.own(vector))
        _, restore = ravel_pytree(jax.tree.map(lambda leaf: leaf[0], along.motions))
        count = along.to_state.shape[-1]

        def read(motions: Motions) -> Array:
            return readings(plant, lanes.lane, motions)

        def push(direction: Array) -> tuple[Array, Array]:
            tangent = jax.tree.map(lambda leaf, value: jnp.full_like(leaf, value), along.motions, restore(direction))
            return jax.jvp(read, (along.motions,), (tangent,))

        predicted, tangents = jax.vmap(push, out_axes=(None, 2))(jnp.eye(count))
        return Seen(predicted, tangents)

    return jax.vmap(one)(lanes, along)


@kept(static=(0,), once=True)
def _from_start(
    table: ParameterTable, vector: Float[Array, " parameter"], lanes: Lanes, start: Float[Array, "lane initial"]
) -> Float[Array, "lane coordinate initial"]:
    """How the first places and velocities depend on an initial-state vector: a motor, say, goes with its cart."""

    def one(lanes: Lanes, start: Array) -> Array:
        plant = table.unravel(lanes.own(vector))
        return jax.jacfwd(lambda start: ravel_pytree(initial_motion(plant, start, lanes.lane.active))[0])(start)

    return jax.vmap(one)(lanes, start)


@dataclasses.dataclass(frozen=True)
class Force:
    """Smoothed unknown forces on all axes along one recording."""

    times: NDArray[np.float64]
    """From the recording's start [s], `(time,)`."""
    mean: NDArray[np.float64]
    """On `x, psi, l` [N, N m, N], `(time, 3)`; NaN on an axis where none was looked for."""
    std: NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Latent:
    """What recordings say of unknown forces and signals beside a model."""

    evidence: dict[str, float]
    """By how much one at a site raises the log probability of the recordings, at the size and time that suit it best.
    Empty where that cannot be said."""
    forces: tuple[Force, ...]
    """By recording; none where the simulation could not be kept on its track."""


class _Track(NamedTuple):
    """A linearisation along one motion of every lane."""

    steps: Steps
    from_start: NDArray[np.float64]
    start: NDArray[np.float64]
    error: float
    """Root mean square of what the simulation leaves, over the noise."""


def unknown_forces(
    table: ParameterTable,
    vector: NDArray[np.float64],
    batch: Batch,
    initial: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> Latent:
    """Evidence for an unknown force or signal at each site, and the forces.

    Args:
        table: of the model's parameters.
        vector: their values.
        batch: whole recordings.
        initial: initial states of the lanes.
        scale: plausible size of a force on each axis [N, N m, N]; 0 where nothing moves.
    """
    stride = _stride(batch)
    moving = np.stack([np.asarray(getattr(batch.lanes.lane.active, axis)) for axis in AXES], axis=1)
    scale = np.where(moving.any(axis=0), scale, 0.0)
    lanes, count = np.asarray(batch.lanes.lane.dt).shape
    group = stride * batch.substeps
    at = own = best = _track(table, vector, batch, initial, np.zeros((lanes, count * batch.substeps, 3)), stride)
    every = _on_every_axis(scale, np.full(3, _QUICK))
    for _ in range(_ROUNDS):
        mean, _, before, first = (np.asarray(part) for part in smooth(every, at.steps))
        # A force is held from where it is known: the end of one step is the beginning of the next.
        held = np.repeat(np.concatenate([before[:, None], mean[:, :-1]], axis=1), group, axis=1)
        force = np.zeros((lanes, count * batch.substeps, 3))
        force[:, : held.shape[1]] = held * moving[:, None]
        coordinates = at.from_start.shape[1]
        start = at.start + np.einsum("lic,lc->li", np.linalg.pinv(at.from_start), first[:, :coordinates])
        if not (np.isfinite(force).all() and np.isfinite(start).all()):
            break
        at = _track(table, vector, batch, start, force, stride)
        if not np.isfinite(at.error):
            break
        best = at if at.error < best.error else best
    sites, priors = _candidates(scale, batch)
    # Along the model's own motion it is exact that nothing is missing, along the measured one what is.
    tracks = [own] if best is own else [own, best]
    weighed = [np.asarray(weigh(priors, track.steps)).sum(axis=1) for track in tracks]
    told = np.max([np.where(np.isfinite(part), part, -np.inf) for part in weighed], axis=0)
    if not np.isfinite(told[-1]) or not np.isfinite(best.error):
        return Latent({}, ())
    rows = {site: max((i for i, name in enumerate(sites) if name == site), key=lambda i: told[i]) for site in sites}
    evidence = {site: float(told[i] - told[-1]) for site, i in rows.items() if np.isfinite(told[i])}
    fitting = [rows.get(site) for site in _FORCE_SITES]
    size = np.array([0.0 if i is None else float(priors.size[i, 0]) for i in fitting])
    length = np.array([_QUICK if i is None else float(priors.length[i, 0]) for i in fitting])
    mean, std, _, _ = (np.array(part) for part in smooth(_on_every_axis(size, length), best.steps))
    if not np.isfinite(mean).all():
        return Latent(evidence, ())
    mean[:, :, size == 0.0] = std[:, :, size == 0.0] = np.nan
    span = np.asarray(best.steps.span)
    counts = [int(np.count_nonzero(span[i])) for i in range(len(batch.grids))]
    times = np.cumsum(span, axis=1)
    return Latent(evidence, tuple(Force(times[i, :n], mean[i, :n], std[i, :n]) for i, n in enumerate(counts)))


def _stride(batch: Batch) -> int:
    """Intervals between the readings that are used: several where they are close, if no channel loses by it."""
    dt = np.asarray(batch.lanes.lane.dt)
    coarsest = max(float(np.median(row[row > 0])) for row in dt if (row > 0).any())
    stride = max(1, round(_PERIOD / coarsest))
    measured = np.asarray(batch.lanes.weight)[:, 1:] > 0
    for each in np.moveaxis(measured, 2, 0):
        if 1.5 * stride * np.count_nonzero(each[:, stride - 1 :: stride]) < np.count_nonzero(each):
            return 1
    return stride


def _on_every_axis(size: NDArray[np.float64], length: NDArray[np.float64]) -> Prior:
    return Prior(np.eye(3), np.zeros((3, 3)), np.maximum(size, _NOTHING), length)


def _candidates(scale: NDArray[np.float64], batch: Batch) -> tuple[list[str], Prior]:
    """Sites in turn with all sizes and spans, and as the last row nothing at all."""
    sites: list[str] = []
    rows: list[tuple] = []
    weight = np.asarray(batch.lanes.weight)
    for k in range(3):
        here, none = np.eye(3)[[k]], np.zeros((1, 3))
        sharpest = float(weight[:, :, k].max())
        if scale[k] > 0:
            sites += [_FORCE_SITES[k]] * (len(_FORCES) * len(_SPANS))
            rows += [(here, none, [share * scale[k]], [span]) for share in _FORCES for span in _SPANS]
        if sharpest > 0:
            sites += [_SIGNAL_SITES[k]] * (len(_SIGNALS) * len(_SPANS))
            rows += [(none, here, [times / sharpest], [span]) for times in _SIGNALS for span in _SPANS]
    rows.append((np.zeros((1, 3)), np.zeros((1, 3)), [_NOTHING], [1.0]))
    return sites, Prior(*(np.array([row[i] for row in rows], float) for i in range(4)))


def _track(
    table: ParameterTable,
    vector: NDArray[np.float64],
    batch: Batch,
    start: NDArray[np.float64],
    force: NDArray[np.float64],
    stride: int,
) -> _Track:
    """The linearisation of a simulation with some forces, integration steps gathered between the readings used."""
    along = linearise(table, vector, start, refined(batch.lanes, batch.substeps), force)
    from_start = np.asarray(_from_start(table, vector, batch.lanes, start))
    sampled = jax.tree.map(lambda leaf: np.asarray(leaf)[:, :: batch.substeps], along.motions)
    seen = _seen(table, vector, batch.lanes, along._replace(motions=sampled))
    dt = np.asarray(batch.lanes.lane.dt)
    lanes, count = dt.shape[0], dt.shape[1] // stride
    group = stride * batch.substeps

    def gathered(values: Array | np.ndarray) -> NDArray[np.float64]:
        return np.asarray(values)[:, : count * group].reshape(lanes, count, group, *values.shape[2:])

    each_a, each_b = gathered(along.to_state), gathered(np.asarray(along.to_ports)[..., FORCES])
    a, b = each_a[:, :, 0], each_b[:, :, 0]
    for i in range(1, group):
        a, b = each_a[:, :, i] @ a, each_a[:, :, i] @ b + each_b[:, :, i]
    at = slice(stride, count * stride + 1, stride)
    error, weight = (
        (np.asarray(batch.lanes.y) - np.asarray(seen.predicted))[:, at],
        np.asarray(batch.lanes.weight)[:, at],
    )
    states, coordinates = a.shape[-1], from_start.shape[1]
    variance = np.where(batch.prior > 0, batch.prior, np.inf) ** -2.0
    spread, away = np.zeros((lanes, states, states)), np.zeros((lanes, states))
    spread[:, :coordinates, :coordinates] = np.einsum("lai,li,lbi->lab", from_start, variance, from_start)
    away[:, :coordinates] = np.einsum("lai,li->la", from_start, batch.initial - start)
    span = dt[:, : count * stride].reshape(lanes, count, stride).sum(axis=2)
    steps = Steps(
        a, b, np.asarray(seen.to_state)[:, at], span, error, weight, gathered(force).mean(axis=2), spread, away
    )
    left = (error * weight)[weight > 0]
    return _Track(steps, from_start, start, float(np.sqrt(np.mean(left**2))) if len(left) else np.inf)
