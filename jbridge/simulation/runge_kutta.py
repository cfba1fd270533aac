"""One interval of a rollout: explicit Runge-Kutta steps of positions and velocities, lags and a hidden spring.

Lags are solved exactly for inputs that are held, a spring's deflection for the way that was gone: neither is stiff
then, however short its time constant.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._math import materialise
from .._types import Axes, Scalar
from ..compilation.programs import returned
from ..model.effects.base import AXIS_OF_SITE
from ..model.effects.motors import LAGS, SpeedDrive
from ..model.equations import Stage, Step, accelerations
from ..model.plant import Motion, Plant
from .inputs import INSTANT
from .state import Motions


class Method(eqx.Module):
    """An explicit Runge-Kutta method whose every stage builds on the one before."""

    nodes: tuple[float, ...] = eqx.field(static=True)
    weights: tuple[float, ...] = eqx.field(static=True)
    bends: tuple[float, ...] = eqx.field(static=True)
    """How much of a stage's h^2 * acceleration the next stage's position takes beyond h * velocity."""
    leads: tuple[float, ...] = eqx.field(static=True)
    """How much of (early - mean) every stage's input takes, so that an input that changes within a step moves velocity
    and position as it should."""


RK4 = Method((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6), (0.0,) * 4, (3.0, 0.0, 0.0, -3.0))
"""The classical method of order 4."""
MIDPOINT = Method((0.0, 0.5), (0.0, 1.0), (1 / 3, 0.0), (1.0, 0.0))
"""Order 2, at half the cost of a step. With this bend a swing keeps its phase to order 4, where errors add up over a
recording; what damping takes from a momentum along a way is the same with any."""


@returned
class Interval(NamedTuple):
    """What is known of an interval's steps before the motion is. Every field but the number has an axis of steps."""

    number: Int[Array, ""]
    t: Array
    """Time at the beginning [s]."""
    h: Array
    """Length [s]."""
    mean: Axes
    """Inputs behind the chains' memoryless parts and delays: see `Drives`."""
    early: Axes
    left: Axes
    """How much of each lag's distance to its target is left after the step,"""
    left_mean: Axes
    """how much is left in the mean over it,"""
    left_early: Axes
    """and in the mean weighted by the time left."""


def intervals(
    plant: Plant,
    steps: Float[Array, "interval edge"],
    mean: Float[Array, "interval step 2"],
    early: Float[Array, "interval step 2"],
) -> Interval:
    """Some intervals, from their steps' edges [s] and the inputs at the drives (see `inputs.Drives`)."""
    h = jnp.diff(steps, axis=1)
    # A compiler may round an edge in two ways, and friction would drive in a step back in time.
    h = jnp.where(h < 0, 0.0, h)
    # What counts of a lag are its means over the step: then one that is shorter than a step is not lost.
    constants = plant.time_constants()
    ratios = [h / jnp.maximum(constant, INSTANT) for constant in constants]
    shares = [constant / jnp.where(h > 0, h, 1.0) for constant in constants]
    left = Axes(*(jnp.exp(-ratio) for ratio in ratios))
    left_mean = Axes(*(-share * jnp.expm1(-ratio) for share, ratio in zip(shares, ratios, strict=True)))
    left_early = Axes(*(_early(share, ratio, m) for share, ratio, m in zip(shares, ratios, left_mean, strict=True)))

    def held(inputs: Float[Array, "interval step 2"]) -> Axes:
        return Axes(inputs[:, :, 0], jnp.zeros_like(h), inputs[:, :, 1])

    number = jnp.arange(h.shape[0])
    return Interval(number, steps[:, :-1], h, held(mean), held(early), left, left_mean, left_early)


def _early(share: Array, ratio: Array, mean: Array) -> Array:
    """Mean of `exp(-t / constant)` over a step, weighted by the time left."""
    # Where the lag is long the difference from 1 would be lost in rounding.
    series = 1.0 - ratio / 3.0 + ratio**2 / 12.0 - ratio**3 / 60.0
    return jnp.where(ratio < 0.02, series, 2.0 * share * (1.0 - mean))


class _Part(NamedTuple):
    """What makes one stage of a step different from another."""

    node: Scalar | float
    weight: Scalar | float
    reach: Scalar | float
    """How far from the step's beginning the next stage is, as a share of the step."""
    bend: Scalar | float
    volts: Axes
    lead: Scalar | float


class _Stage(NamedTuple):
    """Where a stage looks at the bridge, and what the stages before add up to."""

    q: Motion
    v: Motion
    z: Scalar | None
    dq: Motion
    dv: Motion


def advance(
    plant: Plant,
    carry: Motions,
    now: Interval,
    active: Axes,
    *,
    method: Method = MIDPOINT,
    looped: bool = False,
    damped: tuple[str, ...] = (),
) -> Motions:
    """The motion one interval later.

    With `looped`, stages are a loop, which compiles in three quarters of the time. A backward pass computes each stage
    anew from its positions and velocities: that is less work than to write all of it to memory and to read it back.
    Tangents take as long with a loop as without; a simulation alone takes longer. On `damped` axes the viscous
    damping of the drive is solved over the whole step, see `equations.accelerations`.
    """
    spring = plant.hysteresis
    # In one order in every process, so that compiled programs are found again.
    lagging = sorted({AXIS_OF_SITE[effect.site] for cls in LAGS for effect in plant.all(cls)})
    loops = bool(damped) or any(plant.all(SpeedDrive))
    most = max(-lead for lead in method.leads)
    # Unknown to the compiler, but true, and the same for a whole batch: see `materialise`.
    go = now.number < 2**30

    def step(carry: Motions, now: Interval) -> tuple[Motions, None]:
        t, h = now.t, now.h
        drum = plant.drum_gain(carry.q.l)
        target, first_target = (held._replace(l=held.l * drum) for held in (now.mean, now.early))

        # By axis the input's mean over the step, and how much its early part is ahead of that.
        held, ahead = {}, {}
        for axis in Axes._fields:
            g, e, s = (getattr(each, axis) for each in (target, first_target, carry.lag))
            held[axis], ahead[axis] = g, e - g
            if axis in lagging:
                mean, early = getattr(now.left_mean, axis), getattr(now.left_early, axis)
                # No stage may have more than the target: an axis that friction holds would break away.
                gap = jnp.minimum(early - mean, mean / most) if most > 1.0 else early - mean
                held[axis], ahead[axis] = g + (s - g) * mean, (e - g) * (1.0 - early) + (s - g) * gap

        def volts_at(lead: float) -> Axes:
            return Axes(*(held[axis] if lead == 0.0 else held[axis] + lead * ahead[axis] for axis in Axes._fields))

        # Inputs that change evenly and have these means.
        ends = (volts_at(3.0), volts_at(-3.0)) if loops else None
        whole = Step(carry.q, carry.v, h, active, go, ends)

        def stage(at: _Stage, part: _Part) -> tuple[_Stage, None]:
            here = Stage(t + part.node * h, at.q, at.v, part.volts, at.z, part.lead)
            a = materialise(_accelerations(plant, here, whole, damped=damped), go)
            z = at.z
            if spring is not None and carry.z is not None:
                z = spring.deflection(carry.z, part.reach * h * at.v.at_drives().x)
            q, v = _add(carry.q, at.v, part.reach, h), _add(carry.v, a, part.reach, h)
            q = _add(q, a, part.bend, h * h)
            return _Stage(q, v, z, _add(at.dq, at.v, part.weight, h), _add(at.dv, a, part.weight, h)), None

        still = jax.tree.map(jnp.zeros_like, (carry.q, carry.v))
        at = _Stage(carry.q, carry.v, carry.z, *still)
        reaches = (*method.nodes[1:], 0.0)
        volts = [volts_at(lead) for lead in method.leads]
        shares = method.nodes, method.weights, reaches, method.bends, volts, method.leads
        parts = [_Part(*numbers) for numbers in zip(*shares, strict=True)]
        if looped:
            rows = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf, h.dtype) for leaf in leaves]), *parts)
            at, _ = jax.lax.scan(jax.checkpoint(stage), at, rows)
        else:
            for part in parts:
                at, _ = stage(at, part)
        q_next, v_next = _add(carry.q, at.dq), _add(carry.v, at.dv)
        z_next = carry.z
        if spring is not None and carry.z is not None:
            # There and back where the drive reverses: what is lost of a loop, turn by turn, would be a creep.
            was, becomes, way = carry.v.at_drives().x, v_next.at_drives().x, at.dq.at_drives().x
            turns = was * becomes < 0
            there = jnp.where(turns, 0.5 * h * was * was / jnp.where(turns, was - becomes, 1.0), way)
            z_next = spring.deflection(spring.deflection(carry.z, there), way - there)
        lag = target
        for axis in lagging:
            g, s = getattr(target, axis), getattr(carry.lag, axis)
            lag = lag._replace(**{axis: g + (s - g) * getattr(now.left, axis)})
        return Motions(q_next, v_next, lag, z_next), None

    steps = now._replace(number=jnp.zeros_like(now.h, dtype=now.number.dtype))
    if now.h.shape[0] == 1:  # a loop over one step would only be traced and transformed for nothing
        return step(carry, jax.tree.map(lambda leaf: leaf[0], steps))[0]
    return jax.lax.scan(step, carry, steps)[0]


_accelerations = jax.jit(accelerations, static_argnames="damped")
"""Jitted on its own, so that the stages of a step share one trace: half the time before the compiler starts."""


def _add(base: Motion, change: Motion, share: Scalar | float = 1.0, h: Scalar | float = 1.0) -> Motion:
    if isinstance(share, float) and share == 0.0:
        return base
    return jax.tree.map(lambda b, c: b + share * h * c, base, change)
