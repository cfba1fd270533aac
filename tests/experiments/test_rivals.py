"""The rivals of the concealed proof, on recordings made with jbridge itself."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

import jbridge

pytest.importorskip("pysindy")
HERE = Path(__file__).parents[2] / "experiments" / "concealed"
sys.path.insert(0, str(HERE))  # the scripts of an experiment import their neighbours by plain names

balance, rivals, tables = (importlib.import_module(name) for name in ("balance", "rivals", "tables"))

MODEL = """
[bridge]
cart_mass = 5.5
load_mass = 0.15
gravity = 9.81
cart_damping = {damping}
swing_damping = 0.002
cart_gain = {gain}
known = ["cart_mass", "load_mass", "gravity"]
{effect}
"""
EFFECTS = """
[[effect]]
kind = "constant_force"
site = "cart"
level = {level}

[[effect]]
kind = "load_drag"
site = "swing"
coefficient = {drag}
"""


def played(folder: Path, seed: int, level: float = 0.0, drag: float = 0.0) -> tuple:
    """The owner's model with wrong numbers, and two noisy recordings of the true one."""
    true, guess = folder / "true.toml", folder / "model.toml"
    true.write_text(MODEL.format(damping=50.0, gain=16.0, effect=EFFECTS.format(level=level, drag=drag)))
    guess.write_text(MODEL.format(damping=60.0, gain=14.0, effect=""))
    noise, paths = np.random.default_rng(seed), []
    t = np.arange(0, 12, 0.005)
    for i, length in enumerate((0.5, 0.8)):
        levels = noise.uniform(0.8, 2.5, 12) * np.resize([1, -1], 12)
        path = folder / f"train-{i}.csv"
        path.with_suffix(".toml").write_text(f"[locked]\nl = {length}\n")
        columns = {"t": t, "u_x": np.round(levels[t.astype(int)], 3), "x": 0 * t + 0.7, "psi": 0 * t}
        jbridge.save_csv(path, columns)
        run = jbridge.simulate(jbridge.load_model(true), jbridge.load_recording(path), "first-row")
        for name, size, count in (("x", 3e-5, 1e-4), ("psi", 5e-4, 2 * np.pi / 4096)):
            columns[name] = count * np.round((run[name] + size * noise.standard_normal(len(t))) / count)
        jbridge.save_csv(path, columns)
        paths.append(path)
    return jbridge.load_model(guess), jbridge.load_recordings(paths)


@pytest.fixture(scope="module")
def adequate(tmp_path_factory):
    return played(tmp_path_factory.mktemp("adequate"), 1)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    return played(tmp_path_factory.mktemp("pushed"), 2, level=1.5)


@pytest.fixture(scope="module")
def dragged(tmp_path_factory):
    return played(tmp_path_factory.mktemp("dragged"), 3, drag=0.1)


@pytest.mark.parametrize("rival", sorted(rivals.RIVALS))
def test_a_force_is_named_on_its_axis(rival, pushed):
    report = rivals.diagnose(rival, *pushed)
    assert report["verdict"] == "missing_physics" and report["location"]["equation"] == "cart"
    assert [f"{e['kind']} {e['site']}" for e in report["effects"]] == ["constant_force cart"]


@pytest.mark.parametrize("rival", sorted(rivals.RIVALS))
def test_a_torque_is_named_on_its_axis(rival, dragged):
    report = rivals.diagnose(rival, *dragged)
    assert report["location"]["equation"] == "swing"
    assert report["effects"][0]["kind"] == "load_drag"


@pytest.mark.parametrize("rival", sorted(rivals.RIVALS))
def test_wrong_numbers_are_not_missing_physics(rival, adequate):
    report = rivals.diagnose(rival, *adequate)
    assert report["verdict"] == "adequate" and not report["effects"]


@pytest.mark.parametrize("order", range(4))
def test_kernels_differentiate_polynomials(order):
    """The n-th derivative of t^n is exact up to rounding."""
    t = np.arange(200) * 0.005
    found = balance.averaged((t - 0.5) ** order, balance.kernel(0.05, 0.005, order))
    np.testing.assert_allclose(found[30:-30], (1, 1, 2, 6)[order], rtol=1e-8)


def test_rivals_are_compared_on_the_cases_that_all_have():
    row = {
        "true": ["spring_force cart"], "true_verdict": "missing_physics", "verdict": "missing_physics", "before": 9.0,
        "detected": True, "equation_right": True, "first_right": True, "set_right": True, "wall": 100.0,
    }  # fmt: skip
    wrong = row | {"first_right": False, "set_right": False, "before": None, "wall": 1.5}
    halves = {"proof": {"rows": [row | {"id": "a"}, row | {"id": "b"}]}}
    text = "\n".join(tables.beside(halves, {"proof": {"greedy": [wrong | {"id": "a"}, wrong | {"id": "c"}]}}))
    assert "proof, 1 cases" in text
    assert "hold-out error is >= 5 noise | 100 % (1/1; 21-100) | 100 % (1/1; 21-100)" in text
    assert "named first, one missing | 100 % (1/1; 21-100) | 0 % (0/1; 0-79)" in text
