"""The tutorials run as they stand, and end with what they promise."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROMISED = {
    "own_recordings": "confirmed position_direction_friction cart",
    "controller": "#ifndef",
    "course": "quadratic_drag coefficient 25.",
}


def test_every_tutorial_promises_something():
    assert {path.stem for path in (ROOT / "docs" / "tutorials").glob("*.py")} == PROMISED.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", PROMISED)
def test_tutorials_run(name):
    path = ROOT / "docs" / "tutorials" / f"{name}.py"
    done = subprocess.run(
        [sys.executable, path], cwd=ROOT, env=os.environ | {"MPLBACKEND": "Agg"}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert PROMISED[name] in done.stdout
