"""The paper's experiments, one after the other: record, estimate, validate, control.

    python experiments/paper/run.py                 all but the last stage, from scratch (needs the extra `proof`)
    python experiments/paper/run.py --only record   one stage: record, estimate, validate, control, starts, diagnose
    python experiments/paper/run.py --figures       only redraws the figures and the table from what is kept

Recordings and fits go below out/paper; what the figures show goes to figures/data/paper.json. Whatever the paper
calls the real device is here the virtual rig (`virtual.py`).
"""

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np

import jbridge
from figures import draw
from procedure import plan, steps
from virtual import HERE, RAIL, open_truth, play, sampled

ROOT = HERE.parent.parent
OUT = ROOT / "out" / "paper"
DATA = ROOT / "figures" / "data" / "paper.json"
PARTITIONS = np.linspace(*RAIL, 7)
"""Partitions of the rail in which friction is compared."""
STAGES = ("record", "estimate", "validate", "control", "starts", "diagnose")
CART_TESTS = ("ramps-1", "ramps-3", "decay-0.7")
"""Tests of the cart and the swing alone."""
HOIST_NUMBERS = (
    "hoist_damping", "hoist_gain", "coulomb_friction@hoist.level", "dead_zone@hoist_drive.positive",
    "dead_zone@hoist_drive.negative", "actuator_lag@hoist_drive.time_constant",
)  # fmt: skip
KEEP = 4
"""Every so many samples of 5 ms are kept for the figures."""


def record() -> None:
    """Ramps, decays, winch tests, and the steps of Figure 4."""
    folder = OUT / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    for number, (name, law, seconds, start) in enumerate(plan()):
        jbridge.save_csv(folder / f"{name}.csv", play(law, seconds, 100 + number, **start))
        print(f"{name}: {seconds:g} s", flush=True)
    jbridge.save_csv(OUT / "steps.csv", play(steps(2.0, 1.2, 1.0), 7.0, 7, x=0.3, l=0.7))


def estimate() -> None:
    """All unknown numbers from all tests together, the friction table among them."""
    model = jbridge.load_model(HERE / "guess.toml")
    recordings = jbridge.load_recordings(sorted((OUT / "recordings").glob("*.csv")))
    result = jbridge.fit(model, recordings)
    jbridge.save_fit(OUT / "fitted", result)
    print(jbridge.describe_fit(result, OUT / "fitted"))


def validate() -> dict:
    """Figure 4: the steps, before and after the estimation; and the numbers found beside the rig's own."""
    recording = jbridge.load_recording(OUT / "steps.csv")
    shown = {"rig": columns(OUT / "steps.csv")}
    for name, path in (("before", HERE / "guess.toml"), ("after", OUT / "fitted" / "model.toml")):
        table = jbridge.simulate(jbridge.load_model(path), recording, "first-row")
        shown[name] = {key: values[::KEEP].tolist() for key, values in table.items()}
    return {"steps": shown, "friction": friction(), "numbers": numbers()}


def starts() -> dict:
    """The friction table and the damping from 64 random starts in one call: do they arrive at one place?"""
    guess, fitted = (jbridge.load_model(path) for path in (HERE / "guess.toml", OUT / "fitted" / "model.toml"))
    # In these tests the rope is at rest, and what moves it would be free to go anywhere.
    bridge = dataclasses.replace(
        guess.plant.bridge, **{name: getattr(fitted.plant.bridge, name) for name in ("hoist_damping", "hoist_gain")}
    )
    effects = [
        theirs if "hoist" in mine.site else mine
        for mine, theirs in zip(guess.plant.effects, fitted.plant.effects, strict=True)
    ]
    model = dataclasses.replace(
        guess, plant=jbridge.Plant(bridge, tuple(effects)), known=guess.known | set(HOIST_NUMBERS)
    )
    recordings = jbridge.load_recordings([OUT / "recordings" / f"{name}.csv" for name in CART_TESTS])
    found = jbridge.fit_from_many(model, recordings, starts=64, spread=0.5, iterations=25)
    arrived = found.arrived()
    print(f"{arrived.sum()} of 64 starts within 1 % of the best error; spread of their numbers:")
    numbers = []
    for k, name in enumerate(found.names):
        own = found.found[arrived, k]
        spread = float(np.ptp(own) / abs(np.median(own)))
        print(f"  {name}: {np.median(own):.4g}, {100 * spread:.2g} %")
        numbers.append({"name": name, "start": found.starts[:, k].tolist(), "found": found.found[:, k].tolist()})
    return {"starts": {"ratios": found.ratios.tolist(), "numbers": numbers, "window": found.window}}


def columns(path: Path) -> dict[str, list[float]]:
    recording = jbridge.load_recording(path)
    found = {"t": recording.times - recording.times[0]}
    found |= {name: getattr(recording, name) for name in ("u_x", "u_l", "x", "psi", "l")}
    return {name: np.asarray(values)[::KEEP].tolist() for name, values in found.items()}


def friction() -> list[dict]:
    """Mean friction of each partition and direction: the rig's own, found, and the error."""
    truth = next(e for e in open_truth()["effects"] if e["kind"] == "position_direction_friction")
    found = json.loads((OUT / "fitted" / "fit.json").read_text())["model_effects"]
    table = next(e for e in found if e["kind"] == "position_direction_friction")["parameters"]
    rows = []
    for low, high in zip(PARTITIONS, PARTITIONS[1:], strict=False):
        # The cart's tests do not reach the last centimetres of the rail.
        places = np.linspace(max(low, RAIL[0] + 0.08), min(high, RAIL[1] - 0.08), 200)
        for side in ("positive", "negative"):
            own = float(np.mean(np.interp(places, truth["knots"], truth[side])))
            mine = float(np.mean(np.interp(places, table["knots"]["value"], table[side]["value"])))
            rows.append({"low": low, "high": high, "side": side, "rig": own, "found": mine, "error": mine / own - 1})
    return rows


def numbers() -> list[dict]:
    """Every other number, the rig's own and found, with its interval."""
    truth, fitted = open_truth(), json.loads((OUT / "fitted" / "fit.json").read_text())
    rows = []
    for key, own in truth["bridge"].items():
        rows.append({"name": key, "rig": own, **fitted["bridge"][key]})
    for effect in fitted["model_effects"]:
        own = next(e for e in truth["effects"] if (e["kind"], e["site"]) == (effect["kind"], effect["site"]))
        for key, found in effect["parameters"].items():
            if not isinstance(found["value"], list):
                rows.append({"name": f"{effect['kind']}@{effect['site']}.{key}", "rig": own[key], **found})
    return rows


def control() -> dict:
    """Figures 8 to 10: the tracking experiment on the fitted model and on the virtual rig, same controllers."""
    controller = jbridge.Controller(jbridge.paper_controller())
    path = jbridge.paper_path(controller.period)
    model = jbridge.load_model(OUT / "fitted" / "model.toml")
    tracking = jbridge.track(model, controller, path, noise=(0.0, 0.0, 0.0))
    table = play(sampled(controller, path), float(path.times[-1]), 11, x=float(path.x[0]), l=float(path.l[0]))
    every = round(controller.period / 0.005)
    rig = {name: values[::every][: len(path.times)] for name, values in table.items()}
    simulated = {"t": path.times, **tracking.measured, **tracking.command}
    moves = {
        name: [
            dataclasses.asdict(m)
            for m in jbridge.moves(
                path.times,
                np.stack([path.x, path.l], 1),
                np.stack([run[k] for k in ("x", "psi", "l")], 1),
                np.stack([run["u_x"], run["u_l"]], 1),
            )
        ]
        for name, run in (("model", simulated), ("rig", rig))
    }
    rms = {axis: float(np.sqrt(np.mean((simulated[axis] - rig[axis]) ** 2))) for axis in ("x", "psi", "l")}
    return {
        "tracking": {
            "reference": {"t": path.times.tolist(), "x": path.x.tolist(), "l": path.l.tolist()},
            "model": listed(simulated), "rig": listed(rig), "moves": moves, "rms": rms,
        }
    }  # fmt: skip


def listed(run: dict) -> dict[str, list[float]]:
    return {name: np.asarray(values).tolist() for name, values in run.items()}


def diagnose() -> dict:
    """The same tests, given to `diagnose` with a viscous model: what does it say is missing?"""
    model = jbridge.load_model(HERE / "viscous.toml")
    recordings = jbridge.load_recordings(sorted((OUT / "recordings").glob("*.csv")))
    result = jbridge.diagnose(model, recordings, [jbridge.load_recording(OUT / "steps.csv")])
    jbridge.save_report(OUT / "diagnosis", result)
    print(jbridge.describe_diagnosis(result, OUT / "diagnosis"))
    return {
        "diagnosis": {
            "verdict": result.verdict,
            "effects": [[e.kind, e.site] for e in result.effects],
            "seconds": result.seconds,
        }
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=STAGES, action="append", help="these stages, of what is there already")
    parser.add_argument("--figures", action="store_true", help="only redraw")
    arguments = parser.parse_args()
    chosen = [] if arguments.figures else arguments.only or [stage for stage in STAGES if stage != "diagnose"]
    jbridge.set_up()
    DATA.parent.mkdir(parents=True, exist_ok=True)
    for stage in chosen:
        print(f"-- {stage}", flush=True)
        found = globals()[stage]() or {}
        saved = json.loads(DATA.read_text()) if DATA.exists() else {}
        DATA.write_text(json.dumps(saved | found, indent=None) + "\n")
    draw(json.loads(DATA.read_text()), DATA.parent.parent)


if __name__ == "__main__":
    main()
