"""How large must a concealed effect be to matter? Sets `sizes.json`, one number per concealed effect.

For each effect alone: play the truth, refit the rig's unknown numbers without the effect (Gauss-Newton on
two recordings of the rig itself, free run, no noise), and take the largest channel's error on a hold-out
recording over its noise. The size is scaled until that ratio is near a target drawn between 6 and 25. Only
the rig is used, never the tool under test.

    python experiments/concealed/severity.py --half dev
"""

import argparse
import copy
import hashlib
import json
from pathlib import Path

import numpy as np

from cases import HERE, KNOWN, cases
from drives import SAMPLE
from kinds import KINDS
from play import COLUMNS, play
from rig import simulate
from sensors import NOISE
from uncatalogued import KINDS as UNKNOWN

FILE = HERE / "sizes.json"
UNSIZED = {"end_stop", "saturation", "rope_elasticity", "force_limit", "speed_drive"}
"""Their size is where they begin to act, or (a rope's stretch) a length that nothing else explains."""
LEAST = {
    "input_delay": 0.5,
    "start_delay": 0.5,
    "sensor_delay": 0.5,
    "actuator_lag": 0.5,
    "backlash": 0.2,
    "missed_counts": 0.5,
    "double_pendulum": 0.5,
    "gain_asymmetry": 0.3,
    "gain_drift": 0.3,
    "sensor_scale": 0.3,
    "sensor_offset": 0.2,
    "drum_radius_change": 0.2,
    "sensor_eccentricity": 0.3,
    "load_drag": 0.25,
    "stribeck_friction": 0.4,
    "spring_force": 0.25,
    "quadratic_drag": 0.25,
    "position_dependent_friction": 0.25,
    "position_direction_friction": 0.25,
    "periodic_force": 0.25,
    "belt_compliance": 0.3,
}
"""Nobody would call it physics below these: a delay within a sample, a gap of a count, a gain 0.1 % off."""
LIMITS = (0.05, 12.0)
SECONDS = 9.0
"""Of each of the two recordings that the refit sees: enough for a size, and quick."""


def _unknown(truth: dict) -> list[tuple]:
    """Paths of the numbers that the owner would refit: ("bridge", name) or (effect index, name)."""
    model = truth["model"]
    paths: list[tuple] = [("bridge", k) for k in model["bridge"] if k not in KNOWN and k != "known"]
    owned = {(e["kind"], e["site"]) for e in model["effects"]}
    for i, e in enumerate(truth["effects"]):
        if (e["kind"], e["site"]) in owned:
            paths += [(i, k) for k, v in e.items() if isinstance(v, float)]
    return paths


def _shifted(truth: dict, paths: list[tuple], factors: np.ndarray) -> dict:
    changed = copy.deepcopy(truth)
    for (where, name), factor in zip(paths, factors, strict=True):
        table = changed["bridge"] if where == "bridge" else changed["effects"][where]
        table[name] *= 1.0 + factor
    return changed


def _curves(truth: dict, volts: list[np.ndarray], plans: list[dict], channels: list[str]) -> np.ndarray:
    """Free runs under recorded voltages, in units of the noise."""
    curves = []
    for u, plan in zip(volts, plans, strict=True):
        run = simulate(truth, u, (len(u) - 1) * SAMPLE, 0, plan["start"], noisy=False)
        curves += [run[c] / NOISE[c] for c in channels]
    return np.concatenate(curves)


class Bench:
    """One concealed effect, alone on its rig, against the best that a model without it can do.

    Voltages and the slopes of the refit are taken once, at the first size tried; they hardly depend on it.

    Args:
        truth: a case.
        index: which of its concealed effects.
    """

    def __init__(self, truth: dict, index: int):
        self.index = index
        self.channels = [c for c in COLUMNS[truth["parts"], truth["rope"]] if c in NOISE]
        train = [p | {"seconds": SECONDS} for p in (truth["recordings"][0], truth["recordings"][3])]
        self.plans = train + [p for p in truth["recordings"] if p["name"] == "holdout-1"]
        alone, without = self._pair(truth)
        tables = [play(alone, p) for p in self.plans]
        self.volts = [np.column_stack([t["u_x"], t["u_l"]]) for t in tables]
        self.paths = _unknown(without)
        null = self._train(without)
        slopes = []
        for j in range(len(self.paths)):
            bumped = np.zeros(len(self.paths))
            bumped[j] = 0.01
            slopes.append((self._train(_shifted(without, self.paths, bumped)) - null) / 0.01)
        self.jacobian = np.column_stack(slopes)

    def _pair(self, truth: dict) -> tuple[dict, dict]:
        """The rig with this effect alone, and without it."""
        effect = truth["concealed"][self.index]
        alone = copy.deepcopy(truth)
        alone["noise"], alone["wander"] = {}, 0.0
        alone["effects"] = [e for e in alone["effects"] if e == effect or e not in truth["concealed"]]
        without = copy.deepcopy(alone)
        if effect["kind"] == "wrong_value":
            without["bridge"][effect["site"]] = truth["model"]["bridge"][effect["site"]]
        without["effects"] = [e for e in without["effects"] if e != effect]
        if effect["kind"] == "presliding_friction":  # its rival is friction that does not yield before it slips
            guess = {"kind": "coulomb_friction", "site": "cart", "level": effect["level"]}
            without["effects"].append(guess)
            without["model"]["effects"].append(guess)
        return alone, without

    def _train(self, truth: dict) -> np.ndarray:
        return _curves(truth, self.volts[:2], self.plans[:2], self.channels)

    def error(self, truth: dict) -> float:
        """Hold-out error of the best model without the effect: the worst channel's, over its noise."""
        alone, without = self._pair(truth)
        goal = self._train(alone)
        ridge = np.diag(1e-3 * np.linalg.norm(self.jacobian, axis=0) + 1e-9)
        fit = np.zeros(len(self.paths))
        left = goal - self._train(without)
        for scale in (1.0, 1.0, 0.3):
            padded = np.concatenate([left, np.zeros(len(fit))])
            step = np.linalg.lstsq(np.vstack([self.jacobian, ridge]), padded, rcond=None)[0]
            tried = np.clip(fit + scale * step, -0.8, 8.0)
            remains = goal - self._train(_shifted(without, self.paths, tried))
            if np.linalg.norm(remains) < np.linalg.norm(left):
                fit, left = tried, remains
        runs = [
            _curves(t, self.volts[2:], self.plans[2:], self.channels)
            for t in (alone, _shifted(without, self.paths, fit))
        ]
        errors = (runs[1] - runs[0]).reshape(len(self.channels), -1)
        return float(np.sqrt(np.mean(errors**2, axis=1)).max())


def target(name: str, catalogued: bool) -> float:
    """The error to aim at, over the noise, evenly in the logarithm and always the same by name.

    6 to 25; four times that where no catalogued law explains it, since a sum of laws imitates what is weak.
    """
    share = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4]) / 2**32
    return (6.0 if catalogued else 24.0) * (25.0 / 6.0) ** share


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=["dev", "proof", "clutter", "law-sizes", "recorded"], required=True)
    parser.add_argument("--out", type=Path, default=FILE)
    half, out = parser.parse_args().half, parser.parse_args().out
    sizes = json.loads(out.read_text()) if out.exists() else {}
    for case, truth in cases(half, {}).items():
        for index, effect in enumerate(truth["concealed"]):
            name = f"{half}: {truth['line']}: {effect['kind']} {effect['site']}"
            if name in sizes or effect["kind"] == "clock_scale":  # which changes time stamps, and no motion
                continue
            sized = (effect["kind"], effect["site"]) in KINDS and effect["kind"] not in UNSIZED
            alike = [v["size"] for k, v in sizes.items() if k.split(": ")[-1] == name.split(": ")[-1]]
            size, aim, tried = alike[0] if alike else 1.0, target(name, effect["kind"] not in UNKNOWN), {}
            bench = Bench(cases(half, {name: {"size": size}})[case], index)
            for _ in range(5):
                error = bench.error(cases(half, {name: {"size": size}})[case])
                tried[size] = error
                print(f"{name}: size {size:.3g}, error {error:.1f}, aim {aim:.1f}", flush=True)
                if not sized or 0.75 < error / aim < 1.33:
                    break
                size = size * np.clip(aim / max(error, 0.1), 0.15, 6.0)
                size = float(f"{np.clip(size, LEAST.get(effect['kind'], LIMITS[0]), LIMITS[1]):.3g}")
                if size in tried:
                    break
            size = min(tried, key=lambda s: abs(np.log(max(tried[s], 0.1) / aim)))
            sizes[name] = {"size": size, "error": round(tried[size], 1)}
            out.write_text(json.dumps(sizes, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
