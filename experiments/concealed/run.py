"""Does `jbridge diagnose` find what it was not told? Plays sealed cases, diagnoses, opens, scores.

    python experiments/concealed/run.py --half dev                 everything, resuming what is finished
    python experiments/concealed/run.py --half proof --jobs 2
    python experiments/concealed/run.py --half wide --limit 40       the first 40 of a shuffled 160
    python experiments/concealed/run.py --half dev --generate-only   only the recordings
    python experiments/concealed/run.py --half fresh --again-beside   by today's version, its rows apart
    python experiments/concealed/run.py --half rough --present       by today's version, its rows in a list of their own
    python experiments/concealed/run.py --figures                    redraw from figures/data

Per case, below OUT/CASE: `model.toml`, `recordings/`, `diagnosis/` with the tool's own files and `run.json`
(exit status and seconds). A case is diagnosed once, unless it failed; `--again` forgets finished diagnoses.
Rows go to figures/data/concealed-HALF.json. What `fresh` found first stays: `--again-beside` writes `fresh-again`.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from cases import HERE, MASTER
from figures import draw
from play import write
from score import score
from seal import SEALS, open_truths
from tables import AGAIN, PRESENT

ROOT = HERE.parent.parent
sys.path.append(str(ROOT))
from experiments.version import commit  # noqa: E402

FIGURES = ROOT / "figures"


def recordings(case: Path, role: str) -> list[Path]:
    """A case's recordings of one role, "train" or "holdout"."""
    return sorted((case / "recordings").glob(f"{role}-*.csv"))


def diagnose(case: Path, timeout: float) -> str:
    """Runs the tool on a case from the command line, as an owner would; returns a word on how it went."""
    out = case / "diagnosis"
    done = out / "run.json"
    if done.exists() and json.loads(done.read_text())["status"] == 0:
        return "kept"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command = [sys.executable, "-m", "jbridge", "diagnose", case / "model.toml", *recordings(case, "train")]
    command += ["--holdout", *recordings(case, "holdout"), "--out", out]
    code, start = commit(), time.monotonic()
    with open(out / "log.txt", "w") as log:
        try:
            status = subprocess.run(command, cwd=ROOT, stdout=log, stderr=log, timeout=timeout).returncode
        except subprocess.TimeoutExpired:
            status = -1
    seconds = time.monotonic() - start
    done.write_text(json.dumps({"status": status, "seconds": round(seconds, 2), "code": code}) + "\n")
    return f"{seconds:.0f} s" if status == 0 else f"failed with status {status}, see {out / 'log.txt'}"


def mean_length(case: Path) -> float | None:
    """Mean rope length of the training recordings [m], None without an `l` column."""
    paths = recordings(case, "train")
    with paths[0].open() as file:
        names = file.readline().strip().split(",")
    if "l" not in names:
        return None
    columns = [np.loadtxt(p, delimiter=",", skiprows=1, usecols=names.index("l")) for p in paths]
    return float(np.mean(np.concatenate(columns)))


def row_of(truth: dict, case: Path) -> dict | None:
    """The score of a diagnosed case, None where it has not run."""
    done = case / "diagnosis" / "run.json"
    if not done.exists():
        return None
    run = json.loads(done.read_text())
    report = case / "diagnosis" / "report.json"
    content = json.loads(report.read_text()) if run["status"] == 0 and report.exists() else None
    told = {"wall": run["seconds"], "status": run["status"], "code": run.get("code")}
    return score(truth, content, mean_length(case)) | told


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=sorted(MASTER), help="which part of the cases")
    parser.add_argument("--out", type=Path, help="where recordings and reports go (out/concealed)")
    parser.add_argument("--cases", nargs="+", metavar="ID", help="only these")
    parser.add_argument("--limit", type=int, help="only the first so many")
    parser.add_argument("--again-beside", action="store_true", help=f"of fresh: rows and reports of their own, {AGAIN}")
    parser.add_argument("--present", action="store_true", help=f"rows apart, in {PRESENT}: those of today's version")
    parser.add_argument("--jobs", type=int, default=1, help="diagnoses at a time")
    parser.add_argument(
        "--timeout", type=float, default=1800.0, help="seconds after which a diagnosis counts as failed"
    )
    parser.add_argument("--generate-only", action="store_true", help="write the recordings and stop")
    parser.add_argument("--again", action="store_true", help="forget finished diagnoses of the chosen cases")
    parser.add_argument("--score-only", action="store_true", help="score what is finished, diagnose nothing")
    parser.add_argument("--figures", action="store_true", help="redraw table and picture from saved data and stop")
    chosen = parser.parse_args()
    if not chosen.figures and not chosen.half:
        parser.error(f"--half is needed: {', '.join(MASTER)}")
    if chosen.again_beside and chosen.half != "fresh":
        parser.error("--again-beside is for --half fresh")
    if chosen.out is None:
        chosen.out = ROOT / "out" / ("concealed-again" if chosen.again_beside else "concealed")
    return chosen


def main() -> None:
    chosen = options()
    if chosen.figures:
        draw(FIGURES)
        return
    truths = open_truths(chosen.half)
    seals = json.loads(SEALS.read_text())[chosen.half]
    names = [n for n in sorted(truths) if not chosen.cases or n in chosen.cases][: chosen.limit]
    out = chosen.out.resolve()

    def one(name: str) -> None:
        if chosen.again:
            shutil.rmtree(out / name / "diagnosis", ignore_errors=True)
        try:
            case = write(truths[name], out, seals[name])
            word = "recordings" if chosen.generate_only else diagnose(case, chosen.timeout)
        except RuntimeError as error:
            word = f"not played: {error}"
        print(f"{name}: {word}", flush=True)

    if not chosen.score_only:
        with ThreadPoolExecutor(chosen.jobs) as pool:
            list(pool.map(one, names))
    if chosen.generate_only:
        return
    # Rows of all finished cases, not only of the chosen ones: the data file is the state of the whole half.
    rows = [row_of(truths[name], out / name) for name in sorted(truths) if (out / name / "recordings").exists()]
    rows = [row for row in rows if row]
    kept = PRESENT if chosen.present else AGAIN if chosen.again_beside else chosen.half
    data = FIGURES / "data" / f"concealed-{kept}.json"
    if data.exists():  # rows of cases whose reports are gone stay, each with the code that diagnosed it
        fresh = {row["id"] for row in rows}
        saved = json.loads(data.read_text())
        older = (row for row in saved["rows"] if row["id"] not in fresh)
        rows += [row | {"code": row.get("code") or saved["commit"]} for row in older]
        rows.sort(key=lambda row: row["id"])
    saved = {
        "half": chosen.half, "commit": commit(), "cores": os.cpu_count(), "cases": len(truths),
        "seed": MASTER[chosen.half],
        "rows": rows,
    }  # fmt: skip
    data.parent.mkdir(parents=True, exist_ok=True)
    data.write_text(json.dumps(saved, indent=1) + "\n")
    draw(FIGURES)


if __name__ == "__main__":
    main()
