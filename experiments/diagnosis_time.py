"""How long a diagnosis takes: six recordings of 16 s at 200 Hz of a whole bridge, every effect at every site tried.

    python experiments/diagnosis_time.py

One rig of the concealed proof's development half, by default with a late cart drive, is played six times for 16 s and
diagnosed from the command line twice: with no compiled programs kept, and again with those of the first time. Numbers
go to figures/data/diagnosis-time.json. Machines differ and are shared: the ratio says more than the seconds do.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(Path(__file__).parent / "concealed"))

from cases import cases  # noqa: E402
from play import write  # noqa: E402

STYLES = ("steps", "pulses", "ramps", "mixed", "staircase", "creep")
SECONDS = 16.0


def plan(truth: dict) -> dict:
    """The case with six recordings of 16 s to learn from, and its own hold-out."""
    train = [r for r in truth["recordings"] if r["name"].startswith("train")]
    six = []
    for i, style in enumerate(STYLES):
        like = train[i % len(train)]
        six.append(
            like | {"name": f"train-{i + 1}", "input": style, "seconds": SECONDS, "seed": like["seed"] + 100 * i}
        )
    return truth | {"recordings": six + [r for r in truth["recordings"] if r["name"].startswith("holdout")]}


def diagnose(case: Path, cache: Path) -> tuple[float, dict]:
    """Seconds that the command takes, and its report."""
    recordings = case / "recordings"
    command = [
        sys.executable,
        "-m",
        "jbridge",
        "diagnose",
        case / "model.toml",
        *sorted(recordings.glob("train-*.csv")),
    ]
    command += ["--holdout", *sorted(recordings.glob("holdout-*.csv")), "--out", case / "diagnosis"]
    begun = time.perf_counter()
    subprocess.run(
        command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, env=os.environ | {"XDG_CACHE_HOME": str(cache)}
    )
    return time.perf_counter() - begun, json.loads((case / "diagnosis" / "report.json").read_text())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", default="dev-10", help="whose rig (default: %(default)s)")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "figures" / "data" / "diagnosis-time.json", help="where numbers go"
    )
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        case = write(plan(cases("dev")[arguments.case]), Path(folder) / "cases")
        cold, report = diagnose(case, Path(folder) / "cache")
        warm, _ = diagnose(case, Path(folder) / "cache")
    found = [f"{e['kind']} {e['site']}" for e in report["effects"]]
    row = {
        "case": arguments.case, "recordings": len(STYLES), "seconds_each": SECONDS, "rate_hz": 200,
        "cores": os.cpu_count(), "cold_s": round(cold, 1), "warm_s": round(warm, 1),
        "cold_over_warm": round(cold / warm, 2), "verdict": report["verdict"], "effects": found,
    }  # fmt: skip
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(row, indent=1) + "\n")
    print(f"cold {cold:.0f} s, warm {warm:.0f} s, found {', '.join(found) or 'nothing'}; {arguments.out}")


if __name__ == "__main__":
    main()
