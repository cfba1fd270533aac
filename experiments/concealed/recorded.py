"""What real rigs do beyond a plain model: the force by which their recordings miss a balance of a few terms.

Accelerations of a recorded motion, smoothed, are regressed on what every model has (input, damping, dry friction, a
constant, and the coupling of cart and load); what is left is the rig's own, with its true spectrum and tails. Stretches
of it act in another rig's simulation, in units of their own root mean square. The recordings are read in place, as
`experiments/real_rigs` lists them, and nothing of them is kept; the balance is no part of the tool under test.
"""

import functools
import os
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

RIGS = Path(__file__).parents[1] / "real_rigs"
SHARED = Path(os.environ.get("JBRIDGE_RECORDINGS", RIGS.parents[2] / "shared"))
SOURCES = {
    "cart": ("emps", "Aalborg cart", "student crane, 2", "repeated crane"),
    "swing": ("INTECO pendulum", "Washington pendulum", "student crane, 2"),
    "hoist": ("gantry, hoist",),
}
"""Rigs of `rigs.toml` by the axis that they tell of."""
_STEP, _SMOOTH = 0.005, 0.12
"""Grid and smoothing window [s]."""
_STRETCH, _FADE = 1.5, 0.1
"""Length of a stretch and of the passage to the next one [s]."""
_LONGEST = 30.0
"""Of a simulation [s]."""


def there() -> bool:
    """Whether the recordings are at hand."""
    return (SHARED / "recordings").is_dir()


def force(rig: str, axis: str, seed: int) -> Callable[[float], float]:
    """A force over time with a root mean square of 1, made of stretches of what a rig's recordings leave.

    Args:
        rig: of `SOURCES`.
        axis: "cart", "swing" or "hoist".
        seed: of the choice of stretches.
    """
    left, key = _left(rig, axis), np.random.default_rng(seed)
    long, fade = round(_STRETCH / _STEP), round(_FADE / _STEP)
    count = int(_LONGEST / _STRETCH) + 2
    usable = [part for part in left if len(part) > long + fade]
    shares = np.array([len(part) - long - fade for part in usable], float)
    out, ramp = np.zeros(count * long + fade), np.linspace(0.0, 1.0, fade)
    for k in range(count):
        part = usable[key.choice(len(usable), p=shares / shares.sum())]
        begin = int(key.integers(0, len(part) - long - fade))
        weight = np.concatenate([ramp, np.ones(long - fade), ramp[::-1]])
        out[k * long : (k + 1) * long + fade] += weight * part[begin : begin + long + fade]
    out /= np.sqrt(np.mean(out**2))
    times = (np.arange(len(out)) - fade) * _STEP
    return lambda t: float(np.interp(t, times, out))


@functools.cache
def _left(rig: str, axis: str) -> tuple[np.ndarray, ...]:
    """What the balance of every recording of a rig leaves, on an even grid."""
    made = [_terms(recording, axis) for recording in _recordings(rig)]
    a, terms = np.concatenate([m[0] for m in made]), np.concatenate([m[1] for m in made])
    weights = np.linalg.lstsq(terms, a, rcond=None)[0]
    return tuple(own - rows @ weights for own, rows in made)


def _recordings(name: str) -> list:
    import jbridge  # reads files, no more: the rig has nothing else of the tool under test

    rig = tomllib.loads((RIGS / "rigs.toml").read_text(encoding="utf-8"))[name]
    sidecar = RIGS / Path(rig["folder"]).name / "recordings.toml"
    found = []
    for piece in (*rig["train"], *rig.get("holdout", ())):
        cut = {"file": piece} if isinstance(piece, str) else piece
        path = SHARED / rig["folder"] / cut["file"]
        recording = jbridge.load_recording(path, sidecar=sidecar if sidecar.is_file() else None)
        span = np.searchsorted(recording.times - recording.start, [cut.get("start", 0.0), cut.get("stop", np.inf)])
        found.append(recording.rows(slice(int(span[0]), int(span[1]))))
    return found


def _terms(recording, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of an axis, and what they are regressed on."""
    rows = recording.times - recording.times[0]
    t = np.arange(0.0, rows[-1], _STEP)
    width = round(_SMOOTH / _STEP) // 2 * 2 + 1

    def smooth(values: np.ndarray, order: int) -> np.ndarray:
        return savgol_filter(np.interp(t, rows, values), width, 3, deriv=order, delta=_STEP)

    name = {"cart": "x", "swing": "psi", "hoist": "l"}[axis]
    q, v, a = (smooth(getattr(recording, name), order) for order in range(3))
    terms = [v, np.tanh(v / (0.05 * np.std(v) + 1e-12)), np.ones_like(t)]
    volts = recording.u_l if axis == "hoist" else recording.u_x
    if axis == "swing":
        terms.append(np.sin(q))
        if recording.x is not None:
            terms.append(np.cos(q) * smooth(recording.x, 2))
    elif volts is not None:
        terms.append(volts[np.clip(np.searchsorted(rows, t, side="right") - 1, 0, len(rows) - 1)])
        if axis == "cart" and recording.psi is not None:
            psi, rate, swing = (smooth(recording.psi, order) for order in range(3))
            terms += [np.sin(psi) * rate**2, np.cos(psi) * swing]
    return a, np.stack(terms, 1)
