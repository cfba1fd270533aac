"""Are gradients true where laws have corners? Closed and open loops against central differences, at random points.

    python experiments/gradients.py                     200 points of each sort, and a million gradients: minutes
    python experiments/gradients.py --many 10000        fewer of the latter
    python experiments/gradients.py --figures           redraw the table from figures/data/gradients.json

Every point is a bridge with friction, dead zones, saturation and lag of random size. A fifth of the open loops is at
rest within its dead zone, a fifth creeps about the breakaway, a fifth is saturated. Closed loops begin at their set
point, near it, or far from it. What is differentiated is the mean square of the cart's and the load's way, in one
random direction of all numbers together; central differences take the better of two widths.
"""

import argparse
import dataclasses
import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jbridge

ROOT = Path(__file__).parents[1]
DATA, TABLE = ROOT / "figures" / "data" / "gradients.json", ROOT / "figures" / "gradients-table.md"
NUMBERS = {
    "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81, "cart_damping": 45.0,
    "swing_damping": 0.0015, "hoist_damping": 25.0, "cart_gain": 16.0, "hoist_gain": 3.0,
}  # fmt: skip
EFFECTS = """
[[effect]]
kind = "direction_dependent_friction"
site = "cart"
positive = 4.0
negative = 3.0
[[effect]]
kind = "coulomb_friction"
site = "hoist"
level = 2.0
[[effect]]
kind = "dead_zone"
site = "cart_drive"
positive = 0.25
negative = 0.3
[[effect]]
kind = "saturation"
site = "cart_drive"
limit = 2.5
[[effect]]
kind = "actuator_lag"
site = "hoist_drive"
time_constant = 0.06
"""
VARIED = {
    "cart_damping": 45.0, "cart_gain": 16.0, "load_mass": 0.143, "hoist_gain": 3.0,
    "direction_dependent_friction@cart.positive": 4.0, "direction_dependent_friction@cart.negative": 3.0,
    "coulomb_friction@hoist.level": 2.0, "dead_zone@cart_drive.positive": 0.25, "dead_zone@cart_drive.negative": 0.3,
    "saturation@cart_drive.limit": 2.5, "actuator_lag@hoist_drive.time_constant": 0.06,
}  # fmt: skip
"""Numbers that are differentiated by, with their values."""
COUNT, HELD = 200, 40
"""Intervals of 5 ms, and how many of them an input is held."""
PERIODS = 50
"""Of a closed loop, 20 ms each."""
WIDTHS = (1e-5, 1e-6)
SORTS = ("open: driven", "open: at rest", "open: about the breakaway", "open: saturated", "closed: at the set point",
         "closed: near it", "closed: far from it")  # fmt: skip
LANES = 1000


def model() -> Any:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "model.toml"
        path.write_text("[bridge]\n" + "".join(f"{k} = {v}\n" for k, v in NUMBERS.items()) + EFFECTS)
        return jbridge.load_model(path).plant


def losses() -> dict[str, Any]:
    """Open and closed loop, as functions of the varied numbers (in parts of the plant's), a start and inputs."""
    plant = model()
    law = dataclasses.replace(jbridge.paper_controller(), softness=0.05)

    def bridge(factors: Any) -> Any:
        return jbridge.with_values(plant, {name: value * factors[k] for k, (name, value) in enumerate(VARIED.items())})

    def mean(run: Any) -> Any:
        return jnp.mean((run.q.x - 0.5) ** 2 + (run.q.l * run.q.psi) ** 2 + (run.q.l - 0.6) ** 2)

    def open_loop(factors: Any, start: Any, given: Any) -> Any:
        volts = jnp.repeat(given, HELD, axis=0)
        return mean(jbridge.play(bridge(factors), start, volts, period=0.005, substeps=1, reverse=True))

    def closed_loop(factors: Any, start: Any, given: Any) -> Any:
        still = jnp.zeros(PERIODS)
        wanted = jbridge.Reference(jnp.full(PERIODS, given[0, 0]), jnp.full(PERIODS, given[0, 1]), still, still)
        return mean(jbridge.closed_loop(bridge(factors), law, start, wanted, period=0.02, substeps=4, reverse=True))

    return {"open": open_loop, "closed": closed_loop}


def drawn(sort: str, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Factors of the numbers, starts, inputs or references, and directions, a row each."""
    key = np.random.default_rng([seed, SORTS.index(sort)])
    factors = key.uniform(0.6, 1.6, (count, len(VARIED)))
    start = np.zeros((count, 6))
    start[:, :3] = np.array([0.5, 0.0, 0.6]) + key.uniform(-0.05, 0.05, (count, 3))
    blocks = COUNT // HELD
    given = key.uniform(-1.0, 1.0, (count, blocks, 2)) * [2.4, 1.5] + [0.0, -0.4]
    if sort == "open: at rest":
        start[:, 1], given = 0.0, key.uniform(-1.0, 1.0, (count, blocks, 2)) * [0.12, 0.2] + [0.0, -0.45]
    elif sort == "open: about the breakaway":
        given[:, :, 0] = np.sign(given[:, :, 0]) * key.uniform(0.3, 0.7, (count, blocks))
    elif sort == "open: saturated":
        given[:, :, 0] = np.sign(given[:, :, 0]) * key.uniform(2.4, 4.5, (count, blocks))
    elif sort.startswith("closed"):
        far = {"closed: at the set point": 0.0, "closed: near it": 0.004, "closed: far from it": 0.3}[sort]
        if far == 0.0:
            start[:, 1] = 0.0
        given[:, 0, :] = start[:, [0, 2]] + key.uniform(-1.0, 1.0, (count, 2)) * far
    else:
        start[:, 3:] = key.uniform(-0.3, 0.3, (count, 3))
    along = key.normal(size=factors.shape)
    return factors, start, given, along / np.linalg.norm(along, axis=1, keepdims=True)


def compared(count: int) -> list[dict[str, Any]]:
    """Derivatives along random directions beside central differences."""
    rows = []
    for loop, loss in losses().items():
        value, slope = jax.jit(jax.vmap(loss)), jax.jit(jax.vmap(jax.grad(loss)))
        for sort in (sort for sort in SORTS if sort.startswith(loop)):
            factors, start, given, along = drawn(sort, count, 0)
            told = np.sum(np.asarray(slope(factors, start, given)) * along, axis=1)
            found = [
                (value(factors + h * along, start, given) - value(factors - h * along, start, given)) / (2 * h)
                for h in WIDTHS
            ]
            size = float(np.sqrt(np.mean(np.square(found[0])))) + 1e-12
            off = np.min([np.abs(told - np.asarray(f)) for f in found], axis=0)
            rows.append(
                {"sort": sort, "points": count, "size": size, "median": float(np.median(off) / size),
                 "largest": float(off.max() / size), "beyond": int((off > 1e-3 * size).sum())}
            )  # fmt: skip
            print(json.dumps(rows[-1]), flush=True)
    return rows


def counted(many: int) -> int:
    """How many of so many gradients are not finite."""
    lost = 0
    for loop, loss in losses().items():
        slope = jax.jit(jax.vmap(jax.grad(loss)))
        sorts = [sort for sort in SORTS if sort.startswith(loop)]
        for k in range(max(many // (2 * LANES), 1)):
            factors, start, given, _ = drawn(sorts[k % len(sorts)], LANES, k + 1)
            lost += int((~np.isfinite(np.asarray(slope(factors, start, given))).all(axis=1)).sum())
    return lost


def table(saved: dict[str, Any]) -> str:
    lines = [
        "# Gradients at corners", "",
        "Derivatives in a random direction of eleven numbers against central differences, over the root mean square of",
        f"the sort's derivatives. Of {saved['many']:,} further gradients {saved['lost']} were not finite. Redrawn by",
        "`python experiments/gradients.py --figures`; do not edit.", "",
        "| runs | points | median error | largest error | beyond 0.1 % |",
        "|---|---|---|---|---|",
    ]  # fmt: skip
    for r in saved["rows"]:
        lines.append(f"| {r['sort']} | {r['points']} | {r['median']:.1g} | {r['largest']:.1g} | {r['beyond']} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=200, help="of each sort (default: %(default)s)")
    parser.add_argument("--many", type=int, default=1_000_000, help="gradients to look for what is not finite")
    parser.add_argument("--figures", action="store_true", help="redraw from saved data and stop")
    chosen = parser.parse_args()
    if chosen.figures:
        TABLE.write_text(table(json.loads(DATA.read_text())))
        return
    jbridge.set_up()
    saved = {"rows": compared(chosen.points), "many": chosen.many, "lost": counted(chosen.many)}
    DATA.write_text(json.dumps(saved, indent=1) + "\n")
    TABLE.write_text(table(saved))
    print(table(saved))


if __name__ == "__main__":
    main()
