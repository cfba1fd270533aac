"""With its true numbers the engine meets recordings of another one to the noise: belts, plays, and the laws that
recordings of real rigs asked for."""

import importlib
import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco")
sys.path.insert(0, str(Path(__file__).parents[2] / "experiments" / "concealed"))
ceiling, play, seal = (importlib.import_module(name) for name in ("ceiling", "play", "seal"))

HALVES = ("dev", "laws")
SEALS = {name: sealed for half in HALVES for name, sealed in json.loads(seal.SEALS.read_text())[half].items()}
TRUTHS = {name: truth for half in HALVES for name, truth in seal.open_truths(half).items()}
PARTED = ["backlash", "belt_compliance"]
CASES = sorted(
    name
    for name, truth in TRUTHS.items()
    if truth["line"].endswith(" at 60")
    or (truth["half"] == "dev" and any(e["kind"] in PARTED for e in truth["effects"]))
)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_true_numbers_leave_the_noise(name, tmp_path):
    usual, fine = ceiling.left_by_the_truth(TRUTHS[name], play.write(TRUTHS[name], tmp_path, SEALS[name]))
    assert max(usual.values()) < 1.2, usual  # two engines' instants of impact differ by some of the noise
    assert max(fine.values()) < 1.2, fine
