"""Every command ends the same in every process: other hash seeds, one thread or many, new programs or kept ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "experiments"))

import kills

ALONE = {"PYTHONHASHSEED": "1", "NPROC": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Threads of JAX, and of NumPy's linear algebra."""
TOGETHER = {"PYTHONHASHSEED": "2", "NPROC": "4", "OMP_NUM_THREADS": "4", "OPENBLAS_NUM_THREADS": "4"}


@pytest.mark.slow
@pytest.mark.parametrize("name", [*kills.COMMANDS, *kills.OTHERS])
def test_a_command_ends_the_same_in_every_process(tmp_path, name):
    kills.prepare(tmp_path)
    for out, environment in (("one", ALONE), ("two", TOGETHER)):  # the second finds the programs of the first
        words = [sys.executable, "-m", "jbridge", *kills.words_of(name, out)]
        environment = os.environ | environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
    one, two = (kills.contents(tmp_path, out) for out in ("one", "two"))
    assert one.keys() == two.keys() and [key for key in one if one[key] != two[key]] == []
