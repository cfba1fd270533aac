"""What would the truth itself leave? Simulates opened cases with their true numbers; only initial states are estimated.

    python experiments/concealed/ceiling.py --half wide --out out/concealed
    python experiments/concealed/ceiling.py --half dev --out out/concealed --cases dev-07 dev-12

A diagnosis that finds the truth leaves this. More than the noise is the simulation's own error, which a search might
explain with effects that nobody concealed: at the steps that a search takes, and (in brackets) at the finer ones of a
last fit, errors over noise should be 1. Where they are far from it, a last fit takes no finer ones. Rigs whose
friction wanders, and laws that the catalogue does not have, are left out.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

import jbridge
from cases import MASTER
from play import model_toml, write
from run import ROOT, recordings
from seal import SEALS, open_truths


def has_no_ceiling(truth: dict) -> str:
    """Why a truth's simulation need not meet its recordings; empty where it should."""
    if truth.get("wander"):
        return "its friction wanders"
    strange = sorted({effect["kind"] for effect in truth["effects"]} - set(jbridge.CATALOGUE))
    return f"the catalogue has no {', '.join(strange)}" if strange else ""


def true_model(truth: dict) -> str:
    """The model file with which a case was played, every number known."""
    known = list(truth["bridge"])
    for effect in truth["effects"]:
        numbers = [name for name, value in effect.items() if not isinstance(value, str)]
        known += [f"{effect['kind']}@{effect['site']}.{name}" for name in numbers]
    return model_toml({"bridge": {**truth["bridge"], "known": known}, "effects": truth["effects"]})


def left_by_the_truth(truth: dict, case: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Errors over noise of each channel in free runs over the training recordings, and with finer steps."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.toml"
        path.write_text(true_model(truth))
        checked = jbridge.fit(jbridge.load_model(path), jbridge.load_recordings(recordings(case, "train")))

    def errors(which: str) -> dict[str, float]:
        out = {}
        for axis, noise in checked.noise.items():
            off = [getattr(t, which)[axis] - t.measured[axis] for t in checked.traces if axis in t.measured]
            out[axis] = float(np.sqrt(np.nanmean(np.concatenate(off) ** 2))) / noise
        return out

    return errors("before"), errors("after")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=sorted(MASTER), required=True, help="which part of the cases")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "concealed", help="where recordings are or go")
    parser.add_argument("--cases", nargs="+", metavar="ID", help="only these")
    chosen = parser.parse_args()
    jbridge.set_up()
    truths, seals = open_truths(chosen.half), json.loads(SEALS.read_text())[chosen.half]
    unknown = sorted(set(chosen.cases or ()) - set(truths))
    if unknown:
        sys.exit(f"{chosen.half} has no case {', '.join(unknown)}")
    for name in sorted(truths):
        truth = truths[name]
        if chosen.cases and name not in chosen.cases:
            continue
        concealed = " + ".join(f"{e['kind']} {e['site']}" for e in truth["concealed"]) or "nothing"
        why = has_no_ceiling(truth)
        if why:
            print(f"{name}  {concealed}: {why}", flush=True)
            continue
        case = write(truth, chosen.out, seals[name])
        usual, fine = left_by_the_truth(truth, case)
        told = ", ".join(
            f"{axis} {usual[axis]:.2f} ({'not finer' if fine == usual else f'{fine[axis]:.2f}'})" for axis in usual
        )
        print(f"{name}  {concealed}: {told}", flush=True)


if __name__ == "__main__":
    main()
