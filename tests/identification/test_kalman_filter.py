"""Corrections of a simulated state, against Gaussian conditioning with the whole covariance matrix."""

import numpy as np
import pytest

from jbridge.identification.evaluation import kalman_filter


def stretches(count, samples, dt=0.005):
    return np.tile(dt * np.arange(samples + 1), (count, 1))


def conditioned(times, residual, seen, spread, q):
    """Mean of an integrated Wiener process and its rate at the last time, given noisy readings (closed form)."""
    t, end = times[:-1][seen], times[-1]
    early, late = np.minimum(t[:, None], t), np.maximum(t[:, None], t)
    of_place = q * (early**2 * late / 2 - early**3 / 6) + spread[0] ** 2 + spread[1] ** 2 * np.outer(t, t)
    to_place = q * (t**2 * end / 2 - t**3 / 6) + spread[0] ** 2 + spread[1] ** 2 * t * end
    to_rate = q * t**2 / 2 + spread[1] ** 2 * t
    told = np.linalg.solve(of_place + np.eye(len(t)), residual[seen])
    return to_place @ told, to_rate @ told


def test_the_filter_is_gaussian_conditioning(monkeypatch):
    monkeypatch.setattr(kalman_filter, "_TAILS", 1e12)
    monkeypatch.setattr(kalman_filter, "_STRENGTHS", np.array([1e-9, 3e4]))
    rng = np.random.default_rng(0)
    times, spread = stretches(4, 60), np.tile([30.0, 200.0], (4, 1))
    residual = 40.0 * np.sin(8.0 * times[:, :-1]) + rng.standard_normal((4, 60))
    seen = rng.random((4, 60)) < 0.8
    found = kalman_filter.corrections(times, residual, seen, spread, 0.0)
    for row in range(4):
        wanted = conditioned(times[row], residual[row], seen[row], spread[row], 3e4)
        np.testing.assert_allclose(found[row], wanted, rtol=1e-8)


@pytest.mark.parametrize("frequency", [0.0, 5.0])
def test_noise_alone_corrects_nothing(frequency):
    corrected = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(30 * 20 + 100)
        residual = np.stack([noise[20 * row : 20 * row + 100] for row in range(30)])
        times, spread = stretches(30, 100) + 0.1 * np.arange(30)[:, None], np.tile([20.0, 200.0], (30, 1))
        found = kalman_filter.corrections(times, residual, np.ones((30, 100), bool), spread, frequency)
        corrected += bool(found.any())
    assert corrected <= 1


def test_an_error_that_grows_is_met_at_the_end():
    rng = np.random.default_rng(2)
    times = stretches(20, 100)
    strength = rng.uniform(-1.0, 1.0, 20)
    error = 400.0 * strength[:, None] * times**2
    residual = error[:, :-1] + rng.standard_normal((20, 100))
    # Readings that are far off, as a log has them here and there, bend little.
    residual[::4, 90] += 300.0
    found = kalman_filter.corrections(times, residual, np.ones((20, 100), bool), np.tile([20.0, 200.0], (20, 1)), 0.0)
    assert np.abs(found[:, 0] - error[:, -1]).max() < 3.0
    assert np.abs(found[:, 1] - 800.0 * strength * times[:, -1]).max() < 60.0


def test_a_force_that_keeps_changing_a_swing_is_followed():
    """An oscillation that noise drives, simulated with small steps; the filter is told its frequency alone."""
    rng = np.random.default_rng(4)
    frequency, fine, count = 5.0, 20, 40
    times = stretches(count, 100)
    place, rate, dt = np.zeros(count), np.zeros(count), 0.005 / fine
    course = [place]
    for _ in range(100 * fine):
        rate = rate - frequency**2 * place * dt + 300.0 * np.sqrt(dt) * rng.standard_normal(count)
        place = place + rate * dt
        course.append(place)
    error = np.stack(course[::fine], axis=1)
    residual = error[:, :-1] + rng.standard_normal((count, 100))
    spread = np.tile([20.0, 200.0], (count, 1))
    found = kalman_filter.corrections(times, residual, np.ones((count, 100), bool), spread, frequency)
    # A rate is known less well than a place: what drove it last is still to be seen.
    assert np.std(found[:, 0] - error[:, -1]) < 0.1 * np.std(error[:, -1])
    assert np.std(found[:, 1] - rate) < 0.5 * np.std(rate)


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_without_readings_there_is_no_correction(share):
    rng = np.random.default_rng(3)
    seen = rng.random((5, 40)) < share
    found = kalman_filter.corrections(stretches(5, 40), np.zeros((5, 40)), seen, np.tile([20.0, 200.0], (5, 1)), 5.0)
    assert not found.any()
