"""Gradients beside central differences where laws have corners; the study of many is `experiments/gradients.py`."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "experiments"))

import gradients


@pytest.mark.slow
def test_gradients_are_true_at_corners():
    rows = gradients.compared(200)
    assert {row["sort"] for row in rows} == set(gradients.SORTS)
    for row in rows:
        assert row["size"] > 1e-9, row
        assert row["median"] < 1e-7, row
        # A step's end may fall on the instant at which an axis stops.
        assert row["beyond"] <= 1 and row["largest"] < 0.01, row
    assert gradients.counted(4000) == 0
