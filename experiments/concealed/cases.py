"""The concealed cases: parts, each drawn from a seed of its own.

A case is a truth (numbers, effects, what was concealed, what a perfect answer would be), a model with wrong
numbers and without the concealed effects, and a plan of recordings. The `dev` half serves for choosing
settings, and so do `rough` and `hybrid`, which are closer to real rigs (`hybrid` is played where recordings of them
are at hand, see `recorded.py`); the `proof` half for the proof. `wide` is a larger proof, with every effect at three
severities, and `fresh` a smaller one for the method when it is done, each case once. Which case holds what is shuffled,
so a case's number says nothing.
"""

import hashlib
import json
from pathlib import Path

import numpy as np

from kinds import Draw, draw
from makeup import AXES, CLUTTER, HALVES, RECORDED
from uncatalogued import KINDS as UNKNOWN

HERE = Path(__file__).parent
MASTER = {"dev": 20240607, "proof": 77310185, "wide": 50421962, "rough": 60417253, "fresh": 91350746, "laws": 30918827,
          "hybrid": 48120659, "starts": 70351192, "coasts": 83106574, "blind": 32438002,
          "blind2": 59174336, "blind3": 74406921}  # fmt: skip
_SIZED = {"clutter": 60417254, "law-sizes": 30918828, "recorded": 48120660}
"""Drawn only to find sizes."""
KNOWN = ["cart_mass", "load_mass", "winch_mass", "gravity"]
AXIS = {"cart": "cart", "cart_drive": "cart", "x_sensor": "cart", "swing": "swing", "psi_sensor": "swing",
        "hoist": "hoist", "hoist_drive": "hoist", "l_sensor": "hoist", "clock": "swing"}  # fmt: skip
OWNED = {
    "full": ["coulomb_friction cart", "coulomb_friction hoist", "dead_zone cart_drive",
             "dead_zone hoist_drive", "actuator_lag hoist_drive"],
    "locked": ["coulomb_friction cart", "dead_zone cart_drive"],
    "cart": ["coulomb_friction cart", "dead_zone cart_drive"],
    "pendulum": [],
}  # fmt: skip
"""What each flavour of rig has and its owner's model knows of."""

SAME_SCALE = (
    "only the ratio of x to psi enters the swing equation; a common scale of x goes into gains, damping and"
    " friction, and what is left (the load's 3 % reaction, psi^3 terms) is below the noise"
)
EQUIVALENT = {
    "constant_force cart": [
        (
            "direction_dependent_friction cart",
            "a force c beside Coulomb F is Coulomb F - c and F + c by direction",
        )
    ],
    "direction_dependent_friction cart": [
        ("constant_force cart", "levels F - c and F + c are Coulomb F beside a constant force c")
    ],
    "sensor_scale x_sensor": [("sensor_scale psi_sensor", SAME_SCALE)],
    "sensor_scale psi_sensor": [("sensor_scale x_sensor", SAME_SCALE)],
    "sensor_offset psi_sensor": [
        (
            "wind swing",
            "a wind that always blows turns the vertical by F/(m2 g); its push on the cart is 0.01 N",
        )
    ],
    "force_limit cart_drive": [
        ("saturation cart_drive", "behind a dead zone alone, a limit of the input is one of the force")
    ],
    "load_dependent_friction swing": [
        ("coulomb_friction swing", "within small angles the pull on the pivot is the weight of one load")
    ],
    "input_delay hoist_drive": [
        (
            "sensor_delay l_sensor",
            "a late length is a late winch, but for the load's reaction on cart and swing",
        )
    ],
}
"""Answers as good as the truth, with the reason why recordings cannot tell them apart."""
_LATE = "with no other coordinate than the cart's, a late input is a late reading"
ALSO_EQUIVALENT = {
    ("full", "direction_dependent_friction hoist"): [
        ("constant_force hoist", "levels F - c and F + c are Coulomb F beside a constant force c")
    ],
    ("cart", "input_delay cart_drive"): [("sensor_delay x_sensor", _LATE)],
    ("cart", "sensor_delay x_sensor"): [("input_delay cart_drive", _LATE)],
}
"""More of them, by flavour."""
DECLARED_LATER = frozenset({"blind2", "blind3"})
"""Parts whose sealed truths have these answers; the scorer knows them for all parts."""
UNKNOWN_AXES = {"lift": ["swing", "hoist"]}
"""Where more than one equation feels an effect that has no name."""


def _bridge(d: Draw, names: list[str]) -> dict:
    bridge = {
        "cart_mass": d.u(4.8, 6.2), "load_mass": d.u(0.12, 0.22), "winch_mass": 0.1, "gravity": 9.81,
        "cart_damping": d.u(44, 60), "swing_damping": d.u(0.0016, 0.0026), "hoist_damping": d.u(20, 30),
        "cart_gain": d.u(15, 19), "hoist_gain": d.u(2.5, 3.2),
    }  # fmt: skip
    if "rope_elasticity hoist" in names:  # a light load would stretch the rope too little to see
        bridge["load_mass"] = d.u(0.35, 0.45)
    return bridge


def _owned(name: str, bridge: dict, d: Draw) -> dict:
    """The true table of an effect that every rig of its flavour has."""
    kind, site = name.split()
    dead = d.u(0.15, 0.35) if site == "cart_drive" else d.u(0.35, 0.55)
    weight = bridge["load_mass"] * bridge["gravity"]
    numbers = {
        "coulomb_friction": {"level": d.u(2.5, 4.5) if site == "cart" else round(weight + d.u(1.0, 1.8), 4)},
        "dead_zone": {"positive": dead, "negative": dead},
        "actuator_lag": {"time_constant": d.u(0.045, 0.075)},
    }[kind]
    return {"kind": kind, "site": site} | numbers


def _wrong(value: float, d: Draw) -> float:
    """A number off by 8 to 25 %, either way."""
    return float(f"{value * (1 + d.sign() * d.key.uniform(0.08, 0.25)):.4g}")


def _model(bridge: dict, effects: list[dict], flavour: str, d: Draw) -> dict:
    """What the owner believes: known numbers right, the rest guessed."""
    absent = {
        "full": [], "locked": ["hoist_damping", "hoist_gain", "winch_mass"],
        "cart": ["hoist_damping", "hoist_gain", "winch_mass", "load_mass", "gravity", "swing_damping"],
        "pendulum": ["hoist_damping", "hoist_gain", "winch_mass", "cart_mass", "cart_damping", "cart_gain"],
    }[flavour]  # fmt: skip
    numbers = {k: v if k in KNOWN else _wrong(v, d) for k, v in bridge.items() if k not in absent}
    guessed = []
    for e in effects:
        off = {k: _wrong(v, d) for k, v in e.items() if k not in ("kind", "site")}
        if "negative" in off:
            off["negative"] = off["positive"]
        guessed.append({"kind": e["kind"], "site": e["site"]} | off)
    return {"bridge": numbers | {"known": [k for k in KNOWN if k in numbers]}, "effects": guessed}


def _plan(flavour: str, loop: str, d: Draw) -> list[dict]:
    """Four to six recordings to learn from, one or two to prove on, with other inputs and rope lengths."""
    styles = ["steps", "pulses", "ramps", "mixed"] + ["staircase", "creep"][: int(d.key.integers(0, 3))]
    lengths = d.key.permutation([0.45, 0.55, 0.65, 0.75, 0.85, 0.6])
    plan = []
    for i, style in enumerate(styles):
        plan.append({"name": f"train-{i + 1}", "input": style if loop == "open" else "controller-steps",
                     "range": [0.4, 0.9], "start": {"l": round(float(lengths[i]), 3)}})  # fmt: skip
    for i in range(1 + int(d.key.integers(0, 2))):
        plan.append({"name": f"holdout-{i + 1}", "input": "sines" if loop == "open" else "controller-sines",
                     "range": [0.85, 1.15], "start": {"l": round(d.u(0.95, 1.05), 3)}})  # fmt: skip
    for recording in plan:
        recording["seconds"] = d.key.choice([12.0, 14.0, 16.0])
        recording["start"] |= {"x": round(d.u(0.5, 1.0), 3), "psi": 0.0}
        if flavour == "pendulum":
            recording |= {"input": "none"}
            recording["start"]["psi"] = round(d.sign() * d.u(0.12, 0.35), 3)
        recording["seed"] = int(d.key.integers(1, 2**31))
    return plan


def _scaled(name: str, error: float, sizes: dict) -> float:
    """A size that should leave some error over the noise, in proportion to what the same effect left elsewhere."""
    found = [v for k, v in sizes.items() if k.endswith(f": {name}")]
    rates = [np.log(v["error"] / v["size"]) for v in found]
    return float(f"{error / np.exp(np.mean(rates)):.3g}") if rates else 1.0


def _clutter(flavour: str, severity: float, sizes: dict, d: Draw) -> list[dict]:
    """Four to eight pieces of clutter (fewer where the rig has fewer sorts), each a tenth of the error or less."""
    sorts = [name for axis in AXES[flavour] for name in CLUTTER[axis]]
    chosen = d.key.permutation(sorts)[: d.key.integers(4, 9)].tolist()
    sized = [(name, _scaled(name, severity * d.u(0.03, 0.1), sizes)) for name in chosen]
    return [draw(*name.split(), d.key, size) for name, size in sized]


def _recorded(flavour: str, severity: float, sizes: dict, d: Draw) -> list[dict]:
    """What a real rig's recordings leave, on every axis, each a tenth of the error."""
    names = [name for name in RECORDED if name.split()[1] in AXES[flavour]]
    return [draw(*name.split(), d.key, _scaled(name, 0.1 * severity, sizes)) for name in names]


def _truth(half: str, line: str, key: np.random.Generator, sizes: dict) -> dict:
    d = Draw(key)
    words = line.split(maxsplit=1)
    flavour, rest = words[0], words[1]
    loop = "closed" if rest.endswith(" closed") else "open"
    rest, _, company = rest.removesuffix(" closed").partition(" in ")
    rest, _, severity = rest.partition(" at ")
    names = [] if rest.startswith("null") else rest.split(" + ")
    bridge = _bridge(d, names)
    owned = [_owned(name, bridge, d) for name in OWNED[flavour]]
    if names == ["presliding_friction cart"]:  # it is the friction, not a second one beside it
        owned = [e for e in owned if e["site"] != "cart"]
    model = _model(bridge, [e for e in owned if f"{e['kind']} {e['site']}" not in names], flavour, d)
    plan = _plan(flavour, loop, d)
    concealed = []
    for name in names:
        kind, site = name.split()
        mine = [e for e in owned if f"{e['kind']} {e['site']}" == name]
        if kind == "wrong_value":
            model["bridge"][site] = float(f"{bridge[site] * d.u(1.08, 1.2):.4g}")
            concealed.append({"kind": kind, "site": site, "value": bridge[site]})
        elif mine:
            concealed += mine
        else:
            own = sizes.get(f"{half}: {line}: {name}", {}).get("size")
            size = own or (_scaled(name, float(severity), sizes) if severity else 1.0)
            concealed.append(draw(kind, site, key, size))
    played = owned + [e for e in concealed if e["kind"] != "wrong_value" and e not in owned]
    if company:
        played += {"clutter": _clutter, "recorded forces": _recorded}[company](flavour, float(severity), sizes, d)
    catalogued = all(e["kind"] not in UNKNOWN for e in concealed)
    also = ALSO_EQUIVALENT if half in DECLARED_LATER else {}
    axes = [a for e in concealed for a in UNKNOWN_AXES.get(e["kind"], [AXIS.get(e["site"], "hoist")])]
    equivalents = [
        {"for": name, "kind": other.split()[0], "site": other.split()[1], "why": why}
        for name in names
        for other, why in (*EQUIVALENT.get(name, []), *(also.get((flavour, name), [])))
    ]
    axes += [AXIS[e["site"]] for e in equivalents if AXIS[e["site"]] not in axes]
    if names == ["wrong_value load_mass"]:  # it weighs on the rope and it pulls at the cart
        axes = ["hoist", "cart", "swing"]
    truth = {
        "half": half, "line": line, "flavour": flavour, "loop": loop, "bridge": bridge, "effects": played,
        "parts": {"locked": "full"}.get(flavour, flavour), "rope": "winch" if flavour == "full" else "locked",
        "model": model, "recordings": plan, "concealed": concealed, "equivalents": equivalents,
        "verdict": "adequate" if not concealed else "missing_physics" if catalogued else "unknown",
        "equations": sorted(set(axes)) or ["none"],
    }  # fmt: skip
    if "wander" in rest:
        truth["wander"] = 0.05
    if "rough" in rest:
        truth["noise"] = {
            "x": {"total": 6e-5, "correlation": 0.03},
            "psi": {"total": 9e-4, "correlation": 0.03},
        }
    return truth


def cases(half: str, sizes: dict | None = None) -> dict[str, dict]:
    """All truths of a half by id, the same on every machine. Sizes default to `sizes.json`."""
    sizes = json.loads((HERE / "sizes.json").read_text()) if sizes is None else sizes
    made, seed = HALVES[half], (MASTER | _SIZED)[half]
    order = np.random.default_rng(seed).permutation(len(made))
    found = {}
    for place, index in enumerate(order):
        digest = hashlib.sha256(f"{made[index]} {index}".encode()).digest()
        key = np.random.default_rng([seed, int.from_bytes(digest[:4])])
        truth = _truth(half, made[index], key, sizes)
        found[f"{half}-{place + 1:02d}"] = {"id": f"{half}-{place + 1:02d}"} | truth
    return found
