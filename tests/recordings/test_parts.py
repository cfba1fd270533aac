"""The parts of a rig follow from its columns, and columns that contradict each other are refused."""

import numpy as np
import pytest

from jbridge.recordings import load_recording


@pytest.mark.parametrize(
    ("names", "cart", "swing", "hoist"),
    [
        ("t u_x x", True, False, False),
        ("t u_x x u_l l psi", True, True, True),
        ("t u_x x u_l l", True, True, True),
        ("t u_l l", False, False, True),
        ("t u_l l psi", False, True, True),
    ],
)
def test_parts_follow_from_the_columns(write, names, cart, swing, hoist, chosen):
    recording = load_recording(write(chosen(names)))
    assert (recording.has_cart, recording.has_swing, recording.has_hoist) == (cart, swing, hoist)
    assert recording.locked_length is None


@pytest.mark.parametrize(("names", "cart"), [("t u_x x psi l", True), ("t psi l", False), ("t u_x x l", True)])
def test_without_u_l_the_rope_is_locked_at_the_median(write, columns, names, cart, chosen):
    columns["l"] = 0.6 + 0.0025 * np.sign(np.arange(400) - 300)
    recording = load_recording(write(chosen(names)))
    assert (recording.has_cart, recording.has_swing, recording.has_hoist) == (cart, True, False)
    assert recording.locked_length == 0.5975
    assert recording.l is not None  # still a measurement, which may carry an offset
    assert any("locked at 0.5975 m, the median of l" in note for note in recording.notes)


def test_a_declared_length_wins_over_the_median(write, columns, chosen):
    columns["l"][:] = 0.65
    recording = load_recording(write(chosen("t u_x x psi l"), "[locked]\nl = 0.7\n"))
    assert recording.locked_length == 0.7
    np.testing.assert_array_equal(recording.l, 0.65)


def test_a_declared_length_replaces_the_column(write, chosen):
    recording = load_recording(write(chosen("t psi"), "[locked]\nl = 0.7\n"))
    assert recording.locked_length == 0.7
    assert (recording.has_cart, recording.has_swing, recording.has_hoist) == (False, True, False)


def test_a_locked_rope_of_unknown_length_is_refused(write, refusal, chosen):
    message = refusal(write(chosen("t u_x x psi")))
    assert "unknown length" in message
    assert "l = 0.7, under [locked] in run.toml" in message


@pytest.mark.parametrize("sidecar", ["", "[locked]\nl = 0.7\n"])
def test_a_rope_that_moves_is_not_locked(write, columns, sidecar, refusal, chosen):
    columns["l"] = np.where(np.arange(400) == 122, 0.7211, 0.7)
    message = refusal(write(chosen("t u_x x psi l"), sidecar))
    for needle in ("row 124", "column l", "21 mm", "20", "l = false"):
        assert needle in message


def test_a_rope_that_moves_by_20_mm_is_locked(write, columns, chosen):
    columns["l"] = np.where(np.arange(400) == 122, 0.7199, 0.7)
    assert load_recording(write(chosen("t u_x x psi l"))).locked_length == 0.7


def test_a_declared_lock_sets_a_constant_input_aside(write, columns):
    columns["u_l"][:] = 0.0
    columns["l"][:] = 0.7
    recording = load_recording(write(columns, "[locked]\nl = 0.71\n"))
    assert (recording.u_l, recording.locked_length, recording.has_hoist) == (None, 0.71, False)
    assert recording.units == {"u_x": "V"}
    assert "u_l" in recording.extras


def test_a_declared_lock_and_a_varying_input_contradict(write, columns, refusal):
    message = refusal(write(columns, "[locked]\nl = 0.7\n"))
    assert "u_l varies" in message
    assert "u_l = false" in message


def test_without_x_the_input_of_the_cart_is_set_aside(write, columns, chosen):
    recording = load_recording(write(chosen("t u_x u_l psi l")))
    assert recording.u_x is None
    assert recording.units == {"u_l": "V"}
    assert any("fixed point" in note for note in recording.notes)
    np.testing.assert_array_equal(recording.extras["u_x"], columns["u_x"])


def test_a_recording_measures_something(write, columns, refusal, chosen):
    assert "nothing measured" in refusal(write(chosen("t u_x")))
    columns["l"][:] = 0.7
    assert "nothing that moves" in refusal(write(chosen("t l")))


def test_inputs_alone_will_do_for_a_simulation(write, columns, chosen):
    sidecar = "[initial]\nx = 0.3\npsi = -0.1\nl = 0.7\n"
    recording = load_recording(write(chosen("t u_x u_l"), sidecar), inputs_only=True)
    np.testing.assert_array_equal(recording.u_l, columns["u_l"])
    assert recording.initial == {"x": 0.3, "psi": -0.1, "l": 0.7}
    assert (recording.x, recording.psi, recording.l) == (None, None, None)
    assert recording.units == {"u_x": "V", "u_l": "V"}


def test_the_initial_length_is_that_of_a_locked_rope(write, refusal, chosen):
    path = write(chosen("t u_x psi"), "[initial]\nl = 0.9\n")
    assert load_recording(path, inputs_only=True).locked_length == 0.9
    assert "unknown length" in refusal(path)


def test_inputs_alone_are_checked_like_any_recording(write, columns, refusal, chosen):
    columns["u_x"][3] = np.nan
    message = refusal(write(chosen("t u_x")), inputs_only=True)
    assert "row 5, column u_x" in message
