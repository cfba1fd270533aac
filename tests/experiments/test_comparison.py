"""The table of controllers, from numbers made up so that every entry is known."""

import numpy as np
import pytest

from experiments.tuning.comparison import draw, table

T = np.arange(0.0, 2.0, 0.02)
RUN = {name: np.zeros_like(T).tolist() for name in ("x", "psi", "l", "u_x", "u_l")} | {"t": T.tolist()}


def controller(load, swing, itae, late=None):
    """Two moves on the rig; two bridges with two moves each, all alike but one."""
    move = {
        "settling": {"x": load, "l": load, "load": load}, "overshoot": {"x": 0.01, "l": 0.002},
        "swing": np.radians(swing), "itae": {"x": itae, "l": itae}, "run": RUN,
        "reference": {key: RUN[key] for key in ("t", "x", "l")},
    }  # fmt: skip
    held = {"residual_swing": [[np.radians(swing)] * 2] * 2, "itae_x": [[itae] * 2] * 2, "itae_l": [[itae] * 2] * 2}
    return {"rig": [move, move], "measures": {"held_out": held | {"settling_load": [[load, load], [load, late]]}}}


KEPT = {
    "settings": {"plants": 64},
    "controllers": {
        "paper": controller(5.0, 2.0, 0.4),
        "paper tuned": controller(4.0, 1.0, 0.1, 4.5),
        "extended tuned": controller(3.3, 0.1, 0.2, 6.0),
        "LQR": controller(3.0, 0.2, 0.2, 7.0),
    },
    "tuning": {
        "extended tuned": {
            "rollouts": 5000, "seconds": 250.0, "costs": [9.0, 5.0], "history": [3.0, 2.0], "softness": [0.3, 0.03],
        },
    },
    "limit": [{"seconds": 1.8, "reference": 7.5, "run": RUN}, {"seconds": 1.4, "reference": 4.4, "run": RUN}],
}  # fmt: skip


@pytest.mark.parametrize("line", [
    "| paper | 5, 5 | 2, 2 | 1, 1 | 0.8, 0.8 | 5 (1 of 4 never) | 2 (2) | 0.8 (0.8) |",
    "| LQR | 3, 3 | 0.2, 0.2 | 1, 1 | 0.4, 0.4 | 3 (7) | 0.2 (0.2) | 0.4 (0.4) |",
    "| extended rules tuned, virtual rig, load within 1 cm, against the LQR | <= 1.1 times | 3.3 / 3 s, 3.3 / 3 s |",
    "| paper's rules tuned, ITAE on held-out bridges, over that of the hand-set | <= 0.5 | 0.25 |",
    "| extended rules tuned, settling on held-out bridges | no longer than | 0 of 4 never, 99 % within 6 s |",
    "| one tuning run | <= 300 s | 250 s |",
    "| extended tuned | 5,000 | 250 | 9 | 5 |",
    "1.80 s and 1.40 s (`python experiments/tuning/limit.py`); the reference that all controllers follow takes",
])  # fmt: skip
def test_the_table_says_what_was_kept(line):
    assert line in table(KEPT).splitlines()


def test_pictures_are_drawn_from_what_is_there(tmp_path):
    draw(KEPT, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "tuning-table.md", "tuning-ensemble.png", "tuning-move-1.png", "tuning-move-2.png", "tuning-limit.png",
    }  # fmt: skip
    assert all(path.stat().st_size > 500 for path in tmp_path.iterdir())
