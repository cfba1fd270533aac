"""What is kept of one move in a closed loop: a handful of numbers, updated while time passes."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from .._math import sincos
from ..control.move_metrics import DWELL, FULL, IDLE, NEAR
from .outputs import AbstractSummary

UNITS = {
    "settling_x": "s",
    "settling_l": "s",
    "settling_load": "s",
    "overshoot_x": "m",
    "overshoot_l": "m",
    "final_error_x": "m",
    "final_error_l": "m",
    "rms_error_x": "m",
    "rms_error_l": "m",
    "itae_x": "m s^2",
    "itae_l": "m s^2",
    "largest_swing": "rad",
    "residual_swing": "rad",
    "effort_x": "V^2",
    "effort_l": "V^2",
    "chatter_x": "V/s",
    "chatter_l": "V/s",
    "sign_changes_x": "1",
    "sign_changes_l": "1",
    "saturation_x": "1",
    "saturation_l": "1",
    "lowest_x": "m",
    "highest_x": "m",
}
"""Unit of every summary."""
_LATE, _AT_LAST = 0.75, 0.9
"""Share of the rest after which the swing counts as residual, and of a move without any rest."""


def late_from(arrival: Array, end: Array) -> Array:
    """Time from which swing is residual [s]: the last quarter of the rest, or a tenth of a move without any."""
    return jnp.where(arrival < end, arrival + _LATE * (end - arrival), _AT_LAST * end)


class _Numbers(NamedTuple):
    samples: Array
    outside: Array
    """Last time outside 1 cm of the goal, for x, l, load [s]."""
    beyond: Array
    squares: Array
    itae: Array
    swing: Array
    residual: Array
    effort: Array
    chatter: Array
    side: Array
    """Sign of each voltage when it last had one."""
    changes: Array
    full: Array
    last: Array
    error: Array
    low: Array
    high: Array


class MoveSummary(AbstractSummary):
    """Numbers of one move to the reference's last point, from its first."""

    goal: Array
    """Cart position and rope length at the end [m]."""
    way: Array
    """From the start to the goal [m]."""
    late: Array
    """Time from which the swing counts as residual [s]."""
    period: Array
    """Of sampling [s]."""
    limits: Array
    """Voltages beyond which the drives saturate [V]: cart, hoist."""

    def start(self, sample: Any) -> _Numbers:
        zero, two = jnp.zeros_like(self.period), jnp.zeros_like(self.goal)
        big = jnp.full_like(self.period, jnp.inf)
        never = jnp.full(3, -1.0, two.dtype)
        return _Numbers(zero, never, two, two, two, zero, zero, two, two, two, two, two, two, two, big, -big)

    def update(self, numbers: _Numbers, sample: Any) -> _Numbers:
        q, t, u = sample.q, sample.times, sample.command
        place = jnp.stack([q.x, q.l])
        error = place - self.goal
        sideways = jnp.abs(q.x + q.l * sincos(q.psi)[0] - self.goal[0])
        load = jnp.maximum(sideways, jnp.abs(error[1]))
        # A position that is no number any more is not near.
        away = ~(jnp.append(jnp.abs(error), load) <= NEAR)
        follow = place - jnp.stack([sample.reference.x, sample.reference.l])
        swing = jnp.abs(q.psi)
        side = jnp.where(jnp.abs(u) > IDLE * self.limits, jnp.sign(u), numbers.side)
        return _Numbers(
            numbers.samples + 1.0,
            jnp.where(away, t, numbers.outside),
            jnp.maximum(numbers.beyond, jnp.sign(self.way) * error),
            numbers.squares + follow * follow,
            numbers.itae + t * jnp.abs(follow) * self.period,
            jnp.maximum(numbers.swing, swing),
            jnp.where(t >= self.late, jnp.maximum(numbers.residual, swing), numbers.residual),
            numbers.effort + u * u,
            numbers.chatter + jnp.where(numbers.samples > 0, jnp.abs(u - numbers.last), 0.0),
            side,
            numbers.changes + jnp.where(side * numbers.side < 0.0, 1.0, 0.0),
            numbers.full + jnp.where(jnp.abs(u) >= FULL * self.limits, 1.0, 0.0),
            u,
            error,
            jnp.minimum(numbers.low, q.x),
            jnp.maximum(numbers.high, q.x),
        )

    def finish(self, numbers: _Numbers) -> dict[str, Array]:
        count = numbers.samples
        seconds = count * self.period
        settled = numbers.outside + jnp.where(numbers.outside >= 0, self.period, 1.0)
        # Outside near the end: not settled, which is no number. The last sample is a period before `seconds`.
        settled = jnp.where(settled > seconds - self.period - DWELL + 0.5 * self.period, jnp.nan, settled)
        rms = jnp.sqrt(numbers.squares / count)
        values = (
            settled[0], settled[1], settled[2], numbers.beyond[0], numbers.beyond[1], numbers.error[0],
            numbers.error[1], rms[0], rms[1], numbers.itae[0], numbers.itae[1], numbers.swing, numbers.residual,
            numbers.effort[0] / count, numbers.effort[1] / count, numbers.chatter[0] / seconds,
            numbers.chatter[1] / seconds, numbers.changes[0], numbers.changes[1], numbers.full[0] / count,
            numbers.full[1] / count, numbers.low, numbers.high,
        )  # fmt: skip
        return dict(zip(UNITS, values, strict=True))


def is_sound(summary: dict[str, Array]) -> Array:
    """Whether a run has stayed finite; a position that never settles is no failure."""
    settling = ("settling_x", "settling_l", "settling_load")
    return jnp.all(jnp.stack([jnp.isfinite(v) for k, v in summary.items() if k not in settling]), axis=0)
