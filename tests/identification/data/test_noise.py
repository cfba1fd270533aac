"""The noise floor: what it must see, and what it must not take for noise."""

import numpy as np
import pytest

from jbridge.identification.data.noise import LEAST, noise_floor
from tests.identification.cases import make_recording

TIMES = np.arange(3000) * 0.005
MOTION = 0.6 + 0.25 * np.sin(1.3 * TIMES) + 0.1 * np.sin(3.1 * TIMES)


def floor_of(
    x: np.ndarray, *, times: np.ndarray = TIMES, resolution: float = 0.0, fresh: np.ndarray | None = None
) -> float:
    run = make_recording("run.csv", times[: len(x)], u_x=np.sin(times[: len(x)]), x=x)
    run.resolution["x"] = resolution
    if fresh is not None:
        run.fresh["x"] = fresh
    return noise_floor([run])["x"]


@pytest.mark.parametrize("sigma", [2e-5, 1e-4, 1e-3])
def test_white_noise(sigma):
    noise = sigma * np.random.default_rng(0).standard_normal(len(TIMES))
    # 750 windows of six degrees of freedom give 3 %; four times that.
    assert floor_of(MOTION + noise) == pytest.approx(sigma, rel=0.12)


def test_motion_alone_is_not_noise():
    assert floor_of(MOTION) == LEAST["x"]


def test_rounding_is_noise():
    step = 1e-3
    found = floor_of(step * np.round(MOTION / step), resolution=step)
    # In slow motion rounding is a ramp and not noise, so the scatter may be less; the encoder says how much it is.
    assert found == pytest.approx(step / np.sqrt(12), rel=0.25)


def test_the_larger_of_two_estimates_and_not_their_sum():
    sigma = 5e-4
    noisy = MOTION + sigma * np.random.default_rng(0).standard_normal(len(TIMES))
    assert floor_of(noisy, resolution=1e-4) == pytest.approx(sigma, rel=0.12)


def test_at_rest_an_encoder_shows_its_count():
    assert floor_of(np.full(len(TIMES), 0.5), resolution=1e-3) == pytest.approx(1e-3 / np.sqrt(12))


def test_rest_does_not_hide_the_noise():
    step, sigma = 1e-4, 2e-4
    moving = np.where(np.arange(len(TIMES)) < 1000, MOTION, MOTION[1000])
    noise = sigma * np.random.default_rng(0).standard_normal(len(TIMES))
    noise[1000:] = 0.0
    read = step * np.round((moving + noise) / step)
    assert floor_of(read, resolution=step) == pytest.approx(np.hypot(sigma, step / np.sqrt(12)), rel=0.15)


def test_a_slow_sensor_is_judged_by_its_own_samples():
    sigma = 1e-3
    slow = MOTION[::5] + sigma * np.random.default_rng(0).standard_normal(len(TIMES[::5]))
    fresh = np.zeros(len(TIMES), bool)
    fresh[::5] = True
    assert floor_of(np.repeat(slow, 5), fresh=fresh) == pytest.approx(sigma, rel=0.25)


def test_jerks_do_not_count():
    sigma = 1e-4
    noisy = MOTION + sigma * np.random.default_rng(0).standard_normal(len(TIMES))
    noisy[600:] += 0.05
    noisy[1700:] -= 0.03
    assert floor_of(noisy) == pytest.approx(sigma, rel=0.12)


def test_an_exact_channel_still_has_a_scale():
    assert floor_of(np.linspace(0.0, 1.0, len(TIMES))) == LEAST["x"]


def driven(times: np.ndarray, period: float) -> np.ndarray:
    """A cart of 5.5 kg and 50 N s/m under steps of force every `period` seconds, in closed form."""
    lag = 5.5 / 50.0
    force = np.random.default_rng(3).uniform(-0.35, 0.35, 200)
    edges = np.arange(200) * period
    x, v, found = 0.0, 0.0, np.zeros(len(times))
    for start, speed in zip(edges, force, strict=True):
        here = (times >= start) & (times < start + period)
        t = times[here] - start
        found[here] = x + speed * t + (v - speed) * lag * (1.0 - np.exp(-t / lag))
        x += speed * period + (v - speed) * lag * (1.0 - np.exp(-period / lag))
        v = speed + (v - speed) * np.exp(-period / lag)
    return found


@pytest.mark.parametrize(("rate", "limit"), [(100.0, 1.3), (50.0, 1.3), (30.0, 1.5), (20.0, 1.8)])
def test_motion_that_is_sampled_slowly_is_not_noise(rate, limit):
    """A cart whose speed steps every second, seen by an encoder of 0.1 mm with 0.03 mm of noise besides."""
    times = np.arange(0.0, 48.0, 1.0 / rate)
    step, sigma = 1e-4, 3e-5
    read = driven(times, 1.0) + sigma * np.random.default_rng(0).standard_normal(len(times))
    true = np.hypot(sigma, step / np.sqrt(12))
    assert 0.8 < floor_of(step * np.round(read / step), times=times, resolution=step) / true < limit


@pytest.mark.parametrize("share", [0.1, 0.3, 0.45])
def test_uneven_times_are_not_noise(share):
    sigma, rng = 5e-5, np.random.default_rng(1)
    times = TIMES + share * 0.005 * rng.uniform(-1.0, 1.0, len(TIMES))
    moved = 0.6 + 0.25 * np.sin(1.3 * times) + 0.1 * np.sin(3.1 * times)
    read = moved + sigma * rng.standard_normal(len(times))
    assert floor_of(read, times=times) == pytest.approx(sigma, rel=0.15)


def test_times_in_bursts_still_tell_the_noise():
    """A logger that writes four rows a time: what it says of the times is all that is known of them."""
    sigma, rng = 1e-3, np.random.default_rng(1)
    times = TIMES - (np.arange(len(TIMES)) % 4) * 0.0045
    read = 0.6 + 0.25 * np.sin(1.3 * times) + sigma * rng.standard_normal(len(times))
    assert floor_of(read, times=times) == pytest.approx(sigma, rel=0.2)
