"""The fastest swing-free move that the drives allow, by optimal control on the fitted model.

    python experiments/tuning/limit.py        after experiments/paper/run.py; numbers go to figures/data/tuning.json

From rest to rest, the load hanging still at the end, within 3 V at the cart and 10 V at the hoist. For a given duration
the voltages are moved until the end is met: the simulation is linearised about them, and the smallest change within the
limits that removes what is missed is a bounded least-squares problem (SciPy). The duration is then shortened step by
step, until the end is met no longer. What comes out is a move that is possible; a faster one may exist.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import lsq_linear

import jbridge

ROOT = Path(__file__).resolve().parent.parent.parent
FITTED = ROOT / "out" / "paper" / "fitted" / "model.toml"
DATA = ROOT / "figures" / "data" / "tuning.json"
LIMITS = np.array([3.0, 10.0])
"""[V]"""
PIECES, SUBSTEPS = 120, 6
"""Voltages held one after the other in a move, and integration steps in each."""
MET = np.array([1e-3, np.radians(0.05), 1e-3, 2e-3, np.radians(0.3), 2e-3])
"""What may be missed at the end: `x` [m], `psi` [rad], `l` [m], and their speeds [m/s, rad/s]."""
SHORTER = 0.97
"""Each duration tried, over the one before."""
ROUNDS = 40
"""Linearisations for one duration."""
REACH = 0.5
"""Largest change of a voltage in one of them, as a share of its limit."""
EASE = 1e-3
"""How much a change of the voltages weighs against what is missed."""


def end_of(plant: jbridge.Plant) -> tuple[Callable, Callable]:
    """The state at the end of a move, and its slope towards every voltage, as compiled functions."""

    class Ending(jbridge.AbstractSummary):
        """The latest positions and speeds."""

        def start(self, sample):
            return jnp.zeros(6)

        def update(self, numbers, sample):
            return jnp.stack([*sample.q.axes, *sample.v.axes])

        def finish(self, numbers):
            return numbers

    def end(volts: jax.Array, initial: jax.Array, seconds: jax.Array) -> jax.Array:
        # A sample is taken before its input acts, so that the last input does not matter.
        given = jnp.concatenate([volts, volts[-1:]])
        return jbridge.play(
            plant, initial, given, period=seconds / PIECES, substeps=SUBSTEPS, collect=Ending(), reverse=True
        )

    return jax.jit(end), jax.jit(jax.jacrev(end))


def fastest(plant: jbridge.Plant, start: np.ndarray, goal: np.ndarray) -> tuple[float, np.ndarray]:
    """Duration [s] and voltages `(piece, 2)` of the fastest move found."""
    end, slope = end_of(plant)
    initial = jnp.zeros(6).at[0].set(start[0]).at[2].set(start[1])
    target = np.array([goal[0], 0.0, goal[1], 0.0, 0.0, 0.0])

    def solve(volts: np.ndarray, seconds: float) -> np.ndarray | None:
        missed = (np.asarray(end(volts, initial, seconds)) - target) / MET
        reach = REACH
        for _ in range(ROUNDS):
            if np.abs(missed).max() < 1.0:
                return volts
            ways = (np.asarray(slope(volts, initial, seconds)) / MET[:, None, None]).reshape(6, -1)
            scale = np.tile(LIMITS, PIECES)
            share = volts.ravel() / scale
            matrix = np.concatenate([ways * scale, EASE * np.eye(len(scale))])
            bounds = np.maximum(-1.0 - share, -reach), np.minimum(1.0 - share, reach)
            step = lsq_linear(matrix, np.concatenate([-missed, np.zeros(len(scale))]), bounds).x
            tried = ((share + step) * scale).reshape(volts.shape)
            after = (np.asarray(end(tried, initial, seconds)) - target) / MET
            if np.linalg.norm(after) < np.linalg.norm(missed):
                volts, missed, reach = tried, after, min(2.0 * reach, REACH)
            else:
                reach *= 0.3
        return None

    seconds, volts = 8.0, first_guess(plant, start, goal, 8.0)
    found = solve(volts, seconds)
    if found is None:
        raise SystemExit("not even a slow move meets its end; is the model fitted?")
    while (shorter := solve(found, SHORTER * seconds)) is not None:
        seconds, found = SHORTER * seconds, shorter
        print(f"  {seconds:.2f} s", file=sys.stderr, flush=True)
    return seconds, found


def first_guess(plant: jbridge.Plant, start: np.ndarray, goal: np.ndarray, seconds: float) -> np.ndarray:
    """Voltages that a smooth move takes if the load did not swing: what friction and dead zones ask for."""
    s = (np.arange(PIECES) + 0.5) / PIECES
    speed = (goal - start) * (30 * s**2 * (1 - s) ** 2)[:, None] / seconds
    bridge = plant.bridge
    drag = np.array([bridge.cart_damping, bridge.hoist_damping]) * speed / [bridge.cart_gain, bridge.hoist_gain]
    lost = jbridge.compensation_for(plant, 1.0)
    volts = drag + np.sign(goal - start) * [float(lost.cart), float(lost.hoist)]
    volts[:, 1] += float(lost.hoist_bias)
    return np.clip(volts, -LIMITS, LIMITS)


def played(plant: jbridge.Plant, start: np.ndarray, volts: np.ndarray, seconds: float) -> dict[str, list[float]]:
    """The move with half a second at rest after it, as columns."""
    period = seconds / PIECES
    rest = np.tile([0.0, float(jbridge.compensation_for(plant).hoist_bias)], (round(0.5 / period), 1))
    given = np.concatenate([volts, rest])
    initial = jnp.zeros(6).at[0].set(start[0]).at[2].set(start[1])
    sample = jbridge.play(plant, initial, jnp.asarray(given), period=period, substeps=SUBSTEPS)
    columns = {"t": sample.times, "x": sample.q.x, "psi": sample.q.psi, "l": sample.q.l}
    columns |= {"u_x": given[:, 0], "u_l": given[:, 1]}
    return {name: [float(f"{value:.4g}") for value in np.asarray(values)] for name, values in columns.items()}


def main() -> None:
    jbridge.set_up()
    plant = jbridge.load_model(FITTED).plant
    legs = jbridge.paper_legs()
    course = jbridge.Course(plant, jbridge.scattered(plant, 1, 0), legs, 0.02)
    found = []
    for number, (start, goal) in enumerate(zip(legs.start, legs.goal, strict=True)):
        seconds, volts = fastest(plant, start, goal)
        arrival = float(course.moves.leg.arrival[0, number])
        found.append({"seconds": seconds, "reference": arrival, "run": played(plant, start, volts, seconds)})
        print(f"from {start} to {goal} m: {seconds:.2f} s; the reference takes {arrival:.2f} s", flush=True)
    kept = json.loads(DATA.read_text()) if DATA.exists() else {}
    DATA.write_text(json.dumps(kept | {"limit": found}, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()
