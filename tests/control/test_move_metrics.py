"""Measures of a move, on motions whose measures are known."""

import numpy as np
import pytest

from jbridge.control.move_metrics import moves

T = np.arange(0.0, 20.0, 0.02)


def run(x, psi=0.0, u=0.0):
    """One leg of x from 0 to 1 in 2 s and back after 10 s, l at 0.5."""
    wanted = np.interp(T, [0, 0.5, 2.5, 10.0, 12.0, 20.0], [0, 0, 1, 1, 0, 0])
    reference = np.stack([wanted, np.full_like(T, 0.5)], axis=1)
    position = np.stack([x(wanted), np.full_like(T, psi) if np.isscalar(psi) else psi, np.full_like(T, 0.5)], axis=1)
    return moves(T, reference, position, np.stack([np.full_like(T, u), np.zeros_like(T)], axis=1))


def test_legs_begin_and_end_with_the_reference():
    first, second = run(lambda wanted: wanted)
    assert first.start == pytest.approx(0.5, abs=0.03) and first.arrival == pytest.approx(2.5, abs=0.03)
    assert second.start == pytest.approx(10.0, abs=0.03) and second.arrival == pytest.approx(12.0, abs=0.03)
    assert first.settling_time["x"] == pytest.approx(1.99, abs=0.05) and first.settling_time["l"] == 0.0
    assert first.overshoot == {"x": 0.0, "l": 0.0} and first.residual_swing == 0.0


def test_a_place_to_hold_is_one_leg():
    place = np.tile([0.3, 0.5], (len(T), 1))
    position = np.stack([place[:, 0] + 0.02, np.full_like(T, 0.1), place[:, 1]], axis=1)
    [held] = moves(T, place, position, np.zeros((len(T), 2)))
    assert held.start == held.arrival == 0.0 and held.overshoot == {"x": 0.0, "l": 0.0}
    assert held.settling_time["x"] is None and held.settling_time["l"] == 0.0
    assert held.steady_error["x"] == pytest.approx(0.02) and held.residual_swing == pytest.approx(0.1)


def test_a_position_that_stays_away_never_settles():
    first, _ = run(lambda wanted: 0.95 * wanted, psi=0.1, u=2.0)
    assert first.settling_time["x"] is None and first.steady_error["x"] == pytest.approx(-0.05)
    assert first.residual_swing == pytest.approx(0.1) and first.effort["x"] == pytest.approx(4.0)
    # The load hangs 0.5 m below, 5 cm ahead of the cart: there it is at the goal.
    assert first.settling_time["load"] is not None


def test_overshoot_is_a_share_of_the_way():
    beyond = 0.04 * np.exp(-((T - 3.0) ** 2) / 0.1)
    first, second = run(lambda wanted: wanted + beyond)
    assert first.overshoot["x"] == pytest.approx(0.04, abs=2e-3) and second.overshoot["x"] == 0.0
    assert 3.0 < first.start + first.settling_time["x"] < 3.6


def test_itae_is_of_the_error_to_the_reference():
    """At 0.9 all the time while the reference goes from 0 to 1 within 2 s: by hand 0.486 + 0.0193 + 4.3125."""
    first, _ = run(lambda wanted: np.where(T < 10.0, 0.9, 0.0))
    assert first.itae["x"] == pytest.approx(4.818, rel=0.01)


@pytest.mark.parametrize(("late", "settles"), [(0.4, False), (0.6, True)])
def test_settled_means_for_half_a_second_at_least(late, settles):
    """A load that swings on crosses its goal, too."""
    first, _ = run(lambda wanted: wanted + 0.02 * ((T > 9.5) & (T < 10.0 - late)) * (T < 10.0))
    assert (first.settling_time["x"] is not None) == settles


def test_travel_sign_changes_and_saturation_are_counted():
    """A voltage of 2 cos(pi t) in a move of 9.5 s, cut off at the drive's limit; 0.02 V of noise have no sign."""
    wanted = np.interp(T, [0, 0.5, 2.5, 10.0, 12.0, 20.0], [0, 0, 1, 1, 0, 0])
    reference = np.stack([wanted, np.full_like(T, 0.5)], axis=1)
    position = np.stack([wanted, np.zeros_like(T), np.full_like(T, 0.5)], axis=1)
    command = np.stack([np.clip(2.0 * np.cos(np.pi * T), -1.0, 1.0), 0.02 * (-1.0) ** np.arange(len(T))], axis=1)
    first, _ = moves(T, reference, position, command, (1.0, 10.0))
    # From 0.5 to 10 s it passes 0 at 1.5, 2.5, ..., 9.5, and is cut off two thirds of the time.
    assert first.sign_changes == {"x": 9, "l": 0}
    assert first.saturation["x"] == pytest.approx(2 / 3, abs=0.02) and first.saturation["l"] == 0.0
    # Twice the height of 1 V in every second; and 0.04 V in every sample of 0.02 s.
    assert first.travel["x"] == pytest.approx(2.0, rel=0.06) and first.travel["l"] == pytest.approx(2.0, rel=0.01)
