"""Controllers tuned and compared on the same bridges: the paper's rules, extended rules, PID, LQR, input shaping.

    python experiments/tuning/run.py                  all of it (extra `proof`; after experiments/paper/run.py)
    python experiments/tuning/run.py --only paper     one controller
    python experiments/tuning/run.py --figures        table and pictures from the kept numbers

Everything is tuned on the model that experiments/paper/run.py has fitted, scattered into an ensemble; rivals are given
as many rollouts as ours. What counts is measured with the textbook's inference on bridges and moves that took no part,
and on the virtual rig. Numbers are kept in figures/data/tuning.json, tuned controllers below out/tuning.
"""

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path += [str(HERE.parent), str(HERE.parent / "paper")]

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from version import commit  # noqa: E402

import jbridge  # noqa: E402
from comparison import draw  # noqa: E402
from on_rig import on_rig  # noqa: E402
from rivals import lqr_gains, population  # noqa: E402

DATA = ROOT / "figures" / "data" / "tuning.json"
OUT = ROOT / "out" / "tuning"
MEASURES = (
    "settling_load", "residual_swing", "itae_x", "itae_l", "chatter_x", "chatter_l", "sign_changes_x",
    "sign_changes_l",
)  # fmt: skip
"""What is kept of every held-out bridge and move."""
FITTED = ROOT / "out" / "paper" / "fitted" / "model.toml"
PLANTS, HELD_OUT, STEPS, STARTS, SEED, PERIOD = 64, 200, 200, 2, 0, 0.02
ROLLOUTS_OF_A_GRADIENT = 5
"""As how many rollouts an evaluation of a descent counts. A value with its gradient costs five to seven; the few
judgements on the way cost one, and count as much. A gradient by differences would take as many as there are numbers."""
HELD_OUT_SEED = 77
CONTROLLERS = (
    "paper", "paper scaled", "paper scaled, compensated", "paper tuned", "extended", "extended tuned",
    "extended CMA-ES", "PID tuned", "PID tuned, ZV", "PID tuned, ZVD", "LQR",
)  # fmt: skip


class Bench:
    """Courses to tune on and to measure on."""

    def __init__(self) -> None:
        self.model = jbridge.load_model(FITTED)
        plant, given = self.model.plant, self.model.uncertainty
        self.noise = jbridge.Scatter().noise
        rows = jbridge.scattered(plant, PLANTS, SEED, uncertainty=given)
        self.train = jbridge.Course(plant, rows, jbridge.mixed_legs(PLANTS, SEED), PERIOD, noise=self.noise)
        self.others = jbridge.scattered(plant, HELD_OUT + 1, HELD_OUT_SEED, uncertainty=given)[1:]
        self.moves = jbridge.random_legs(4, HELD_OUT_SEED, bridges=HELD_OUT)


def controllers(bench: Bench, wanted: set[str]) -> None:
    """Tunes and measures what is wanted; results are kept one by one."""
    tuned: dict[str, object] = {}
    budget = PLANTS * 2 * (STEPS + STARTS * STEPS // 5) * ROLLOUTS_OF_A_GRADIENT

    def by_gradient(name: str, law: object) -> object:
        found = jbridge.tune(
            bench.model, jbridge.Controller(law, PERIOD), plants=PLANTS, steps=STEPS, starts=STARTS, seed=SEED,
            held_out=8, prepare=shaper(name, bench), progress=told,
        )  # fmt: skip
        keep("tuning", name, {
            "history": found.history, "softness": found.softness, "seconds": found.seconds,
            "rollouts": found.rollouts * ROLLOUTS_OF_A_GRADIENT, "coordinates": found.coordinates,
            "costs": found.costs["train"],
        })  # fmt: skip
        return found.controller.law

    def by_population(name: str, law_of, begin: np.ndarray, spread: np.ndarray, bounds) -> object:
        cost = jbridge.Cost(bench.train, jbridge.usual_goal())
        begun = time.perf_counter()
        best, history = population(
            lambda z: cost.of(law_of(z)), begin, spread, bounds, budget // cost.count, SEED, told
        )
        keep("tuning", name, {
            "history": history, "seconds": time.perf_counter() - begun, "rollouts": len(history) * cost.count,
            "costs": (history[0], history[-1]),
        })  # fmt: skip
        return law_of(best)

    def knobs_by_population(name: str, knobs: jbridge.FuzzyKnobs) -> object:
        spread = np.array([knob.spread for knob in knobs.knobs])
        return by_population(name, lambda z: knobs.set(jnp.asarray(z)), np.zeros(len(spread)), spread, knobs.bounds())

    def law(name: str) -> object:
        """A controller by name, tuned if it is not yet."""
        if name in tuned:
            return tuned[name]
        if name == "paper":
            found: object = jbridge.paper_controller()
        elif name == "extended":
            found = jbridge.extended_controller(jbridge.compensation_for(bench.model.plant))
        elif name == "paper scaled":
            found = knobs_by_population(name, jbridge.FuzzyKnobs(law("paper"), weights=False, sets=False))
        elif name == "paper scaled, compensated":
            given = dataclasses.replace(law("paper"), compensation=jbridge.compensation_for(bench.model.plant))
            found = knobs_by_population(name, jbridge.FuzzyKnobs(given, weights=False, sets=False))
        elif name == "extended CMA-ES":
            found = knobs_by_population(name, jbridge.FuzzyKnobs(law("extended")))
        elif name in ("paper tuned", "extended tuned"):
            found = by_gradient(name, law(name.removesuffix(" tuned")))
        elif name.startswith("PID tuned"):
            found = by_gradient(name, jbridge.Pid(compensation=jbridge.compensation_for(bench.model.plant)))
        else:
            weights = lqr_gains(bench.model.plant, PERIOD)

            def law_of(z: np.ndarray) -> jbridge.StateFeedback:
                return jbridge.StateFeedback(
                    jnp.asarray(weights(z[:8])),
                    compensation=jbridge.compensation_for(bench.model.plant, float(z[8])),
                )

            bounds = np.array([-8.0] * 8 + [0.0]), np.array([8.0] * 8 + [1.0])
            found = by_population(name, law_of, np.array([0.0] * 8 + [0.8]), np.array([1.0] * 8 + [0.1]), bounds)
        tuned[name] = found
        return found

    for name in filter(wanted.__contains__, CONTROLLERS):
        compare(name, law(name), bench)


def compare(name: str, law: object, bench: Bench) -> None:
    """Measures a controller on held-out bridges and on the rig."""
    if isinstance(law, jbridge.FuzzyController):
        OUT.mkdir(parents=True, exist_ok=True)
        file = OUT / f"{name.replace(',', '').replace(' ', '-')}.toml"
        jbridge.save_controller(file, jbridge.Controller(law, PERIOD))
    prepare = shaper(name, bench)
    held_out = jbridge.Course(bench.model.plant, bench.others, bench.moves, PERIOD, prepare, bench.noise)
    measured = jbridge.measure(held_out, law)
    moves = jbridge.Course(bench.model.plant, bench.train.rows[:1], jbridge.paper_legs(), PERIOD, prepare)
    rig = on_rig(jbridge.Controller(law, PERIOD), moves)
    keep("controllers", name, {"measures": {"held_out": {key: measured[key] for key in MEASURES}}, "rig": rig})
    told(f"{name}: settled on the rig {[run['settling'] for run in rig]}")


def shaper(name: str, bench: Bench):
    """Shapes the reference for the swing's frequency at the middle of the move's rope lengths."""
    if "ZV" not in name:
        return None
    kind = name.rpartition(" ")[2].lower()
    gravity = float(bench.model.plant.bridge.gravity)

    def prepare(path: jbridge.Path) -> jbridge.Path:
        length = 0.5 * (path.l[0] + path.l[-1])
        return jbridge.shaped(path, float(np.sqrt(gravity / length)), kind=kind)

    return prepare


def told(text: str) -> None:
    print(f"  {text}", file=sys.stderr, flush=True)


def keep(section: str, name: str, value: dict) -> None:
    kept = json.loads(DATA.read_text()) if DATA.exists() else {}
    own = kept.get(section, {}) | {name: rounded(value)}
    # In a fixed order, and without what is compared no more.
    kept[section] = {key: own[key] for key in CONTROLLERS if key in own}
    kept["settings"] = {
        "plants": PLANTS, "held_out": HELD_OUT, "steps": STEPS, "starts": STARTS, "seed": SEED,
        "held_out_seed": HELD_OUT_SEED, "period": PERIOD, "commit": commit(),
    }  # fmt: skip
    DATA.write_text(json.dumps(kept, separators=(",", ":")) + "\n")


def rounded(value: object) -> object:
    if isinstance(value, dict):
        return {str(key): rounded(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [rounded(entry) for entry in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.4g}") if np.isfinite(value) else None
    return value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=CONTROLLERS, action="append", help="these controllers")
    parser.add_argument("--figures", action="store_true", help="only redraw table and pictures")
    arguments = parser.parse_args()
    if not arguments.figures:
        if not FITTED.exists():
            sys.exit(f"{FITTED.relative_to(ROOT)}: not there yet; run python experiments/paper/run.py first")
        jbridge.set_up()
        controllers(Bench(), set(arguments.only or CONTROLLERS))
    if DATA.exists():
        draw(json.loads(DATA.read_text()), ROOT / "figures")


if __name__ == "__main__":
    main()
