"""A controller tuned on a model by one command, on a rig that another engine plays and the model does not describe."""

import importlib
from pathlib import Path

import jax
import numpy as np
import pytest

import jbridge
from jbridge.cli import main
from tests.problems import model_text

EXPERIMENTS = Path(__file__).parents[2] / "experiments"

MODEL = model_text(
    ("coulomb_friction", "cart", {"level": 3.7}),
    ("coulomb_friction", "hoist", {"level": 2.7}),
    ("dead_zone", "cart_drive", {"positive": 0.22, "negative": 0.22}),
)
MODEL += """
[uncertainty.cart_gain]
std = 1.2
low = 13.6
high = 18.4

[uncertainty."coulomb_friction@cart.level"]
std = 0.9
low = 1.9
high = 5.5
"""
TRUTH = {
    "bridge": {
        "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81, "cart_damping": 48.0,
        "swing_damping": 0.0012, "hoist_damping": 24.0, "cart_gain": 17.0, "hoist_gain": 2.9,
    },
    "effects": [
        {
            "kind": "position_direction_friction", "site": "cart", "knots": [-0.1, 0.35, 0.7, 1.4],
            "positive": [2.5, 4.0, 3.0, 3.8], "negative": [4.5, 3.2, 5.0, 4.1],
        },
        {"kind": "coulomb_friction", "site": "hoist", "level": 3.0},
        {"kind": "dead_zone", "site": "cart_drive", "positive": 0.25, "negative": 0.2},
        {"kind": "input_delay", "site": "cart_drive", "delay": 0.01},
        {"kind": "input_delay", "site": "hoist_drive", "delay": 0.01},
    ],
    "parts": "full", "rope": "winch",
}  # fmt: skip
MOVES = (((0.2, 0.4), (0.9, 0.6)), ((0.9, 0.6), (0.3, 0.3)), ((0.5, 0.25), (1.1, 0.45)))


@pytest.mark.slow
def test_a_tuned_controller_beats_the_papers_on_another_rig(tmp_path, monkeypatch):
    """Friction by place and direction and delays of 10 ms are not the model's; each move is compared by itself."""
    pytest.importorskip("mujoco")
    for folder in ("concealed", "paper", "tuning"):
        monkeypatch.syspath_prepend(str(EXPERIMENTS / folder))
    rig, virtual = (importlib.import_module(name) for name in ("rig", "virtual"))
    (tmp_path / "model.toml").write_text(MODEL)
    small = ["--rules", "extended", "--plants", "24", "--steps", "80", "--starts", "1", "--delay", "10"]
    with jax.numpy_dtype_promotion("standard"):  # optax counts its steps in integers
        assert main(["tune", str(tmp_path / "model.toml"), *small, "--out", str(tmp_path / "out")]) == 0
    rivals = {
        "paper": jbridge.Controller(jbridge.paper_controller()),
        "tuned": jbridge.load_controller(tmp_path / "out" / "controller.toml"),
    }
    found = {name: [] for name in rivals}
    for name, controller in rivals.items():
        for seed, ends in enumerate(MOVES):
            path = jbridge.smooth_path(ends, speed=(0.3, 0.2), rest=6.0, period=controller.period)
            law = virtual.sampled(controller, path)
            table = rig.simulate(TRUTH, law, float(path.times[-1]), seed, {"x": ends[0][0], "l": ends[0][1]})
            every = round(controller.period / rig.SAMPLE)
            run = {key: np.asarray(values)[::every][: len(path.times)] for key, values in table.items()}
            position, command = (np.stack([run[k] for k in keys], 1) for keys in (("x", "psi", "l"), ("u_x", "u_l")))
            wanted = np.stack([path.x, path.l], 1)[: len(position)]
            found[name].append(jbridge.moves(path.times[: len(position)], wanted, position, command)[0])
    for number, (paper, tuned) in enumerate(zip(found["paper"], found["tuned"], strict=True), start=1):
        for name, move in (("paper", paper), ("tuned", tuned)):
            print(number, name, move.settling_time["load"], move.residual_swing, move.itae, move.travel)
        assert tuned.settling_time["load"] is not None
        assert tuned.settling_time["load"] < (paper.settling_time["load"] or np.inf)
        assert sum(tuned.itae.values()) < sum(paper.itae.values())
        assert tuned.residual_swing <= max(paper.residual_swing, np.radians(0.3))
