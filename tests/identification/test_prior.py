"""What is known beforehand counts where recordings tell nothing, and there alone."""

import dataclasses

import numpy as np
import pytest

from jbridge.identification.prior import Prior
from jbridge.model.parameters import ParameterTable
from tests.identification.cases import cart_model, cart_recordings, values
from tests.identification.test_estimation import fitted
from tests.problems import NUMBERS, example, make_plant

MAP = ("position_direction_friction", "cart", example("position_direction_friction", "cart"))
TABLE = ParameterTable(make_plant(MAP))
MASSES = {"cart_mass": 3.0, "load_mass": 0.2}


def vector_with(**changes):
    vector = np.array(TABLE.ravel(make_plant(MAP)), dtype=float)
    for name, value in changes.items():
        vector[TABLE.positions(name)] = value
    return vector


def test_a_factor_of_three_is_one_standard_deviation():
    prior = Prior(MASSES)
    assert prior.cost(TABLE, vector_with(**MASSES)) == 0.0
    assert prior.cost(TABLE, vector_with(cart_mass=9.0, load_mass=0.2)) == pytest.approx(0.5)
    assert prior.cost(TABLE, vector_with(cart_mass=1.0, load_mass=1.8)) == pytest.approx(0.5 + 2.0)


def test_terms_are_the_costs_derivatives():
    prior, vector = Prior(MASSES), vector_with(cart_mass=7.0)
    free = np.array([TABLE.positions(name)[0] for name in ("cart_gain", "cart_mass", "load_mass")])
    precision, gradient = prior.terms(TABLE, free, vector, np.zeros(3))
    for i, place in enumerate(free):
        ahead, behind = vector.copy(), vector.copy()
        ahead[place] *= 1.0 + 1e-6
        behind[place] *= 1.0 - 1e-6
        slope = (prior.cost(TABLE, ahead) - prior.cost(TABLE, behind)) / (2e-6 * vector[place])
        assert gradient[i] == pytest.approx(slope, rel=1e-6, abs=1e-12)
    # A sum of squares of logarithms, linearised.
    assert np.diag(precision) == pytest.approx([0.0, *(1.0 / (np.log(3.0) * vector[free[1:]])) ** 2])


def test_neighbours_in_a_map_are_tied():
    free = np.array(TABLE.positions("position_direction_friction@cart.positive"))
    precision, gradient = Prior().terms(TABLE, free, vector_with(), np.array([5.0, 2.0, 1.0]))
    assert np.allclose(precision @ np.ones(len(free)), 0.0)
    assert np.allclose(precision, 5e-6 * np.array([[1, -1, 0], [-1, 2, -1], [0, -1, 1]]))
    assert np.allclose(gradient, precision @ vector_with()[free])


def test_a_period_is_no_longer_than_recordings_show_to_repeat():
    table = ParameterTable(make_plant(("periodic_force", "cart", example("periodic_force", "cart"))))
    low, high = Prior(largest={"periodic_force@cart.period": 0.4, "torque_ripple@cart_drive.period": 0.2}).bounds(table)
    [place] = table.positions("periodic_force@cart.period")
    free_low, free_high = table.bounds()
    assert high[place] == 0.4 < free_high[place] and (low == free_low).all()
    assert (np.delete(high, place) == np.delete(free_high, place)).all()


def test_a_mass_that_no_recording_tells_stays_and_one_that_is_told_is_found():
    """Mass, damping and gain have a factor in common that no motion shows, until the gain is known."""
    runs = cart_recordings(make_plant(), 2)
    guess = make_plant(cart_mass=2.0 * NUMBERS["cart_mass"])
    model = dataclasses.replace(cart_model(), plant=guess)
    free = dataclasses.replace(model, known=model.known - {"cart_mass"})
    _, found = fitted(free, runs)
    told = values(found.plant)
    assert told["cart_mass"] == pytest.approx(2.0 * NUMBERS["cart_mass"], rel=0.05)
    assert told["cart_gain"] / told["cart_mass"] == pytest.approx(NUMBERS["cart_gain"] / NUMBERS["cart_mass"], rel=0.02)
    _, found = fitted(dataclasses.replace(free, known=free.known | {"cart_gain"}), runs)
    assert values(found.plant)["cart_mass"] == pytest.approx(NUMBERS["cart_mass"], rel=0.02)
