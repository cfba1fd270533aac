"""How fast is the engine? The same bridges, steps and controllers in jbridge and in other engines.

    python experiments/throughput/throughput.py             all of it: a quarter of an hour on two idle cores
    python experiments/throughput/throughput.py --quick     one batch of each sort, to see that it runs
    python experiments/throughput/throughput.py --figures   redraw from figures/data/throughput.json

The C++ (reference.cpp) is compiled here with g++ -O3 -march=native -fopenmp. Final positions of all engines are
compared before anything is told. A rate counts integration steps of one bridge over the whole batch; compile time is
told apart. Ratios are of runs that follow each other, since the machine may be shared.
"""

import argparse
import json
import os
import platform
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import cpp
import draw
import engines
import fresh
import jbridge
import ours
from problem import MODES, bare, batch, load_model

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "figures" / "data" / "throughput.json"
BATCHES = (1, 16, 256, 1024, 4096, 16384, 65536)
HORIZONS = (1.0, 5.0, 15.0, 60.0)
SECONDS = 2.0
"""Simulated time of a run, where nothing else is said."""
AGREE = {"float64": 1e-9, "float32": 2e-3}
"""Largest difference of final positions from the C++ [m, rad]."""
RIVALS = {
    "mujoco": (engines.mujoco_batch, 256),
    "diffrax": (engines.diffrax_batch, 256),
    "scipy": (engines.scipy_batch, 4),
}
"""Another engine, and how many lanes it is given."""


def agreed(name: str, ours_: np.ndarray, theirs: np.ndarray, limit: float) -> float:
    """The largest difference.

    Raises:
        SystemExit: it is too large.
    """
    difference = float(np.abs(ours_ - theirs).max())
    if not difference < limit:
        raise SystemExit(f"{name}: the engines differ by {difference:.2g}, more than {limit:g}; nothing is told")
    return difference


def against_cpp(program: Path, model: Any, mode: str, precision: str, lanes: int, seconds: float) -> dict[str, Any]:
    """Both programs on one problem: first compared, then timed one after the other."""
    given = batch(mode, lanes, seconds)
    # The engine's last sample is at the beginning of the last period, so there the positions are compared.
    theirs = cpp.reference(program, mode, precision, given, short=1, repeats=1)
    with ours.precise(precision):
        run = ours.forward(mode, given, model, precision)
    first, best, final = ours.timed(run, ours.lanes_of(given, precision), precision)
    difference = agreed(f"{mode} {precision}", final, theirs["final"], AGREE[precision] * max(1.0, seconds))
    again = cpp.reference(program, mode, precision, given)
    rate = lanes * len(given.table) * MODES[mode][1] / best
    return {
        "mode": mode, "precision": precision, "lanes": lanes, "seconds": seconds, "jbridge": rate,
        "cpp": again["steps_per_second"], "ratio": rate / again["steps_per_second"], "first_call": first,
        "difference": difference, "gflops": again["gflops"], "vector_bytes": again["vector_bytes"],
        "threads": again["threads"],
    }  # fmt: skip


def against_rivals(seconds: float) -> list[dict[str, Any]]:
    """Bare bridges in jbridge and in another engine; a rate of SciPy counts steps of the others' length."""
    rows: list[dict[str, Any]] = []

    def compare(name: str, lanes: int, span: float, given: Any, run: Callable[[], np.ndarray]) -> dict[str, Any]:
        _, best, final = ours.timed(ours.bare_forward(given), [given.starts], "float64")
        difference = agreed(name, final, run(), engines.AGREE[name] * max(1.0, span / SECONDS))
        steps = lanes * len(given.forces)
        row = {
            "name": name, "lanes": lanes, "seconds": span, "jbridge": steps / best,
            "rate": steps / fresh.best_of(run), "difference": difference,
        }  # fmt: skip
        rows.append(row)
        return row

    for name, (engine, lanes) in RIVALS.items():
        given = bare(lanes, seconds)
        try:
            compare(name, lanes, seconds, given, engine(given))
        except ImportError:
            rows.append({"name": name, "lanes": lanes, "missing": True})
    given = bare(256, seconds, free_hoist=True)
    try:
        run, gradient = engines.torch_crane(given)
    except ImportError:
        rows.append({"name": "torch-fis", "lanes": 256, "missing": True})
    else:
        compare("torch-fis", 256, seconds, given, run)["gradient"] = fresh.best_of(gradient)
        rows[-1]["jbridge gradient"] = fresh.best_of(ours.bare_gradient(given))
    return rows


def softened(model: Any, lanes: int) -> dict[str, float]:
    """Seconds of the same closed loops with the textbook's inference and with the smooth one."""
    given = batch("closed", lanes, SECONDS)
    numbers = ours.lanes_of(given, "float64")
    found = {}
    for name, softness in (("hard", None), ("smooth", fresh.SOFTNESS)):
        found[name] = ours.timed(ours.forward("closed", given, model, "float64", softness), numbers, "float64")[1]
    return found


def few(seconds: str) -> dict[str, float]:
    """A handful of bridges, and the time of another engine as it comes, without the compiler's options of ours."""
    return fresh.ask("few", seconds) | {"plain": fresh.ask("plain", seconds)["diffrax"]}


def measured(quick: bool) -> dict[str, Any]:
    """All numbers."""
    saved: dict[str, Any] = {
        "cores": os.cpu_count(), "processor": platform.processor() or platform.machine(), "quick": quick
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        program, model = cpp.build(Path(name)), load_model(Path(name))
        for key, cases in (
            ("rows", [(p, n, SECONDS) for p in AGREE for n in ((256,) if quick else BATCHES)]),
            ("horizon", [("float64", 64 if quick else 1024, s) for s in (HORIZONS[:1] if quick else HORIZONS)]),
        ):
            saved[key] = []
            for mode in MODES:
                for precision, lanes, seconds in cases:
                    row = against_cpp(program, model, mode, precision, lanes, seconds)
                    saved[key].append(row)
                    rates = f"jbridge {row['jbridge'] / 1e6:8.3f} M/s, C++ {row['cpp'] / 1e6:8.3f} M/s"
                    print(
                        f"{mode:6} {precision} {lanes:6} x {seconds:2g} s: {rates}, ratio {row['ratio']:.2f}",
                        flush=True,
                    )
        for key, part in (
            ("rivals", lambda: against_rivals(0.4 if quick else SECONDS)),
            ("smooth", lambda: softened(model, 256 if quick else 4096)),
            ("gradient", lambda: fresh.ask("gradient", *(("64", "0.4") if quick else ("1024", str(SECONDS))))),
            ("few", lambda: few("1.6" if quick else "16")),
            ("compile", lambda: fresh.ask("compile")),
            ("memory", lambda: {str(s): fresh.ask("memory", str(s)) for s in ((1.0, 4.0) if quick else (1.0, 60.0))}),
        ):
            saved[key] = part()
            if key == "few":
                agreed("diffrax", np.array(saved[key]["difference"]), np.zeros(()), 8 * engines.AGREE["diffrax"])
            print(f"{key}: {json.dumps(saved[key])}", flush=True)
    return saved


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one batch of each sort, nothing saved")
    parser.add_argument("--figures", action="store_true", help="redraw from saved data and stop")
    chosen = parser.parse_args()
    if chosen.figures:
        draw.everything(json.loads(DATA.read_text()), ROOT / "figures")
        return
    jbridge.set_up(cache=False)
    saved = measured(chosen.quick)
    if chosen.quick:
        print("\n".join(draw.aims(saved)))
    else:
        DATA.write_text(json.dumps(saved, indent=1) + "\n")
        draw.everything(saved, ROOT / "figures")


if __name__ == "__main__":
    main()
