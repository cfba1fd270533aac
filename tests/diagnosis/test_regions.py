"""Where a mismatch sits: a local force is found along its variable and in time, a spread one is not."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.localization.missing_force import Track
from jbridge.diagnosis.localization.regions import equation_of, intervals, regions, times_of
from jbridge.diagnosis.result import NamedEffect
from jbridge.identification.result import Estimate

TIMES = np.arange(1600) * 0.01


def track(force, seed=0, times=TIMES):
    """A cart that goes to and fro in its own way, with a missing force and what a smoother leaves of noise."""
    rng = np.random.default_rng(seed)
    x = 0.75 + 0.5 * np.sin(rng.uniform(0.7, 1.1) * times + rng.uniform(0, 6)) * np.cos(rng.uniform(0.1, 0.2) * times)
    v = np.gradient(x, times)
    rest = 0.05 * rng.standard_normal(len(times))
    u = 2 * np.sign(v) + rng.normal(0, 0.2, len(times))
    others = {"l": np.full(len(times), 0.6), "v_l": np.zeros(len(times))}
    return Track(times, x, v, u, others, force(x, v, times) + rest, np.ones(len(times)))


def tracks(force, count=4):
    return [track(force, seed) for seed in range(count)]


def by_name(found):
    return [(f"run-{i}.csv", each) for i, each in enumerate(found)]


def brake(x, v, t):
    return -1.5 * np.sign(v) * ((x > 0.5) & (x < 0.75))


def test_a_force_at_one_place_is_found():
    found = regions(tracks(brake), "x")
    assert found[0].variable == "x" and found[0].share > 0.8
    # A bin is a twenty-fourth of the metre that was covered.
    assert found[0].low == pytest.approx(0.5, abs=0.05) and found[0].high == pytest.approx(0.75, abs=0.05)


def test_what_a_fit_made_of_it_is_undone():
    """A refit spreads a brake over the rail as friction and damping: then the force is nowhere nothing."""
    found = regions(tracks(lambda x, v, t: brake(x, v, t) + 0.5 * np.sign(v) + 0.4 * v), "x")
    assert found[0].variable == "x"
    assert found[0].low == pytest.approx(0.5, abs=0.05) and found[0].high == pytest.approx(0.75, abs=0.05)


def test_a_force_that_is_hardly_more_than_noise_is_found():
    found = regions(tracks(lambda x, v, t: brake(x, v, t) / 15), "x")
    assert found[0].variable == "x" and found[0].low == pytest.approx(0.5, abs=0.05)


def test_a_force_at_high_speed_is_found_there():
    found = regions(tracks(lambda x, v, t: 3.0 * (v > 0.25)), "x")
    at = next(r for r in found if r.variable == "v_x")
    assert at.low == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize(
    "force",
    [
        lambda x, v, t: 0.8 * np.sign(v),
        lambda x, v, t: np.sin(40 * x),
        lambda x, v, t: 3.0 * np.sign(v) * (x - 0.5),
        lambda x, v, t: 3.0 * (x - 0.4),
        lambda x, v, t: 0 * x,
        lambda x, v, t: np.random.default_rng(7).normal(0, 0.5, len(x)),
    ],
    ids=["friction", "ripple", "a gain that changes with the place", "spring", "nothing", "noise"],
)
def test_a_force_everywhere_has_no_place_and_no_time(force):
    assert regions(tracks(force), "x") == ()
    assert intervals(by_name(tracks(force))) == ()


def test_a_place_that_one_recording_alone_has_is_none():
    some = [track(brake, 0), *(track(lambda x, v, t: 0 * x, seed) for seed in range(1, 4))]
    assert "x" not in {region.variable for region in regions(some, "x")}
    assert regions([], "x") == ()


def test_a_push_at_the_same_time_in_all_recordings_is_timed():
    found = intervals(by_name(tracks(lambda x, v, t: 0.3 * ((t > 4.1) & (t < 8.6)))))
    assert [interval.recording for interval in found] == [f"run-{i}.csv" for i in range(4)]
    for interval in found:
        assert interval.start == pytest.approx(4.1, abs=0.3) and interval.stop == pytest.approx(8.6, abs=0.3)


def test_an_event_of_one_recording_is_timed():
    bump = track(lambda x, v, t: 5.0 * ((t > 11.0) & (t < 11.4)), 1)
    (found,) = intervals(by_name([track(lambda x, v, t: 0 * x, 0), bump, track(lambda x, v, t: 0 * x, 2)]))
    assert found.recording == "run-1.csv" and found.start >= 10.7 and found.stop <= 11.7


def test_a_long_recording_is_cut_into_as_many_bins():
    times = np.arange(60_000) * 0.01
    found = intervals([("long.csv", track(lambda x, v, t: 2.0 * ((t > 200) & (t < 260)), times=times))])
    assert found[0].start == pytest.approx(200, abs=5) and found[0].stop == pytest.approx(260, abs=5)


def estimate(value, low=None, high=None):
    return Estimate(value, None, low, high, "s")


def test_named_effects_tell_their_times():
    push = NamedEffect(
        kind="wind",
        site="swing",
        probability=1.0,
        parameters={"start": estimate(3.0), "stop": estimate(6.5)},
        equivalents=(),
        statement="",
    )
    jump = NamedEffect(
        kind="missed_counts",
        site="x_sensor",
        probability=1.0,
        parameters={"time": estimate(5.3, 5.25, 5.4)},
        equivalents=(),
        statement="",
    )
    drag = NamedEffect(
        kind="quadratic_drag",
        site="cart",
        probability=1.0,
        parameters={"coefficient": estimate(3.0)},
        equivalents=(),
        statement="",
    )
    # The second recording ends before the push does, the third before it begins.
    found = times_of([drag, push, jump], [("a.csv", 16.0), ("b.csv", 6.0), ("b.csv", 2.0)])
    assert [(i.recording, i.start, i.stop) for i in found] == [
        ("a.csv", 3.0, 6.5), ("a.csv", 5.25, 5.4), ("b.csv", 3.0, 6.0), ("b.csv", 5.25, 5.4),
    ]  # fmt: skip
    assert times_of([drag], [("a.csv", 16.0)]) == ()


def test_a_push_that_never_ends_is_at_no_particular_time():
    def push(start, stop):
        return NamedEffect(
            kind="wind",
            site="swing",
            probability=1.0,
            parameters={"start": estimate(start), "stop": estimate(stop)},
            equivalents=(),
            statement="",
        )

    assert times_of([push(-0.1, 32.0)], [("a.csv", 16.0)]) == ()
    (late,) = times_of([push(5.0, 32.0)], [("a.csv", 16.0)])
    assert (late.start, late.stop) == (5.0, 16.0)
    (turned,) = times_of([push(8.0, 4.0)], [("a.csv", 16.0)])
    assert (turned.start, turned.stop) == (4.0, 8.0)


@pytest.mark.parametrize(("rate", "known"), [(20.0, 1.0), (50.0, 0.3)])
def test_coarse_recordings_are_timed_too(rate, known):
    times = np.arange(int(16 * rate)) / rate
    some = [track(lambda x, v, t: 0.4 * ((t > 4) & (t < 9)), seed, times) for seed in range(4)]
    found = intervals(by_name([dataclasses.replace(each, weight=known * each.weight) for each in some]))
    assert len(found) >= 3
    for interval in found:
        assert interval.start == pytest.approx(4.0, abs=1.0) and interval.stop == pytest.approx(9.0, abs=1.0)


def test_a_force_that_is_nothing_has_no_place_and_no_time():
    still = dataclasses.replace(track(brake), force=np.zeros(len(TIMES)))
    assert regions([still], "x") == () and intervals([("a.csv", still)]) == ()
    unknown = dataclasses.replace(still, weight=np.zeros(len(TIMES)))
    assert intervals([("a.csv", unknown)]) == ()


def test_equations():
    assert [equation_of(axis) for axis in ("x", "psi", "l", None)] == ["cart", "swing", "hoist", "none"]
