"""Rows that a log lost are found, and an encoder's own repeats are not taken for them."""

import numpy as np
import pytest

from jbridge.recordings import load_recording
from jbridge.recordings.dropouts import lost_rows
from tests.recordings.test_hold import COUNT, MOTIONS, clock, counts

GAPS = [(300, 3), (750, 1), (1200, 8), (2100, 2)]
"""First row and number of rows that are lost."""


def filled(values: np.ndarray, how: str) -> tuple[np.ndarray, np.ndarray]:
    """Values with gaps filled with the row before them or after them, and which rows those are."""
    values, lost = values.copy(), np.zeros(values.size, bool)
    for first, number in GAPS:
        rows = slice(first, first + number)
        values[rows] = values[first - 1] if how == "before" else values[first + number]
        lost[rows] = True
    return values, lost


@pytest.mark.parametrize("how", ["before", "after"])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_lost_rows_are_found(how, noise):
    times = clock("regular", 3000)
    values, lost = filled(counts(MOTIONS["fast"](times), noise), how)
    np.testing.assert_array_equal(lost_rows(times, values, COUNT), lost)


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
@pytest.mark.parametrize("noise", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("kind", ["regular", "jittered", "bursts"])
def test_an_encoder_has_lost_nothing(motion, noise, kind):
    times = clock(kind, 6000)
    assert np.count_nonzero(lost_rows(times, counts(motion(times), noise), COUNT)) <= 2


def test_a_cart_that_sticks_and_slips_has_lost_nothing():
    """It stands between two slips of one speed, and makes up for nothing."""
    moves = np.tile(np.repeat([1.0, 0.0], 20), 50)
    times = np.arange(moves.size) * 0.005
    assert not lost_rows(times, np.cumsum(moves) * 30 * COUNT, COUNT).any()


def test_a_cart_that_slows_down_and_starts_again_has_lost_nothing():
    speed = 40 * np.abs(np.sin(0.05 * np.arange(3000)))
    assert not lost_rows(np.arange(3000) * 0.005, np.round(np.cumsum(speed)) * COUNT, COUNT).any()


@pytest.mark.parametrize("creep", [(2, 1, 1, 1), (0, 1, 0, 1), (5, 3, 2, 1)])
@pytest.mark.parametrize("rows", [10, 14, 18])
def test_a_cart_that_rests_and_is_driven_away_has_lost_nothing(creep, rows):
    """It comes to rest by single counts; its speed grows from the first step on, so that none is a jump."""
    steps = np.tile([*creep, *([0] * rows), 9, 17, 26, 32, 36, 30, 20, 10, 5], 20)
    for way in (1, -1):
        counted = np.cumsum(way * steps) * COUNT
        assert not lost_rows(np.arange(counted.size) * 0.02, counted, COUNT).any()
        assert not lost_rows(np.arange(counted.size) * 0.02, -counted[::-1], COUNT).any()


def test_a_wiper_that_leaps_and_falls_back_has_lost_nothing():
    """A potentiometer that moves slowly gives plateaus and spikes, after which it comes back."""
    steps = np.tile([0, 0, 0, 1, 0, 0, 0, 0, 5, -4, 0, 0, 0, 1], 200)
    assert not lost_rows(np.arange(steps.size) * 0.001, np.cumsum(steps) * COUNT, COUNT).any()


def test_a_row_that_comes_again_at_once_is_found():
    """The stamps of the two lie close together, so that the speed shows the jump and its size does not."""
    times = np.sort(np.append(np.arange(500) * 0.01, 2.9998))
    values = 0.3 * times
    values[300] = values[299]
    np.testing.assert_array_equal(np.flatnonzero(lost_rows(times, values, 0.0)), [300])


def test_lost_rows_are_said_and_are_no_measurements(write, columns):
    rows = slice(200, 204)
    for name in ("x", "l"):
        columns[name] = columns[name].copy()
        columns[name][rows] = columns[name][204]
    recording = load_recording(write(columns))
    expected = np.ones(400, bool)
    expected[rows] = False
    np.testing.assert_array_equal(recording.fresh["x"], expected)
    np.testing.assert_array_equal(recording.fresh["l"], expected)
    assert recording.fresh["psi"].all()
    assert any("lost 4 rows of x, the first at 1 s" in note for note in recording.notes)


def test_a_declaration_wins(write, columns):
    columns["x"] = columns["x"].copy()
    columns["x"][200:204] = columns["x"][204]
    assert load_recording(write(columns, "[hold]\nx = false\n")).fresh["x"].all()
