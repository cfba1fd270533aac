"""Drives of the concealed rig: the voltage that was logged in, the voltage that the motor acts on out.

The stages compose in one fixed order: delay, saturation, dead zone, gain asymmetry and drift, late start,
drum radius, lag, ripple. Gain, speed loop and the force's limit follow.
"""

import math
from collections.abc import Callable

import clutter
from effects import Effect, Layout, Vector
from uncatalogued import DRIVE_STAGES

SAMPLE = 5e-3
"""Time between two samples, over which inputs are held [s]."""

Stage = Callable[[float, float, Vector, Vector], float]
"""(voltage, time, joint positions, both logged voltages) -> voltage."""


def _saturation(e: Effect, at: Layout, dt: float) -> Stage:
    return lambda u, t, q, both: min(max(u, -e["limit"]), e["limit"])


def _dead_zone(e: Effect, at: Layout, dt: float) -> Stage:
    return lambda u, t, q, both: u - min(max(u, -e["negative"]), e["positive"])


def _start_delay(e: Effect, at: Layout, dt: float) -> Stage:
    since = [math.inf]

    def stage(u: float, t: float, q: Vector, both: Vector) -> float:
        since[0] = min(since[0], t) if u else math.inf
        # The share of the step that lies behind the start and its delay.
        return u * min(max((t + dt - since[0] - e["delay"]) / dt, 0.0), 1.0)

    return stage


def _gain_asymmetry(e: Effect, at: Layout, dt: float) -> Stage:
    return lambda u, t, q, both: u * (1.0 + e["ratio"] if u > 0 else 1.0 - e["ratio"])


def _gain_drift(e: Effect, at: Layout, dt: float) -> Stage:
    return lambda u, t, q, both: u * (1.0 + e["rate"] * t)


def _drum_radius_change(e: Effect, at: Layout, dt: float) -> Stage:
    return lambda u, t, q, both: u * (1.0 + e["slope"] * (at.length(q) - e["length"]))


def _torque_ripple(e: Effect, at: Layout, dt: float) -> Stage:
    joint = at.x if e["site"] == "cart_drive" else at.l
    turn = 2 * math.pi / e["period"]
    return lambda u, t, q, both: u * (1.0 + e["amplitude"] * math.sin(turn * q[joint] + e["phase"]))


def _actuator_lag(e: Effect, at: Layout, dt: float) -> Stage:
    """First order, exact for a held input; the mean over the step is what acts, which keeps second order."""
    share = 1.0 - math.exp(-dt / e["time_constant"])
    state = [0.0]

    def stage(u: float, t: float, q: Vector, both: Vector) -> float:
        before = state[0]
        state[0] = before + share * (u - before)
        return 0.5 * (before + state[0])

    return stage


STAGES: dict[str, Callable[[Effect, Layout, float], Stage]] = {
    "saturation": _saturation,
    "dead_zone": _dead_zone,
    "gain_asymmetry": _gain_asymmetry,
    "gain_drift": _gain_drift,
    "start_delay": _start_delay,
    "drum_radius_change": _drum_radius_change,
    **DRIVE_STAGES,
    **clutter.DRIVE_STAGES,
    "actuator_lag": _actuator_lag,
    "speed_drive": _actuator_lag,
    "torque_ripple": _torque_ripple,
}
"""In the order in which they compose."""


class Drive:
    """One motor's chain from logged voltage to force.

    Args:
        gain: force per volt [N/V].
        effects: the effects at this drive's site.
        column: which of the two logged voltages drives it (0: u_x, 1: u_l).
        joint: its slide.
        damping: of that slide in the engine [N s/m], of which a speed loop's part is the drive's own.
        dt: engine step [s].
    """

    def __init__(
        self, gain: float, effects: list[Effect], column: int, at: Layout, joint: int, damping: float, dt: float
    ):
        self.gain, self.column, self.joint, self.dt = gain, column, joint, dt
        self.delay = sum(e["delay"] for e in effects if e["kind"] == "input_delay")
        order = list(STAGES)
        rest = sorted(
            (e for e in effects if e["kind"] not in ("input_delay", "force_limit", "freewheeling")),
            key=lambda e: order.index(e["kind"]),
        )
        self.stages = [STAGES[e["kind"]](e, at, dt) for e in rest]
        loops = [e for e in effects if e["kind"] == "speed_drive"]
        self.loop = sum(e.get("share", 1.0) * damping for e in loops)
        self.coasts = [(e["constant"], e["width"]) for e in effects if e["kind"] == "freewheeling"]
        self.before = 0.0
        """Velocity of the joint one step earlier."""
        self.limit = min((e["limit"] for e in effects if e["kind"] in ("speed_drive", "force_limit")), default=math.inf)

    def force(self, step: int, t: float, q: Vector, v: Vector, log: list[Vector]) -> float:
        """Force [N] over engine step number `step`, from the logged voltages up to now."""
        if self.delay:
            row = math.floor((step * self.dt - self.delay) / SAMPLE + 1e-6)
            u = log[row][self.column] if row >= 0 else 0.0
        else:
            u = log[-1][self.column]
        for stage in self.stages:
            u = stage(u, t, q, log[-1])
        # The engine's damping, of the mean velocity over the step, goes on at the limit, where the loop's part of it is
        # none: given back.
        rate = v[self.joint]
        mean = 1.5 * rate - 0.5 * self.before
        taken = self.loop * mean
        self.before = rate
        induced = sum(constant * min(abs(u) / width, 1.0) for constant, width in self.coasts) * mean
        return min(max(self.gain * (u - induced) - taken, -self.limit), self.limit) + taken
