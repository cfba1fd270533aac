"""What would a careful practitioner find with sparse regression? Two rivals on the very same concealed recordings.

    python experiments/concealed/rivals.py --half proof
    python experiments/concealed/rivals.py --half wide --out DIR --limit 40

`sindy` is pysindy's sequentially thresholded least squares on smoothed accelerations, its threshold chosen by BIC.
`greedy` is forward selection of groups by BIC on weak-form balances. Both see model.toml and the training
recordings, share one library (`library.py`), and refit the model's own coefficients together with the candidates.
They never say `unknown`. Rows go to figures/data/concealed-rivals.json; those of cases that were not run stay.
"""

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from balance import EQUATION, Balance, Filter, project, run_of
from cases import MASTER
from jbridge import Model, Recording, load_model, load_recordings
from library import Term, library, owned
from run import FIGURES, ROOT
from score import score
from seal import open_truths

PENALTY = 3.0
"""Times BIC's log of the sample size per number: model errors are correlated beyond the filter. Chosen on `dev`."""
SHARE = 0.05
"""Of the squared rest, what an effect must explain at least. Chosen on `dev`."""
MOST = 4
"""Effects per axis."""


@dataclass(frozen=True)
class Choice:
    """One effect that a rival names."""

    label: str
    gain: float
    """How much BIC rises when it is left out."""


def bic(left: np.ndarray, numbers: int, samples: float) -> float:
    return samples * math.log(max(float(left @ left), 1e-300)) + PENALTY * numbers * math.log(max(samples, 2.0))


def numbers_of(term: Term, columns: np.ndarray) -> int:
    return columns.shape[1] + (len(term.variants) > 1)


def physical(term: Term, base: np.ndarray, columns: np.ndarray, target: np.ndarray) -> bool:
    """Whether the first column's coefficient has the sign that the law has."""
    if not term.positive:
        return True
    first = project(np.column_stack([base, columns[:, 1:]]), columns[:, 0])
    return float(first @ target) > 0


def best_variant(term: Term, balance: Balance, base: np.ndarray, left: np.ndarray) -> np.ndarray | None:
    """The columns of the variant that explains most of what the base leaves, None if none is physical."""
    found, best = None, math.inf
    for made in term.variants:
        columns = balance.column(made)
        free = project(base, columns)
        if np.linalg.norm(free, axis=0).min() < 1e-6 * max(np.linalg.norm(columns, axis=0).max(), 1e-12):
            continue
        rest = project(free, left)
        if rest @ rest < best and physical(term, base, columns, left):
            found, best = columns, float(rest @ rest)
    return found


def gains(chosen: dict[str, tuple[Term, np.ndarray]], base: np.ndarray, balance: Balance) -> list[Choice]:
    """What each chosen effect adds beside the others."""

    def total(labels: list[str]) -> float:
        columns = np.column_stack([base, *(chosen[k][1] for k in labels)])
        numbers = sum(numbers_of(*chosen[k]) for k in labels)
        return bic(project(columns, balance.needed), numbers, balance.samples)

    labels = list(chosen)
    everything = total(labels)
    return [Choice(k, total([other for other in labels if other != k]) - everything) for k in labels]


def greedy(balance: Balance) -> list[Choice]:
    """Grouped forward selection by BIC; the drive's nonlinear numbers are found anew beside each selection."""
    columns = np.column_stack([balance.column(made) for made in owned(balance)])
    chosen: dict[str, tuple[Term, np.ndarray]] = {}
    while True:
        base = balance.refit(np.column_stack([columns, *(c for _, c in chosen.values())]))
        left = project(base, balance.needed)
        if len(chosen) == MOST:
            break
        scores = []
        for term in library(balance):
            made = None if term.label in chosen else best_variant(term, balance, base, left)
            if made is not None:
                rest = project(np.column_stack([base, made]), balance.needed)
                change = bic(rest, numbers_of(term, made), balance.samples) - bic(left, 0, balance.samples)
                if change < 0 and rest @ rest < (1 - SHARE) * (left @ left):
                    scores.append((change, term, made))
        if not scores:
            break
        _, term, made = min(scores, key=lambda s: s[0])
        chosen[term.label] = term, made
    alone = balance.refit(columns) if balance.drive is None else base_without(base, chosen, columns)
    found = gains(chosen, alone, balance)
    return [choice for choice in found if choice.gain > 0]


def base_without(base: np.ndarray, chosen: dict[str, tuple[Term, np.ndarray]], columns: np.ndarray) -> np.ndarray:
    """The base columns of `refit` less those of the chosen effects."""
    first = 1 + columns.shape[1]
    return np.delete(base, np.s_[first : first + sum(c.shape[1] for _, c in chosen.values())], axis=1)


def sindy(balance: Balance) -> list[Choice]:
    """STLSQ over the candidates after the base is projected out, which is the joint fit; the threshold by BIC."""
    import pysindy

    base = balance.refit(np.column_stack([balance.column(made) for made in owned(balance)]))
    left = project(base, balance.needed)
    terms, blocks = [], []
    for term in library(balance):
        made = best_variant(term, balance, base, left)
        if made is not None:
            terms.append(term)
            blocks.append(made)
    if not terms:
        return []
    owner = np.repeat(np.arange(len(terms)), [b.shape[1] for b in blocks])
    free = project(base, np.column_stack(blocks))
    scale = np.linalg.norm(free, axis=0) / math.sqrt(len(free))
    unit = math.sqrt(float(np.mean(left**2)))
    best, kept = bic(left, 0, balance.samples), []
    for threshold in np.geomspace(0.05, 3.0, 24):
        # Coefficients in units of the rest: a column's own contribution, root mean square.
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-3, max_iter=30)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns where nothing is left, which is an answer here
            optimizer.fit(free / scale, (left / unit)[:, None])
        groups = sorted({int(i) for i in owner[np.abs(np.ravel(optimizer.coef_)) > 0]})
        if not groups or len(groups) > MOST:
            continue
        rest = project(np.column_stack([base, *(blocks[i] for i in groups)]), balance.needed)
        total = bic(rest, sum(numbers_of(terms[i], blocks[i]) for i in groups), balance.samples)
        if total < best and rest @ rest < (1 - SHARE) * (left @ left):
            best, kept = total, groups
    found = gains({terms[i].label: (terms[i], blocks[i]) for i in kept}, base, balance)
    return [choice for choice in found if choice.gain > 0]


RIVALS: dict[str, tuple[Callable[[Balance], list[Choice]], Filter]] = {
    "sindy": (sindy, Filter(0.06, {"x": 0.0, "psi": 0.0, "l": 0.0}, 0.02)),
    "greedy": (greedy, Filter(0.03, {"x": 0.1, "psi": 0.1, "l": 0.1}, 0.05)),
}


def axes_of(recording: Recording) -> list[str]:
    """Axes that have an equation."""
    there = {"x": recording.has_cart, "psi": recording.psi is not None, "l": recording.has_hoist}
    return [axis for axis, has in there.items() if has]


def diagnose(rival: str, model: Model, recordings: tuple[Recording, ...]) -> dict:
    """A report of the shape that `score` reads: verdict, effects by gain, equation of the first."""
    start = time.monotonic()
    select, filter = RIVALS[rival]
    runs = [run_of(r, filter) for r in recordings]
    found = []
    for axis in axes_of(recordings[0]):
        balance = Balance(axis, model, runs, filter)
        if len(balance.needed) > 50:
            found += [(choice, EQUATION[axis]) for choice in select(balance)]
    found.sort(key=lambda pair: -pair[0].gain)
    effects, seen = [], set()
    for choice, _ in found:
        kind, site = choice.label.split()
        if choice.label not in seen:
            effects.append({"kind": kind, "site": site, "parameters": {}, "probability": None})
        seen.add(choice.label)
    return {
        "verdict": "missing_physics" if found else "adequate", "effects": effects,
        "location": {"equation": found[0][1] if found else "none"},
        "fit": {"holdout": {"before": {}, "after": {}}, "noise": {}}, "bridge": {},
        "seconds": round(time.monotonic() - start, 2),
    }  # fmt: skip


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=sorted(MASTER), required=True, help="which part of the cases")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "concealed", help="where the recordings are")
    parser.add_argument("--cases", nargs="+", metavar="ID", help="only these")
    parser.add_argument("--limit", type=int, help="only the first so many of those with recordings")
    parser.add_argument("--data", type=Path, default=FIGURES / "data" / "concealed-rivals.json", help="rows go here")
    return parser.parse_args()


def main() -> int:
    chosen = options()
    try:
        import pysindy  # noqa: F401
    except ImportError:
        print("pysindy is not installed; install the extra `proof`: pip install -e '.[proof]'", file=sys.stderr)
        return 2
    truths = open_truths(chosen.half)
    names = [n for n in sorted(truths) if not chosen.cases or n in chosen.cases]
    names = [n for n in names if (chosen.out / n / "recordings" / ".done").exists()][: chosen.limit]
    if not names:
        print(f"no recordings of {chosen.half} below {chosen.out}; run.py --generate-only makes them", file=sys.stderr)
        return 2
    saved = json.loads(chosen.data.read_text()) if chosen.data.exists() else {}
    rows = {r: {row["id"]: row for row in saved.get(chosen.half, {}).get(r, [])} for r in RIVALS}
    for name in names:
        case = chosen.out / name
        model = load_model(case / "model.toml")
        recordings = load_recordings(sorted((case / "recordings").glob("train-*.csv")))
        for rival in RIVALS:
            report = diagnose(rival, model, recordings)
            row = score(truths[name], report) | {"wall": report["seconds"]}
            rows[rival][name] = row
            print(f"{name} {rival}: {', '.join(row['named']) or 'nothing'} ({report['seconds']:.1f} s)", flush=True)
    saved[chosen.half] = {r: [found[n] for n in sorted(found)] for r, found in rows.items()}
    chosen.data.parent.mkdir(parents=True, exist_ok=True)
    chosen.data.write_text(json.dumps(saved, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
