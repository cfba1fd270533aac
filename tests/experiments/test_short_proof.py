"""A short run of the concealed proof: every second case of its development half, from the command line.

About an hour on two cores. The whole of it is `python experiments/concealed/run.py`.
"""

import importlib
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
sys.path.insert(0, str(Path(__file__).parents[2] / "experiments" / "concealed"))
run, play, seal = (importlib.import_module(name) for name in ("run", "play", "seal"))

CASES = [f"dev-{number:02d}" for number in range(1, 49, 2)]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_concealed_case_is_diagnosed(name, tmp_path):
    truth = seal.open_truths("dev")[name]
    case = play.write(truth, tmp_path)
    run.diagnose(case, timeout=1800.0)
    row = run.row_of(truth, case)
    told = f"{' + '.join(row['true']) or 'nothing missing'} was called {row['verdict']}, {row['named']}"
    assert row["verdict_right"], told
    assert row["equation_right"], told
    if truth["verdict"] == "missing_physics":
        assert row["first_right"], told
