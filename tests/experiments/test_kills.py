"""Killed commands leave whole files, and end the same when they are called again; `experiments/kills.py` has many."""

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "experiments"))

import kills


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no process groups")
@pytest.mark.parametrize("name", kills.COMMANDS)
def test_nothing_is_torn(name, tmp_path):
    kills.prepare(tmp_path)
    assert kills.killed(tmp_path, name, 2, random.Random(0)) == []


def test_a_torn_file_would_be_found(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text('{"a": 1')
    with pytest.raises(ValueError, match=r"report\.json"):
        kills.contents(tmp_path, "out")
