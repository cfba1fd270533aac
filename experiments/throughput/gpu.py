"""How fast is the engine on a graphics processor, and how far from a processor's results?

    python experiments/throughput/gpu.py             a few minutes, on a machine with one
    python experiments/throughput/gpu.py --figures   redraw the table from figures/data/throughput-gpu.json

Batches, steps and rates are those of throughput.py; both devices of a machine run one after the other.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jbridge
import ours
from problem import MODES, batch, load_model

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "figures" / "data" / "throughput-gpu.json"
TABLE = ROOT / "figures" / "throughput-gpu.md"
BATCHES = (1024, 16384, 1048576)
ON_CPU = 2
"""Batches that the processor runs, too; its rate no longer grows with larger ones."""
SECONDS = 1.0


def rate(mode: str, precision: str, lanes: int, model: Any) -> tuple[float, float, np.ndarray]:
    """Steps of one bridge per second, seconds of the first call, and final positions."""
    given = batch(mode, lanes, SECONDS)
    with ours.precise(precision):
        run = ours.forward(mode, given, model, precision)
    first, best, final = ours.timed(run, ours.lanes_of(given, precision), precision)
    return lanes * len(given.table) * MODES[mode][1] / best, first, final


def measure(gpu: bool, folder: Path) -> None:
    """Rates of one device, as a line each, and final positions to a folder."""
    jbridge.set_up(cache=False, gpu=gpu)
    model = load_model(folder)
    for mode in MODES:
        for precision in ("float64", "float32"):
            for lanes in BATCHES if gpu else BATCHES[:ON_CPU]:
                found, first, final = rate(mode, precision, lanes, model)
                place = folder / f"{mode}-{precision}-{lanes}.npy"
                row = {"mode": mode, "precision": precision, "lanes": lanes, "rate": found, "first_call": first}
                if place.exists():
                    row["difference"] = float(np.abs(np.load(place) - final).max())
                np.save(place, final)
                print(json.dumps(row | {"device": jax.devices()[0].device_kind}), flush=True)


def measured() -> dict[str, Any]:
    """Both devices, each in a process of its own, since a program is written for one."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        for device in ("cpu", "gpu"):
            command = [sys.executable, __file__, "--device", device, "--folder", name]
            told = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
            print(told, end="", flush=True)
            rows.append([json.loads(line) for line in told.splitlines()])
    cpu = {(r["mode"], r["precision"], r["lanes"]): r["rate"] for r in rows[0]}
    own = [r | {"gpu": r["rate"], "cpu": cpu.get((r["mode"], r["precision"], r["lanes"]))} for r in rows[1]]
    return {"gpu": rows[1][0]["device"], "cores": os.cpu_count(), "seconds": SECONDS, "rows": own}


def table(saved: dict[str, Any]) -> str:
    """The numbers as a page."""
    lines = [
        "# Throughput on a graphics processor", "",
        f"Steps of one bridge per second over the whole batch (RK4, {saved['seconds']:g} s simulated) on one",
        f"{saved['gpu']} and on {saved['cores']} cores beside it, and the largest difference of final positions",
        "[m, rad]. Redrawn by `python experiments/throughput/gpu.py --figures`; do not edit.", "",
        "| loop | precision | bridges | GPU [M/s] | processor [M/s] | ratio | difference | first call [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    best = {(r["mode"], r["precision"]): 0.0 for r in saved["rows"]}
    for r in saved["rows"]:
        kind = (r["mode"], r["precision"])
        best[kind] = max(best[kind], r["cpu"] or 0.0)
    for r in saved["rows"]:
        kind = (r["mode"], r["precision"])
        cpu = f"{r['cpu'] / 1e6:.3g}" if r["cpu"] else f"({best[kind] / 1e6:.3g}, its best)"
        ratio = r["gpu"] / (r["cpu"] or best[kind])
        difference = f"{r['difference']:.1g}" if "difference" in r else ""
        lines.append(
            f"| {r['mode']} | {r['precision']} | {r['lanes']} | {r['gpu'] / 1e6:.3g} | {cpu} | {ratio:.3g} | "
            f"{difference} | {r['first_call']:.1f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", action="store_true", help="redraw from saved data and stop")
    parser.add_argument("--out", type=Path, default=DATA, help="where the numbers go (default: %(default)s)")
    parser.add_argument("--device", choices=("cpu", "gpu"), help="measure one, as the command does itself")
    parser.add_argument("--folder", type=Path, help="for its final positions")
    chosen = parser.parse_args()
    if chosen.figures:
        TABLE.write_text(table(json.loads(DATA.read_text())))
        return
    if chosen.device:
        measure(chosen.device == "gpu", chosen.folder)
        return
    if not any(device.platform == "gpu" for device in jax.devices()):
        raise SystemExit("JAX sees no graphics processor; install jax[cuda13] or what fits yours")
    chosen.out.write_text(json.dumps(measured(), indent=1) + "\n")
    TABLE.write_text(table(json.loads(chosen.out.read_text())))


if __name__ == "__main__":
    main()
