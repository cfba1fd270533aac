"""One recording of several that something happened in: it stands out, and the others' model meets it until then."""

import numpy as np
import pytest

from jbridge.diagnosis.aside import since, stands_out
from jbridge.diagnosis.words import aside_sentence
from jbridge.identify.setting import make_setting
from tests.diagnosis.test_once import run
from tests.identify.cases import DRY, NOISE, cart_model, cart_recordings


@pytest.mark.parametrize(
    ("sizes", "odd"),
    [
        ([2.7, 4.3, 9.3, 2.1, 1.9], 2),
        ([1.0, 1.0, 1.0, np.inf], 3),
        ([1.0, 1.0, np.inf, np.inf], None),
        # Wandering friction, a law that shows in half of them, and too few to spare one.
        ([1.4, 2.9, 2.0, 1.0], None),
        ([9.0, 30.0, 17.0, 1.0, 1.2], None),
        ([1.0, 30.0, 1.0], None),
        ([0.2, 0.3, 1.2, 0.4], None),
    ],
)
def test_a_recording_stands_out_by_twice_the_next_one(sizes, odd):
    assert stands_out(run(sizes)) == odd


MODEL = cart_model(DRY, cart_damping=30.0)


def found(runs, plant=MODEL.plant):
    return since(plant, make_setting(MODEL, runs, ()), runs[-1])


def test_a_jump_is_timed_and_sized():
    runs = cart_recordings(MODEL.plant, 4)
    runs[-1].x[312:] += 2e-3
    when, channel, ratio = found(runs)
    assert when.recording == runs[-1].name and channel == "x"
    assert when.start == pytest.approx(3.12, abs=0.02) and when.stop == pytest.approx(6.0, abs=0.02)
    assert ratio == pytest.approx(2e-3 / NOISE["x"], rel=0.1)


def test_a_law_is_not_taken_for_something_that_happened():
    """What is met well throughout, and what is off from the start, are no events."""
    runs = cart_recordings(MODEL.plant, 4)
    assert found(runs) is None
    assert found(runs, cart_model(DRY, cart_damping=36.0).plant) is None
    runs[-1].x[40:] += 2e-3
    assert found(runs) is None


def test_the_sentence_says_what_when_and_how_large():
    told = aside_sentence("run-3.csv", 6.351, "x", 41.2)
    assert told.startswith("run-3.csv was set aside") and "until 6.35 s" in told
    assert "41 times the noise in the cart position" in told
