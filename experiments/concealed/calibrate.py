"""How wide must intervals be? Coverage of the truth by 95 % intervals on finished cases, as reported and widened.

    python experiments/concealed/calibrate.py --out out/concealed

Another engine made the recordings, in steps a tenth as long and with friction of another make. What differs between two
engines (and between an engine and a rig) is not noise, and no covariance knows it. So `jbridge` widens every standard
deviation `s` of a number `v` to `hypot(factor s, share |v|)`, with numbers chosen on the development half. For reports
of versions that widen already, the first row (1, 0) is what counts.
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np

FACTORS, SHARES = (1.0, 2.0, 3.0), (0.0, 0.001, 0.0025, 0.005)
HERE = Path(__file__).resolve().parent


def numbers(half: str, out: Path) -> np.ndarray:
    """True value, found value and standard deviation of every number, where the verdict was right."""
    from run import open_truths, row_of

    rows = []
    for name, truth in sorted(open_truths(half).items()):
        report = out / name / "diagnosis" / "report.json"
        if not report.exists() or not row_of(truth, out / name).get("verdict_right"):
            continue
        found = json.loads(report.read_text())
        own = {(e["kind"], e["site"]): e for e in truth["effects"] + truth["concealed"]}
        pairs = [(truth["bridge"][key], told) for key, told in found["bridge"].items() if key in truth["bridge"]]
        for effect in found["effects"] + found["model_effects"]:
            played = own.get((effect["kind"], effect["site"]), {})
            pairs += [(played[key], told) for key, told in effect["parameters"].items() if key in played]
        for true, told in pairs:
            if told["std"] is None or isinstance(true, str):
                continue
            true, value, std = (np.ravel(np.array(v, dtype=float)) for v in (true, told["value"], told["std"]))
            if len(true) == len(value) == len(std):
                rows += [row for row in zip(true, value, std, strict=True) if row[0] != 0 and np.isfinite(row[2])]
    return np.array(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE.parent.parent / "out" / "concealed", help="finished cases")
    out = parser.parse_args().out.resolve()
    os.chdir(HERE)
    found = {half: numbers(half, out) for half in ("dev", "proof")}
    print("factor  share   " + "  ".join(f"{half} ({len(rows)})" for half, rows in found.items()))
    for factor in FACTORS:
        for share in SHARES:
            covered = []
            for true, value, std in (rows.T for rows in found.values() if len(rows)):
                covered.append(np.mean(np.abs(value - true) < 1.96 * np.hypot(factor * std, share * value)))
            print(f"{factor:6g}  {share:6g}  " + "  ".join(f"{100 * c:8.1f} %" for c in covered))


if __name__ == "__main__":
    main()
