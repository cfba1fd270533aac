"""The criterion: effective numbers of samples against theory, weights against its gradient."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from jbridge.identification.data.windows import make_data
from jbridge.identification.likelihood import index, likelihood
from tests.identification.cases import FULL, make_recording


@pytest.fixture(scope="module")
def data():
    times = np.arange(6000) * 0.01
    x = 0.5 + 0.2 * np.sin(times)
    return make_data([make_recording("run.csv", times, u_x=np.sin(times), x=x)], (1.0, 3.0))


def second(data):
    """The windows of one second alone."""
    return data.with_tilings([tiling for tiling in data.tilings if tiling.horizon == 1.0])


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_effective_number_of_an_autoregressive_process(data, pole):
    noise = np.random.default_rng(0).standard_normal(data.samples)
    residual = np.zeros((data.samples, 3))
    residual[:, 0] = lfilter([1.0], [1.0, -pole], noise)
    found = likelihood(data, index(data), [residual] * len(data.tilings))
    # Between the numbers of which a mean and a mean square are as uncertain, for an infinitely long one.
    low, high = ((1 - p) / (1 + p) for p in (pole, pole**2))
    assert 0.9 * low < found.total / 6000 < 1.1 * high
    # A window has its share of them, and one at least, but for what windows of each horizon happen to leave.
    windows = np.maximum(index(data).count[:, 0] * found.total / 6000, 1.0)
    np.testing.assert_allclose(found.within[:, 0], windows, rtol=0.05)


@pytest.mark.parametrize("pole", [0.9, 0.97])
def test_windows_shorter_than_an_errors_memory_tell_no_more(data, pole):
    """To divide each by its own error would make half as many again of them, by the law of arcsines."""
    noise = np.random.default_rng(3).standard_normal(data.samples)
    residual = np.zeros((data.samples, 3))
    residual[:, 0] = lfilter([1.0], [1.0, -pole], noise)
    short, whole = (make_data(data.recordings, (horizon,)) for horizon in (0.1, np.inf))
    found, wanted = (likelihood(each, index(each), [residual]).total for each in (short, whole))
    assert found == pytest.approx(wanted, rel=0.3)


def test_one_window_that_is_not_met_says_nothing_of_the_others(data):
    """A cart that hits what the model does not have leaves one smooth error, thousands of times the noise."""
    white = np.random.default_rng(0).standard_normal((data.samples, 3))
    hit = white.copy()
    hit[3000:3100] += 3000.0
    (usual, _), (after, _) = (counted(second(data), [left]) for left in (white, hit))
    assert after[0] == pytest.approx(usual[0], rel=0.2)


def thinned(data):
    """The same with a single reading in the first window of the longest horizon."""
    measured = data.measured.copy()
    measured[0, 1 : max(tiling.stops[0] for tiling in data.tilings)] = False
    return dataclasses.replace(data, measured=measured)


def test_what_moves_in_a_window_is_the_variance_of_its_readings(data):
    windows = index(thinned(data))
    for w, (begin, stop) in enumerate(zip(windows.begin, windows.stop, strict=True)):
        seen = thinned(data).measured[0, begin:stop, 0]
        readings = data.y[0, begin:stop, 0][seen] / data.noise[0, 0]
        assert windows.count[w, 0] == len(readings)
        assert windows.signal[w, 0] == pytest.approx(np.var(readings) if len(readings) else 0.0, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("change", [lambda data: data, thinned], ids=["all", "few"])
@pytest.mark.parametrize("left", [np.ones, np.random.default_rng(4).standard_normal], ids=["smooth", "white"])
def test_weights_are_the_gradient(data, left, change):
    data = change(data)
    windows = index(data)
    found = likelihood(data, windows, [left((data.samples, 3))] * len(data.tilings))
    square = np.random.default_rng(1).uniform(0.5, 1e4, windows.count.shape)
    weights = found.weights(square)
    for w in (0, 5, len(square) - 1):
        moved = [square.copy(), square.copy()]
        step = 1e-4 * square[w, 0]
        moved[0][w, 0] += step
        moved[1][w, 0] -= step
        slope = (found.value(moved[0]) - found.value(moved[1])) / (2 * step)
        # The criterion counts half the weighted squares of all samples of the window.
        assert 0.5 * weights[w, 0] * windows.count[w, 0] == pytest.approx(slope, rel=1e-5)


def test_what_another_model_is_expected_to_lose(data):
    """The mean over draws of the noise, where it predicts something else in a few windows; nothing in the others."""
    windows, rng = index(data), np.random.default_rng(5)
    found = likelihood(data, windows, [rng.standard_normal((data.samples, 3))] * len(data.tilings))
    excited = np.zeros(windows.count.shape, bool)
    excited[::9, 0] = windows.count[::9, 0] > 0
    apart = np.where(excited, 4.0, 0.0)
    lost, expected = 0.0, 0.0
    for _ in range(30):
        noise = rng.chisquare(np.maximum(windows.count, 1)) / np.maximum(windows.count, 1)
        cross = 2.0 * np.sqrt(apart / np.maximum(windows.count, 1)) * rng.standard_normal(apart.shape)
        told = found.expected(noise, apart)
        assert np.all(told[~excited] == 0.0) and np.all(told[excited] > 0.0)
        expected += told.sum()
        lost += found.value(noise + apart + cross) - found.value(noise)
    assert expected == pytest.approx(lost, rel=0.2)


def test_least_squares_are_half_the_sum_of_squares(data):
    windows = index(data)
    found = likelihood(data, windows, [np.ones((data.samples, 3))] * len(data.tilings)).of_squares()
    squares = np.random.default_rng(1).uniform(0.5, 100.0, (2, *windows.count.shape))
    sums = (squares * windows.count).sum(axis=(1, 2))
    assert found.value(squares[1]) - found.value(squares[0]) == pytest.approx(0.5 * (sums[1] - sums[0]), rel=1e-5)


def test_a_scale_is_where_windows_above_and_below_balance(data):
    windows = index(data)
    found = likelihood(data, windows, [np.ones((data.samples, 3))] * len(data.tilings))
    square = 10.0 ** np.random.default_rng(2).uniform(-1.0, 5.0, windows.count.shape)
    scale, variance = found.scale(square)[:, 0], found.variance(square)[:, 0]
    for horizon in data.horizons:
        own = windows.horizon == horizon
        assert len(np.unique(scale[own])) == 1
        above = np.average(variance[own] / (scale[own] + variance[own]), weights=windows.motion[own, 0])
        assert above == pytest.approx(0.5, abs=1e-6)
    # What all windows together count says nothing of where they balance.
    more = dataclasses.replace(found, share=1e4 * found.share)
    np.testing.assert_allclose(more.scale(square), found.scale(square), rtol=1e-9)


def test_half_the_error_gains_as_much_at_any_size(data):
    windows = index(data)
    found = likelihood(data, windows, [np.ones((data.samples, 3))] * len(data.tilings))
    square = np.random.default_rng(3).uniform(1e2, 1e5, windows.count.shape)
    gains = [found.value(4.0 * size * square) - found.value(size * square) for size in (1.0, 1e4)]
    assert gains == pytest.approx([np.log(2.0) * found.share.sum()] * 2, rel=1e-2)


def test_a_window_that_is_met_by_luck_has_no_say(data):
    """A sum of logarithms would give a window ten times better than most a hundred times the weight."""
    windows = index(data)
    found = likelihood(data, windows, [np.ones((data.samples, 3))] * len(data.tilings))
    square = np.full(windows.count.shape, 1e4)
    weights = []
    for size in (1e-2, 1.0, 1e2):
        square[0, 0] = 1e4 * size
        weights.append(found.weights(square)[0, 0])
    assert weights[0] < 2.2 * weights[1]
    assert weights[2] < 0.03 * weights[1]


def test_windows_at_rest_count_for_little():
    times = np.arange(400) * 0.01
    still = make_recording("rest.csv", times, u_x=np.sin(times), x=np.full(400, 0.5))
    moving = make_recording("run.csv", times, **FULL)
    told = index(make_data([still, moving], (1.0,), {"x": 4e-5, "psi": 6e-4, "l": 4e-5}))
    rest, run = told.motion[told.recording == 0, 0], told.motion[told.recording == 1, 0]
    assert rest.max() < 0.01 and run.min() > 0.9


def test_a_rest_counts_where_the_model_moves():
    times = np.arange(400) * 0.01
    data = make_data([make_recording("rest.csv", times, u_x=np.sin(times), x=np.full(400, 0.5))], (1.0,), {"x": 4e-5})
    windows = index(data)
    left = np.zeros((data.samples, 3))
    left[:, 0] = np.repeat([0.0, 1.0, 5.0, 100.0], 100)[np.minimum(np.arange(data.samples), 399)]
    share = likelihood(data, windows, [left]).share[:, 0]
    assert share / share[3] == pytest.approx(np.array([0.0, 1 / 26, 0.5, 1.0]), rel=0.05, abs=1e-9)
    # Without a model nothing moves, wherever the place 0 is.
    far = dataclasses.replace(data, y=data.y + 50.0)
    assert likelihood(far, windows).share[:, 0].max() < 1e-9


def counted(data, left):
    """What the windows of each horizon count together, were all of them in motion."""
    windows = index(data)
    found = likelihood(data, windows, left)
    level = found.share[:, 0] / np.maximum(windows.motion[:, 0], 1e-12)
    return [level[windows.horizon == h].sum() for h in data.horizons], found.total


def test_horizons_with_the_same_errors_count_the_same(data):
    totals, _ = counted(data, [np.ones((data.samples, 3))] * len(data.tilings))
    assert totals[0] == pytest.approx(totals[1])


def test_horizons_weigh_as_their_own_samples_do_and_by_no_more_than_the_mean(data):
    white = np.random.default_rng(0).standard_normal((data.samples, 3))
    drift = np.linspace(-1.0, 1.0, data.samples)[:, None] * np.ones(3)
    many, few = (counted(data, [left] * 2)[1] for left in (white, drift))
    assert few < 10.0 < many
    totals, total = counted(data, [white, drift])
    mean = np.sqrt(many * few)
    # Errors are taken over those of their windows, which are others at each horizon.
    assert total == pytest.approx(mean, rel=0.02) and sum(totals) == pytest.approx(mean, rel=0.02)
    assert totals[1] / totals[0] == pytest.approx(few / mean, rel=0.02)


def test_a_window_counts_its_own_samples_alone(data):
    """A simulation that runs away in one window leaves 1e15 there, beside which the next is not lost."""
    [tiling] = second(data).tilings
    values = np.ones((data.samples, 3))
    values[tiling.begins[3] : tiling.stops[3]] = 1e17
    sums = tiling.sums(values)
    np.testing.assert_array_equal(np.delete(sums[:, 0], 3), np.delete(tiling.stops - tiling.begins, 3))
    empty = dataclasses.replace(tiling, stops=tiling.count_from)
    assert not empty.sums(values).any()
