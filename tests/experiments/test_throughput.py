"""The benchmark's engines answer the same, and its table says what was measured."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parents[2] / "experiments" / "throughput"
sys.path.insert(0, str(HERE))  # the scripts of an experiment import their neighbours by plain names

import cpp  # noqa: E402
import draw  # noqa: E402
import engines  # noqa: E402
import ours  # noqa: E402
import problem  # noqa: E402


@pytest.mark.parametrize("name", ["mujoco", "diffrax", "scipy"])
def test_other_engines_move_the_bare_bridge_alike(name):
    if name == "mujoco":
        pytest.importorskip("mujoco")
    given = problem.bare(3, 0.4)
    engine = {"mujoco": engines.mujoco_batch, "diffrax": engines.diffrax_batch, "scipy": engines.scipy_batch}[name]
    final = ours.bare_forward(given)(given.starts)
    assert np.abs(final - given.starts).max() > 1e-3
    np.testing.assert_allclose(engine(given)(), final, atol=engines.AGREE[name])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="no compiler for C++")
@pytest.mark.parametrize("mode", problem.MODES)
def test_the_reference_in_cpp_agrees(mode, tmp_path):
    program, model = cpp.build(tmp_path), problem.load_model(tmp_path)
    given = problem.batch(mode, 5, 0.4)
    theirs = cpp.reference(program, mode, "float64", given, short=1, repeats=1)["final"]
    found = ours.timed(ours.forward(mode, given, model, "float64"), ours.lanes_of(given, "float64"), "float64")[2]
    np.testing.assert_allclose(found, theirs, atol=1e-9)


def test_the_table_tells_what_falls_short(tmp_path):
    row = {"precision": "float64", "lanes": 64, "seconds": 1.0, "jbridge": 30e6, "cpp": 60e6, "ratio": 0.5}
    row |= {"first_call": 1.0}
    rows = [row | {"mode": mode} for mode in problem.MODES]
    other = {"lanes": 256, "seconds": 1.0, "jbridge": 30e6, "rate": 1e6, "difference": 1e-9}
    saved = {
        "cores": 2, "processor": "x", "rows": rows, "horizon": rows, "smooth": {"hard": 1.0, "smooth": 1.2},
        "rivals": [other | {"name": "mujoco"}, {"name": "torch-fis", "lanes": 256, "missing": True}],
        "gradient": {"forward": 1.0, "rematerialised": 6.0, "kept": 3.0, "compile rematerialised": 9.0},
        "few": {"seconds": 16.0, "diffrax": 2.0, "plain": 5.0, "jbridge": 1.0}, "compile": {"open": 1.0, "closed": 2.0},
        "memory": {"1.0": {"peak": 1e8}, "60.0": {"peak": 1.05e8}},
    }  # fmt: skip
    draw.everything(saved, tmp_path)
    text = (tmp_path / "throughput-table.md").read_text()
    for words in (
        ">= 1.0 | 0.50 (30 against 60 M steps/s)",
        "rematerialised | <= 4 | 6.00",
        "plain `diffeqsolve` | >= 4 | 5.00 (2.00 with our compiler options)",
        "torch-fis, 256 bare bridges | >= 10 | not installed",
        "60 s against 1 s | <= 1.1 | 1.05",
        "| mujoco | 256 | 1 | 30 | 1 | 30 | 1e-09 |",
    ):
        assert words in text
    assert (tmp_path / "throughput.png").exists() and (tmp_path / "throughput-horizon.png").exists()
