"""Where a mismatch sits: a local force is found along its variable, a spread one is not."""

import numpy as np
import pytest

from jbridge.diagnosis.locate import equation_of, intervals, region
from jbridge.identify.result import Trace

TIMES = np.arange(3000) * 0.01


def trace(force, *, before=None, name="train-1.csv", seed=0):
    """A cart that goes to and fro, with a residual force and the errors of two models."""
    x = 0.75 + 0.5 * np.sin(0.9 * TIMES)
    v = np.gradient(x, TIMES)
    rest = 0.05 * np.random.default_rng(seed).standard_normal(len(TIMES))
    measured = x if before is None else x
    return Trace(
        name,
        "train",
        TIMES,
        {"u_x": 2 * np.sign(np.cos(0.9 * TIMES))},
        {"x": measured},
        {"x": x if before is None else x + before},
        {"x": x},
        {"x": x},
        {"x": v},
        {"x": force(x, v, TIMES) + rest},
        {"x": rest},
    )


def test_a_force_at_one_place_is_found():
    found = region([trace(lambda x, v, t: 2.0 * ((x > 0.5) & (x < 0.65)))], "x")
    assert found[0].variable == "x"
    # A bin is a twelfth of the metre that was covered.
    assert found[0].low == pytest.approx(0.5, abs=0.09) and found[0].high == pytest.approx(0.65, abs=0.09)
    assert found[0].share > 0.6


def test_a_force_at_high_speed_is_found_there():
    found = region([trace(lambda x, v, t: 3.0 * (v > 0.3))], "x")
    assert "v_x" in [r.variable for r in found]
    at = next(r for r in found if r.variable == "v_x")
    assert at.low > 0.2


def test_a_force_everywhere_has_no_place():
    assert region([trace(lambda x, v, t: np.ones_like(x))], "x") == ()


def test_rest_and_reversals_do_not_disturb():
    some = trace(lambda x, v, t: np.where(np.abs(v) < 0.1, np.nan, 2.0 * (x > 1.1)))
    assert region([some, some], "x")[0].low > 0.9


def test_without_a_force_there_is_no_place():
    assert region([trace(lambda x, v, t: np.full_like(x, np.nan))], "x") == ()
    assert region([], "x") == ()


def test_a_jump_is_found_in_time():
    jump = np.where(TIMES > 12.0, 0.02, 0.0)
    (found,) = intervals([trace(lambda x, v, t: 0 * x, before=jump)], "x", {"x": 4e-5})
    assert found.recording == "train-1.csv"
    assert found.start == pytest.approx(12.0, abs=0.3) and found.stop == pytest.approx(12.0, abs=0.3)


def test_a_steady_drift_has_no_time():
    assert intervals([trace(lambda x, v, t: 0 * x, before=1e-3 * TIMES)], "x", {"x": 4e-5}) == ()


def test_what_lies_within_noise_has_no_time():
    jump = np.where(TIMES > 12.0, 1e-4, 0.0)
    assert intervals([trace(lambda x, v, t: 0 * x, before=jump)], "x", {"x": 4e-5}) == ()


def test_equations():
    assert [equation_of(axis) for axis in ("x", "psi", "l", None)] == ["cart", "swing", "hoist", "none"]
