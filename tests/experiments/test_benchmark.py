"""The benchmark runs any command on a case, and counts as no answer what fails or takes too long."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="cases are played by MuJoCo")
SCRIPT = Path(__file__).parents[2] / "experiments" / "benchmark" / "run.py"
spec = importlib.util.spec_from_file_location("benchmark", SCRIPT)
benchmark = importlib.util.module_from_spec(spec)
spec.loader.exec_module(benchmark)

TOOL = """
import json, sys, time
case, out, does = sys.argv[2], sys.argv[3], sys.argv[1]
if does == "sleeps":
    time.sleep(60)
if does == "fails":
    sys.exit(3)
json.dump({"read": case}, open(out + "/report.json", "w"))
"""


@pytest.mark.parametrize(("does", "status"), [("writes", 0), ("fails", 3), ("sleeps", -1)])
def test_a_tool_is_called_with_case_and_folder(tmp_path, does, status):
    (tmp_path / "tool.py").write_text(TOOL)
    command, out = f"{sys.executable} {tmp_path / 'tool.py'} {does}", tmp_path / "out"
    told = benchmark.answered(command, tmp_path / "case", out, 1.0)
    assert told["status"] == status
    if status == 0:
        assert json.loads((out / "report.json").read_text()) == {"read": str(tmp_path / "case")}
        # What is finished is not run again.
        (tmp_path / "tool.py").unlink()
        assert benchmark.answered(command, tmp_path / "case", out, 1.0) == told


def test_no_answer_is_no_right_one(tmp_path):
    truth = next(t for t in benchmark.open_truths("dev").values() if t["concealed"])
    case = tmp_path / "recordings"
    case.mkdir()
    (case / "train-1.csv").write_text("t,u_x,x\n0,0,0\n")
    row = benchmark.scored(truth, tmp_path, tmp_path, {"status": 3, "wall": 0.1})
    assert row["verdict"] == "failed" and not row["first_right"] and row["named"] == []
    page = benchmark.table({"nothing": [row]})
    assert "| verdict right | 0 % (0/1;" in page and "| confirmed names that are true or equivalent | 0 of 0 |" in page
