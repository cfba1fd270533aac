"""Does a simulation ever end in NaN without saying so? Up to a million random bridges, as four sweeps.

    python experiments/random_rollouts.py                   a million rollouts: hours
    python experiments/random_rollouts.py --gpu             the same on a graphics processor: minutes
    python experiments/random_rollouts.py --count 10000     fewer
    python experiments/random_rollouts.py --figures         redraw the table from figures/data/random-rollouts.json

Every bridge has thirty effects, and in three of the sweeps a mechanism besides: a belt, an elastic rope, a second
pendulum. Each number is drawn, evenly in its logarithm, from a tenth to ten times a usual value (masses, gains and
dampings of the bridge from a third to three times; places and times are held). The paper's controllers move the load;
most of these bridges stick, hit their end stops or swing wildly. A rollout that runs away must be marked.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import jbridge

ROOT = Path(__file__).parents[1]
DATA, TABLE = ROOT / "figures" / "data" / "random-rollouts.json", ROOT / "figures" / "random-rollouts-table.md"
BRIDGE = {
    "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "cart_damping": 45.0, "swing_damping": 0.0015,
    "hoist_damping": 25.0, "cart_gain": 16.0, "hoist_gain": 3.0,
}  # fmt: skip
EFFECTS: dict[str, dict[str, float]] = {
    "coulomb_friction@cart": {"level": 3.0},
    "coulomb_friction@swing": {"level": 5e-4},
    "direction_dependent_friction@hoist": {"positive": 2.0, "negative": 2.5},
    "load_dependent_friction@hoist": {"level": 0.3, "share": 0.1},
    "quadratic_drag@cart": {"coefficient": 10.0},
    "quadratic_drag@hoist": {"coefficient": 20.0},
    "friction_drift@cart": {"level": 0.3, "rate": 0.05},
    "constant_force@cart": {"level": 1.0},
    "spring_force@cart": {"stiffness": 5.0, "rest": 0.5},
    "periodic_force@cart": {"amplitude": 0.7, "period": 0.05, "phase": 0.5},
    "end_stop@cart": {"position": 0.9, "stiffness": 5e3, "damping": 30.0},
    "load_drag@swing": {"coefficient": 0.03},
    "wind@swing": {"force": 0.05, "start": 2.0, "stop": 3.0},
    "length_dependent_damping@swing": {"slope": 2e-3, "length": 0.4},
    "power_law_damping@swing": {"coefficient": 1e-3, "exponent": 1.5},
    "dead_zone@cart_drive": {"positive": 0.25, "negative": 0.3},
    "dead_zone@hoist_drive": {"positive": 0.3, "negative": 0.2},
    "saturation@cart_drive": {"limit": 5.0},
    "input_delay@cart_drive": {"delay": 0.02},
    "input_delay@hoist_drive": {"delay": 0.01},
    "start_delay@cart_drive": {"delay": 0.02},
    "actuator_lag@hoist_drive": {"time_constant": 0.05},
    "gain_drift@cart_drive": {"rate": 0.01},
    "drum_radius_change@hoist_drive": {"slope": 0.2, "length": 0.4},
    "force_limit@hoist_drive": {"limit": 20.0},
    "back_emf@cart_drive": {"constant": 1.0},
    "freewheeling@hoist_drive": {"constant": 1.0, "width": 0.2},
    "torque_ripple@cart_drive": {"amplitude": 0.05, "period": 0.04, "phase": 1.0},
    "sensor_scale@x_sensor": {"scale": 1.0},
    "sensor_delay@psi_sensor": {"delay": 0.01},
    "sensor_eccentricity@l_sensor": {"amplitude": 1e-3, "period": 0.1, "phase": 0.2},
    "missed_counts@x_sensor": {"jump": 0.01, "time": 3.0},
}
MECHANISMS: dict[str, dict[str, dict[str, float]]] = {
    "no mechanism": {},
    "belt": {"belt_compliance@cart": {"stiffness": 2e4, "damping": 20.0, "motor_mass": 0.5}},
    "elastic rope": {"rope_elasticity@hoist": {"stiffness": 3e3, "damping": 3.0}},
    "second pendulum": {"double_pendulum@swing": {"hook_mass": 0.015, "link": 0.1, "damping": 1e-4}},
}
OWN_FACTORS = {
    "sensor_scale@x_sensor.scale": 2.0, "power_law_damping@swing.exponent": 1.7,
    "load_dependent_friction@hoist.share": 5.0, "belt_compliance@cart.motor_mass": 3.0,
    "double_pendulum@swing.hook_mass": 3.0,
}  # fmt: skip
"""Numbers with a range of their own: the factor up and down."""
CHUNK, ON_GPU = 4096, 125_000
"""Rollouts in a chunk, on a processor and on a graphics processor."""
HELD = {"position", "start", "stop", "length", "rest", "phase", "time"}
"""Keys of numbers that are not drawn: places and times."""


def model_text(bridge: dict[str, float], effects: dict[str, dict[str, float]]) -> str:
    """A model file of a bridge with effects, each by `kind@site`."""
    lines = ["[bridge]", *(f"{key} = {value}" for key, value in bridge.items())]
    for name, values in effects.items():
        kind, site = name.split("@")
        lines += ["[[effect]]", f'kind = "{kind}"', f'site = "{site}"', *(f"{k} = {v}" for k, v in values.items())]
    return "\n".join(lines) + "\n"


def specification(folder: Path, mechanism: dict[str, dict[str, float]], count: int, seed: int, gpu: bool) -> Path:
    """Writes model and sweep."""
    vary = [(key, value, 3.0) for key, value in BRIDGE.items()]
    for name, values in (EFFECTS | mechanism).items():
        vary += [(f"{name}.{k}", v, OWN_FACTORS.get(f"{name}.{k}", 10.0)) for k, v in values.items() if k not in HELD]
    (folder / "model.toml").write_text(model_text({"gravity": 9.81, **BRIDGE}, EFFECTS | mechanism))
    sweep = [
        'model = "model.toml"', f"chunk = {ON_GPU if gpu else CHUNK}",
        "[reference]", "rest = 1.0", "speed = [0.6, 0.4]",
        "[sample]", 'kind = "random"', f"count = {count}", f"seed = {seed}",
    ]  # fmt: skip
    for name, value, factor in vary:
        sweep += ["[[vary]]", f'name = "{name}"', f"low = {value / factor}", f"high = {value * factor}", "log = true"]
    path = folder / "sweep.toml"
    path.write_text("\n".join(sweep) + "\n")
    return path


def measured(name: str, count: int, seed: int, gpu: bool = False) -> dict[str, Any]:
    """One sweep: how many rollouts were marked, and how many have a number that is not finite although they are not."""
    with tempfile.TemporaryDirectory() as folder:
        question = jbridge.load_sweep(specification(Path(folder), MECHANISMS[name], count, seed, gpu))
        result = jbridge.run_sweep(question, Path(folder) / "results")
        table = jbridge.read_sweep(Path(folder) / "results")
    sound = np.asarray(table["sound"], bool)
    silent = np.zeros(len(sound), bool)
    for column, values in table.items():
        if not column.startswith("settling") and np.issubdtype(np.asarray(values).dtype, np.floating):
            silent |= sound & ~np.isfinite(values)
    return {
        "varied": len(question.design.axes), "rollouts": len(sound), "marked": int(np.sum(~sound)),
        "silent": int(silent.sum()), "seconds": round(result.seconds),
    }  # fmt: skip


def table(kept: dict[str, Any]) -> str:
    lines = [
        "# Random rollouts", "",
        "Bridges with thirty effects under the paper's controllers. Numbers are drawn from a tenth to ten times usual",
        "values, those of the bridge from a third to three times. Marked: it ran away, and its row says so.",
        "Silent: NaN or an infinite number in a row that is not marked. Redrawn by",
        "`python experiments/random_rollouts.py --figures`; do not edit.", "",
        "| bridges with | numbers drawn | rollouts | marked | silent | s |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for name, row in kept.items():
        counts = f"{row['varied']} | {row['rollouts']:,} | {row['marked']:,} | {row['silent']:,} | {row['seconds']}"
        lines.append(f"| {name} | {counts} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1_000_000, help="rollouts (default: %(default)d)")
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn (default: %(default)d)")
    parser.add_argument("--gpu", action="store_true", help="on a graphics processor")
    parser.add_argument("--figures", action="store_true", help="only redraw")
    arguments = parser.parse_args()
    if not arguments.figures:
        jbridge.set_up(True, gpu=arguments.gpu)
        kept = {}
        for number, name in enumerate(MECHANISMS):
            kept[name] = measured(
                name, max(arguments.count // len(MECHANISMS), 1), arguments.seed + number, arguments.gpu
            )
            print(name, kept[name], flush=True)
        DATA.write_text(json.dumps(kept, indent=1) + "\n")
    TABLE.write_text(table(json.loads(DATA.read_text())))


if __name__ == "__main__":
    main()
