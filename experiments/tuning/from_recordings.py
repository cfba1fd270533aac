"""From recordings of an unknown rig to a controller that moves it: does the tuned one beat the paper's, move by move?

    python experiments/tuning/from_recordings.py            two rigs (extra `proof`); a quarter of an hour on idle cores
    python experiments/tuning/from_recordings.py --rig 1    one of them
    python experiments/tuning/from_recordings.py --figures  table and picture from the kept numbers

Each rig is played by another engine (MuJoCo) and drawn from its seed: dry friction by place and direction, dead zones,
and drives that answer late. Its owner records seven runs, knows the masses, and has the paper's model with round
guesses, which has no delays and other knots. Then the commands are run as a user runs them: `jbridge fit` estimates the
model, `jbridge tune` makes the extended rules fit it, allowing for drives that answer up to 20 ms late. The rig plays
them, as given and tuned, and the paper's rules, in the paper's two moves and in six others. Numbers are kept in
figures/data/tuning-from-recordings.json; recordings, models and controllers below out/tuning/from-recordings, where
what is there already is not computed again.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path += [str(HERE.parent / "paper")]

import numpy as np  # noqa: E402

import jbridge  # noqa: E402
from every_move import draw  # noqa: E402
from on_rig import on_rig  # noqa: E402
from procedure import at_rest, ramps, winch  # noqa: E402
from virtual import Law, play  # noqa: E402
from virtual import draw as draw_truth  # noqa: E402

DATA = ROOT / "figures" / "data" / "tuning-from-recordings.json"
OUT = ROOT / "out" / "tuning" / "from-recordings"
MODEL = HERE.parent / "paper" / "guess.toml"
RIGS = (1, 2)
"""Seeds."""
DELAYS = (8, 20)
"""Shortest and longest delay of a drive [ms]."""
SEARCH = ("--plants", 32, "--steps", 100, "--starts", 1)
"""Half of the bridges and steps that `jbridge tune` takes by itself, and one start: a fifth of its time. The table says
what each rig's tuning took."""
HELD_OUT = "both-2"
KEEP = 2
"""Every so many samples of 20 ms are kept for the picture."""


def truth_of(seed: int) -> dict:
    """A rig with friction by place and direction, dead zones, and a delay in each drive instead of a lag."""
    truth = draw_truth(seed)
    key = np.random.default_rng([seed, 1])
    late = [
        {"kind": "input_delay", "site": site, "delay": float(f"{1e-3 * key.uniform(*DELAYS):.3g}")}
        for site in ("cart_drive", "hoist_drive")
    ]
    return truth | {"effects": [e for e in truth["effects"] if e["kind"] != "actuator_lag"] + late}


def both(cart: Law, hoist: Law) -> Law:
    """The cart driven by one law while the winch is driven by another."""
    return lambda t, reading: (cart(t, reading)[0], hoist(t, reading)[1])


def plan() -> list[tuple[str, Law, float, dict[str, float]]]:
    """Name, law, length [s] and start of every recording, the one that is held out among them."""
    return [
        ("cart-1", ramps(1.6, 0.6), 20.0, {"x": 0.0, "l": 0.7}),
        ("cart-2", ramps(2.0, 0.4, -1.0), 20.0, {"x": 1.3, "l": 0.4}),
        ("decay", at_rest, 10.0, {"x": 0.65, "psi": np.radians(12.0), "l": 0.6}),
        ("winch-1", winch(3.0, 0.5), 14.0, {"x": 0.65, "l": 0.3}),
        ("winch-2", winch(2.2, 0.8), 16.0, {"x": 0.65, "l": 0.8}),
        ("both-1", both(ramps(1.1, 1.0), winch(2.6, 0.6)), 20.0, {"x": 0.0, "l": 0.35}),
        (HELD_OUT, both(ramps(1.8, 0.5, -1.0), winch(2.4, 0.7)), 20.0, {"x": 1.3, "l": 0.5}),
    ]


def record(truth: dict, folder: Path) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for number, (name, law, seconds, start) in enumerate(plan()):
        files.append(folder / f"{name}.csv")
        jbridge.save_csv(files[-1], play(law, seconds, 100 + number, truth, **start))
    return files


def command(out: Path, *words: object) -> None:
    """Runs `jbridge` as a user does, unless its results are there."""
    if any(out.glob("*.html")):
        return
    print("jbridge", *words, "--out", out, flush=True)
    subprocess.run([sys.executable, "-m", "jbridge", *map(str, words), "--out", str(out), "--quiet"], check=True)


def legs() -> jbridge.Legs:
    """The paper's two moves and six others."""
    paper, others = jbridge.paper_legs(), jbridge.random_legs(6, 5)
    return jbridge.Legs(np.concatenate([paper.start, others.start]), np.concatenate([paper.goal, others.goal]))


def measured(seed: int) -> dict:
    """One rig from its recordings to its moves."""
    folder, truth = OUT / f"rig-{seed}", truth_of(seed)
    files = record(truth, folder / "recordings")
    used = [path for path in files if path.stem != HELD_OUT]
    held_out = [path for path in files if path.stem == HELD_OUT]
    command(folder / "fitted", "fit", MODEL, *used, "--holdout", *held_out)
    model = folder / "fitted" / "model.toml"
    command(folder / "tuned", "tune", model, "--rules", "extended", "--delay", DELAYS[1], *SEARCH)
    told = json.loads((folder / "tuned" / "tune.json").read_text())
    plant = jbridge.load_model(model).plant
    controllers = {
        "paper's rules": jbridge.Controller(jbridge.paper_controller()),
        "extended rules": jbridge.Controller(jbridge.extended_controller(jbridge.compensation_for(plant))),
        "extended rules tuned": jbridge.load_controller(folder / "tuned" / "controller.toml"),
    }
    moves = {}
    for name, own in controllers.items():
        course = jbridge.Course(plant, jbridge.scattered(plant, 1, 0), legs(), own.period)
        moves[name] = [shown(run) for run in on_rig(own, course, truth)]
    fitted = json.loads((folder / "fitted" / "fit.json").read_text())
    return {
        "truth": truth["effects"], "moves": moves, "holdout": fitted["fit"]["holdout"],
        "seconds": {"fit": fitted["seconds"], "tune": told["seconds"]},
        "search": {"bridges": len(told["measures"]["train"]["itae_x"]["after"]), "steps": len(told["history"])},
        "ensemble": on_ensemble(told["measures"]["held_out"]),
    }  # fmt: skip


def on_ensemble(held_out: dict) -> dict:
    """What became of held-out bridges and moves, before and after the tuning: moves never settled, travel of `u_x`."""
    return {
        when: {
            "never": sum(time is None for row in held_out["settling_load"][when] for time in row),
            "moves": sum(map(len, held_out["settling_load"][when])),
            "travel": float(np.mean(held_out["chatter_x"][when])),
        }
        for when in ("before", "after")
    }


def shown(run: dict) -> dict:
    """What table and picture need of a move."""
    path, wanted = run["run"], run["reference"]
    goal = [wanted[axis][-1] for axis in ("x", "l")]
    aside = path["x"] + path["l"] * np.sin(path["psi"]) - goal[0]
    kept = {key: run[key] for key in ("settling", "swing", "itae", "travel")}
    ends = {"from": [wanted["x"][0], wanted["l"][0]], "to": goal}
    lines = {"t": wanted["t"], "aside": aside, "wanted": wanted["x"] - goal[0]}
    return kept | ends | {name: [float(f"{v:.4g}") for v in values[::KEEP]] for name, values in lines.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", type=int, choices=RIGS, action="append", help="these rigs")
    parser.add_argument("--figures", action="store_true", help="only redraw table and picture")
    arguments = parser.parse_args()
    if not arguments.figures:
        jbridge.set_up()
        for seed in arguments.rig or RIGS:
            found = measured(seed)
            kept = json.loads(DATA.read_text()) if DATA.exists() else {}
            kept[str(seed)] = found
            DATA.write_text(json.dumps(dict(sorted(kept.items())), separators=(",", ":")) + "\n")
    draw(json.loads(DATA.read_text()), ROOT / "figures")


if __name__ == "__main__":
    main()
