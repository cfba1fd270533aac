"""An angle in degrees that is said to be in radians is refused; a load that goes over the top is not."""

import re

import numpy as np
import pytest

from jbridge.recordings import load_recording


def swing(
    amplitude: float, length: float, rows: int = 4000, spin: float = 0.0, cart: float = 0.0, pace: float = 3.0
) -> dict:
    """Returns a load's swing below a cart that moves to and fro, integrated in steps of 1 ms."""
    t = np.arange(rows) * 0.005
    x = cart * np.sin(pace * t)
    psi, rate, angles = amplitude, spin, []
    for moment in t:
        angles.append(psi)
        for step in range(5):
            push = -(pace**2) * cart * np.sin(pace * (moment + step / 1000))
            rate -= 0.001 * ((9.81 * np.sin(psi) + push * np.cos(psi)) / length + 0.05 * rate)
            psi += 0.001 * rate
    columns = {"t": t, "psi": np.array(angles), "l": np.full(rows, length)}
    return {**columns, "u_x": -np.sin(pace * t), "x": x} if cart else columns


SWINGS = {
    "small": swing(0.08, 0.7),
    "short rope": swing(0.08, 0.15),
    "driven": swing(0.0, 0.7, cart=0.3),
    "shaken": swing(0.0, 0.15, cart=0.3, pace=12.0),  # at 4 g
    "wide": swing(1.5, 0.7),
    "from upright": swing(3.14, 0.32),
    "several turns": swing(0.0, 0.32, spin=40.0),
    "short": swing(0.2, 0.7, rows=250),
}


@pytest.mark.parametrize("columns", SWINGS.values(), ids=SWINGS)
@pytest.mark.parametrize("offset", [0.0, np.pi])
def test_degrees_are_told_from_radians(write, columns, offset, refusal):
    """Every one of these swings passes in radians, and none does in degrees, wherever the angle's zero is."""
    shifted = {**columns, "psi": columns["psi"] + offset}
    assert load_recording(write(shifted), force=offset > 0).has_swing  # an upright zero is another slip
    message = refusal(write({**shifted, "psi": np.rad2deg(shifted["psi"])}))
    assert re.search(r"row \d+, column psi: .*degrees.*unit = \"deg\"", message)


def test_the_turning_load_turns(write):
    """Or else the test above would say nothing about turns."""
    assert SWINGS["several turns"]["psi"].max() > 4 * np.pi


@pytest.mark.parametrize("zero", [-np.pi, 0.0, -1.0], ids=["-pi to pi", "0 to 2 pi", "-1 to 2 pi - 1"])
def test_a_sensor_that_starts_again_at_each_turn(write, zero):
    columns = SWINGS["several turns"]
    psi = columns["psi"]
    recording = load_recording(write({**columns, "psi": (psi - zero) % (2 * np.pi) + zero}))
    turns = (recording.psi - psi) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)
    assert any("jumps by a turn" in note for note in recording.notes)


def test_an_angle_without_jumps_stays_as_it_is_but_for_whole_turns(write):
    """It hangs longest where it came to rest, 78 turns on."""
    for name, turns in (("several turns", 78), ("from upright", 0)):
        recording = load_recording(write(SWINGS[name]))
        np.testing.assert_allclose(recording.psi, SWINGS[name]["psi"] - 2 * np.pi * turns, atol=1e-9)
        assert not any("turn" in note for note in recording.notes)


def test_declared_degrees_become_radians(write):
    columns = SWINGS["wide"]
    sidecar = '[columns]\npsi = {unit = "deg", sign = -1, offset = 180}\n'
    path = write({**columns, "psi": 180 - np.rad2deg(columns["psi"])}, sidecar)
    np.testing.assert_allclose(load_recording(path).psi, columns["psi"], atol=1e-12)


def test_noise_is_not_taken_for_degrees(write):
    columns = SWINGS["small"]
    noise = np.random.default_rng(0).normal(size=columns["t"].size)
    glitches = np.where(np.arange(noise.size) % 97 == 0, 3.0, 0.0)
    noisy = {**columns, "psi": columns["psi"] + 0.01 * noise + glitches}
    assert load_recording(write(noisy)).has_swing


@pytest.mark.parametrize(("column", "read"), [('unit = "rad"', 1.0), ('unit = "deg"', 180 / np.pi)])
@pytest.mark.parametrize(("name", "sign"), [("small", 1.0), ("driven", 1.0), ("driven", -1.0)])
def test_an_upright_zero_is_refused_with_the_line_that_makes_the_load_hang_at_0(
    write, refusal, name, sign, column, read
):
    columns = SWINGS[name]
    raw = {**columns, "psi": read * (sign * columns["psi"] + np.pi)}
    message = refusal(write(raw, f"[columns]\npsi = {{{column}}}\n"))
    assert "falls away from 0 as from upright" in message
    line = re.search(r"declare (psi = \{.*\})", message)[1]
    mended = load_recording(write(raw, f"[columns]\n{line}\n"))
    np.testing.assert_allclose(mended.psi, columns["psi"], atol=0.02)


@pytest.mark.parametrize(("volts", "dry"), [(2.0, 0.05), (8.0, 0.15)])
def test_an_upright_zero_of_a_turned_angle_is_mended_in_one_line(write, refusal, volts, dry):
    """A rod hangs at a cart that is driven once; it swings as on more than its length, and its pivot rubs."""
    step, rows = 0.001, 9000
    x = v = psi = rate = 0.0
    seen = []
    for row in range(rows):
        u = volts if 1.0 < row * step < 1.0 + 9.6 / volts else 0.0
        seen.append((row * step, u, x, psi))
        push = (0.06 * u - v) / 0.03
        turn = -(9.81 * np.sin(psi) + push * np.cos(psi)) / 0.157 - 0.15 * rate
        rub = dry / 0.157
        holds = abs(rate) < rub * step and abs(turn) < rub
        rate = 0.0 if holds else rate + step * (turn - np.sign(rate) * rub)
        v, x, psi = v + step * push, x + step * (v + step * push), psi + step * rate
    t, u, x, psi = np.array(seen[::10]).T
    columns = {"t": t, "u_x": u, "x": np.round(x / 7.2e-5) * 7.2e-5, "psi": np.round((np.pi - psi) / 1.5e-3) * 1.5e-3}
    message = refusal(write(columns, "[locked]\nl = 0.1225\n"))
    assert re.search(r"declare psi = \{.*sign = -1, offset = 3\.1\d*\}", message) and "scale" not in message


def test_a_load_that_is_held_upright_has_its_zero_right(write, refusal):
    """A cart balances it about half a turn from hanging; it falls away from there, and not from 0."""
    t, psi, rate, seen = np.arange(2000) * 0.005, np.pi + 0.05, 0.0, {"psi": [], "x": []}
    x, v, random = 0.0, 0.0, np.random.default_rng(0)
    for _ in t:
        seen["psi"].append(psi)
        seen["x"].append(x)
        push = -40 * (psi - np.pi) - 8 * rate + 1.0 * x + 2.0 * v + random.normal()
        rate -= 0.005 * (9.81 * np.sin(psi) + push * np.cos(psi)) / 0.5
        psi, v = psi + 0.005 * rate, v + 0.005 * push
        x += 0.005 * v
    columns = {"t": t, **{name: np.array(values) for name, values in seen.items()}}
    columns |= {"u_x": np.gradient(np.gradient(columns["x"], 0.005), 0.005), "l": np.full(t.size, 0.5)}
    assert np.abs(columns["psi"] - np.pi).max() < 0.3
    assert load_recording(write(columns)).has_swing
    for sign in (1.0, -1.0):
        message = refusal(write({**columns, "psi": sign * (columns["psi"] - np.pi)}))
        assert "falls away from 0" in message and ("sign = -1" in message) == (sign < 0)
