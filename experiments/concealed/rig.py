"""The concealed rig: a loading bridge in another engine (MuJoCo), with true stick-slip and every effect.

It shares nothing with the simulator that is under test: no import, no equation, no friction model. Dry
friction is a hard constraint whose level is set at every step from place, direction and speed. Levels that
differ by direction, p for v > 0 and n for v < 0, are the engine's symmetric friction (p+n)/2 beside a
constant force -(p-n)/2: the same law, stuck and sliding.
"""

import math
from collections.abc import Callable

import mujoco
import numpy as np

import clutter
import effects as catalogue
import uncatalogued
from drives import SAMPLE, Drive
from effects import Layout, Vector
from scene import DT, build
from sensors import Sensor

SUBSTEPS = round(SAMPLE / DT)
FRICTION = {**catalogue.FRICTION, **uncatalogued.FRICTION}
FORCES = {**catalogue.FORCES, **uncatalogued.FORCES, **clutter.FORCES}
LOAD = {**catalogue.LOAD, **uncatalogued.LOAD}

Commands = np.ndarray | Callable[[float, dict[str, float]], tuple[float, float]]
"""Voltages (u_x, u_l), one row per sample, or a law from time [s] and readings to voltages."""


def wander(share: float, key: np.random.Generator) -> Callable[[float, float], float]:
    """Friction that wanders: a factor 1 + share f(t, q), f a smooth random field of unit variance."""
    places = key.uniform(0.1, 0.5, 8)
    periods = key.uniform(2.0, 10.0, 8)
    phases = key.uniform(0.0, 2 * math.pi, 8)
    waves = [(2 * math.pi / a, 2 * math.pi / b, c) for a, b, c in zip(places, periods, phases, strict=True)]
    return lambda t, q: 1.0 + share * 0.5 * sum(math.cos(a * q + b * t + c) for a, b, c in waves)


class Rig:
    """One recording's rig: engine, laws, drives.

    Args:
        truth: see `simulate`.
        start: initial `x` [m], `psi` [rad], `l` [m], at rest.
        key: for what wanders.
    """

    def __init__(self, truth: dict, start: dict, key: np.random.Generator):
        self.model, self.at = build(truth, start["l"])
        self.data = mujoco.MjData(self.model)
        # The engine damps implicitly, by the velocity after the step: first order, 1 % of the hoist's
        # damping. Half of it taken before the step makes the trapezoidal rule, second order.
        self.model.dof_damping *= 0.5
        self.half_damping = self.model.dof_damping.tolist()
        at, bridge, effects = self.at, truth["bridge"], truth["effects"]
        for joint, value in (("x", "x"), ("psi", "psi"), ("l", "l")):
            if getattr(at, joint) >= 0:
                self.data.qpos[getattr(at, joint)] = start[value]
        for e in effects:
            if e["kind"] == "rope_elasticity":  # hanging at rest
                self.data.qpos[at.stretch] = bridge["load_mass"] * bridge["gravity"] / e["stiffness"]
            if e["kind"] == "hoist_backlash":
                self.data.qpos[at.stretch] = e["gap"] / 2
        self.load = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, "load")
        self.frictions = self._frictions(effects, truth.get("wander", 0.0), key)
        self.forces = [FORCES[e["kind"]](e, at, DT) for e in effects if e["kind"] in FORCES]
        self.load_forces = [LOAD[e["kind"]](e, at) for e in effects if e["kind"] in LOAD]
        rods = [(e["mass"], e["centre"]) for e in effects if e["kind"] == "rod_inertia"]
        self.hanging = [(bridge.get("load_mass", 0.0), 0.0), *rods]
        """Masses below the pivot, each with its distance from there; 0 stands for the rope's length."""
        self.drives = []
        for column, (site, joint, gain) in enumerate(
            (("cart_drive", at.x, "cart_gain"), ("hoist_drive", at.l, "hoist_gain"))
        ):
            if joint >= 0:
                own = [e for e in effects if e["site"] == site]
                damping = bridge["cart_damping" if site == "cart_drive" else "hoist_damping"]
                self.drives.append((joint, Drive(bridge[gain], own, column, at, joint, damping, DT)))
        parted = [e for e in effects if e["kind"] in ("belt_compliance", "backlash")]
        self.motor_encoder = bool(parted) and parted[0].get("encoder", "cart") == "motor"
        winch = [e for e in effects if e["kind"] == "hoist_backlash"]
        self.drum_encoder = bool(winch) and winch[0].get("encoder", "motor") == "drum"

    def _frictions(self, effects: list, share: float, key: np.random.Generator) -> list:
        """Per axis with dry friction: joint, laws, laws that look at other axes or at the load, and what wanders."""
        found = []
        for site, joint in (("cart", self.at.x), ("swing", self.at.psi), ("hoist", self.at.l)):
            own = [e for e in effects if e["site"] == site]
            laws = [FRICTION[e["kind"]](e) for e in own if e["kind"] in FRICTION]
            coupled = [
                uncatalogued.COUPLED_FRICTION[e["kind"]](e, self.at)
                for e in own
                if e["kind"] in uncatalogued.COUPLED_FRICTION
            ]
            loaded = [catalogue.LOADED_FRICTION[e["kind"]](e) for e in own if e["kind"] in catalogue.LOADED_FRICTION]
            if laws or coupled or loaded:
                found.append((joint, laws, coupled, loaded, wander(share, key) if share else None))
        return found

    def _pull(self, q: Vector, v: Vector) -> float:
        """Weight and centrifugal force of what hangs on the pivot, along the rope [N]."""
        gravity, cosine, spin = -self.model.opt.gravity[2], math.cos(q[self.at.psi]), v[self.at.psi]
        return sum(mass * (gravity * cosine + (at or self.at.length(q)) * spin**2) for mass, at in self.hanging)

    def coordinates(self) -> dict[str, float]:
        """True `x`, `psi`, `l` now; the half step by which the engine's positions lead is taken back."""
        q = (self.data.qpos - 0.5 * DT * self.data.qvel).tolist()
        at: Layout = self.at
        return {
            "x": q[at.x] if self.motor_encoder else at.cart(q),
            "psi": q[at.psi] if at.psi >= 0 else 0.0,
            "l": at.length(q) + (q[at.stretch] if self.drum_encoder else 0.0),
        }

    def step(self, number: int, log: list[Vector]) -> None:
        """One engine step under the logged voltages."""
        data, t = self.data, (number + 0.5) * DT
        q, v = data.qpos.tolist(), data.qvel.tolist()
        forces = [-half * rate for half, rate in zip(self.half_damping, v, strict=True)]
        for law in self.forces:
            law(t, q, v, forces)
        thrusts = {joint: drive.force(number, t, q, v, log) for joint, drive in self.drives}
        for joint, laws, coupled, loaded, field in self.frictions:
            positive = negative = sum(law(q, v) for law in coupled)
            if loaded:
                load = self._pull(q, v) if joint == self.at.psi else abs(thrusts[joint])
                positive = negative = positive + sum(law(load) for law in loaded)
            for law in laws:
                p, n = law(t, q[joint], v[joint])
                positive, negative = positive + p, negative + n
            if field is not None:
                factor = field(t, q[joint])
                positive, negative = positive * factor, negative * factor
            self.model.dof_frictionloss[joint] = 0.5 * (positive + negative)
            forces[joint] -= 0.5 * (positive - negative)
        for joint, thrust in thrusts.items():
            forces[joint] += thrust
        data.qfrc_applied[:] = forces
        if self.load_forces:
            pushes = [law(t, q, v) for law in self.load_forces]
            data.xfrc_applied[self.load, 0] = sum(p[0] for p in pushes)
            data.xfrc_applied[self.load, 2] = sum(p[1] for p in pushes)
        mujoco.mj_step(self.model, data)


def simulate(
    truth: dict, commands: Commands, seconds: float, seed: int, start: dict | None = None, noisy: bool = True
) -> dict[str, np.ndarray]:
    """One recording: columns `t`, `u_x`, `u_l`, `x`, `psi`, `l` in SI, sampled every 5 ms.

    Args:
        truth: `bridge` and `effects` (as in a model file), `parts` ("full", "cart", "pendulum"), `rope`
            ("winch", "locked"), optionally `noise` (per channel) and `wander` (share of friction).
        commands: voltages, open loop, or a law that sees the readings.
        seconds: length of the recording [s].
        seed: of noise and of what wanders; the same seed gives the same recording.
        start: initial `x`, `psi`, `l`, at rest.
        noisy: False returns the readings without noise and counts (a law that commands still sees both).
    """
    start = {"x": 0.75, "psi": 0.0, "l": 0.7, **(start or {})}
    key = np.random.default_rng(seed)
    rig = Rig(truth, start, key)
    count = round(seconds / SAMPLE) + 1
    encoders = {
        c: Sensor(
            c,
            [e for e in truth["effects"] if e["site"] == f"{c}_sensor"],
            count,
            SAMPLE,
            truth.get("noise", {}).get(c, {}),
            key,
        )
        for c in ("x", "psi", "l")
    }
    clock = math.prod(e["scale"] for e in truth["effects"] if e["kind"] == "clock_scale")
    late = {c: round(s.delay / DT) for c, s in encoders.items() if s.delay}
    fine: dict[str, Vector] = {c: [] for c in late}
    log: list[Vector] = []
    rows = []
    for k in range(count):
        t = k * SAMPLE
        true = rig.coordinates()
        for c, steps in late.items():
            true[c] = fine[c][max(k * SUBSTEPS - steps, 0)] if k else true[c]
        reading = {c: s.read(k, t, true[c]) for c, s in encoders.items()}
        u = commands(t, reading) if callable(commands) else commands[min(k, len(commands) - 1)]
        log.append([float(u[0]), float(u[1])])
        shown = reading if noisy else {c: s.distort(t, true[c]) for c, s in encoders.items()}
        rows.append([t / clock, *log[-1], shown["x"], shown["psi"], shown["l"]])
        if k == count - 1:
            break
        for n in range(k * SUBSTEPS, (k + 1) * SUBSTEPS):
            if late:
                now = rig.coordinates()
                for c in late:
                    fine[c].append(now[c])
            rig.step(n, log)
    return dict(zip(("t", "u_x", "u_l", "x", "psi", "l"), np.array(rows).T, strict=True))
