"""The table of moves on rigs known by their recordings, from numbers made up so that every entry is known."""

import copy

import numpy as np
import pytest

from experiments.tuning.every_move import OURS, RIVAL, draw, table

T = np.arange(0.0, 10.0, 0.5)


def move(settled, swing, itae):
    """Settled after so many seconds or never, with a swing [deg] and an ITAE of cart and of rope."""
    signals = {"t": T.tolist(), "aside": (0.1 * np.cos(T)).tolist(), "wanted": np.zeros_like(T).tolist()}
    return {
        "settling": {"load": settled}, "swing": np.radians(swing), "itae": {"x": itae, "l": 0.1},
        "travel": {"x": 1.5, "l": 0.5}, "from": [0.0, 0.2], "to": [1.2, 0.6], **signals,
    }  # fmt: skip


RIG = {
    "truth": [{"kind": "input_delay", "site": "cart_drive", "delay": 0.012}],
    "holdout": {"x": 0.002, "psi": np.radians(0.15), "l": 0.0007},
    "seconds": {"fit": 60.0, "tune": 300.0},
    "search": {"bridges": 32, "steps": 100},
    "ensemble": {
        "before": {"never": 20, "moves": 256, "travel": 1.0}, "after": {"never": 2, "moves": 256, "travel": 1.25},
    },
    "moves": {
        RIVAL: [move(None, 3.0, 0.7), move(6.0, 0.2, 0.3)],
        OURS: [move(6.5, 0.1, 0.2), move(6.5, 0.2, 0.2)],
    },
}  # fmt: skip


@pytest.mark.parametrize("line", [
    f"| {RIVAL} | 1 | never | 1.6 (3) | 0.6 (0.8) | 1.5 |",
    f"| {OURS} | 2 | 6.5 | 0.15 (0.2) | 0.3 (0.3) | 1.5 |",
    f"| {OURS} | 1 | 1 (1) | 2 | 1 |",
    "| 1 | 1 | 0.00, 0.20 to 1.20, 0.60 | never / 6.5 | 3 / 0.1 | 0.8 / 0.3 |",
    "| 1 | 2 | 0.00, 0.20 to 1.20, 0.60 | 6 / 6.5 | 0.2 / 0.2 | 0.4 / 0.3 |",
    "| 1 | 12 | 2 mm, 0.15 deg, 0.7 mm | 32, 100 | 20 / 2 of 256 | 1 / 1.2 | 60, 300 |",
])  # fmt: skip
def test_the_table_says_how_every_move_went(line):
    assert line in table({"1": RIG}).splitlines()


def test_each_rig_has_its_moves(tmp_path):
    draw({"1": RIG, "2": copy.deepcopy(RIG)}, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"tuning-from-recordings.md", "tuning-from-recordings.png"}
    text = (tmp_path / "tuning-from-recordings.md").read_text()
    assert text.startswith("# Controllers tuned from recordings\n\nRigs (1, 2) in") and "| 2 | 2 | 0.00" in text
    assert f"| {RIVAL} | 2 | " in text
