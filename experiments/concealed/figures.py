"""Table and confusion picture of the concealed proof, from saved rows alone."""

import json
from collections import Counter
from pathlib import Path
from statistics import median

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

VERDICTS = ["adequate", "missing_physics", "unknown"]
EQUATIONS = ["none", "cart", "swing", "hoist"]


def _share(rows: list[dict], key: str) -> str:
    """`hits/all` and the percentage, with the 95 % Wilson interval: these are small numbers."""
    n, hits = len(rows), sum(bool(row[key]) for row in rows)
    if n == 0:
        return "none"
    z = 1.96
    centre = (hits / n + z * z / (2 * n)) / (1 + z * z / n)
    half = z * ((hits / n * (1 - hits / n) + z * z / (4 * n)) / n) ** 0.5 / (1 + z * z / n)
    low, high = 100 * max(centre - half, 0.0), 100 * min(centre + half, 1.0)
    return f"{100 * hits / n:.0f} % ({hits}/{n}; {low:.0f}-{high:.0f})"


def groups(rows: list[dict]) -> dict[str, list[dict]]:
    """The rows by what is asked of them."""
    catalogued = [r for r in rows if r["true_verdict"] == "missing_physics"]
    marked = [r | {"said": r["verdict"] == "unknown"} for r in rows]
    return {
        "null": [r for r in rows if r["true_verdict"] == "adequate"],
        "visible": [r for r in rows if r["true"] and (r["before"] or 0.0) >= 5.0],
        "concealed": [r for r in rows if r["true"]],
        "single": [r for r in catalogued if len(r["true"]) == 1],
        "double": [r for r in catalogued if len(r["true"]) == 2],
        "triple": [r for r in catalogued if len(r["true"]) == 3],
        "catalogued": catalogued,
        "unknown": [r for r in marked if r["true_verdict"] == "unknown"],
        "known": [r for r in marked if r["true_verdict"] != "unknown"],
    }


def _numbers(rows: list[dict], what: str) -> tuple[list[float], list[bool]]:
    found = [p for r in rows for p in r[what].values()]
    return [p["error"] for p in found], [p["covered"] for p in found if p["covered"] is not None]


def _percent(values: list, middle: bool = True) -> str:
    if not values:
        return "none"
    return f"{100 * (median(values) if middle else sum(values) / len(values)):.1f} % of {len(values)}"


def summary(rows: list[dict]) -> list[tuple[str, str, str]]:
    """Rows of the table: measure, aim, result."""
    g = groups(rows)
    errors, covered = _numbers(rows, "parameters")
    rig_errors, rig_covered = _numbers(rows, "bridge")
    gaps = [r["gap_closed"] for r in g["catalogued"] if r["gap_closed"] is not None]
    seconds = [r["wall"] for r in rows if r.get("wall") is not None]
    return [
        ("false alarms where only numbers are wrong", "<= 2 %", _share(g["null"], "detected")),
        (
            "detected where the base model's hold-out error is >= 5 noise",
            ">= 98 %",
            _share(g["visible"], "detected"),
        ),
        ("right equation", ">= 97 %", _share(g["concealed"], "equation_right")),
        (
            "right effect, or its declared equivalent, named first, one missing",
            ">= 95 %",
            _share(g["single"], "first_right"),
        ),
        ("right effect first or among its declared equivalents", "", _share(g["single"], "in_set")),
        ("exact set, one missing", "", _share(g["single"], "set_right")),
        ("exact set, two missing", ">= 80 %", _share(g["double"], "set_right")),
        ("exact set, three missing", ">= 60 %", _share(g["triple"], "set_right")),
        ("`unknown` said when it is", ">= 90 %", _share(g["unknown"], "said")),
        ("`unknown` wrongly said", "<= 5 %", _share(g["known"], "said")),
        ("verdict right", "", _share(rows, "verdict_right")),
        ("effect parameters, median error", "<= 5 %", _percent(errors)),
        ("effect parameters, 95 % intervals that cover", "92-98 %", _percent(covered, middle=False)),
        ("the rig's own numbers, median error", "<= 5 %", _percent(rig_errors)),
        ("the rig's own numbers, 95 % intervals that cover", "92-98 %", _percent(rig_covered, middle=False)),
        ("hold-out gap closed, median", ">= 95 %", _percent(gaps)),
        (
            "seconds per case, median (longest)",
            "<= 60 s",
            f"{median(seconds):.0f} ({max(seconds):.0f})" if seconds else "none",
        ),
    ]


def misses(rows: list[dict]) -> list[str]:
    """One line for every case with a wrong verdict, a wrong first effect or a wrong equation."""
    lines = []
    for r in rows:
        wrong = [] if r["verdict_right"] else [f"said {r['verdict']}, was {r['true_verdict']}"]
        if r["true"] and not r["equation_right"]:
            wrong.append(f"equation {r['equation']}, was {' or '.join(r['true_equations'])}")
        if r["true_verdict"] == "missing_physics" and not r["set_right"]:
            wrong.append(f"named {', '.join(r['named']) or 'nothing'}")
        if wrong:
            true = " + ".join(r["true"]) or "nothing missing"
            lines.append(f"- `{r['id']}` ({r['flavour']}, {r['loop']} loop) {true}: {'; '.join(wrong)}")
    return lines


def table(halves: dict[str, dict]) -> str:
    """The whole page in markdown."""
    names = list(halves)
    columns = [summary(halves[n]["rows"]) for n in names]
    lines = [
        "# Concealed cases",
        "",
        "Recordings from another engine with true stick-slip; truths sealed before the diagnosis. Settings were",
        "chosen on `dev`; `proof` was opened once; `wide` has every effect at three sizes. Percentages come with",
        "counts and 95 % Wilson intervals.",
        "Redrawn by `python experiments/concealed/run.py --figures`; do not edit.",
        "",
        "| measure | aim | " + " | ".join(names) + " |",
        "|" + "---|" * (2 + len(names)),
    ]
    for i, (measure, aim, _) in enumerate(columns[0]):
        lines.append(f"| {measure} | {aim} | " + " | ".join(column[i][2] for column in columns) + " |")
    for n in names:
        rows, made = halves[n]["rows"], halves[n]
        missed = misses(rows)
        lines += ["", f"## Misses of {n}: {len(missed)} of {len(rows)} cases", ""]
        codes = sorted({r["code"] for r in rows if r.get("code")}) or [made["commit"] or "unversioned"]
        code = ", ".join(codes)
        lines += [f"{len(rows)} of {made['cases']} cases run; code {code}; {made['cores']} cores.", ""]
        lines += missed or ["none"]
        if any(r.get("probability") is not None for r in rows):
            lines += ["", f"## By size, {n}", "", *by_severity(rows), "", *reliability(rows)]
    return "\n".join(lines) + "\n"


SEVERITIES = ((0.0, 2.0), (2.0, 5.0), (5.0, 20.0), (20.0, float("inf")))
"""Of the hold-out error of the refitted model without the effect, over the noise, root mean square of the channels."""


def by_severity(rows: list[dict]) -> list[str]:
    """How often what is missing is seen and named, over how large it is."""
    lines = ["| hold-out error over noise | cases | detected | right equation | exact set, where it has a name |"]
    lines += ["|---|---|---|---|---|"]
    for low, high in SEVERITIES:
        here = [r for r in rows if r["true"] and r["before"] is not None and low <= r["before"] < high]
        named = [r for r in here if r["true_verdict"] == "missing_physics"]
        span = f"{low:g} to {high:g}" if high < float("inf") else f"above {low:g}"
        shares = _share(here, "detected"), _share(here, "equation_right"), _share(named, "set_right")
        lines.append(f"| {span} | {len(here)} | " + " | ".join(shares) + " |")
    failed = [r for r in rows if r["true"] and r["before"] is None]
    return [*lines, f"| did not finish | {len(failed)} | | | |"] if failed else lines


def reliability(rows: list[dict]) -> list[str]:
    """How often the first name is right where one was given as the verdict, over its probability."""
    lines = ["| probability of the first name | cases | mean probability | right |", "|---|---|---|---|"]
    told = [r for r in rows if r.get("probability") is not None and r["verdict"] == "missing_physics"]
    for low, high in ((0.0, 0.6), (0.6, 0.9), (0.9, 0.99), (0.99, 1.01)):
        here = [r for r in told if low <= r["probability"] < high]
        mean = f"{100 * sum(r['probability'] for r in here) / len(here):.1f} %" if here else "none"
        lines.append(f"| {low:g} to {min(high, 1.0):g} | {len(here)} | {mean} | {_share(here, 'first_right')} |")
    return lines


def _answer(row: dict) -> str:
    if row["true_verdict"] == row["verdict"] == "unknown":  # effects that passed stay listed, but the answer is this
        return "unknown"
    if row["named"]:
        return row["named"][0]
    return {"adequate": "nothing missing", "unknown": "unknown"}.get(row["verdict"], row["verdict"])


def _truth(row: dict) -> str:
    if not row["true"]:
        return "nothing missing"
    # Of several concealed effects the one that was named first counts, if any of them was.
    return row["named"][0] if row["named"] and row["named"][0] in row["true"] else row["true"][0]


def _right(row: dict) -> bool:
    return row["first_right"] if row["true_verdict"] == "missing_physics" else row["verdict_right"]


def _grid(axes, answers: list[tuple[str, str, bool]], rows: list[str], columns: list[str], size: float) -> None:
    """Counts as squares: blue where the answer is right or as good as right, orange elsewhere."""
    for (true, said, right), count in Counter(answers).items():
        y, x = rows.index(true), columns.index(said)
        colour = "tab:blue" if right else "tab:orange"
        axes.add_patch(plt.Rectangle((x - 0.5, y - 0.5), 1, 1, color=colour, alpha=0.75, linewidth=0))
        axes.text(x, y, str(count), ha="center", va="center", fontsize=size)
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=size)
    axes.set_yticks(range(len(rows)), rows, fontsize=size)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel("said")
    axes.set_ylabel("true")
    axes.set_xticks([i - 0.5 for i in range(1, len(columns))], minor=True)
    axes.set_yticks([i - 0.5 for i in range(1, len(rows))], minor=True)
    axes.grid(which="minor", color="0.9", linewidth=0.5)
    axes.tick_params(which="both", length=0)


def confusion(half: dict, path: Path) -> None:
    """True against named effect, and the same for equations and verdicts."""
    rows = half["rows"]
    pairs = [(_truth(r), _answer(r), _right(r)) for r in rows]
    kinds = sorted({true for true, _, _ in pairs}, key=lambda k: (k == "nothing missing", k.split()[-1], k))
    others = sorted({said for _, said, _ in pairs} - set(kinds), key=lambda k: (k.split()[-1], k))
    figure = plt.figure(figsize=(15, 11))
    left = figure.add_axes((0.2, 0.24, 0.5, 0.7))
    _grid(left, pairs, kinds, kinds + others, 6.5)
    left.set_title(f"first effect named, {half['half']} half, {len(rows)} cases")
    verdicts = figure.add_axes((0.84, 0.66, 0.13, 0.2))
    said = VERDICTS + sorted({r["verdict"] for r in rows} - set(VERDICTS))
    _grid(verdicts, [(r["true_verdict"], r["verdict"], r["verdict_right"]) for r in rows], VERDICTS, said, 8)
    verdicts.set_title("verdict")
    equations = figure.add_axes((0.84, 0.28, 0.13, 0.2))
    hits = []
    for r in rows:
        answer = r["equation"] or "none"
        if not r["true"] and not r["detected"]:
            answer = "none"
        right = answer in r["true_equations"]
        hits.append((answer if right else r["true_equations"][0], answer, right))
    _grid(equations, hits, EQUATIONS, EQUATIONS, 8)
    equations.set_title("equation")
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)


def draw(folder: Path) -> None:
    """Redraws `concealed-table.md` and `concealed-confusion.png` from `data/concealed-*.json`."""
    halves = {}
    for half in ("dev", "proof", "wide"):
        data = folder / "data" / f"concealed-{half}.json"
        if data.exists():
            saved = json.loads(data.read_text())
            if saved["rows"]:
                halves[half] = saved
    if not halves:
        print(f"no rows below {folder / 'data'} yet")
        return
    (folder / "concealed-table.md").write_text(table(halves))
    confusion(halves.get("proof", halves.get("dev", {})), folder / "concealed-confusion.png")
