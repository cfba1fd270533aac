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
sys.path += [str(HERE.parent / "paper")]

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

import jbridge  # noqa: E402
from on_rig import on_rig  # noqa: E402
from rivals import lqr_gains, population  # noqa: E402

DATA = ROOT / "figures" / "data" / "tuning.json"
OUT = ROOT / "out" / "tuning"
MEASURES = ("settling_load", "residual_swing", "itae_x", "itae_l")
"""What is kept of every held-out bridge and move."""
FITTED = ROOT / "out" / "paper" / "fitted" / "model.toml"
PLANTS, HELD_OUT, STEPS, STARTS, SEED, PERIOD = 64, 200, 200, 2, 0, 0.02
ROLLOUTS_OF_A_GRADIENT = 5
"""What a value with its gradient costs, in rollouts: at most this, measured by experiments/throughput."""
CONTROLLERS = (
    "paper", "paper scaled", "paper tuned", "extended", "extended tuned", "extended tuned, 6 moves", "extended CMA-ES",
    "PID tuned", "PID tuned, ZV", "PID tuned, ZVD", "LQR",
)  # fmt: skip


class Bench:
    """Courses to tune on and to measure on."""

    def __init__(self) -> None:
        self.model = jbridge.load_model(FITTED)
        plant = self.model.plant
        self.train = jbridge.Course(plant, jbridge.scattered(plant, PLANTS, SEED), jbridge.paper_legs(), PERIOD)
        rows = jbridge.scattered(plant, HELD_OUT + 1, SEED + 1)[1:]
        self.held_out = jbridge.Course(plant, rows, jbridge.random_legs(4, SEED + 1), PERIOD)
        effects = {(e.kind, e.site): e for e in plant.effects}
        friction = effects["position_direction_friction", "cart"]
        level = float(np.mean([np.asarray(friction.positive), np.asarray(friction.negative)]))
        bridge = plant.bridge
        dead = [
            float(effects["dead_zone", f"{axis}_drive"].positive + effects["dead_zone", f"{axis}_drive"].negative) / 2
            for axis in ("cart", "hoist")
        ]
        hoist = float(effects["coulomb_friction", "hoist"].level)
        self.lost = (dead[0] + level / float(bridge.cart_gain), dead[1] + hoist / float(bridge.hoist_gain))
        self.bias = -float(bridge.load_mass * bridge.gravity / bridge.hoist_gain)
        """Voltage that holds the load."""

    def compensation(self, share: float = 0.8) -> jbridge.Compensation:
        # Full compensation of a friction that is smaller elsewhere would push by itself.
        cart, hoist = (share * lost for lost in self.lost)
        return jbridge.Compensation(cart=cart, hoist=hoist, hoist_bias=self.bias)


def controllers(bench: Bench, wanted: set[str]) -> None:
    """Tunes and measures what is wanted; results are kept one by one."""
    tuned: dict[str, object] = {}
    budget = PLANTS * 2 * (STEPS + STARTS * STEPS // 5) * ROLLOUTS_OF_A_GRADIENT

    def by_gradient(name: str, law: object, legs: jbridge.Legs | None = None, plants: int = PLANTS) -> object:
        found = jbridge.tune(
            bench.model, jbridge.Controller(law, PERIOD), legs=legs, plants=plants, steps=STEPS, starts=STARTS,
            seed=SEED, held_out=8, progress=told,
        )  # fmt: skip
        keep("tuning", name, {
            "history": found.history, "softness": found.softness, "seconds": found.seconds,
            "rollouts": found.rollouts * ROLLOUTS_OF_A_GRADIENT, "coordinates": found.coordinates,
        })  # fmt: skip
        return found.controller.law

    def by_population(
        name: str, law_of, low: np.ndarray, high: np.ndarray, cost: jbridge.Cost, rollouts: int
    ) -> object:
        begun = time.perf_counter()
        best, history = population(lambda z: cost.of(law_of(z)), low, high, rollouts // cost.count, SEED, told)
        keep("tuning", name, {"history": history, "seconds": time.perf_counter() - begun, "rollouts": rollouts})
        return law_of(best)

    def law(name: str) -> object:
        """A controller by name, tuned if it is not yet."""
        if name in tuned:
            return tuned[name]
        if name == "paper":
            found: object = jbridge.paper_controller()
        elif name == "extended":
            found = jbridge.extended_controller()
        elif name == "paper scaled":
            knobs = jbridge.FuzzyKnobs(jbridge.paper_controller(), weights=False, sets=False)
            cost = jbridge.Cost(bench.train, knobs, jbridge.usual_goal())
            found = by_population(name, lambda z: knobs.set(jnp.asarray(z)), *knobs.bounds(), cost, budget)
        elif name == "paper tuned":
            found = by_gradient(name, law("paper"))
        elif name == "extended tuned":
            found = by_gradient(name, law("extended"))
        elif name == "extended tuned, 6 moves":
            few, more = jbridge.paper_legs(), jbridge.random_legs(4, SEED + 7)
            legs = jbridge.Legs(np.concatenate([few.start, more.start]), np.concatenate([few.goal, more.goal]))
            found = by_gradient(name, law("extended"), legs, PLANTS // 3)
        elif name == "extended CMA-ES":
            knobs = jbridge.FuzzyKnobs(jbridge.extended_controller())
            cost = jbridge.Cost(bench.train, knobs, jbridge.usual_goal())
            found = by_population(name, lambda z: knobs.set(jnp.asarray(z)), *knobs.bounds(), cost, budget)
        elif name.startswith("PID tuned"):
            if "," in name:
                return law("PID tuned")
            found = by_gradient(name, jbridge.Pid(compensation=bench.compensation()))
        else:
            weights = lqr_gains(bench.model.plant, PERIOD)
            start = jbridge.StateFeedback(jnp.asarray(weights(np.zeros(8))), compensation=bench.compensation())
            cost = jbridge.Cost(bench.train, jbridge.knobs_of(jbridge.Pid()), jbridge.usual_goal())

            def law_of(z: np.ndarray) -> jbridge.StateFeedback:
                return dataclasses.replace(
                    start, gains=jnp.asarray(weights(z[:8])), compensation=bench.compensation(float(z[8]))
                )

            low, high = np.array([-8.0] * 8 + [0.0]), np.array([8.0] * 8 + [1.0])
            found = by_population(name, law_of, low, high, cost, budget)
        tuned[name] = found
        return found

    for name in CONTROLLERS:
        if name not in wanted:
            continue
        found = law(name)
        if isinstance(found, jbridge.FuzzyController):
            OUT.mkdir(parents=True, exist_ok=True)
            jbridge.save_controller(
                OUT / f"{name.replace(',', '').replace(' ', '-')}.toml", jbridge.Controller(found, PERIOD)
            )
        prepare = shaper(name, bench)
        held_out = jbridge.Course(bench.model.plant, bench.held_out.rows, bench.held_out.legs, PERIOD, prepare)
        measured = jbridge.measure(held_out, found)
        train = jbridge.Course(bench.model.plant, bench.train.rows[:1], bench.train.legs, PERIOD, prepare)
        rig = on_rig(jbridge.Controller(found, PERIOD), train)
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
    kept.setdefault(section, {})[name] = rounded(value)
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
        jbridge.set_up(whole_loops=True)
        controllers(Bench(), set(arguments.only or CONTROLLERS))
    if DATA.exists():
        jbridge.save_comparison(ROOT / "figures", DATA, OUT)


if __name__ == "__main__":
    main()
