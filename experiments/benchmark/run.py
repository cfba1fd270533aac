"""Scores any tool on concealed cases: recordings in, report.json out. README.md beside it has the rules.

    python experiments/benchmark/run.py sindy "python experiments/benchmark/sindy.py"
    python experiments/benchmark/run.py jbridge "bash experiments/benchmark/jbridge.sh" --jobs 2
    python experiments/benchmark/run.py --figures        # the table of all entrants from the kept rows

The command is called with two folders: that of the case (model.toml, recordings/train-*.csv and holdout-*.csv with a
sidecar) and an empty one, into which it writes report.json. A command that takes longer than --timeout, or ends with
another status than 0, has given no answer. Cases that are finished are not run again.
"""

import argparse
import json
import shlex
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "experiments" / "concealed"))

from play import write  # noqa: E402
from run import mean_length  # noqa: E402
from score import score  # noqa: E402
from seal import SEALS, open_truths  # noqa: E402
from tables import groups, share  # noqa: E402

HALF = "dev"
KEPT = ROOT / "figures" / "data" / "benchmark.json"
TABLE = ROOT / "figures" / "benchmark-table.md"


def answered(command: str, case: Path, out: Path, timeout: float) -> dict:
    """Status and seconds of a tool on one case; its report lies in `out`."""
    done = out / "run.json"
    if done.exists():
        return json.loads(done.read_text())
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    begun = time.monotonic()
    with open(out / "log.txt", "w") as log:
        words = [*shlex.split(command), str(case), str(out)]
        try:
            status = subprocess.run(words, cwd=ROOT, stdout=log, stderr=log, timeout=timeout).returncode
        except subprocess.TimeoutExpired:
            status = -1
    told = {"status": status, "wall": round(time.monotonic() - begun, 2)}
    done.write_text(json.dumps(told) + "\n")
    return told


def scored(truth: dict, case: Path, out: Path, told: dict) -> dict:
    """A row of the benchmark."""
    report = out / "report.json"
    content = json.loads(report.read_text()) if told["status"] == 0 and report.exists() else None
    return score(truth, content, mean_length(case)) | told


def table(entrants: dict[str, list[dict]]) -> str:
    """The page in markdown."""
    names = list(entrants)
    measures = [
        ("false alarms where only numbers are wrong", "null", "detected"),
        ("right effect, or its declared equivalent, named first, one missing", "single", "first_right"),
        ("exact set, one missing", "single", "set_right"),
        ("exact set, two missing", "double", "set_right"),
        ("exact set, three missing", "triple", "set_right"),
        ("right equation, of all sizes", "concealed", "equation_right"),
    ]
    lines = [
        "# Benchmark",
        "",
        f"All {len(open_truths(HALF))} cases of the development part, whose truths are open. Shares come with counts",
        "and 95 % Wilson intervals.",
        "Redrawn by `python experiments/benchmark/run.py --figures`; do not edit.",
        "",
        f"| measure | {' | '.join(names)} |",
        "|---" * (1 + len(names)) + "|",
    ]
    grouped = {name: groups(rows) for name, rows in entrants.items()}
    for words, group, key in measures:
        cells = [share(grouped[name][group], key) for name in names]
        lines.append(f"| {words} | {' | '.join(cells)} |")
    verdicts = [share(rows, "verdict_right") for rows in entrants.values()]
    lines.append(f"| verdict right | {' | '.join(verdicts)} |")
    claims = [
        (sum(r["claims_right"] for r in rows), sum(len(r["claimed"]) for r in rows)) for rows in entrants.values()
    ]
    lines.append(f"| confirmed names that are true or equivalent | {' | '.join(f'{a} of {b}' for a, b in claims)} |")
    walls = [sorted(r["wall"] for r in rows) for rows in entrants.values()]
    lines.append(
        f"| seconds per case, median (longest) | {' | '.join(f'{w[len(w) // 2]:.0f} ({w[-1]:.0f})' for w in walls)} |"
    )
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="?", help="what the table calls the tool")
    parser.add_argument("command", nargs="?", help="command that is called with CASE and OUT behind it")
    parser.add_argument("--cases", nargs="+", metavar="ID", help="only these")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time (default: %(default)d)")
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for a case (default: %(default)g)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "benchmark", help="where recordings and reports go")
    parser.add_argument("--kept", type=Path, default=KEPT, help="where rows are kept")
    parser.add_argument("--figures", action="store_true", help="only redraw the table")
    chosen = parser.parse_args()
    kept = json.loads(chosen.kept.read_text()) if chosen.kept.is_file() else {}
    if not chosen.figures:
        if not chosen.name or not chosen.command:
            parser.error("name the tool and give its command, such as: sindy 'python experiments/benchmark/sindy.py'")
        truths, seals, out = open_truths(HALF), json.loads(SEALS.read_text())[HALF], chosen.out.resolve()
        rows = {row["id"]: row for row in kept.get(chosen.name, [])}

        def one(name: str) -> dict:
            case = write(truths[name], out / "cases", seals[name])
            answer = out / chosen.name / name
            told = answered(chosen.command, case, answer, chosen.timeout)
            print(f"{name}: {told['wall']:.0f} s, status {told['status']}", flush=True)
            return scored(truths[name], case, answer, told)

        with ThreadPoolExecutor(chosen.jobs) as pool:
            found = pool.map(one, [n for n in sorted(truths) if not chosen.cases or n in chosen.cases])
            rows |= {row["id"]: row for row in found}
        kept[chosen.name] = [rows[name] for name in sorted(rows)]
        chosen.kept.parent.mkdir(parents=True, exist_ok=True)
        chosen.kept.write_text(json.dumps(kept, indent=1) + "\n")
    if chosen.kept == KEPT:
        TABLE.write_text(table(kept), encoding="utf-8")
    else:
        print(table(kept))


if __name__ == "__main__":
    main()
