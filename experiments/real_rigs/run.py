"""Diagnoses recordings of rigs that nobody in this project built, read in place, and draws one table of them.

    python experiments/real_rigs/run.py                       # all, an hour
    python experiments/real_rigs/run.py emps "repeated crane" # some
    python experiments/real_rigs/run.py --figures             # table and picture from the kept numbers

Each diagnosis has a process of its own. A new result replaces the kept one of the same name.
"""

import argparse
import json
import multiprocessing
import os
import resource
import sys
import time
import tomllib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(ROOT))

import jbridge  # noqa: E402
from experiments.version import commit  # noqa: E402

SHARED = Path(os.environ.get("JBRIDGE_RECORDINGS", ROOT.parent / "shared"))
"""The folder that holds `recordings` and `faults`."""
KEPT = ROOT / "figures" / "data" / "real-rigs.json"
PIECE = str | dict[str, Any]


def rigs() -> dict[str, dict[str, Any]]:
    """What is diagnosed, by name."""
    return tomllib.loads((HERE / "rigs.toml").read_text(encoding="utf-8"))


def model_file(rig: dict[str, Any]) -> Path:
    """Ours, or the one beside the recordings."""
    folder = HERE / Path(rig["folder"]).name
    return (folder if folder.is_dir() else SHARED / rig["folder"]) / rig.get("model", "model.toml")


def load(rig: dict[str, Any], piece: PIECE) -> jbridge.Recording:
    """A recording or a piece of one."""
    cut: dict[str, Any] = {"file": piece} if isinstance(piece, str) else piece
    sidecar = HERE / Path(rig["folder"]).name / "recordings.toml"
    path = SHARED / rig["folder"] / cut["file"]
    recording = jbridge.load_recording(path, sidecar=sidecar if sidecar.is_file() else None)
    span = np.searchsorted(recording.times - recording.start, [cut.get("start", 0.0), cut.get("stop", np.inf)])
    return recording.rows(slice(int(span[0]), int(span[1])))


def diagnosed(name: str, budget: float, out: Path) -> dict[str, Any]:
    """One row of the table; its report lies below `out`."""
    rig = rigs()[name]
    jbridge.set_up(True)
    begun = time.perf_counter()
    found = jbridge.diagnose(
        jbridge.load_model(model_file(rig)),
        [load(rig, piece) for piece in rig["train"]],
        [load(rig, piece) for piece in rig.get("holdout", ())],
        budget=budget,
    )
    seconds = time.perf_counter() - begun
    folder = out / name.replace(" ", "-").replace(",", "")
    jbridge.save_report(folder, found)
    print(jbridge.describe_diagnosis(found, folder), flush=True)
    report = json.loads((folder / "report.json").read_text())
    code = {"code": commit()}
    keys = ("verdict", "complete", "explained", "stopped", "statement", "effects", "bridge", "fit")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {"seconds": round(seconds), "gigabytes": round(peak, 2), **code, **{key: report[key] for key in keys}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="rigs (default: all)")
    parser.add_argument("--budget", type=float, default=300.0, help="seconds for each (default: %(default)g)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "real-rigs", help="where reports go")
    parser.add_argument("--kept", type=Path, default=KEPT, help="where numbers are kept")
    parser.add_argument("--figures", action="store_true", help="only redraw")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.names) - set(rigs()))
    if unknown:
        parser.error(f"no rig is called {', '.join(unknown)}; there are {', '.join(rigs())}")
    if not arguments.figures:
        if not SHARED.is_dir():
            print(f"skipped: the recordings are not at {SHARED}; JBRIDGE_RECORDINGS names another folder")
            return
        for name in arguments.names or rigs():
            # A process of its own tells its memory, and leaves none behind.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
                row = alone.submit(diagnosed, name, arguments.budget, arguments.out).result()
            kept = json.loads(arguments.kept.read_text()) if arguments.kept.is_file() else {}
            arguments.kept.parent.mkdir(parents=True, exist_ok=True)
            arguments.kept.write_text(json.dumps(kept | {name: row}, indent=1) + "\n")
    if arguments.kept == KEPT:
        from experiments.real_rigs.figures import draw

        draw(json.loads(KEPT.read_text()), rigs(), ROOT / "figures")


if __name__ == "__main__":
    main()
