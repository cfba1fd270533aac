"""Diagnoses the recordings of three rigs that nobody in this project built, read in place.

    python experiments/real_rigs/run.py --rig pendulum_multiarm_uw
    python experiments/real_rigs/run.py --figures

Numbers are kept in figures/data/real-rigs.json and replaced case by case; table and pictures are drawn from there.
"""

import argparse
import dataclasses
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(ROOT))

import jbridge  # noqa: E402
from experiments.real_rigs import figures  # noqa: E402
from experiments.real_rigs.cases import (  # noqa: E402
    AAU,
    CART_MAP_HOLDOUT,
    CART_MAP_TRAIN,
    CASES,
    GANTRY,
    LEVELS,
    RIGS,
    Case,
    Piece,
    runs,
)
from experiments.real_rigs.friction import levels_by_place  # noqa: E402

RECORDINGS = ROOT.parent / "shared" / "recordings"
"""Beside the project, a folder for each rig; JBRIDGE_RECORDINGS names another."""
if "JBRIDGE_RECORDINGS" in os.environ:
    RECORDINGS = Path(os.environ["JBRIDGE_RECORDINGS"])
FIGURES = ROOT / "figures"
KEPT = (
    "verdict", "statement", "adequacy", "location", "missing_force",
    "effects", "model_effects", "fit", "bridge", "settings",
)  # fmt: skip
"""What is kept of a report."""
MAP_WINDOW = 0.5
"""Windows [s] in which the friction map is fitted: a few reversals of the slowest oscillation."""
POINTS = 400
"""Points kept of each curve of a picture."""


def load(rig: str, piece: Piece) -> jbridge.Recording:
    """A recording read in place, cut by its sidecar and thinned as its piece says."""
    recording = jbridge.load_recording(RECORDINGS / rig / piece.file, sidecar=HERE / rig / piece.sidecar)
    keep = slice(None, None, piece.every)
    arrays = {
        name: getattr(recording, name)[keep]
        for name in ("times", "u_x", "u_l", "x", "psi", "l")
        if getattr(recording, name) is not None
    }
    return dataclasses.replace(
        recording,
        name=piece.name or piece.file,
        fresh={name: flag[keep] for name, flag in recording.fresh.items()},
        extras={},
        **arrays,
    )


def rounded(value: object) -> object:
    """Numbers as they are kept: six digits, and null for what is not known."""
    if isinstance(value, dict):
        return {str(key): rounded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [rounded(entry) for entry in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value


def tell(text: str) -> None:
    """Progress, on a terminal alone."""
    if sys.stderr.isatty():
        print(f"  {text}", file=sys.stderr, flush=True)


def curves(diagnosis: jbridge.Diagnosis) -> list[dict]:
    """What was measured on each hold-out recording beside both models' free runs."""
    out = []
    for trace in diagnosis.traces:
        if trace.role != "holdout":
            continue
        every = max(1, len(trace.times) // POINTS)
        out.append({"recording": trace.recording, "t": trace.times[::every]})
        for axis, measured in trace.measured.items():
            last = measured.copy()
            for i in np.flatnonzero(np.isnan(last)):  # a slower sensor holds its value
                last[i] = last[i - 1] if i else np.nan
            error = {name: getattr(trace, name)[axis] - measured for name in ("before", "after")}
            out[-1][axis] = {"measured": last[::every]} | {
                name: getattr(trace, name)[axis][::every] for name in ("before", "after")
            }
            out[-1][axis]["rmse"] = {name: float(np.sqrt(np.nanmean(e**2))) for name, e in error.items()}
    return out


def diagnose(case: Case, out: Path) -> dict:
    """One diagnosis as it is kept."""
    begun = time.perf_counter()
    model = jbridge.load_model(HERE / case.rig / case.model)
    train = [load(case.rig, piece) for piece in case.train]
    holdout = [load(case.rig, piece) for piece in case.holdout]
    print(f"{case.rig}, {case.name}: {len(train)} recordings, {len(holdout)} held out", file=sys.stderr, flush=True)
    found = jbridge.diagnose(model, train, holdout, progress=tell)
    folder = out / case.rig / case.name.replace(" ", "-")
    jbridge.save_report(folder, found)
    print(jbridge.describe_diagnosis(found, folder), flush=True)
    report = json.loads((folder / "report.json").read_text())
    row = {
        "rig": case.rig,
        "name": case.name,
        "published": case.published,
        "train": [r.name for r in train],
        "holdout": list(found.holdout),
        "seconds": round(time.perf_counter() - begun),
        "curves": curves(found),
    }
    return rounded(row | {key: report[key] for key in KEPT})


def errors(model: jbridge.Model, recording: jbridge.Recording) -> dict[str, float]:
    """RMSE by channel over all rows of an open-loop run from the first sample, at rest [m, rad, m]."""
    simulated = jbridge.simulate(model, recording)
    return {
        axis: float(np.sqrt(np.mean((simulated[axis] - getattr(recording, axis)) ** 2)))
        for axis in ("x", "psi", "l")
        if axis in simulated and getattr(recording, axis) is not None
    }


def fit_level(axis: str, level: int, out: Path) -> dict:
    """The extended model fitted to runs 1 and 2 of one PWM level, and its open-loop errors on all three."""
    begun = time.perf_counter()
    model = jbridge.load_model(HERE / GANTRY / f"{axis}-fit.toml")
    recordings = [load(GANTRY, piece) for piece in runs(axis, (level,), (1, 2, 3))]
    fitted = jbridge.fit(model, recordings[:2], recordings[2:])
    folder = out / GANTRY / f"{axis}-{level}"
    jbridge.save_fit(folder, fitted)
    row = {
        "axis": axis,
        "level": level,
        "stop": [r.duration for r in recordings],
        "cut": [errors(fitted.model, r) for r in recordings],
        "window": {
            "train": dict(fitted.train.window),
            "holdout": dict(fitted.holdout.window) if fitted.holdout is not None else {},
        },
        "estimates": {name: e.value for name, e in fitted.estimates.items()},
        "seconds": round(time.perf_counter() - begun),
    }
    if axis == "trolley":
        whole = [load(GANTRY, piece) for piece in runs(axis, (level,), (1, 2, 3), "trolley-15s.toml")]
        row["whole"] = [errors(fitted.model, r) for r in whole]
        row["still"] = [float(np.sqrt(np.mean((r.psi - np.median(r.psi)) ** 2))) for r in recordings]
    else:
        row["whole"] = row["cut"]
    print(f"{axis} {level}: runs 1, 2, 3 {[rounded(e) for e in row['cut']]}", file=sys.stderr, flush=True)
    return rounded(row)


def friction_map(diagnosed: dict, out: Path) -> dict:
    """The cart's friction by place and direction, from a fit of the published structure and from the diagnosis."""
    begun = time.perf_counter()
    model = jbridge.load_model(HERE / AAU / "cart-map.toml")
    train, holdout = ([load(AAU, piece) for piece in pieces] for pieces in (CART_MAP_TRAIN, CART_MAP_HOLDOUT))
    # A cart whose force is commanded is a double integrator: whole recordings tell where it drifted, not its friction.
    fitted = jbridge.fit(model, train, holdout, window=MAP_WINDOW)
    jbridge.save_fit(out / AAU / "cart-map", fitted)
    table = np.genfromtxt(RECORDINGS / AAU / "published_friction_table.csv", delimiter=",", names=True)
    x = table["x"]
    effect = fitted.model.plant.effects[0]
    found = {
        "positive": np.interp(x, np.asarray(effect.knots), np.asarray(effect.positive)),
        "negative": np.interp(x, np.asarray(effect.knots), np.asarray(effect.negative)),
    }
    named = jbridge.load_model(out / AAU / diagnosed["name"] / "model.toml")
    positive, negative = levels_by_place(named.plant, x)
    published = {"positive": table["f_pos_dir"], "negative": table["f_neg_dir"]}
    distance = {
        key: {
            "mean": float(np.mean(found[key] - published[key])),
            "rms": float(np.sqrt(np.mean((found[key] - published[key]) ** 2))),
            "correlation": float(np.corrcoef(found[key], published[key])[0, 1]),
        }
        for key in found
    }
    spread = fitted.estimates["position_direction_friction@cart.positive"]
    other = fitted.estimates["position_direction_friction@cart.negative"]
    return rounded(
        {
            "x": x,
            "found": found,
            "published": published,
            "diagnosed": {"positive": positive, "negative": negative},
            "distance": distance,
            "knots": np.asarray(effect.knots),
            "knot_positive": {"value": spread.value, "low": spread.low, "high": spread.high},
            "knot_negative": {"value": other.value, "low": other.low, "high": other.high},
            "window": MAP_WINDOW,
            "cart_mass": fitted.estimates["cart_mass"].value,
            "train": [r.name for r in train],
            "window_holdout": dict(fitted.holdout.window) if fitted.holdout is not None else {},
            "seconds": round(time.perf_counter() - begun),
        }
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", choices=RIGS, help="this rig alone")
    parser.add_argument("--limit", type=int, help="at most so many diagnoses, and PWM levels of each axis")
    parser.add_argument(
        "--out", type=Path, default=Path("out/real_rigs"), help="where reports go (default: %(default)s)"
    )
    parser.add_argument("--figures", action="store_true", help="only redraw table and pictures from the kept numbers")
    parser.add_argument("--only", help="only this part: a diagnosis by its name, `levels` or `map`")
    arguments = parser.parse_args()
    if not arguments.figures:
        if not RECORDINGS.is_dir():
            print(f"skipped: no recordings of real rigs in {RECORDINGS}; JBRIDGE_RECORDINGS=DIR names another folder")
            return
        jbridge.set_up()
        work(arguments.rig, arguments.limit, arguments.out, arguments.only)
    figures.draw(FIGURES)


def work(rig: str | None, limit: int | None, out: Path, only: str | None) -> None:
    """Runs what was asked for, and keeps each result as soon as it is there."""
    path = FIGURES / "data" / "real-rigs.json"
    kept = json.loads(path.read_text()) if path.exists() else {}

    def keep(section: str, name: str, value: dict) -> None:
        kept.setdefault(section, {})[name] = value
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps(kept, separators=(",", ":")) + "\n")
        part.replace(path)

    chosen = [case for case in CASES if rig in (None, case.rig) and only in (None, case.name)]
    for case in chosen[:limit]:
        keep("cases", f"{case.rig}/{case.name}", diagnose(case, out))
    cart = kept.get("cases", {}).get(f"{AAU}/cart")
    if rig in (None, AAU) and only in (None, "map") and cart is not None and limit is None:
        keep("map", "cart", friction_map(cart, out))
    if rig in (None, GANTRY) and only in (None, "levels"):
        for axis, levels in LEVELS.items():
            for level in levels[:limit]:
                keep("levels", f"{axis} {level}", fit_level(axis, level, out))


if __name__ == "__main__":
    main()
