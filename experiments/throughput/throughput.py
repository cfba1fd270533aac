"""How fast is the engine? The same bridges, steps and controllers in jbridge and in hand-written C++.

    python experiments/throughput/throughput.py             all of it: a quarter of an hour on two idle cores
    python experiments/throughput/throughput.py --quick     one batch of each sort, to see that it runs
    python experiments/throughput/throughput.py --figures   redraw from figures/data/throughput.json

The C++ (reference.cpp) is compiled here with g++ -O3 -march=native -fopenmp. Final positions are compared before
anything is timed. A rate counts integration steps of one bridge over the whole batch; compile time is told apart.
Ratios are of runs that follow each other, since the machine may be shared.
"""

import argparse
import json
import os
import platform
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jbridge

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
DATA = ROOT / "figures" / "data" / "throughput.json"
BATCHES = (1, 16, 256, 1024, 4096, 16384, 65536)
ABREAST = 64
SECONDS = 2.0
"""Simulated time of a run."""
MODES = {"open": (0.005, 1), "closed": (0.02, 4)}
"""Held interval or sampling period [s], and steps in each."""
AGREE = {"float64": 1e-9, "float32": 2e-3}
"""Largest difference of final positions [m, rad]."""
MODEL = {
    "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81, "cart_damping": 45.0,
    "swing_damping": 0.0015, "hoist_damping": 25.0, "cart_gain": 16.0, "hoist_gain": 3.0,
}  # fmt: skip
EFFECTS = {"cart friction": 4.0, "hoist friction": 3.0, "cart dead zone": 0.25, "hoist dead zone": 0.45, "lag": 0.06}
TOML = """
[[effect]]
kind = "coulomb_friction"
site = "cart"
level = {cart friction}
[[effect]]
kind = "coulomb_friction"
site = "hoist"
level = {hoist friction}
[[effect]]
kind = "dead_zone"
site = "cart_drive"
positive = {cart dead zone}
negative = {cart dead zone}
[[effect]]
kind = "dead_zone"
site = "hoist_drive"
positive = {hoist dead zone}
negative = {hoist dead zone}
[[effect]]
kind = "actuator_lag"
site = "hoist_drive"
time_constant = {lag}
"""


def build(folder: Path) -> Path:
    """Compiles the reference."""
    program = folder / "reference"
    flags = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-fopenmp", "-std=c++17"]
    subprocess.run(["g++", *flags, str(HERE / "reference.cpp"), "-o", str(program)], check=True)
    return program


def problem(mode: str, lanes: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters and starts of every lane, and what all lanes are given over time."""
    key = np.random.default_rng(0)
    numbers = [*MODEL.values(), *EFFECTS.values(), 3.0, 3.0]
    rows = np.repeat(np.array([numbers]), lanes, axis=0)
    rows[:, 1], rows[:, 9] = key.uniform(0.1, 0.2, lanes), key.uniform(3.0, 5.0, lanes)
    begin = (0.3, 0.6) if mode == "open" else (0.0, 0.185)
    starts = np.stack([np.full(lanes, begin[0]), key.uniform(-0.1, 0.1, lanes), np.full(lanes, begin[1])], axis=1)
    count = round(seconds / MODES[mode][0])
    if mode == "open":
        held = key.uniform(-1, 1, (-(-count // 40), 2)) * [2.5, 3.0] + [0.0, -0.3]
        return rows, starts, np.repeat(held, 40, axis=0)[:count]
    path = jbridge.smooth_path([(0.0, 0.185), (1.2, 0.6)], speed=(0.45, 0.3), rest=seconds, period=MODES[mode][0])
    return rows, starts, np.stack([path.x, path.l], axis=1)[:count]


def reference(program: Path, mode: str, precision: str, given: tuple, folder: Path, short: int = 0) -> dict:
    rows, starts, table = given
    (folder / "in").write_bytes(np.concatenate([rows, starts], axis=1).tobytes() + table.tobytes())
    words = [mode, precision, len(rows), len(table) - short, MODES[mode][1], 5, folder / "in", folder / "out"]
    found = subprocess.run([program, *map(str, words)], check=True, capture_output=True, text=True)
    return json.loads(found.stdout) | {"final": np.fromfile(folder / "out").reshape(-1, 3)}


class Last(jbridge.AbstractSummary):
    """The latest positions."""

    def start(self, sample):
        return jnp.zeros(3, sample.q.x.dtype)

    def update(self, numbers, sample):
        return jnp.stack([sample.q.x, sample.q.psi, sample.q.l])

    def finish(self, numbers):
        return numbers


def engine(mode: str, table: np.ndarray, model: "jbridge.Model"):
    """The batch as one function of the lanes' numbers: masses, friction levels and starts."""
    law = jax.tree.map(lambda leaf: leaf.astype(jnp.result_type(float)), jbridge.paper_controller())
    period, substeps = MODES[mode]

    def one(load_mass, friction, start):
        plant = jbridge.with_values(model.plant, {"load_mass": load_mass, "coulomb_friction@cart.level": friction})
        initial = jnp.concatenate([start, jnp.zeros(3, start.dtype)])
        given = jnp.asarray(table, start.dtype)
        if mode == "open":
            return jbridge.play(plant, initial, given, period=period, substeps=substeps, collect=Last())
        still = jnp.zeros(len(table), start.dtype)
        reference = jbridge.Reference(given[:, 0], given[:, 1], still, still)
        return jbridge.closed_loop(plant, law, initial, reference, period=period, substeps=substeps, collect=Last())

    return jax.jit(jax.vmap(one))


def measure(program: Path, model: "jbridge.Model", mode: str, precision: str, lanes: int, folder: Path) -> dict:
    """Both programs on one problem: first compared, then timed one after the other."""
    given = problem(mode, lanes, SECONDS)
    rows, starts, table = given
    # The engine's last sample is at the beginning of the last period, so there the positions are compared.
    theirs = reference(program, mode, precision, given, folder, short=1)
    numbers = [np.asarray(a, precision) for a in (rows[:, 1], rows[:, 9], starts)]
    double = precision == "float64"
    with jax.enable_x64(double):
        run = engine(mode, table, model)
        threads = os.cpu_count() or 1
        # On a core, as many bridges abreast as its cache holds; on another device, all of them.
        pieces = -(-lanes // ABREAST) if jax.devices()[0].platform == "cpu" else 1
        parts = list(zip(*(map(jnp.asarray, np.array_split(a, pieces)) for a in numbers), strict=True))
        begun = time.perf_counter()
        jax.block_until_ready(run(*parts[0]))
        compiling = time.perf_counter() - begun
        best = np.inf

        def one(part: tuple) -> jax.Array:
            with jax.enable_x64(double):  # holds for one thread
                return jax.block_until_ready(run(*part))

        with ThreadPoolExecutor(threads) as pool:
            for _ in range(5):
                begun = time.perf_counter()
                final = list(pool.map(one, parts))
                best = min(best, time.perf_counter() - begun)
    difference = float(np.abs(np.concatenate([np.asarray(f) for f in final]) - theirs["final"]).max())
    if not difference < AGREE[precision]:
        raise SystemExit(f"{mode} {precision}: the engines differ by {difference:.2g}; nothing is timed")
    steps = lanes * len(table) * MODES[mode][1]
    again = reference(program, mode, precision, given, folder)
    fastest = max(theirs["steps_per_second"], again["steps_per_second"])
    return {
        "mode": mode, "precision": precision, "lanes": lanes, "jbridge": steps / best, "cpp": fastest,
        "ratio": steps / best / fastest, "first_call": compiling, "difference": difference, "gflops": again["gflops"],
        "vector_bytes": again["vector_bytes"], "threads": again["threads"],
    }  # fmt: skip


def draw(saved: dict) -> None:
    """Throughput against batch, as a picture and a table."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained", sharey=True)
    for panel, mode in zip(panels, MODES, strict=True):
        for precision, style in (("float64", "-"), ("float32", "--")):
            rows = [r for r in saved["rows"] if (r["mode"], r["precision"]) == (mode, precision)]
            for name, colour in (("jbridge", "#0a6ebd"), ("cpp", "#dd6a00")):
                said = f"{'C++' if name == 'cpp' else name}, {precision}"
                rates = [row[name] for row in rows]
                panel.loglog([row["lanes"] for row in rows], rates, style, color=colour, marker="o", ms=3, label=said)
        panel.set_title(f"{mode} loop", loc="left", fontsize=11, fontweight="bold")
        panel.set_xlabel("bridges in a batch")
        panel.grid(color="#e6e6e6")
    panels[0].set_ylabel("steps of one bridge per second")
    panels[0].legend(frameon=False, fontsize=9)
    figure.savefig(ROOT / "figures" / "throughput.png", dpi=130, metadata={"Software": None})
    lines = [
        "# Throughput", "",
        f"Steps of one bridge per second over the whole batch (RK4), {saved['cores']} cores, {saved['processor']}.",
        "C++: the same by hand (`experiments/throughput/reference.cpp`). Redrawn by",
        "`python experiments/throughput/throughput.py --figures`; do not edit.", "",
        "| loop | precision | bridges | jbridge [M/s] | C++ [M/s] | ratio | first call [s] |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for r in saved["rows"]:
        rates = f"{r['jbridge'] / 1e6:.3g} | {r['cpp'] / 1e6:.3g} | {r['ratio']:.2f}"
        lines.append(f"| {r['mode']} | {r['precision']} | {r['lanes']} | {rates} | {r['first_call']:.1f} |")
    (ROOT / "figures" / "throughput-table.md").write_text("\n".join(lines) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one batch of each sort, nothing saved")
    parser.add_argument("--figures", action="store_true", help="redraw from saved data and stop")
    chosen = parser.parse_args()
    if chosen.figures:
        draw(json.loads(DATA.read_text()))
        return
    jbridge.set_up(cache=False, whole_loops=True)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = build(folder)
        (folder / "model.toml").write_text(
            "[bridge]\n" + "".join(f"{key} = {value}\n" for key, value in MODEL.items()) + TOML.format(**EFFECTS)
        )
        model = jbridge.load_model(folder / "model.toml")
        for mode in MODES:
            for precision in ("float64", "float32"):
                for lanes in (256,) if chosen.quick else BATCHES:
                    row = measure(program, model, mode, precision, lanes, folder)
                    rows.append(row)
                    rates = f"jbridge {row['jbridge'] / 1e6:8.3f} M/s, C++ {row['cpp'] / 1e6:8.3f} M/s"
                    print(f"{mode:6} {precision} {lanes:6}: {rates}, ratio {row['ratio']:.2f}", flush=True)
    if not chosen.quick:
        saved = {"cores": os.cpu_count(), "processor": platform.processor() or platform.machine(), "rows": rows}
        DATA.write_text(json.dumps(saved, indent=1) + "\n")
        draw(saved)


if __name__ == "__main__":
    main()
