"""Recordings with fewer samples have the same inputs."""

import dataclasses

import numpy as np
import pytest

from jbridge.identification.data.thinning import thinned
from jbridge.recordings.recording import Commands
from tests.identification.cases import make_recording

PERIOD = 0.001


def recorded(times):
    """A cart by formula; what its input was before goes on at the same pace."""
    one = make_recording("fast.csv", times, u_x=np.sin(9 * times), x=0.5 + 0.1 * np.sin(times))
    before = np.arange(-400, 0) * PERIOD
    return dataclasses.replace(one, earlier=Commands(before, np.sin(9 * before), None))


def impulse(times, values, end):
    return float(np.sum(values * np.diff(np.append(times, end))))


@pytest.mark.parametrize("jitter", [0.0, 0.001, 0.3])
@pytest.mark.parametrize("missing", [[], [1203, 1204, 2000]])
def test_rows_and_the_inputs_before_are_taken_every_few_milliseconds(missing, jitter):
    """Rows whose stamps are off by up to a third of the period, and rows that are missing, change little."""
    times = np.delete(np.arange(4000) * PERIOD, missing)
    times[1:] += PERIOD * np.random.default_rng(0).uniform(-jitter, jitter, times.size - 1)
    whole = recorded(times)
    few = thinned(whole)
    assert few.times.size == pytest.approx(1000, abs=3) and np.ptp(np.diff(few.times)) <= 4.7 * PERIOD
    if jitter < 0.1:
        usual = np.quantile(np.diff(few.times), [0.02, 0.98])
        assert usual == pytest.approx(4 * PERIOD, abs=2.1 * jitter * PERIOD + 1e-9)
    np.testing.assert_array_equal(few.x, 0.5 + 0.1 * np.sin(few.times))
    end = times[-1] + PERIOD
    assert impulse(few.times, few.u_x, end) == pytest.approx(impulse(times, whole.u_x, end), abs=4 * PERIOD)
    assert few.earlier.times.size == pytest.approx(100, abs=1) and -4 * PERIOD <= few.earlier.times[-1] < 0.0
    assert impulse(few.earlier.times, few.earlier.u_x, 0.0) == pytest.approx(
        impulse(whole.earlier.times, whole.earlier.u_x, 0.0)
    )


def test_what_is_slow_stays_as_it_is():
    times = np.arange(400) * 0.005
    slow = make_recording("slow.csv", times, u_x=np.sin(9 * times), x=np.sin(times))
    assert thinned(slow) is slow
