"""The count of an encoder is found where there is one, and nothing is found where there is none."""

import numpy as np
import pytest

from jbridge.recordings import load_recording
from jbridge.recordings.resolution import estimate_resolution

T = np.arange(4000) * 0.005


@pytest.mark.parametrize("count", [1e-4, 2 * np.pi / 4096, 1.5 / 27000, 0.001])
@pytest.mark.parametrize("amplitude", [0.003, 0.1, 1.4], ids=str)
@pytest.mark.parametrize("decimals", [5, 17], ids=["printed", "exact"])
def test_counts_are_found(count, amplitude, decimals):
    """Also where five decimals blur them: the count comes out to 3 %."""
    steps = np.round(amplitude * np.sin(2 * T) / count) + 1234
    readings = np.round(steps * count, decimals)
    assert estimate_resolution(readings) == pytest.approx(count, rel=0.03)


def test_counts_are_found_where_motion_skips_most():
    """A cart at 0.5 m/s passes 80 counts of 56 um from one frame to the next, and never comes back."""
    count = 1.5 / 27000
    random = np.random.default_rng(0)
    x = np.cumsum(random.uniform(0.002, 0.008, 280))
    readings = np.round(np.round(x / count) * count, 5)
    assert np.diff(np.unique(readings)).min() > 5 * count
    assert estimate_resolution(readings) == pytest.approx(count, rel=0.01)


def test_two_values_that_alternate_show_a_count():
    readings = np.where(np.random.default_rng(0).random(300) < 0.3, 0.377, 0.378)
    assert estimate_resolution(readings) == pytest.approx(0.001, rel=1e-6)


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(0).normal(size=4000),
        np.random.default_rng(0).normal(size=45),
        np.random.default_rng(0).normal(size=10).repeat(5),
        np.random.default_rng(0).normal(size=200).repeat(5),
        np.cumsum(np.random.default_rng(0).normal(size=4000)),
        0.1 * np.sin(2 * T),
        0.1 * np.sin(2 * T) + 1e-5 * np.random.default_rng(0).normal(size=4000),
        np.exp(-T) * np.cos(9 * T),
        np.full(100, 0.7),
        np.where(T < 10, 0.3, 0.5),
        np.random.default_rng(0).choice(np.random.default_rng(1).normal(size=12), 300),
    ],
    ids=[
        "noise",
        "few",
        "held-few",
        "held",
        "walk",
        "sine",
        "noisy-sine",
        "decay",
        "constant",
        "one-step",
        "levels",
    ],
)
def test_nothing_is_found_where_there_is_no_grid(values):
    assert estimate_resolution(values) == 0.0


@pytest.mark.parametrize("unit", [1e-300, 1e-12, 1e12, 1e300])
def test_a_count_does_not_depend_on_the_unit(unit):
    readings = np.round(0.1 * np.sin(2 * T) / 1e-3) * 1e-3
    assert estimate_resolution(readings * unit) == pytest.approx(1e-3 * unit, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-310, 1e-300, 1e300, 1.7e308])
@pytest.mark.parametrize("spread", [1.0, 1e-9, 1e-290], ids=str)
def test_values_of_extreme_size_have_a_finite_count(scale, spread):
    """Neither the inverse of the smallest values nor the span of the largest is a finite number."""
    values = scale * np.random.default_rng(0).uniform(-1.0, 1.0, 300) * np.geomspace(spread, 1.0, 300)
    assert 0.0 <= estimate_resolution(values) < scale


def test_what_is_found_is_said_in_si(write, columns):
    columns["x"] = np.round(columns["x"] / 1e-4) * 0.1  # the file is in mm
    recording = load_recording(write(columns, '[columns]\nx = {unit = "mm"}\n'))
    assert recording.resolution["x"] == pytest.approx(1e-4, rel=1e-5)
    assert any("x lie on a grid of 0.0001 m" in note for note in recording.notes)
