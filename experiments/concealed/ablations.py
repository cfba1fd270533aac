"""What is each part of the method worth? The same concealed cases, diagnosed without it.

    python experiments/concealed/ablations.py                    everything, resuming what is finished
    python experiments/concealed/ablations.py --part seeds

`rescreening`: after an acceptance the ranking of the first screen stands; asked where two or three effects are missing.
`seeds`: every effect starts from one place; asked where one effect is missing (of these every second case).
`bootstrap`: Ljung's and Box's limit in place of drawn signs; asked where nothing is missing.
Every case is diagnosed with everything, too, by the same code; pairs of which one is of other code are left out of the
table, and run again here. Rows go to figures/data/concealed-ablations.json.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import jbridge
from figures import draw
from play import write
from run import FIGURES, ROOT, commit, mean_length, recordings
from score import score
from seal import SEALS, open_truths

DATA = FIGURES / "data" / "concealed-ablations.json"
NOTHING = "nothing"
WANTED = {
    "rescreening": (("dev", "proof"), lambda truth: len(truth["concealed"]) > 1, 1),
    "seeds": (("dev",), lambda truth: len(truth["concealed"]) == 1 and truth["verdict"] == "missing_physics", 2),
    "bootstrap": (("dev",), lambda truth: not truth["concealed"], 1),
}
"""Of each part: in which halves, of which truths, and of these one in how many."""


def diagnose(case: Path, part: str, out: Path) -> None:
    """A diagnosis without a part, saved."""
    jbridge.set_up()
    model = jbridge.load_model(case / "model.toml")
    train, holdout = (jbridge.load_recordings(recordings(case, role)) for role in ("train", "holdout"))
    found = jbridge.diagnose(model, train, holdout, leave_out=() if part == NOTHING else (part,))
    jbridge.save_report(out, found)


def asked(part: str, truths: dict[str, dict]) -> list[str]:
    """The cases of a part."""
    halves, fits, every = WANTED[part]
    return [
        name
        for half in halves
        for name in sorted(n for n, t in truths.items() if t["half"] == half and fits(t))[::every]
    ]


def row_of(truth: dict, case: Path, part: str, timeout: float) -> dict:
    """The score of one diagnosis, in a process of its own as an owner's would be."""
    out = case / f"without-{part}"
    command = [sys.executable, __file__, "--one", case, part, out]
    code, start = commit(), time.monotonic()
    with open(case / f"without-{part}.txt", "w") as log:
        try:
            status = subprocess.run(command, stdout=log, stderr=log, timeout=timeout).returncode
        except subprocess.TimeoutExpired:
            status = -1
    seconds = round(time.monotonic() - start, 2)
    report = json.loads((out / "report.json").read_text()) if status == 0 else None
    row = score(truth, report, mean_length(case)) | {"wall": seconds, "status": status, "code": code}
    return row | {"without": part, "p_value": report["adequacy"]["p_value"] if report else None}


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", choices=sorted(WANTED), nargs="+", default=list(WANTED), help="only without these")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "ablations", help="where recordings and reports go")
    parser.add_argument(
        "--timeout", type=float, default=1800.0, help="seconds after which a diagnosis counts as failed"
    )
    parser.add_argument("--one", nargs=3, metavar=("CASE", "PART", "DIR"), help=argparse.SUPPRESS)
    return parser.parse_args()


def main() -> None:
    chosen = options()
    if chosen.one:
        case, part, out = chosen.one
        diagnose(Path(case), part, Path(out))
        return
    halves = sorted({half for halves, _, _ in WANTED.values() for half in halves})
    truths = {name: t for half in halves for name, t in open_truths(half).items()}
    code = commit()
    seals = json.loads(SEALS.read_text())
    rows = json.loads(DATA.read_text())["rows"] if DATA.exists() else []
    for part in chosen.part:
        for name in asked(part, truths):
            for without in (NOTHING, part):
                done = [row for row in rows if (row["id"], row["without"]) == (name, without) and row["code"] == code]
                if any(row["status"] == 0 for row in done):
                    continue
                case = write(truths[name], chosen.out.resolve(), seals[truths[name]["half"]][name])
                row = row_of(truths[name], case, without, chosen.timeout)
                rows = [old for old in rows if (old["id"], old["without"]) != (name, without)] + [row]
                print(
                    f"{name} without {without}: {row['verdict']}, {', '.join(row['named']) or 'nothing named'}",
                    flush=True,
                )
                DATA.write_text(
                    json.dumps({"rows": sorted(rows, key=lambda r: (r["id"], r["without"]))}, indent=1) + "\n"
                )
    draw(FIGURES)


if __name__ == "__main__":
    main()
