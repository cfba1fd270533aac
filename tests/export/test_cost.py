"""What controllers cost in C, measured on the smallest and the largest of them."""

import platform
import shutil

import pytest

from experiments.export_cost import controllers, measure

REASON = "needs gcc on x86-64"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None or platform.machine() != "x86_64", reason=REASON)
def test_fuzzy_rules_cost_more_than_a_pid_and_single_precision_less():
    every = controllers()
    pid, rules = (every[name] for name in ("PID with compensation", "the paper's rules"))
    small, large, single = measure(pid, "double"), measure(rules, "double"), measure(rules, "float")
    # Last readings, speeds and integrals: three, three and two numbers of eight bytes.
    assert small["state"] == 8 * 8 and large["state"] == 2 * single["state"]
    assert 100 < small["code"] < single["code"] < large["code"]
    assert large["cycles"] > 3 * small["cycles"] > 0
