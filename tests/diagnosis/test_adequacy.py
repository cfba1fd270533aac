"""Is what remains noise? White residuals pass, drifting ones do not, and recordings' gaps do not matter."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jbridge.diagnosis.adequacy import (
    LARGE,
    SIGNIFICANT,
    carries_over,
    channels,
    closes_little,
    in_vain,
    is_large,
    ratios,
    significance,
    worst_ratio,
)
from jbridge.identify.evaluate import Run
from jbridge.identify.lanes import make_batch
from jbridge.identify.result import Errors
from tests.identify.cases import NOISE, make_recording

TIMES = np.arange(1200) * 0.01


@pytest.fixture(scope="module")
def batch():
    runs = [make_recording(f"{i}.csv", TIMES, u_x=np.sin(TIMES + i), x=np.zeros(len(TIMES))) for i in range(3)]
    return make_batch(runs, NOISE)


def predicted(batch, error):
    """Readings that miss the measurements by an error, given by recording and sample."""
    y = np.zeros(batch.lanes.y.shape)
    for lane, row in zip(np.flatnonzero(batch.recording >= 0), error, strict=True):
        y[lane, : len(row), 0] = row
    return y


def white(seed):
    return NOISE["x"] * np.random.default_rng(seed).standard_normal((3, len(TIMES)))


@pytest.mark.parametrize("draws", [True, False])
def test_white_residuals_are_rarely_significant(batch, draws):
    found = [significance(batch, predicted(batch, white(seed)), draws=draws) for seed in range(20)]
    # Under the null the chance of one among twenty at 0.01 is a fifth, of two one in sixty.
    assert sum(p <= SIGNIFICANT for p in found) <= 1
    assert 0.2 < np.mean(found) < 0.8


@pytest.mark.parametrize("draws", [True, False])
def test_a_slow_error_is_significant(batch, draws):
    drift = NOISE["x"] * np.sin(2 * np.pi * TIMES / 5.0)
    assert significance(batch, predicted(batch, white(0) + drift), draws=draws) <= SIGNIFICANT


def test_without_draws_it_is_ljungs_and_boxs_statistic(batch):
    """One recording of white noise, with the sum over lags written out and SciPy's own distribution."""
    noise = white(5)
    noise[1:] = 0.0
    left = (noise[0] / NOISE["x"])[:1200].reshape(120, 10).sum(axis=1)
    # The row that is missed by nothing still counts no blocks, for there is nothing in it.
    r = [np.sum(left[k:] * left[:-k]) / np.sum(left**2) for k in range(1, 11)]
    q = 120 * 122 * sum(r[k - 1] ** 2 / (120 - k) for k in range(1, 11))
    found = significance(batch, predicted(batch, noise), draws=False)
    assert found == pytest.approx(stats.chi2.sf(q, 10), rel=1e-6)


def test_an_error_that_noise_hides_is_not(batch):
    drift = 0.02 * NOISE["x"] * np.sin(2 * np.pi * TIMES / 5.0)
    assert significance(batch, predicted(batch, white(0) + drift)) > SIGNIFICANT


def test_the_same_residuals_give_the_same_answer(batch):
    assert significance(batch, predicted(batch, white(3))) == significance(batch, predicted(batch, white(3)))


def test_channels_and_their_size(batch):
    found = channels(batch, predicted(batch, np.full((3, len(TIMES)), 3 * NOISE["x"])), {"x": NOISE["x"]})
    assert set(found) == {"x"} and found["x"].ratio == pytest.approx(3.0)
    assert is_large(found)
    small = channels(batch, predicted(batch, np.full((3, len(TIMES)), 0.99 * LARGE * NOISE["x"])), {"x": NOISE["x"]})
    assert not is_large(small)


def test_what_was_not_measured_does_not_count(batch):
    weight = np.array(batch.lanes.weight)
    weight[:, 100:] = 0.0
    lanes = replace(batch.lanes, weight=jnp.asarray(weight))
    error = np.zeros((3, len(TIMES)))
    error[:, 100:] = 1.0
    found = channels(replace(batch, lanes=lanes), predicted(batch, error), {"x": NOISE["x"]})
    assert found["x"].rmse == 0.0


def asked_of_both(question, before, after):
    """An answer from errors over noise of free runs, and of windows, where the others say the opposite."""
    noise = {"x": 1e-3, "l": 1e-4}
    away, good = ({axis: 1e3 * noise[axis] for axis in noise}, dict(noise))
    scaled = [{axis: ratio * noise[axis] for axis, ratio in ratios.items()} for ratios in (before, after)]
    runs = question(*(Errors(s, away) for s in scaled), noise, windows=False)
    return runs, question(*(Errors(good, s) for s in scaled), noise, windows=True)


@pytest.mark.parametrize(
    ("before", "after", "holds"),
    [
        ({"x": 10.0, "l": 1.0}, {"x": 5.0, "l": 1.0}, True),
        ({"x": 10.0, "l": 1.0}, {"x": 6.0, "l": 1.0}, False),
        ({"x": 2.0, "l": 1.0}, {"x": 1.4, "l": 1.0}, True),
        ({"x": 10.0, "l": 1.0}, {"x": 1.0, "l": 8.0}, False),
    ],
)
def test_a_gap_must_close_on_the_holdout_too(before, after, holds):
    """Half of the excess of the worst channel, or down to what counts as small."""
    assert asked_of_both(carries_over, before, after) == (holds, holds)


@pytest.mark.parametrize(
    ("before", "after", "vain"),
    [
        ({"x": 1.0, "l": 20.0}, {"x": 1.0, "l": 12.0}, False),
        ({"x": 1.0, "l": 20.0}, {"x": 1.0, "l": 19.0}, True),
        # A tenth less of the worst channel, and another one spoilt.
        ({"x": 1.0, "l": 20.0}, {"x": 9.0, "l": 18.0}, True),
        ({"x": 1.0, "l": 20.0}, {"x": np.nan, "l": 1.0}, True),
        ({"x": 1.0, "l": 20.0}, {"x": 1.0, "l": 40.0}, True),
    ],
)
def test_names_that_leave_the_holdout_as_it_was_are_vain(before, after, vain):
    assert asked_of_both(in_vain, before, after) == (vain, vain)


@pytest.mark.parametrize(
    ("before", "after", "closes"),
    [
        ([1.3, 1.0, 1.0], [1.1, 1.0, 1.0], True),
        ([1.3, 1.0, 1.0], [1.2, 1.0, 1.0], False),
        # What the hold-out does not show is not proven by it.
        ([1.05, 1.0, 1.0], [1.0, 1.0, 1.0], False),
        ([1.3, 1.0, 1.0], [1.0, 1.3, 1.0], False),
        ([1.3, 1.0, 1.0], [np.nan, 1.0, 1.0], False),
    ],
)
def test_a_little_gap_must_close_in_every_recording(batch, before, after, closes):
    first, last = (
        Run(batch, predicted(batch, np.array(sizes)[:, None] * NOISE["x"] * np.ones(len(TIMES))), Errors({}, {}))
        for sizes in (before, after)
    )
    np.testing.assert_allclose(ratios(first.batch, first.predicted)[:, 0], before)
    assert closes_little(first, last) is closes


def test_a_simulation_that_ran_away_is_the_worst():
    for errors in ({"x": np.nan, "l": 1e-3}, {"l": 1e-3, "x": np.nan}):
        assert worst_ratio(errors, {"x": 1e-3, "l": 1e-3}) == np.inf
