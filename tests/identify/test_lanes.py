"""Recordings as lanes: gaps, irregular times, windows with their past, and lanes that only fill up a shape."""

import numpy as np
import pytest

from jbridge.identification.data.grid import grid
from jbridge.identify.lanes import make_batch
from tests.identify.cases import NOISE, make_recording

PERIOD = 0.01


def swing_run(times: np.ndarray, name: str = "run.csv"):
    u = np.sign(np.sin(5 * times)) * (1 + times)
    return make_recording(name, times, u_x=u, x=0.5 + 0.1 * np.sin(times))


def even(seconds: float) -> np.ndarray:
    return np.arange(round(seconds / PERIOD) + 1) * PERIOD


def test_a_gap_is_bridged_without_measurements():
    times = np.delete(even(3.0), slice(100, 140))
    run = swing_run(times)
    found = grid(run, 1.5 * PERIOD)
    assert np.diff(found.times).max() <= 1.5 * PERIOD + 1e-12
    rows = np.searchsorted(found.times, times - 1e-9)
    np.testing.assert_allclose(found.times[rows], times, atol=1e-12)
    assert found.measured[rows, 0].all() and found.measured[:, 0].sum() == len(times)
    np.testing.assert_array_equal(found.y[rows, 0], run.x)
    # The input is held over the whole gap.
    inside = (found.times[:-1] >= times[99]) & (found.times[:-1] < times[100] - 1e-9)
    assert inside.sum() >= 27
    np.testing.assert_array_equal(found.u[inside, 0], run.u_x[99])


def test_irregular_times_are_kept():
    key = np.random.default_rng(1)
    times = np.cumsum(key.uniform(0.8, 1.2, 400) * PERIOD)
    found = grid(swing_run(times), 1.5 * PERIOD)
    np.testing.assert_allclose(found.times, times - times[0], atol=1e-12)
    np.testing.assert_array_equal(found.u[:, 0], swing_run(times).u_x[:-1])


def test_a_repeated_sample_is_no_measurement():
    run = swing_run(even(2.0))
    run.fresh["x"][1::2] = False
    batch = make_batch([run], NOISE)
    assert (np.asarray(batch.lanes.weight)[0, :, 0] > 0).sum() == run.fresh["x"].sum()


def test_weights_are_one_over_the_noise():
    weight = np.asarray(make_batch([swing_run(even(2.0))], NOISE).lanes.weight)
    assert set(np.unique(weight[:, :, 0])) == {0.0, 1 / NOISE["x"]}
    assert not weight[:, :, 1:].any()


@pytest.mark.parametrize("seconds", [4.0, 6.0, 6.9, 7.3])
def test_windows_follow_each_other_and_leave_less_than_half_of_one(seconds):
    run = swing_run(even(seconds))
    batch = make_batch([run], NOISE, window=2.0)
    lengths = np.asarray(batch.lanes.lane.dt).sum(axis=1)
    real = batch.recording >= 0
    begins = np.asarray(batch.lanes.lane.start)[real]
    np.testing.assert_allclose(begins, 2.0 * np.arange(real.sum()), atol=1e-9)
    np.testing.assert_allclose(lengths[real][:-1], 2.0, atol=1e-9)
    assert begins[-1] + lengths[real][-1] >= seconds - 1.0 - 1e-9


@pytest.mark.parametrize(
    ("gap", "begins"), [((1.5, 2.8), [0.0, 2.8, 4.0]), ((1.5, 4.5), [0.0, 4.5]), ((5.6, 6.0), [0.0, 2.0, 4.0])]
)
def test_a_window_does_not_begin_within_a_gap(gap, begins):
    times = even(6.5)
    times = times[(times <= gap[0] + 1e-9) | (times >= gap[1] - 1e-9)]
    batch = make_batch([swing_run(times)], NOISE, window=2.0)
    real = batch.recording >= 0
    np.testing.assert_allclose(np.asarray(batch.lanes.lane.start)[real], begins, atol=1e-9)
    measured = np.asarray(batch.lanes.weight)[real, :, 0] > 0
    assert measured[:, 0].all()


def test_where_a_thing_is_does_not_follow_from_a_sensor_that_reads_something_else():
    run = swing_run(even(2.0))
    trusted, altered = make_batch([run], NOISE), make_batch([run], NOISE, altered=["x"])
    # Held about a reading that is 0.055 m off, a start would be a thousand standard deviations away.
    assert trusted.prior[0, 0] > 100.0 and altered.prior[0, 0] * 0.055 < 0.1
    np.testing.assert_array_equal(trusted.prior[0, 1:], altered.prior[0, 1:])
    np.testing.assert_array_equal(trusted.initial, altered.initial)


def test_a_window_knows_the_inputs_before_it():
    run = swing_run(even(4.0))
    batch = make_batch([run], NOISE, window=2.0)
    before, u = np.asarray(batch.lanes.lane.before), np.asarray(batch.lanes.lane.u)
    past = before.shape[1]
    assert np.all(u[0, :past] == 0.0)
    np.testing.assert_array_equal(u[1, :past, 0], run.u_x[200 - past : 200])
    np.testing.assert_allclose(before[1], PERIOD, atol=1e-12)


def test_lanes_that_fill_up_the_shape_hold_nothing():
    runs = [swing_run(even(seconds), f"{seconds}.csv") for seconds in (2.0, 3.0, 2.5)]
    batch = make_batch(runs, NOISE)
    spare = batch.recording < 0
    assert batch.count == 4 and spare.sum() == 1
    assert not np.asarray(batch.lanes.weight)[spare].any() and not np.asarray(batch.lanes.lane.dt)[spare].any()
    assert np.all(np.isinf(batch.prior[spare]))
    durations = np.asarray(batch.lanes.lane.dt).sum(axis=1)
    np.testing.assert_allclose(durations[:3], [2.0, 3.0, 2.5], atol=1e-9)


def test_a_batch_takes_the_shape_of_a_larger_one():
    large = make_batch([swing_run(even(5.0)), swing_run(even(4.0))], NOISE)
    small = make_batch([swing_run(even(3.0))], NOISE, like=large)
    assert small.lanes.y.shape == large.lanes.y.shape
    larger = make_batch([swing_run(even(30.0))], NOISE, like=large)
    assert larger.lanes.y.shape[1] > large.lanes.y.shape[1]


def test_the_first_guess_is_near_the_truth():
    times = even(2.0)
    run = make_recording("run.csv", times, u_x=np.zeros_like(times), x=0.5 + 0.3 * times - 0.2 * times**2)
    batch = make_batch([run], NOISE)
    np.testing.assert_allclose(batch.initial[0, [0, 3]], [0.5, 0.3], atol=1e-9)
    # What does not move is held.
    assert np.isinf(batch.prior[0, [1, 2, 4, 5]]).all()


def test_a_run_that_begins_at_rest_may_not_be_pushed():
    times = even(2.0)
    rng = np.random.default_rng(0)
    x = 0.5 + NOISE["x"] * rng.uniform(-1.0, 1.0, len(times))
    resting = make_recording("rest.csv", times, u_x=np.zeros_like(times), x=x)
    moving = make_recording("moves.csv", times, u_x=np.zeros_like(times), x=x + 0.1 * times)
    batch = make_batch([resting, moving], NOISE)
    assert batch.initial[0, 3] == 0.0 and np.isinf(batch.prior[0, 3])
    assert batch.initial[1, 3] == pytest.approx(0.1, abs=0.02) and np.isfinite(batch.prior[1, 3])


def test_what_drives_a_rig_that_begins_in_motion_did_so_before():
    times = even(3.0)
    rolling = make_recording("rolling.csv", times, u_x=np.full(len(times), 2.0), x=0.2 + 0.3 * times)
    rest = make_recording("rest.csv", times, u_x=np.full(len(times), 2.0), x=0.2 + 0.0 * times)
    # From rest through a slow drive: speed and force are zero at first.
    since = times / 0.1
    from_rest = make_recording(
        "from-rest.csv", times, u_x=np.full(len(times), 2.0), x=0.2 + 0.06 * since**3 / (9 + since**2)
    )
    u = np.asarray(make_batch([rolling, rest, from_rest], NOISE).lanes.lane.u)
    earlier = u.shape[1] - np.asarray(make_batch([rolling, rest, from_rest], NOISE).lanes.lane.dt).shape[1]
    assert earlier > 0 and np.all(u[0, :earlier, 0] == 2.0)
    assert not u[1, :earlier].any() and not u[2, :earlier].any()
    # A piece of a recording knows what was before it.
    piece = make_batch([swing_run(even(4.0)).rows(slice(150, None))], NOISE).lanes.lane
    np.testing.assert_array_equal(np.asarray(piece.u)[0, earlier - 50 : earlier, 0], swing_run(even(4.0)).u_x[100:150])
