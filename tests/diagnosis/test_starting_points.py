"""Where to begin looking for effects that may be anywhere."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.selection.starting_points import _Mode, _nearby
from jbridge.diagnosis.structures.candidates import Candidate
from jbridge.diagnosis.structures.space import proposals
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import DRY, play, steps
from tests.problems import CART_ALONE, NUMBERS, PERIOD, make_plant


@pytest.mark.parametrize("root", [-103.0, -8.2, 0.0, -0.02 + 3.7j])
def test_a_linear_axis_follows_a_held_force(root):
    """However strongly it is damped, and over a gap: each sample from the one before, in closed form."""
    t = np.delete(np.arange(4000) * PERIOD, slice(1500, 2200))
    force = np.sin(3.0 * t)
    expected = np.zeros(len(t), complex)
    for k, dt in enumerate(np.diff(t)):
        gained = dt if root == 0.0 else (np.exp(root * dt) - 1.0) / root
        expected[k + 1] = np.exp(root * dt) * expected[k] + gained * force[k]
    found = _Mode.of(complex(root), t).followed(force)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_events_are_looked_for_where_something_was_recorded():
    """Two pieces of a long run, with minutes between them."""
    inputs = np.stack([steps(200, 1), np.zeros(200)], axis=1)
    plant = make_plant(DRY)
    pieces = [
        dataclasses.replace(play(plant, inputs, active=CART_ALONE, start={"x": 0.6}), begun=begun)
        for begun in (5.0, 600.0)
    ]
    setting = make_setting(Model(plant, frozenset({"cart_mass"}), frozenset(NUMBERS), {}, ""), pieces, [])
    times = [c.values["time"] for c in proposals(setting, plant, frozenset({"cart_mass"})) if c.kind == "missed_counts"]
    assert sum(5.0 < time < 7.0 for time in times) == sum(600.0 < time < 602.0 for time in times) == len(times) / 2


def test_only_free_numbers_move_between_the_places_to_start():
    """The turn of a disc is no number that the recordings tell, whatever wave they would like."""
    values = [{"amplitude": 0.0, "period": 2 * np.pi / k, "phase": 0.0} for k in range(1, 9)]
    places = [Candidate("sensor_eccentricity", "psi_sensor", each, ("amplitude", "phase"), False) for each in values]
    liked = lambda tried: np.array([-abs(each.values["period"] - 5.0) for each in tried])  # noqa: E731
    _, held = _nearby(-np.inf, places[0], places, liked)
    assert held.values["period"] == 2 * np.pi
    freed = [dataclasses.replace(each, free=("amplitude", "period", "phase")) for each in places]
    _, moved = _nearby(-np.inf, freed[0], freed, liked)
    assert moved.values["period"] == pytest.approx(5.0, abs=0.01)
