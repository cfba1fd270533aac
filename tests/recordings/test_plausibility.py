"""Signs are doubted only where they are certainly wrong: worlds of all sorts, and rigs of other people."""

import os
from pathlib import Path

import numpy as np
import pytest

from experiments.real_rigs import run
from jbridge.recordings.plausibility.drive_equation import is_input, runs_backwards, unfelt_rows
from jbridge.recordings.plausibility.inputs import gains_energy
from jbridge.recordings.plausibility.signs import is_swapped
from jbridge.recordings.plausibility.swing_equation import misread_swing

ROOT = Path(__file__).parents[2]
SHARED = Path(os.environ.get("JBRIDGE_RECORDINGS", ROOT.parent / "shared"))
PERIOD, STEPS, ROWS, WORLDS = 0.01, 5, 1200, 60
MODES = {
    "steps": lambda w: w["level"],
    "a position loop": lambda w: w["gain"] * (w["place"] - w["x"] - 0.2 * w["v"]),
    "a motor that is off": lambda w: 0.0 * w["x"],
    "a fixed cart": lambda w: w["level"],
    "a sine": lambda w: 3.0 * np.sin(w["pace"] * w["t"]),
    "a swing damper": lambda w: 0.3 * w["gain"] * (w["place"] - w["x"] - 0.6 * w["v"]) + 5.0 * w["psi"],
    "a speed loop": lambda w: w["gain"] * (w["place"] - w["v"]),
    "sums of sines": lambda w: 3.0 * np.sin(w["pace"] * w["t"]) * np.cos(0.3 * w["pace"] * w["t"] + w["hold"]),
}
QUICK = {"steps", "a speed loop", "a motor that is off"}


def worlds(mode: str) -> dict[str, np.ndarray]:
    """Returns carts with loads of all sizes, frictions and delays below one kind of input, side by side."""
    key = np.random.default_rng(sorted(MODES).index(mode))
    draw = lambda low, high: np.exp(key.uniform(np.log(low), np.log(high), WORLDS))  # noqa: E731
    mass, length, gain = draw(0.3, 8.0), draw(0.2, 1.5), draw(2.0, 150.0)
    load, damping, force = mass * draw(0.01, 2.0), mass * draw(0.02, 20.0), mass * draw(0.3, 10.0)
    dry, pace, hold = mass * key.uniform(0.0, 0.5, WORLDS), draw(0.5, 8.0), draw(0.2, 2.5)
    late = key.integers(0, 16, WORLDS)
    noise_x, noise_psi = draw(1e-5, 5e-3), draw(1e-4, 2e-2)
    x, v, rate, psi = np.zeros(WORLDS), np.zeros(WORLDS), np.zeros(WORLDS), key.uniform(-0.8, 0.8, WORLDS)
    u = np.zeros((ROWS, WORLDS))
    seen = {"x": np.zeros_like(u), "psi": np.zeros_like(u)}
    level = place = np.zeros(WORLDS)
    for row in range(ROWS):
        t = row * PERIOD
        new = np.floor(t / hold) != np.floor((t - PERIOD) / hold)
        level = np.where(new, key.uniform(-3.0, 3.0, WORLDS), level)
        place = np.where(new, key.uniform(-0.4, 0.4, WORLDS), place)
        seen["x"][row] = x + noise_x * key.standard_normal(WORLDS)
        seen["psi"][row] = psi + noise_psi * key.standard_normal(WORLDS)
        now = {"t": t, "x": x, "v": v, "psi": psi, "level": level, "place": place, "gain": gain, "pace": pace}
        now["hold"] = hold
        u[row] = np.clip(MODES[mode](now), -10.0, 10.0)
        felt = u[np.maximum(row - late, 0), np.arange(WORLDS)]
        for _ in range(STEPS):
            h = PERIOD / STEPS
            swing = load * np.sin(psi) * (9.81 * np.cos(psi) + length * rate**2)
            push = force * felt - damping * v + swing - dry * np.clip(v / 1e-3, -1.0, 1.0)
            a = 0.0 * v if mode == "a fixed cart" else push / (mass + load * np.sin(psi) ** 2)
            v, rate = v + h * a, rate - h * ((9.81 * np.sin(psi) + a * np.cos(psi)) / length + 0.05 * rate)
            x, psi = x + h * v, psi + h * rate
    # Lengths of ropes are known to a factor, not to a percent.
    return {"t": np.arange(ROWS) * PERIOD, "u": u, "l": length * draw(0.6, 1.6), **seen}


@pytest.mark.parametrize(
    "mode", [pytest.param(mode, marks=[] if mode in QUICK else [pytest.mark.slow]) for mode in MODES]
)
def test_right_signs_are_never_doubted_and_wrong_ones_often(mode):
    seen = worlds(mode)
    t, found = seen["t"], np.zeros(5)
    for k in range(WORLDS):
        x, psi, u = (t, seen["x"][:, k]), (t, seen["psi"][:, k]), seen["u"][:, k]
        rope = t[[0, -1]], np.full(2, seen["l"][k])
        assert misread_swing(t, psi, x, rope) is None
        assert not is_swapped(t, psi, x, rope)
        if mode == "a motor that is off":
            assert not gains_energy(t, x, psi, rope)
            assert not gains_energy(t, x, (t, -psi[1]), rope)
        for load in (psi, None):
            assert not runs_backwards(t, u, x, load)
            assert not is_input(t, u, x, load)
            assert not unfelt_rows(t, u, x, load).size
        turned = misread_swing(t, (t, -psi[1]), x, rope)
        halved = misread_swing(t, psi, (t, 0.5 * x[1]), rope)
        assert halved is None or (1.5 < halved.factor < 2.7 and not halved.turned)
        glitch = np.where(np.arange(t.size) == 700, 1e4, u)
        unfelt = unfelt_rows(t, glitch, x, psi).tolist()
        assert unfelt in ([], [700])
        exchanged = is_input(t, x[1], (t, u), psi)
        wrong = runs_backwards(t, -u, x, psi), unfelt == [700], exchanged, halved is not None
        found += [turned is not None and turned.turned, *wrong]
    if mode == "steps":
        assert found[:4].min() > 0.5 * WORLDS
        assert found[4] > 0.2 * WORLDS
    if mode == "sums of sines":
        assert found[3] > 0.3 * WORLDS
    if mode == "a fixed cart":
        assert found.max() == 0


def test_the_kick_of_a_controller_is_no_slip():
    """Logged before the drive cuts it off, which leaves the motion as little of it as of a wild sample."""
    period, key, found = 0.01, np.random.default_rng(0), 0
    t = np.arange(2000) * period
    for _ in range(30):
        mass, gain, slow, pull = key.uniform(0.5, 5.0), key.uniform(10, 60), key.uniform(1, 10), key.uniform(1, 8)
        reference = np.zeros(t.size)
        for row in key.integers(50, 1800, key.integers(1, 8)):
            reference[row:] = key.uniform(-0.5, 0.5)
        x, v, before, u, seen = 0.0, 0.0, 0.0, np.zeros(t.size), np.zeros(t.size)
        for row in range(t.size):
            error = reference[row] - x
            u[row], before = gain * error + slow * (error - before) / period, error
            seen[row] = x + 1e-4 * key.standard_normal()
            v += period * (pull * np.clip(u[row], -10.0, 10.0) - v / mass)
            x += period * v
        assert not unfelt_rows(t, u, (t, seen), None).size
        wild = np.where(np.arange(t.size) == 1900, 1e4, u)
        found += 1900 in unfelt_rows(t, wild, (t, seen), None)
    assert found > 5


@pytest.mark.skipif(not (SHARED / "recordings").is_dir(), reason=f"the recordings are not at {SHARED}")
def test_no_real_rig_is_doubted(monkeypatch):
    """With the sidecars that its owner's documents tell; reading raises otherwise."""
    monkeypatch.setattr(run, "SHARED", SHARED)
    for rig in run.rigs().values():
        for piece in (*rig["train"], *rig.get("holdout", ())):
            run.load(rig, piece)


def test_no_number_is_too_small(recwarn):
    """An angle that underflows is read without a warning that reaches the user."""
    t = np.arange(0, 40, 0.1)
    u = np.sin(t)
    assert not runs_backwards(t, u, (t, 0.5 + 0.1 * np.sin(t / 3)), (t, 5e-322 * np.sin(t)))
    assert not runs_backwards(t, 5e-322 * u, (t, 0.5 + 0.1 * np.sin(t / 3)), None)
    assert not runs_backwards(t, 1e-200 * u, (t, 0.5 + 0.1 * np.sin(t / 3)), None)
    assert not list(recwarn)
