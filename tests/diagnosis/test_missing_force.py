"""How much of a force other recordings foresee: of laws written down here, and of scatter that follows none."""

import numpy as np
import pytest

from jbridge.diagnosis.localization.missing_force import Track, features, foreseen, foreseen_by_few, learn
from tests.diagnosis.test_symmetries import track

COUNT = 6


def tracks(law):
    return [track(law, seed) for seed in range(COUNT)]


def wandering(seed):
    """A force that turns round with the direction, of a size that drifts anew in every recording."""
    rng = np.random.default_rng(100 + seed)
    rates, phases, places = rng.uniform(0.6, 3.0, 8), rng.uniform(0.0, 2 * np.pi, 8), rng.uniform(12.0, 60.0, 8)
    return lambda t, q, v, u, swing, since: (
        np.sign(v) * np.cos(np.outer(t, rates) + np.outer(q, places) + phases).sum(axis=1)
    )


@pytest.mark.parametrize(
    ("law", "least"),
    [
        (lambda t, q, v, u, swing, since: np.sin(2 * np.pi * q / 0.15), 0.8),
        (lambda t, q, v, u, swing, since: -np.sign(v) * 5 * (q - 0.7), 0.9),
        (lambda t, q, v, u, swing, since: -np.tanh(4 * v), 0.9),
        (lambda t, q, v, u, swing, since: 4 * (u / 8) ** 3, 0.9),
        (lambda t, q, v, u, swing, since: -np.sign(v) * 10 * np.abs(swing), 0.9),
        (lambda t, q, v, u, swing, since: np.sign(v) * np.sin(np.pi * since / 0.1) ** 2, 0.9),
        (lambda t, q, v, u, swing, since: np.exp(-((t - 6.0) ** 2)), 0.8),
    ],
    ids=["place", "place and direction", "velocity", "input", "another axis", "memory", "clock"],
)
def test_a_law_is_foreseen(law, least):
    runs = tracks(law)
    assert foreseen_by_few(runs, features(runs).each()) > least


def test_what_grows_with_the_time_since_a_reversal_is_foreseen():
    """Friction that strengthens while the axis keeps on: neither the place nor the distance tells of it as well."""

    def law(t, q, v, u, swing, since):
        turned = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(v)) != 0) + 1])
        last = t[turned[np.searchsorted(turned, np.arange(len(t)), side="right") - 1]]
        return -np.sign(v) * (1.0 - np.exp(-(t - last) / 0.6) - 0.7)

    runs = tracks(law)
    on = features(runs)
    without = [table for table in on.each() if table is not on.lasting]
    assert foreseen_by_few(runs, on.each()) > 0.95 > foreseen_by_few(runs, without) + 0.05


def test_a_sum_of_laws_is_foreseen_by_few():
    both = tracks(lambda t, q, v, u, swing, since: np.sin(2 * np.pi * q / 0.3) - np.sign(v) * np.abs(swing) * 10)
    on = features(both)
    assert foreseen_by_few(both, on.each()) > max(foreseen(both, table) for table in on.each()) + 0.2


@pytest.mark.parametrize("first", [0, 20, 40])
@pytest.mark.parametrize("count", [2, 3, COUNT])
def test_what_wanders_is_not_foreseen(first, count):
    scattered = [track(wandering(seed), seed) for seed in range(first, first + count)]
    on = features(scattered)
    assert foreseen_by_few(scattered, on.each()) < 0.15
    assert foreseen(scattered, on.both) < 0.05


def test_shares_are_those_of_fits_that_left_one_out():
    """Held to least squares of SciPy's, one recording at a time."""
    from scipy.linalg import lstsq

    runs = tracks(lambda t, q, v, u, swing, since: np.sin(2 * np.pi * q / 0.3))
    table = features(runs).place
    total, left = 0.0, 0.0
    for i, (run, own) in enumerate(zip(runs, table, strict=True)):
        others = [j for j in range(COUNT) if j != i]
        count = sum(len(runs[j].times) for j in others)
        ridge = np.sqrt(0.02 * count / 24) * np.eye(own.shape[1])
        matrix = np.concatenate([*(table[j] for j in others), ridge])
        force = np.concatenate([*(runs[j].force for j in others), np.zeros(own.shape[1])])
        learned, *_ = lstsq(matrix, force)
        total += float(run.force @ run.force)
        left += float(np.sum((run.force - own @ learned) ** 2))
    assert foreseen(runs, table) == pytest.approx(1.0 - left / total, rel=1e-9)


def test_learning_recovers_what_a_table_can_express():
    runs = [track(lambda t, q, v, u, swing, since: 0.8 * u, seed, noise=0.0) for seed in range(COUNT)]
    table = features(runs).inputs
    learned = learn(runs, table)
    for run, own in zip(runs, table, strict=True):
        assert np.std(own @ learned - run.force) < 0.02 * np.std(run.force)


def test_a_channel_that_flickers_once_is_no_variable():
    """Its range is not nothing, but nearly all of its values are one."""
    t = np.arange(2000) * 0.005
    flicker = np.full(2000, 0.7)
    flicker[5:7] += 1e-4
    motion = np.sin(2.0 * t)
    run = Track(t, motion, np.cos(2.0 * t), motion, {"l": flicker}, motion, np.ones(2000))
    on = features([run] * 3)
    assert on.others["l"][0][0].shape == (2000, 0)
    assert on.place[0].shape[1] and on.velocity[0].shape[1]


def test_what_has_no_weight_counts_for_nothing():
    runs = tracks(lambda t, q, v, u, swing, since: np.sin(2 * np.pi * q / 0.3))
    for run in runs:
        run.weight[:400] = 0.0
    before = foreseen(runs, features(runs).place)
    for run in runs:
        run.force[:400] = 1e3
    assert foreseen(runs, features(runs).place) == before
