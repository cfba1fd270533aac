"""Random bridges stay finite or say that they do not; the study is `experiments/random_rollouts.py`."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "experiments"))

import random_rollouts


@pytest.mark.slow
@pytest.mark.parametrize("name", list(random_rollouts.MECHANISMS))
def test_no_rollout_ends_in_silence(name):
    row = random_rollouts.measured(name, 500, seed=7)
    assert row["rollouts"] == 500 and row["varied"] >= 40
    # These bridges are possible ones, so none may run away.
    assert row["silent"] == 0 and row["marked"] == 0


def test_the_table_says_what_was_found():
    kept = {"belt": {"varied": 51, "rollouts": 1000, "marked": 2, "silent": 1, "seconds": 30}}
    assert random_rollouts.table(kept).splitlines()[-1] == "| belt | 51 | 1,000 | 2 | 1 | 30 |"
