"""What would the truth itself leave? Simulates opened cases with their true numbers; only initial states are fitted.

    python experiments/concealed/ceiling.py --half wide --out out/concealed
    python experiments/concealed/ceiling.py --half dev --out out/concealed --cases dev-07 dev-12

No diagnosis leaves less than this. More than the noise is the simulation's own error, which a search would explain with
effects that nobody concealed: at the steps that a fit takes, and at a quarter of them, errors over noise should be 1.
Rigs whose friction wanders, and laws that the catalogue does not have, are left out.
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np

import jbridge
from cases import MASTER
from jbridge.identify.base import channel_errors
from jbridge.identify.lanes import Batch
from jbridge.identify.linearise import Engine
from jbridge.identify.setting import lanes_for, make_setting, resolve
from jbridge.identify.solve import solve
from jbridge.model.bridge import Bridge
from jbridge.model.effects.catalogue import KINDS, make_effect
from jbridge.model.plant import Plant
from play import write
from run import ROOT, recordings
from seal import SEALS, open_truths

FINER = 4


def has_no_ceiling(truth: dict) -> str:
    """Why a truth's simulation need not meet its recordings; empty where it should."""
    if truth.get("wander"):
        return "its friction wanders"
    strange = sorted({effect["kind"] for effect in truth["effects"]} - set(KINDS))
    return f"the catalogue has no {', '.join(strange)}" if strange else ""


def true_plant(truth: dict) -> Plant:
    """The bridge and the effects that a case was played with."""
    parts = [dict(effect) for effect in truth["effects"]]
    effects = tuple(make_effect(part.pop("kind"), part.pop("site"), part) for part in parts)
    return Plant(Bridge(**truth["bridge"]), effects)


def left_by_the_truth(truth: dict, case: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Errors over noise of each channel in free runs over the training recordings, and with finer steps."""
    given = jbridge.load_model(case / "model.toml")
    train = jbridge.load_recordings(recordings(case, "train"))
    setting = make_setting(given, train, jbridge.load_recordings(recordings(case, "holdout")))
    plant = resolve(true_plant(truth), setting.length)
    engine = Engine(plant)
    vector = np.array(engine.table.ravel(plant), dtype=float)
    nothing = [np.zeros(0, np.int64)]

    def errors(batch: Batch) -> dict[str, float]:
        fits = solve(engine, batch, vector[None], nothing, initial=batch.initial[None], columns=8, iterations=12)
        return channel_errors(batch, fits.gram.predicted[0], over_noise=True)

    batch = lanes_for(engine.table, plant, setting, setting.recordings)
    return errors(batch), errors(dataclasses.replace(batch, substeps=FINER * batch.substeps))


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
        told = ", ".join(f"{axis} {usual[axis]:.2f} ({fine[axis]:.2f})" for axis in usual)
        print(f"{name}  {concealed}: {told}", flush=True)


if __name__ == "__main__":
    main()
