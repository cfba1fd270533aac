"""Inputs that were not logged, that are the position, or that are old: what moves without them, or not with them."""

import re

import numpy as np
import pytest

from jbridge.recordings import inspect_recordings, load_recording
from tests.recordings.test_slips import TRUTH, table

PERIOD, GAIN, DAMPING = 0.01, 6.0, 4.0
COUNT = 1e-4


def cart(u):
    """Returns time, input and position of a cart on a rail, in counts of its encoder."""
    x, v, seen = 0.0, 0.0, []
    for each in u:
        seen.append(round(x / COUNT) * COUNT)
        v += PERIOD * (GAIN * each - DAMPING * v)
        x += PERIOD * v
    return {"t": np.arange(len(u)) * PERIOD, "u_x": np.array(u), "x": np.array(seen)}


def steps(volts, times=4):
    """Returns an input of steps, rests between them."""
    return np.tile(np.repeat([0.0, volts, 0.0, -volts], [150, 50, 150, 50]), times)


def with_load(columns, length=0.5):
    """Returns the same with the angle of a load below the cart."""
    psi, rate, seen = 0.0, 0.0, []
    acceleration = np.gradient(np.gradient(columns["x"], PERIOD), PERIOD)
    for each in np.convolve(acceleration, np.ones(5) / 5, "same"):
        seen.append(psi)
        rate -= PERIOD * ((9.81 * np.sin(psi) + each * np.cos(psi)) / length + 0.1 * rate)
        psi += PERIOD * rate
    return {**columns, "psi": np.array(seen)}


def unlogged(kind):
    """Returns a driven axis whose input is 0 in all rows."""
    if kind == "rope":
        return {"t": TRUTH["t"], "l": TRUTH["l"], "u_l": 0 * TRUTH["t"]}
    columns = cart(steps(2.0)) if kind == "cart" else with_load(cart(steps(2.0)))
    return {**columns, "u_x": 0 * columns["t"]}


@pytest.mark.parametrize("kind", ["cart", "cart with load", "rope"])
def test_an_input_of_zeros_beside_an_axis_that_is_driven(write, kind, refusal):
    path = write(unlogged(kind), "[locked]\nl = 0.5\n" if kind == "cart with load" else "")
    message = refusal(path)
    name, axis = ("u_l", "l") if kind == "rope" else ("u_x", "x")
    assert f"column {name}: it is 0 throughout, but something drives {axis}, by" in message
    assert "the input was not logged" in message
    assert load_recording(path, force=True).times.size == unlogged(kind)["t"].size


def test_a_cart_that_slows_down_needs_no_input(write):
    """It was pushed before the log begins."""
    t = np.arange(600) * 0.01
    assert load_recording(write({"t": t, "u_x": 0 * t, "x": 0.4 * (1 - np.exp(-t / 2))})).has_cart


def test_an_input_that_is_the_position_itself(write, refusal):
    sidecar = '[columns]\nu_x = {column = "x", unit = "count"}\n'
    message = refusal(write(table(TRUTH), sidecar))
    assert "column x: it is read as u_x and as x, but no position is its own input" in message
    assert "under [columns] in run.toml" in message


@pytest.mark.parametrize("where", ["at the end", "at the start", "between"])
def test_an_input_that_holds_while_the_cart_stands_is_told(write, where):
    """The controller is off, and the log repeats what it last said."""
    parts = [cart(steps(2.0))]
    held = {"u_x": np.full(200, -3.0), "x": np.full(200, parts[0]["x"][-1])}
    if where != "at the end":
        later = parts[0] if where == "at the start" else cart(steps(2.0))
        parts = [held, later] if where == "at the start" else [parts[0], held, later]
        held["x"][:] = 0.0 if where == "at the start" else held["x"]
        later["x"] = later["x"] + held["x"][-1]
    else:
        parts.append(held)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in ("u_x", "x")}
    columns = {"t": np.arange(columns["x"].size) * PERIOD, **columns}
    path = write(columns)
    (note,) = [note for note in load_recording(path).notes if "rests, though" in note]
    begin, end = map(float, re.search(r"holds -3 V from ([\d.]+) to ([\d.]+) s", note).groups())
    assert end - begin == pytest.approx(1.99, abs=0.02)
    line = re.search(r"stand.* stop; (st\w+ = [\d.]+).* under \[trim\] in run.toml", note)[1]
    assert line.startswith("start" if where == "at the start" else "stop")
    path.with_suffix(".toml").write_text(f"[trim]\n{line}\n")
    assert not [note for note in load_recording(path).notes if "rests, though" in note]


@pytest.mark.parametrize("volts", [0.0, 0.3, 1.0])
def test_an_input_that_moves_nothing_is_not_told(write, volts):
    """Friction holds the cart against less than what moves it."""
    columns = cart(steps(2.0))
    rest = columns["u_x"] == 0
    columns["u_x"] = np.where(rest, volts, columns["u_x"])
    assert not [note for note in load_recording(write(columns), force=True).notes if "rests, though" in note]


def test_a_folder_says_the_trim_of_one_file(tmp_path):
    held = {"u_x": np.full(200, -3.0), "x": np.full(200, cart(steps(2.0))["x"][-1])}
    columns = {name: np.concatenate([cart(steps(2.0))[name], held[name]]) for name in ("u_x", "x")}
    (tmp_path / "recordings.toml").write_text('["*.csv".columns]\nu_x = {unit = "A"}\n')
    (tmp_path / "a.csv").write_text(table({"t": np.arange(columns["x"].size) * PERIOD, **columns}))
    (inspected,) = inspect_recordings([tmp_path / "a.csv"])
    assert inspected.recording is not None
    assert any('under ["a.csv".trim] in recordings.toml' in note for note in inspected.recording.notes)
