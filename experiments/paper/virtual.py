"""The virtual rig: the paper's device is not at hand, so another engine (MuJoCo) plays it.

Its friction by place and direction, dead zones, lag and damping are drawn from a seed and kept in `truth.txt`, in
base64 so that nobody reads them by accident. What estimates them is given recordings only; the comparison at the end
opens them. The rig itself is that of the concealed cases.

    python experiments/paper/virtual.py --seal     draw the truth anew (from the same seed: the same truth)
"""

import argparse
import base64
import json
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jbridge

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "concealed"))

TRUTH = HERE / "truth.txt"
SEED = 1958
RAIL = (-0.1, 1.4)
"""Of 1.5 m; the paper's reference begins at 0, where a cart needs some room behind it [m]."""
LENGTHS = (0.15, 1.0)
Law = Callable[[float, dict[str, float]], tuple[float, float]]
"""From time [s] and readings to voltages."""


def draw(seed: int) -> dict:
    """A rig with everything that the paper found on its own: nothing in it is the owner's guess."""
    key = np.random.default_rng(seed)

    def about(value: float, share: float) -> float:
        return float(f"{value * key.uniform(1 - share, 1 + share):.4g}")

    inner = (float(f"{RAIL[0] + 0.25 * i + key.uniform(-0.06, 0.06):.3f}") for i in range(1, 6))
    knots = [RAIL[0], *inner, RAIL[1]]
    mean = {"positive": 3.2, "negative": 4.2}
    levels = {side: [about(level, 0.3) for _ in knots] for side, level in mean.items()}
    bridge = {
        "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81,
        "cart_damping": about(50.0, 0.1), "swing_damping": about(0.0015, 0.2), "hoist_damping": about(25.0, 0.1),
        "cart_gain": about(17.0, 0.08), "hoist_gain": about(2.8, 0.08),
    }  # fmt: skip
    effects = [
        {"kind": "position_direction_friction", "site": "cart", "knots": knots, **levels},
        {"kind": "coulomb_friction", "site": "hoist", "level": about(3.0, 0.1)},
        {"kind": "dead_zone", "site": "cart_drive", "positive": about(0.25, 0.2), "negative": about(0.25, 0.2)},
        {"kind": "dead_zone", "site": "hoist_drive", "positive": about(0.45, 0.1), "negative": about(0.45, 0.1)},
        {"kind": "actuator_lag", "site": "hoist_drive", "time_constant": about(0.06, 0.2)},
    ]
    return {"bridge": bridge, "effects": effects, "parts": "full", "rope": "winch"}


def seal() -> None:
    TRUTH.write_text(base64.b64encode(json.dumps(draw(SEED)).encode()).decode() + "\n")


def open_truth() -> dict:
    """The rig's own numbers, for the rig and for the comparison at the end."""
    return json.loads(base64.b64decode(TRUTH.read_text()))


def play(law: Law, seconds: float, seed: int, truth: dict | None = None, **start: float) -> dict[str, np.ndarray]:
    """One recording: `t`, `u_x`, `u_l`, `x`, `psi`, `l` in SI, every 5 ms, as encoders read them.

    Args:
        law: what commands the drives.
        seconds: length [s].
        seed: of the noise.
        truth: the rig's own numbers, as `draw` returns them; those of `truth.txt` by default.
        start: initial `x` [m], `psi` [rad], `l` [m], at rest.
    """
    from rig import simulate

    return simulate(truth or open_truth(), law, seconds, seed, start)


def sampled(controller: jbridge.Controller, path: jbridge.Path) -> Law:
    """The controller as the rig's computer runs it: asked every 20 ms, its voltages held in between."""
    law, period = controller.law, controller.period
    ask = jax.jit(lambda *given: law.command(*given))
    memory: dict = {"state": None, "next": 0, "volts": (0.0, 0.0)}

    def voltages(t: float, reading: dict[str, float]) -> tuple[float, float]:
        if t >= memory["next"] * period - 1e-9:
            k = min(memory["next"], len(path.times) - 1)
            measured = jbridge.Axes(*(jnp.asarray(reading[name]) for name in ("x", "psi", "l")))
            if memory["state"] is None:
                memory["state"] = law.start(measured)
            wanted = jbridge.Reference(*(jnp.asarray(values[k]) for values in path[1:]))
            volts, memory["state"] = ask(memory["state"], measured, wanted, period)
            memory["volts"] = (float(volts[0]), float(volts[1]))
            memory["next"] += 1
        return memory["volts"]

    return voltages


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seal", action="store_true", required=True, help="write truth.txt")
    parser.parse_args()
    seal()
