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
