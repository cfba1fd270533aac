"""Predictions from the state that half a second tells, against the variance of a straight line's continuation."""

import numpy as np
import pytest

from jbridge.identification.evaluation.judge import make_judge
from jbridge.identification.setting import setting_of
from tests.identification.cases import make_recording
from tests.problems import make_plant

NOISE, PERIOD, ROWS = 4e-5, 0.01, 600
TOLD = 50
"""Samples in half a second."""


def coasting(name, seed):
    """A cart without damping: 0.1 m/s from 0.2 m."""
    times = np.arange(ROWS) * PERIOD
    noise = NOISE * np.random.default_rng(seed).standard_normal(ROWS)
    return make_recording(name, times, u_x=np.zeros(ROWS), x=0.2 + 0.1 * times + noise)


def test_what_half_a_second_leaves_open_is_the_variance_of_a_line_that_goes_on():
    runs = [coasting(f"run-{i}.csv", i) for i in range(12)]
    plant = make_plant(cart_damping=0.0)
    setting = setting_of(plant, runs)
    found = make_judge(setting, runs, setting.noise).evaluate(plant)
    own = found.of(np.inf)
    times = np.arange(ROWS) * PERIOD
    design = np.stack([np.ones(TOLD), times[:TOLD]])
    covariance = np.linalg.inv(design @ design.T)
    line = np.stack([np.ones(ROWS), times])
    variance = np.einsum("in,ij,jn->n", line, covariance, line)
    assert found.undetermined[own, 0].mean() == pytest.approx(variance.mean(), rel=0.1)
    # Recordings of the true model: twelve at once stay below what noise explains, and are not far from it.
    assert 0.5 * found.foreseen(np.inf)["x"] < found.errors(np.inf)["x"] < found.foreseen(np.inf)["x"]
