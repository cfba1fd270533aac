"""Pictures of the concealed proof, from saved rows alone."""

import json
from collections import Counter
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Patch

from tables import AGAIN, LISTED, PROBABILITIES, SEVERITIES, cases, parts, table, wilson, with_probability

plt.style.use("jbridge.report.figures.common")

PARTS = ("dev", "proof", "wide", "fresh", AGAIN)
"""Columns of the table, each with data of its own."""
VERDICTS = ["adequate", "missing_physics", "unknown"]
EQUATIONS = ["none", "cart", "swing", "hoist"]


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
        colour = "#0a6ebd" if right else "#dd6a00"
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
    axes.grid(False, which="major")
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
    said_right = (("#0a6ebd", "right or as good as right"), ("#dd6a00", "wrong"))
    marks = [Patch(color=colour, alpha=0.75, linewidth=0, label=label) for colour, label in said_right]
    figure.legend(handles=marks, loc="upper left", bbox_to_anchor=(0.8, 0.97), frameon=False)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)


def _dots(axes, points: list[tuple[float, int, int]], colour: str, label: str, above: bool = True) -> None:
    """Shares with their Wilson intervals and counts; each point is (place, hits, all)."""
    points = [p for p in points if p[2]]
    spans = [wilson(hits, n) for _, hits, n in points]
    shares = [hits / n for _, hits, n in points]
    # Rounding may put an end of the interval on the wrong side of a share of 0 or 1.
    away = [[max(s - low, 0.0) for s, (low, _) in zip(shares, spans, strict=True)]]
    away += [[max(high - s, 0.0) for s, (_, high) in zip(shares, spans, strict=True)]]
    axes.errorbar([x for x, _, _ in points], shares, yerr=away, fmt="o", color=colour, capsize=3, label=label)
    for (x, hits, n), (low, high) in zip(points, spans, strict=True):
        place, offset, side = (high, 4, "bottom") if above else (low, -4, "top")
        axes.annotate(f"{hits}/{n}", (x, place), (0, offset), textcoords="offset points", ha="center", va=side,
                      fontsize=8, color=colour)  # fmt: skip


def reliability(halves: dict[str, dict], path: Path) -> None:
    """Are probabilities honest, and how large must an effect be to be seen and named?"""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    told = with_probability([r for part, half in halves.items() if part != AGAIN for r in half["rows"]])
    points = []
    for low, high in PROBABILITIES:
        here = [r for r in told if low <= r["probability"] < high]
        if here:
            mean = sum(r["probability"] for r in here) / len(here)
            points.append((mean, sum(r["first_right"] for r in here), len(here)))
    left.plot([0, 1], [0, 1], color="0.7", linewidth=1, label="as often as said")
    _dots(left, points, "#0a6ebd", "first names, 95 % Wilson interval", above=False)
    whole = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    left.set(xlim=(0, 1.05), ylim=(-0.05, 1.2), yticks=whole)
    left.set(xlabel="probability given to the first name", ylabel="share right")
    left.set_title(f"{len(told)} verdicts that name an effect with a probability")
    left.legend(loc="upper center", ncols=2, frameon=False, fontsize=8)
    larger = [half for half in ("wide", "fresh") if half in halves]
    rows = [r for half in larger for r in halves[half]["rows"] if r["true"] and r["before"] is not None]
    seen, exact, spans = [], [], []
    for i, (low, high) in enumerate(SEVERITIES):
        here = [r for r in rows if low <= r["before"] < high]
        named = [r for r in here if r["true_verdict"] == "missing_physics"]
        seen.append((i - 0.12, sum(r["detected"] for r in here), len(here)))
        exact.append((i + 0.12, sum(r["set_right"] for r in named), len(named)))
        spans.append(f"{low:g} to {high:g}" if high < float("inf") else f"above {low:g}")
    _dots(right, seen, "#0a6ebd", "detected")
    _dots(right, exact, "#00805c", "exact set named, where it has a name", above=False)
    right.set_xticks(range(len(spans)), spans)
    right.set(xlim=(-0.5, len(spans) - 0.5), ylim=(-0.2, 1.12), yticks=whole, ylabel="share, 95 % Wilson interval")
    right.set_xlabel("hold-out error of the model without the effect, over the noise")
    right.set_title(f"{' and '.join(larger)}, {len(rows)} cases that lack something")
    right.legend(loc="lower center", ncols=2, frameon=False, fontsize=8)
    figure.savefig(path, dpi=130, metadata={"Software": None})
    plt.close(figure)


def draw(folder: Path) -> None:
    """Redraws table, confusion and reliability (`concealed-*`) from `data/concealed-*.json`."""
    halves = {}
    for half in PARTS:
        data = folder / "data" / f"concealed-{half}.json"
        if data.exists():
            saved = json.loads(data.read_text())
            if saved["rows"]:
                halves[half] = saved
    if not halves:
        print(f"no rows below {folder / 'data'} yet")
        return
    beside = folder / "data" / "concealed-rivals.json"
    rivals = json.loads(beside.read_text()) if beside.exists() else None
    (folder / "concealed-table.md").write_text(table(halves, rivals))
    listed = {}
    for part, name in LISTED.items():
        data = folder / "data" / f"concealed-{part}.json"
        if data.exists() and (rows := json.loads(data.read_text())["rows"]):
            listed[name] = rows
            (folder / f"concealed-{name}.md").write_text(cases(rows))
    (folder / "concealed-parts.md").write_text(parts(listed))
    confusion(halves.get("proof", halves.get("dev", {})), folder / "concealed-confusion.png")
    reliability(halves, folder / "concealed-reliability.png")
