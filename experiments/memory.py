"""How much memory does each command take, and for how long? Its peak, as the system counts it.

    python experiments/memory.py               a quarter of an hour
    python experiments/memory.py --figures     the table from the kept numbers

Commands run on the recordings of the demo, and those that read recordings on one of ten minutes at 1 kHz as well.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import jbridge  # noqa: E402

KEPT = ROOT / "figures" / "data" / "memory.json"
TABLE = ROOT / "figures" / "memory-table.md"
DEMO = ROOT / "jbridge" / "demo_data"
RUNS = [str(DEMO / f"train-{k}.csv") for k in (1, 2, 3)]
SECONDS, RATE = 600, 1000
BRIDGE = """
[bridge]
cart_mass = 5.5
load_mass = 0.143
winch_mass = 0.1
gravity = 9.81
cart_damping = 45.0
swing_damping = 0.0015
hoist_damping = 25.0
cart_gain = 16.0
hoist_gain = 3.0
"""
SWEEP = """
model = "bridge.toml"
[reference]
start = [0.3, 0.4]
goal = [0.7, 0.6]
[sample]
kind = "sobol"
count = 16384
seed = 1
[[vary]]
name = "cart_damping"
low = 20.0
high = 60.0
"""


def commands(folder: Path) -> dict[str, list[str]]:
    """Words of each command, by what the table says of it."""
    model, bridge, long = (str(folder / name) for name in ("model.toml", "bridge.toml", "long.csv"))
    out = ["--out", str(folder / "out")]
    holdout = ["--holdout", str(DEMO / "holdout-1.csv")]
    return {
        "check": ["check", model, *RUNS],
        "fit": ["fit", model, *RUNS, *out],
        "simulate": ["simulate", model, "--input", RUNS[0], "--out", str(folder / "simulated.csv")],
        "diagnose": ["diagnose", model, *RUNS, *holdout, *out],
        "control": ["control", bridge, *out],
        "tune, 16 bridges, 20 steps": ["tune", bridge, "--plants", "16", "--steps", "20", "--starts", "1", *out],
        "sweep, 16,384 rollouts": [
            "sweep",
            str(folder / "sweep.toml"),
            "--workers",
            "0",
            "--out",
            str(folder / "sweep"),
        ],
        "export, a model in C": ["export", bridge, "--to", "c", *out],
        "check, 10 min at 1 kHz": ["check", model, long],
        "fit, 10 min at 1 kHz": ["fit", model, long, *out],
        "simulate, 10 min at 1 kHz": ["simulate", model, "--input", long, "--out", str(folder / "simulated-long.csv")],
        "diagnose, 10 min at 1 kHz, a search of 60 s": ["diagnose", model, long, "--budget", "60", *out],
    }


def prepare(folder: Path) -> None:
    """The demo's model, a bridge, a sweep of it, and a long recording of the demo's rig with dry friction."""
    text = (DEMO / "model.toml").read_text()
    (folder / "model.toml").write_text(text)
    (folder / "bridge.toml").write_text(BRIDGE)
    (folder / "sweep.toml").write_text(SWEEP)
    law = '\n[[effect]]\nkind = "coulomb_friction"\nsite = "cart"\nlevel = 3.0\n'
    (folder / "rig.toml").write_text(text + law)
    rng = np.random.default_rng(0)
    t = np.arange(SECONDS * RATE) / RATE
    # As far forth as back, so that the cart stays on its rail.
    volts = np.repeat(np.outer(rng.uniform(0.8, 2.5, SECONDS // 2), [1.0, -1.0]).ravel(), RATE)
    still, sidecar = np.zeros_like(t), {"locked": {"l": 0.6}}
    jbridge.set_up(True)
    bare = jbridge.Recording.from_arrays(t=t, u_x=volts, x=still, psi=still, sidecar=sidecar)
    played = jbridge.simulate(jbridge.load_model(folder / "rig.toml"), bare, initial="first-row")
    noise = 3e-5 * rng.standard_normal((2, len(t)))
    columns = {"t": t, "u_x": volts, "x": played["x"] + noise[0], "psi": played["psi"] + noise[1]}
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(folder / "long.csv", rows, "%.6f", ",", header=",".join(columns), comments="")
    (folder / "long.toml").write_text("[locked]\nl = 0.6\n")


def measured(words: list[str]) -> dict[str, float]:
    """Seconds, peak memory [GB] and status of a command."""
    begun = time.monotonic()
    process = subprocess.Popen([sys.executable, "-m", "jbridge", *words, "--quiet"], cwd=ROOT)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return {
        "status": process.returncode,
        "seconds": round(time.monotonic() - begun, 1),
        "gigabytes": round(used.ru_maxrss / 2**20, 2),
    }


def table(rows: dict[str, dict[str, float]]) -> str:
    lines = [
        "# Memory",
        "",
        "Peak of resident memory, on the demo's recordings (3 of 14 s) unless said; on two cores,",
        "beside other work, so that seconds are upper bounds. Redrawn by",
        "`python experiments/memory.py --figures`; do not edit.",
        "",
        "| command | GB | s |",
        "|---|---|---|",
    ]
    for name, row in ((name, rows[name]) for name in commands(Path()) if name in rows):
        command, _, said = name.partition(",")
        lines.append(f"| `{command}`{said and f',{said}'} | {row['gigabytes']:.2f} | {row['seconds']:.0f} |")
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="beginnings of rows, such as fit (default: all)")
    parser.add_argument("--figures", action="store_true", help="only redraw")
    arguments = parser.parse_args()
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
    if not arguments.figures:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            prepare(folder)
            for label, words in commands(folder).items():
                if arguments.names and not label.startswith(tuple(arguments.names)):
                    continue
                row = measured(words)
                print(f"{label}: {row['gigabytes']} GB, {row['seconds']} s, status {row['status']}", flush=True)
                if row["status"] == 0:
                    kept[label] = row
        KEPT.write_text(json.dumps(kept, indent=1) + "\n")
    TABLE.write_text(table(kept), encoding="utf-8")


if __name__ == "__main__":
    main()
