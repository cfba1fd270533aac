"""Held channels are told from resting and slow encoders, and their new samples are found."""

import numpy as np
import pytest

from jbridge.recordings import load_recording, load_recordings
from jbridge.recordings.hold import Hold, detect_hold, fresh_rows

COUNT = 2 * np.pi / 4096


def clock(kind: str, rows: int, seed: int = 0) -> np.ndarray:
    """Returns the times of a log at about 200 Hz: regular, jittered, or in bursts."""
    random = np.random.default_rng(seed)
    if kind == "regular":
        return np.arange(rows) * 0.005
    if kind == "jittered":
        return np.cumsum(np.clip(0.005 * (1 + 0.3 * random.normal(size=rows)), 1e-4, None))
    return np.cumsum(np.where(random.random(rows) < 0.5, 2e-4, 0.0098))


def counts(values: np.ndarray, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """Returns readings in counts, with noise of so many counts before they are rounded."""
    return np.round(values + noise * np.random.default_rng(seed).normal(size=values.size)) * COUNT


def camera(times: np.ndarray, motion, rate: float, noise: float) -> np.ndarray:
    """Returns readings, in whole counts, of a sensor that samples at a rate of its own [Hz]."""
    frames = np.floor(times * rate).astype(int)
    readings = counts(motion(np.arange(frames[-1] + 1) / rate), noise)
    return readings[frames]


MOTIONS = {
    "wide swing": lambda t: 130 * np.sin(4 * t),
    "small swing": lambda t: 13 * np.sin(4 * t),
    "sweep": lambda t: 2000 * np.sin(t**1.3 / 2),
    "steps": lambda t: 500 * np.round(np.sin(0.5 * t)),
    "slow": lambda t: 40 * t,
    "one count per row": lambda t: 200 * t,
    "fast": lambda t: 2000 * t,
    "rest": lambda t: 0 * t,
}


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
@pytest.mark.parametrize("noise", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("kind", ["regular", "jittered", "bursts"])
def test_an_encoder_is_not_held(motion, noise, kind):
    times = clock(kind, 6000)
    assert detect_hold(times, counts(motion(times), noise), COUNT).held in (False, None)


@pytest.mark.parametrize("name", ["wide swing", "sweep", "fast"])
@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("noise", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("kind", ["regular", "jittered", "bursts"])
def test_a_camera_is_held(name, rate, noise, kind):
    times = clock(kind, 6000)
    hold = detect_hold(times, camera(times, MOTIONS[name], rate, noise), COUNT)
    assert hold.held
    assert hold.period == pytest.approx(1 / rate, rel=0.15)


def test_a_sensor_at_half_the_rate_of_the_log_is_held():
    times = clock("regular", 4000)
    hold = detect_hold(times, np.repeat(counts(MOTIONS["sweep"](times[::2])), 2), COUNT)
    assert hold.held


def test_rest_leaves_the_question_open():
    times = clock("regular", 1000)
    assert detect_hold(times, np.zeros(1000), COUNT) == Hold(None, 0.0)
    flicker = camera(times, MOTIONS["rest"], 30, noise=0.4)
    assert detect_hold(times, flicker, COUNT).held is None


def test_each_frame_is_fresh_once():
    """In a steady motion, the fresh rows are those that hold a new frame."""
    times = clock("jittered", 3000)
    values = camera(times, MOTIONS["fast"], 30.0, noise=0.0)
    fresh = fresh_rows(times, values, detect_hold(times, values, COUNT))
    frames = np.floor(times * 30.0)
    np.testing.assert_array_equal(fresh, np.concatenate([[True], np.diff(frames) > 0]))


def test_a_sensor_at_rest_keeps_measuring():
    """A second without change, at 30 Hz, is some thirty samples that agree, not one and not two hundred."""
    times = clock("regular", 800)
    values = np.where(times < 2, camera(times, MOTIONS["fast"], 30.0, 0.0), 1e3)
    fresh = fresh_rows(times, values, Hold(True, 1 / 30))
    assert abs(np.count_nonzero(fresh[times >= 3]) - 30) <= 1
    assert abs(np.count_nonzero(fresh[times < 2]) - 60) <= 1


def held_columns(columns: dict) -> dict:
    """Returns the bridge with a camera, at a fifth of the log's rate, for the angle alone."""
    held = columns["psi"][::5].repeat(5)
    return {**columns, "psi": held}


def test_a_held_channel_is_detected_and_said(write, columns):
    recording = load_recording(write(held_columns(columns)))
    np.testing.assert_array_equal(recording.fresh["psi"], np.arange(400) % 5 == 0)
    assert recording.fresh["x"].all()
    assert recording.fresh["l"].all()
    (note,) = recording.notes
    assert "psi" in note
    assert "25 ms" in note


def test_what_is_declared_wins(write, columns):
    said = load_recording(write(held_columns(columns), "[hold]\npsi = false\n"))
    assert said.fresh["psi"].all()
    slow = {**columns, "psi": np.round(held_columns(columns)["psi"] / 0.05) * 0.05}
    assert load_recording(write(slow)).fresh["psi"].all()
    said = load_recording(write(slow, "[hold]\npsi = true\n"))
    assert not said.fresh["psi"].all()
    assert any("as declared" in note for note in said.notes)


def test_a_declared_hold_without_motion_keeps_every_row(write, columns):
    columns |= {"psi": np.full(400, 0.01), "x": np.full(400, 0.5)}
    recording = load_recording(write(columns, "[hold]\npsi = true\n"))
    assert recording.fresh["psi"].all()


def test_rest_learns_from_the_other_recordings(write, columns):
    moving = write(held_columns(columns), name="moving.csv")
    rest = {**columns, "psi": np.where(columns["t"] < 1, 0.01, 0.02)}
    still = write(rest, name="still.csv")
    assert load_recording(still).fresh["psi"].all()
    first, second = load_recordings([still, moving])
    assert 75 <= np.count_nonzero(first.fresh["psi"]) <= 85
    assert any("as in the other recordings" in note for note in first.notes)
    np.testing.assert_array_equal(second.fresh["psi"], np.arange(400) % 5 == 0)
    assert first.fresh["x"].all()


def test_an_encoder_among_cameras_stays_one(write, columns):
    moving = write(held_columns(columns), name="moving.csv")
    encoder = write(columns, name="encoder.csv")
    rest = write({**columns, "psi": np.full(400, 0.01), "x": np.full(400, 0.5)}, name="rest.csv")
    assert load_recordings([moving, encoder])[1].fresh["psi"].all()
    assert load_recordings([moving, encoder, rest])[2].fresh["psi"].all()
