"""What do effects and a quick controller cost? Computing time against the number of effects and the control period.

    python experiments/throughput/cost.py             measure: a few minutes on two idle cores
    python experiments/throughput/cost.py --figures   redraw from figures/data/throughput-cost.json

Batches and duration are in throughput.py. Steps are of 5 ms in all runs; a period of 10 ms has two of them.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT), str(ROOT / "experiments")]

from random_rollouts import EFFECTS, model_text  # noqa: E402

import jbridge  # noqa: E402
import ours  # noqa: E402
from problem import MODEL, batch  # noqa: E402

DATA, PICTURE = ROOT / "figures" / "data" / "throughput-cost.json", ROOT / "figures" / "throughput-cost.png"
COUNTS = (0, 1, 2, 5, 10, 20, 30)
PERIODS = (0.005, 0.01, 0.02, 0.05, 0.1)
STEP = 0.005
LANES, SECONDS = 1024, 2.0


def plant(count: int) -> Any:
    """The bridge with the first so many effects."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        path.write_text(model_text(MODEL, dict(list(EFFECTS.items())[:count])))
        return jbridge.load_model(path).plant


def timed(one: Any, given: Any) -> tuple[float, float]:
    """Seconds of the first call, and of the best later one."""
    run = jax.jit(jax.vmap(lambda load, start: one(load, jnp.concatenate([start, jnp.zeros(3)]))))
    loads, _, starts = ours.lanes_of(given, "float64")
    first, best, _ = ours.timed(run, [loads, starts], "float64")
    return first, best


def measured() -> dict[str, Any]:
    rows: dict[str, Any] = {"lanes": LANES, "seconds": SECONDS, "effects": [], "periods": []}
    given = batch("open", LANES, SECONDS)
    for count in COUNTS:
        bridge = plant(count)

        def free(load: Any, initial: Any, bridge: Any = bridge) -> Any:
            own = jbridge.with_values(bridge, {"load_mass": load})
            table = jnp.asarray(given.table)
            return jbridge.play(own, initial, table, period=STEP, substeps=1, collect=ours.Last())

        first, best = timed(free, given)
        rows["effects"].append({"count": count, "first": first, "best": best})
        print(rows["effects"][-1], flush=True)
    bridge, given = plant(5), batch("closed", LANES, SECONDS)
    for period in PERIODS:
        path = jbridge.smooth_path([(0.0, 0.185), (1.2, 0.6)], speed=(0.45, 0.3), rest=SECONDS, period=period)
        goal = np.stack([path.x, path.l], axis=1)[: round(SECONDS / period)]
        still = jnp.zeros(len(goal))
        reference = jbridge.Reference(jnp.asarray(goal[:, 0]), jnp.asarray(goal[:, 1]), still, still)
        controller = ours.law("float64")

        def closed(load: Any, initial: Any, reference: Any = reference, period: float = period) -> Any:
            own = jbridge.with_values(bridge, {"load_mass": load})
            options = {"period": period, "substeps": round(period / STEP), "collect": ours.Last()}
            return jbridge.closed_loop(own, controller, initial, reference, **options)

        first, best = timed(closed, given)
        rows["periods"].append({"period": period, "first": first, "best": best})
        print(rows["periods"][-1], flush=True)
    return rows


def draw(rows: dict[str, Any]) -> None:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    plt.style.use("jbridge.report.figures.common")
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
    for panel, key, x, label in (
        (left, "effects", "count", "effects of the model, open loop"),
        (right, "periods", "period", "control period [ms], both fuzzy controllers"),
    ):
        places = [row[x] * (1e3 if x == "period" else 1.0) for row in rows[key]]
        panel.plot(places, [1e3 * row["best"] for row in rows[key]], color="#0a6ebd", marker="o", ms=4)
        panel.set_xlabel(label)
        panel.set_ylim(bottom=0.0)
    right.set_xscale("log")
    right.set_xticks([1e3 * p for p in PERIODS], [f"{1e3 * p:g}" for p in PERIODS])
    right.minorticks_off()
    left.set_ylabel(f"{rows['lanes']} bridges, {rows['seconds']:g} s: computing time [ms]")
    figure.savefig(PICTURE, dpi=130, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", action="store_true", help="only redraw")
    if not parser.parse_args().figures:
        jbridge.set_up(True)
        DATA.write_text(json.dumps(measured(), indent=1) + "\n")
    draw(json.loads(DATA.read_text()))


if __name__ == "__main__":
    main()
