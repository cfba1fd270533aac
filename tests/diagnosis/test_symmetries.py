"""What a missing force is like, on forces whose laws are written down here."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.localization.missing_force import Track
from jbridge.diagnosis.localization.symmetries import describe


def track(law, seed, noise=0.02):
    """A cart that goes to and fro, with a force of a given law (`t, q, v, u, swing, since`)."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 16.0, 0.01)
    rates = rng.uniform(0.25, 0.9, 4)
    phases = rng.uniform(0.0, 2 * np.pi, 4)
    q = 0.7 + 0.12 * np.sin(np.outer(t, rates) * 2 + phases).sum(axis=1)
    v = np.gradient(q, t)
    u = 8.0 * np.repeat(rng.uniform(-1.0, 1.0, 80), 20)
    swing = 0.1 * np.sin(4.0 * t + phases[0]) * np.exp(-0.1 * t) + 0.05 * np.sin(3.0 * t + phases[1])
    turned = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(v)) != 0) + 1])
    since = np.abs(q - q[turned[np.searchsorted(turned, np.arange(len(t)), side="right") - 1]])
    force = law(t, q, v, u, swing, since) + noise * rng.standard_normal(len(t))
    return Track(t, q, v, u, {"psi": swing}, force, np.ones(len(t)))


def described(law):
    return describe([track(law, seed) for seed in range(4)], "x")


def test_friction_turns_round_and_takes_energy():
    likeness = described(lambda t, q, v, u, swing, since: -np.sign(v))
    assert likeness.odd > 0.95 and likeness.energy < -0.95 and likeness.foreseen > 0.8
    assert likeness.memory < 0.1 and likeness.period is None
    assert "reverses with the direction of motion" in likeness.statement and "takes energy out" in likeness.statement


def test_a_slope_is_the_same_both_ways():
    likeness = described(lambda t, q, v, u, swing, since: 2.0 * (q - 0.7))
    assert likeness.odd < 0.05 and abs(likeness.energy) < 0.5
    assert "the same in both directions" in likeness.statement


@pytest.mark.parametrize("odd", [False, True])
def test_a_wave_has_its_length(odd):
    likeness = described(
        lambda t, q, v, u, swing, since: np.sin(2 * np.pi * q / 0.11) * (np.sign(v) if odd else np.ones_like(v))
    )
    assert likeness.period == pytest.approx(0.11, rel=0.05)
    assert f"repeats every {1e3 * likeness.period:.3g} mm" in likeness.statement


def test_memory_is_neither_place_nor_velocity():
    likeness = described(lambda t, q, v, u, swing, since: -np.sign(v) * np.sin(np.pi * since / 0.1) ** 2)
    assert likeness.memory > 0.15 and "hysteresis" in likeness.statement
    assert described(lambda t, q, v, u, swing, since: -(v**3) * 10).memory < 0.1


def test_it_names_what_it_hangs_on():
    by_input = described(lambda t, q, v, u, swing, since: (u / 8) ** 3)
    assert max(by_input.by, key=lambda name: by_input.by[name]) == "u_x"
    assert "depends most on the cart drive's input" in by_input.statement
    by_swing = described(lambda t, q, v, u, swing, since: -np.sign(v) * np.abs(swing) * 10)
    assert max(by_swing.by, key=lambda name: by_swing.by[name]) == "psi" and by_swing.odd > 0.9
    in_time = described(lambda t, q, v, u, swing, since: np.exp(-((t - 6.0) ** 2)))
    assert max(in_time.by, key=lambda name: in_time.by[name]) == "t"


@pytest.mark.parametrize("main", [lambda t, u: 1.8 * (u / 8) ** 3, lambda t, u: np.exp(-((t - 6.0) ** 2))])
def test_of_two_laws_neither_speaks_for_both(main):
    """Plain friction beside something else is no memory, and does not make all of it turn round."""
    likeness = described(lambda t, q, v, u, swing, since: main(t, u) - 0.3 * np.sign(v))
    assert likeness.memory < 0.1 and "hysteresis" not in likeness.statement
    assert likeness.odd is None and "reverses" not in likeness.statement


def test_a_force_of_no_size_is_not_described():
    tracks = [track(lambda t, q, v, u, swing, since: 0 * t, seed, 1e-18) for seed in range(3)]
    silent = [dataclasses.replace(t, weight=1e-9 * t.weight) for t in tracks]
    assert describe(silent, "x").statement == ""


def test_nothing_is_said_of_noise():
    likeness = described(lambda t, q, v, u, swing, since: 0 * t)
    assert likeness.statement == "" and likeness.odd is None and likeness.period is None
    assert likeness.foreseen < 0.05


def test_one_recording_is_cut_into_quarters():
    likeness = describe([track(lambda t, q, v, u, swing, since: -np.sign(v), 1)], "x")
    assert likeness.odd > 0.9 and "takes energy out" in likeness.statement
