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

from balance import EQUATION, Balance, Filter, basis, project, run_of
from cases import MASTER
from jbridge import Model, Recording, load_model, load_recordings
from library import Term, library, owned
from run import FIGURES, ROOT
from score import score
from seal import open_truths

PENALTY = 3.0
"""Times BIC's log of the sample size per number: model errors are correlated beyond the filter. Chosen on `dev`."""
SHARE = 0.03
"""Of the squared rest, what an effect must explain at least. Chosen on `dev`."""
RIDGE = 0.03
"""Of STLSQ, over the number of rows: much of the library is nearly dependent. Chosen on `dev`."""
MOST = 4
"""Effects per axis."""


@dataclass(frozen=True)
class Choice:
    """One effect that a rival names."""

    label: str
    gain: float
    """How much BIC rises when it is left out."""


def bic(rest: float, numbers: int, samples: float) -> float:
    """The criterion, from a sum of squares."""
    return samples * math.log(max(rest, 1e-300)) + PENALTY * numbers * math.log(max(samples, 2.0))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A term at the best of its variants."""

    term: Term
    columns: np.ndarray
    free: np.ndarray
    """The columns less what the base explains of them."""
    rest: float
    """Sum of squares that base and columns leave."""

    @property
    def numbers(self) -> int:
        """How many were chosen freely: coefficients, and the place on the grid."""
        return self.columns.shape[1] + (len(self.term.variants) > 1)


def best_variant(term: Term, balance: Balance, base: np.ndarray, left: np.ndarray) -> Candidate | None:
    """The variant that explains most of what the base leaves, None if none has the sign that its law has.

    Args:
        term: a candidate.
        balance: rows of an axis.
        base: orthonormal columns of what is there already.
        left: what these leave.
    """
    found = None
    for made in term.variants:
        columns = balance.column(made)
        free = columns - base @ (base.T @ columns)
        if np.linalg.norm(free, axis=0).min() < 1e-6 * max(np.linalg.norm(columns, axis=0).max(), 1e-12):
            continue
        rest = project(free, left)
        left_over = float(rest @ rest)
        if found is None or left_over < found.rest:
            first = free[:, 0] if free.shape[1] == 1 else project(free[:, 1:], free[:, 0])
            if not term.positive or first @ left > 0:
                found = Candidate(term, columns, free, left_over)
    return found


def lasting(chosen: list[Candidate], base: np.ndarray, balance: Balance) -> list[Choice]:
    """Drops, one by one, what the others explain as well; what each of the rest adds beside the others."""

    def total(kept: list[Candidate]) -> float:
        rest = project(np.column_stack([base, *(c.columns for c in kept)]), balance.needed)
        return bic(float(rest @ rest), sum(c.numbers for c in kept), balance.samples)

    while chosen:
        everything = total(chosen)
        gains = [total([other for other in chosen if other is not c]) - everything for c in chosen]
        if min(gains) > 0:
            return [Choice(c.term.label, gain) for c, gain in zip(chosen, gains, strict=True)]
        chosen = [c for c, gain in zip(chosen, gains, strict=True) if gain > min(gains)]
    return []


def greedy(balance: Balance) -> list[Choice]:
    """Grouped forward selection by BIC; the drive's nonlinear numbers are found anew beside each selection."""
    there = np.column_stack([balance.column(made) for made in owned(balance)])
    chosen: list[Candidate] = []
    while True:
        base = balance.refit(there, [c.columns for c in chosen])
        if len(chosen) == MOST:
            break
        span = basis(np.column_stack([base, *(c.columns for c in chosen)]))
        left = balance.needed - span @ (span.T @ balance.needed)
        before, samples = float(left @ left), balance.samples
        taken = {c.term.label for c in chosen}
        found = [best_variant(t, balance, span, left) for t in library(balance) if t.label not in taken]
        found = [c for c in found if c and c.rest < (1 - SHARE) * before]
        scores = [bic(c.rest, c.numbers, samples) for c in found]
        if not scores or min(scores) >= bic(before, 0, samples):
            break
        chosen.append(found[int(np.argmin(scores))])
    return lasting(chosen, base, balance)


def sindy(balance: Balance) -> list[Choice]:
    """STLSQ over the candidates after the base is projected out, which is the joint fit; the threshold by BIC."""
    import pysindy

    base = balance.refit(np.column_stack([balance.column(made) for made in owned(balance)]))
    span = basis(base)
    left = balance.needed - span @ (span.T @ balance.needed)
    found = [c for c in (best_variant(t, balance, span, left) for t in library(balance)) if c]
    if not found:
        return []
    # Columns of a group are made orthogonal, so that a coefficient is a contribution, in units of the rest.
    blocks = [basis(c.free) for c in found]
    owner = np.repeat(np.arange(len(found)), [b.shape[1] for b in blocks])
    rows = len(left)
    columns, target = math.sqrt(rows) * np.column_stack(blocks), left / math.sqrt(float(np.mean(left**2)))
    best, kept = bic(float(left @ left), 0, balance.samples), []
    for threshold in np.geomspace(0.05, 1.0, 24):
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=RIDGE * rows, max_iter=30)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns where nothing is left, which is an answer here
            optimizer.fit(columns, target[:, None])
        groups = [found[i] for i in sorted(set(owner[np.abs(np.ravel(optimizer.coef_)) > 0]))]
        if not groups or len(groups) > MOST:
            continue
        rest = project(np.column_stack([base, *(c.columns for c in groups)]), balance.needed)
        rest = float(rest @ rest)
        total = bic(rest, sum(c.numbers for c in groups), balance.samples)
        if total < best and rest < (1 - SHARE) * float(left @ left):
            best, kept = total, groups
    return lasting(kept, base, balance)


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
    labels = [choice.label for choice, _ in found]
    if "sensor_delay x_sensor" in labels:  # which the cart's balance can only read as a drive that is late
        labels = [label for label in labels if label != "input_delay cart_drive"]
    effects = [dict(zip(("kind", "site"), k.split(), strict=True)) for k in labels]
    effects = [e | {"parameters": {}, "probability": None} for e in effects]
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
