"""Plays a case on the rig and writes what its owner would have: model.toml, recordings, sidecars."""

import shutil
from pathlib import Path

import numpy as np

from inputs import Controller, Hand, Operator, Rest, Sines
from rig import simulate

COLUMNS = {
    ("full", "winch"): ("t", "u_x", "u_l", "x", "psi", "l"),
    ("full", "locked"): ("t", "u_x", "x", "psi"),
    ("cart", "locked"): ("t", "u_x", "x"),
    ("pendulum", "locked"): ("t", "psi"),
}
FORMAT = {"t": "%.9g", "u_x": "%.4f", "u_l": "%.4f", "x": "%.4f", "psi": "%.7f", "l": "%.4f"}
RAIL = (0.0, 1.5)


def _level(effects: list[dict], kind: str, site: str, name: str) -> float:
    return sum(e[name] for e in effects if e["kind"] == kind and e["site"] == site)


def commands(truth: dict, plan: dict, key: np.random.Generator, vigour: float = 1.0):
    """Whoever drives: a law from time and readings to voltages, the largest times `vigour`."""
    bridge, effects = truth["bridge"], truth["effects"]
    friction = _level(effects, "coulomb_friction", "cart", "level")
    friction += _level(effects, "presliding_friction", "cart", "level")
    dead = _level(effects, "dead_zone", "cart_drive", "positive")
    weight = bridge["load_mass"] * bridge["gravity"]
    rope_friction = _level(effects, "coulomb_friction", "hoist", "level")
    rope_dead = _level(effects, "dead_zone", "hoist_drive", "positive")
    hold = 0.0 if rope_friction > weight else -weight / bridge["hoist_gain"]
    lift = (rope_friction + (weight if rope_friction else 0.0)) / bridge["hoist_gain"] + rope_dead
    short, long = plan["range"]
    winch = truth["rope"] == "winch" and truth["parts"] == "full"

    def cart_speed(volts: float, direction: float) -> float:
        return (bridge["cart_gain"] * (volts - dead) - friction) / bridge["cart_damping"]

    def rope_speed(volts: float, direction: float) -> float:
        net = bridge["hoist_gain"] * (volts - rope_dead) + direction * weight - rope_friction
        return net / bridge["hoist_damping"]

    least = friction / bridge["cart_gain"] + dead
    if plan["input"].startswith("controller"):
        limits = (3.5 * vigour, lift + 4.0)
        return Controller(key, plan["input"].removeprefix("controller-"), (0.35, 1.15), (short, long), limits, hold)
    if plan["input"] == "sines":
        cart = Sines(key, 0.75, (1.6 + 0.6 * least) * vigour, 2.0)
        hoist = Sines(key, 0.5 * (short + long), lift + 0.8, 12.0, hold, lift + 1.0) if winch else Rest()
        return Operator(cart, hoist)
    creep = (0.8 * least + 0.1, 1.25 * least + 0.3)
    cart = Hand(key, plan["input"], 0.2, 1.3, (least + 0.3, max(2.9 * vigour, least + 0.6)), creep, cart_speed)
    if not winch:
        return Operator(cart, Rest())
    style = "mixed" if plan["input"] in ("creep", "pulses") else plan["input"]
    volts = (lift + 0.5, lift + 4.0)
    return Operator(cart, Hand(key, style, short, long, volts, (lift, lift + 0.8), rope_speed, hold, busy=0.5))


def play(truth: dict, plan: dict) -> dict[str, np.ndarray]:
    """One recording's columns, played anew with less vigour if cart, rope or swing leave their range."""
    for attempt in range(12):
        seed = plan["seed"] + attempt
        law = (
            (lambda t, r: (0.0, 0.0))
            if plan["input"] == "none"
            else commands(truth, plan, np.random.default_rng(seed), 0.94**attempt)
        )
        table = simulate(truth, law, float(plan["seconds"]), seed, plan["start"])
        x, rope = table["x"], table["l"]
        on_rail = truth["parts"] == "pendulum" or (x.min() > RAIL[0] + 0.01 and x.max() < RAIL[1] - 0.01)
        if on_rail and rope.min() > 0.25 and rope.max() < 1.4 and np.abs(table["psi"]).max() < 0.9:
            return table
    raise RuntimeError(f"{plan['name']} leaves the rail with every seed tried; make its inputs smaller")


def _toml(value) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return repr(float(value))


def model_toml(model: dict) -> str:
    """The owner's model file."""
    rows = ["[bridge]"] + [f"{k} = {_toml(v)}" for k, v in model["bridge"].items()]
    for effect in model["effects"]:
        rows += ["", "[[effect]]"] + [f"{k} = {_toml(v)}" for k, v in effect.items()]
    return "\n".join(rows) + "\n"


def write(truth: dict, folder: Path, seal: str = "") -> Path:
    """Writes model and recordings below `folder` unless those of this seal are there; returns the case."""
    case = folder / truth["id"]
    done = case / "recordings" / ".done"
    if done.exists() and done.read_text() == seal:
        return case
    shutil.rmtree(case, ignore_errors=True)  # a diagnosis of other recordings would be worthless
    done.parent.mkdir(parents=True)
    (case / "model.toml").write_text(model_toml(truth["model"]))
    names = COLUMNS[truth["parts"], truth["rope"]]
    for plan in truth["recordings"]:
        table = play(truth, plan)
        path = done.parent / f"{plan['name']}.csv"
        rows = np.column_stack([table[c] for c in names])
        np.savetxt(path, rows, [FORMAT[c] for c in names], ",", header=",".join(names), comments="")
        if truth["rope"] == "locked" and truth["parts"] != "cart":
            path.with_suffix(".toml").write_text(f"[locked]\nl = {plan['start']['l']}\n")
    done.write_text(seal)
    return case
