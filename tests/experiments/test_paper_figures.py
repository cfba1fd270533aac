"""The paper's figures and tables, from data made up here."""

import json

import numpy as np

from experiments.paper.figures import draw, table

T = np.linspace(0.0, 5.0, 101)


def made_up():
    run = {"t": T, "u_x": np.sin(T), "u_l": np.cos(T), "x": 0.3 + 0.1 * np.sin(T), "psi": 0.02 * T, "l": 0.7 + 0 * T}
    shifted = run | {"x": run["x"] + 0.01}
    move = {
        "overshoot": {"x": 0.02, "l": 0.0}, "steady_error": {"x": -0.003, "l": 0.001}, "effort": {"x": 1.0, "l": 2.0},
    }  # fmt: skip
    loaded = move | {"effort": {"x": 1.1, "l": 2.0}}
    content = {
        "steps": {"rig": run, "before": shifted, "after": run},
        "tracking": {
            "reference": {"t": T, "x": run["x"], "l": run["l"]},
            "model": run,
            "rig": shifted,
            "moves": {"model": [move, move], "rig": [loaded, loaded]},
            "rms": {"x": 0.01, "psi": 0.0, "l": 0.0},
        },
        "friction": [
            {"low": 0.0, "high": 0.5, "side": side, "rig": 4.0, "found": 4.2, "error": 0.05}
            for side in ("positive", "negative")
        ],
        "numbers": [
            {"name": "cart_gain", "rig": 16.0, "value": 16.8, "std": 0.1, "low": 16.6, "high": 17.0, "unit": "N/V"},
            {"name": "cart_mass", "rig": 5.5, "value": 5.5, "std": None, "low": None, "high": None, "unit": "kg"},
        ],
    }
    return json.loads(json.dumps(content, default=lambda a: a.tolist()))


def test_figures_have_their_counterparts_numbers(tmp_path):
    draw(made_up(), tmp_path)
    wanted = {f"paper-figure-{n}.png" for n in (1, 4, 5, 6, 8, 9, 10)} | {"paper-friction.png", "paper-table.md"}
    assert {path.name for path in tmp_path.iterdir()} == wanted
    assert all(path.stat().st_size > 5000 for path in tmp_path.glob("*.png"))


def test_tables_tell_what_was_measured():
    said = table(made_up())
    assert "| m_1 | 5.5 kg | 5.5 kg |" in said
    assert "| cart position x | error | -3 | 3 | m |" in said and "| rope length l | voltage | -10 | 10 | V |" in said
    assert "median error 5.0 %" in said and "error of x over the steps 10.0 mm before, 0.00 mm after" in said
    assert "rms x 10.00 mm" in said and "x 2.0 % (model), 2.0 % (virtual rig)" in said
    assert "cart 1.10, hoist 1.00" in said
    assert "| cart_gain | 16 N/V | 16.8 | +5.00 % |" in said and "cart_mass" not in said


def test_starts_and_diagnosis_are_told_where_they_were_run(tmp_path):
    content = made_up()
    assert "random starts" not in table(content)
    number = {"name": "cart_gain", "start": [10.0, 20.0, 30.0], "found": [16.0, 16.1, 25.0]}
    content["starts"] = {"ratios": [1.0, 1.005, 3.0], "numbers": [number], "window": 2.0}
    content["diagnosis"] = {"verdict": "missing_physics", "effects": [["dead_zone", "cart_drive"]], "seconds": 1.0}
    text = table(content)
    assert "2 of 3 random starts" in text and "dead zone, cart drive" in text
    draw(content, tmp_path)
    assert (tmp_path / "paper-starts.png").stat().st_size > 5000
