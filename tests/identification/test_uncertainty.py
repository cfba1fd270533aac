"""Intervals: directions that are not determined, and what is said of them."""

import tomllib

import numpy as np
import pytest

from jbridge._toml import as_value
from jbridge.identification.prior import Prior
from jbridge.identification.uncertainty import as_uncertainty, estimates, inverse_normal, warnings
from jbridge.model.parameters import ParameterTable
from tests.problems import make_plant


def test_inverse_of_a_badly_scaled_matrix():
    scale = np.array([1e-6, 1.0, 1e5])
    root = np.random.default_rng(0).standard_normal((3, 3)) + 2 * np.eye(3)
    plain = root @ root.T
    found = inverse_normal(scale[:, None] * plain * scale)
    np.testing.assert_allclose(scale[:, None] * found * scale, np.linalg.inv(plain), rtol=1e-9)


def test_a_direction_without_data_is_wide():
    matrix = np.array([[1.0, 1.0], [1.0, 1.0]])
    assert np.diag(inverse_normal(matrix)).min() > 1e6


PLANT = make_plant(
    ("coulomb_friction", "cart", {"level": 3.0}),
    ("position_dependent_friction", "cart", {"knots": [0.2, 0.6, 1.0], "levels": [0.0, 1.0, 2.0]}),
)
TABLE = ParameterTable(PLANT)
VECTOR = np.array(TABLE.ravel(PLANT))


def places(*names):
    return np.array([place for name in names for place in TABLE.positions(name)])


def test_estimates_of_scalars_and_vectors():
    free = places("cart_gain", "position_dependent_friction@cart.levels[1]", "coulomb_friction@cart.level")
    found = estimates(TABLE, VECTOR, free, np.diag([0.25, 0.01, 9.0]), 0.005)
    gain = found["cart_gain"]
    # Twice the plain deviation, and a quarter of a percent of the value.
    assert (gain.value, gain.unit) == (16.0, "N/V") and gain.std == pytest.approx(np.hypot(1.0, 0.04), rel=1e-9)
    assert gain.low == pytest.approx(16 - 1.96 * gain.std, abs=1e-3) and gain.high == pytest.approx(
        16 + 1.96 * gain.std, abs=1e-3
    )
    levels = found["position_dependent_friction@cart.levels"]
    assert levels.value == [0.0, 1.0, 2.0] and levels.std == pytest.approx([0.0, 0.2, 0.0], abs=1e-4)
    # An interval ends where physics does.
    assert found["coulomb_friction@cart.level"].low == 0.0
    known = found["cart_mass"]
    assert (known.value, known.std, known.low, known.high) == (5.5, None, None, None)


def test_a_level_of_which_nothing_tells_has_an_interval_without_an_end():
    free = places("position_dependent_friction@cart.levels[1]", "position_dependent_friction@cart.levels[2]")
    found = estimates(TABLE, VECTOR, free, np.diag([0.01, 1e200]), 0.005)
    levels = found["position_dependent_friction@cart.levels"]
    assert levels.std[1] == pytest.approx(0.2, abs=1e-3) and levels.std[2] == np.inf
    assert (levels.low[2], levels.high[2]) == (0.0, np.inf)
    kept = as_uncertainty(found)["position_dependent_friction@cart.levels"]
    assert tomllib.loads(f"high = {as_value(kept['high'])}")["high"] == levels.high


def test_a_time_is_known_to_a_hundredth_of_the_sampling_period_at_best():
    plant = make_plant(("actuator_lag", "cart_drive", {"time_constant": 0.002}))
    table = ParameterTable(plant)
    free = np.array(table.positions("actuator_lag@cart_drive.time_constant") + table.positions("cart_gain"))
    vector = np.array(table.ravel(plant))
    times, gains = (
        [estimates(table, vector, free, np.diag([s**2, s**2]), period)[name].std for s in (0.0, 1e-3)]
        for name, period in (("actuator_lag@cart_drive.time_constant", 0.005), ("cart_gain", 0.005))
    )
    assert times == pytest.approx([np.hypot(5e-5, 5e-6), np.hypot(5e-5, np.hypot(2e-3, 5e-6))], rel=1e-9)
    assert gains == pytest.approx([0.04, np.hypot(2e-3, 0.04)], rel=1e-9)


def test_what_is_not_determined_is_said():
    free = places("cart_gain", "cart_damping", "coulomb_friction@cart.level")
    wide = np.array([[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 25.0]])
    (said,) = warnings(TABLE, VECTOR, free, wide, TABLE.bounds())
    assert said.startswith("The recordings hardly determine the level of the Coulomb friction at the cart: 3 N")
    blind = np.diag([1e-4, 1e-4, 1e200])
    (said,) = warnings(TABLE, VECTOR, free, blind, TABLE.bounds())
    assert (
        said
        == "The recordings contain no information on the level of the Coulomb friction at the cart, which stays at 3 N."
    )
    told = estimates(TABLE, VECTOR, free, blind, 0.01)["coulomb_friction@cart.level"]
    assert (told.value, told.std, told.low, told.high) == (3.0, None, None, None)
    tied = np.array([[1.0, 0.999, 0.0], [0.999, 1.0, 0.0], [0.0, 0.0, 1e-4]])
    (said,) = warnings(TABLE, VECTOR, free, tied, TABLE.bounds())
    assert said.startswith("The recordings hardly separate cart gain and cart damping: ")
    assert said.endswith("Inputs of several sizes and steady runs at several speeds would separate them.")
    assert warnings(TABLE, VECTOR, free, 1e-3 * tied, TABLE.bounds()) == []
    free = places("cart_mass", "cart_damping", "cart_gain", "swing_damping")
    scale = np.append(VECTOR[free[:3]], 0.0) * 10.0  # ten times as wide as they are large
    (said,) = warnings(TABLE, VECTOR, free, np.outer(scale, scale) + np.diag([0.0, 0.0, 0.0, 1e-12]), TABLE.bounds())
    assert said.startswith(
        "The recordings hardly determine a factor that cart mass, cart damping and cart gain have in"
    )
    assert said.endswith("list a mass that was weighed under known.")
    free = places("cart_gain", "cart_damping", "coulomb_friction@cart.level")
    at_bound = VECTOR.copy()
    at_bound[free[2]] = 0.0
    for variance in (1e-20, 1.0):
        (said,) = warnings(TABLE, at_bound, free, np.diag([1e-4, 1e-4, variance]), TABLE.bounds())
        assert said == "The level of the Coulomb friction at the cart ended at its bound of 0 N."


def test_numbers_that_are_tied_are_said_with_what_would_part_them():
    """A factor in common is told where no force is of known size: all numbers uncertain, a mass among them."""
    heavy, light = places("cart_mass", "cart_damping", "cart_gain"), places("cart_damping", "cart_gain")
    for free, width, begin in (
        (heavy, 10.0, "The recordings hardly determine a factor that cart mass, cart damping and cart gain have in"),
        (heavy, 0.1, "The recordings hardly separate cart mass, cart damping and cart gain"),
        (light, 10.0, "The recordings hardly separate cart damping and cart gain"),
    ):
        std = width * VECTOR[free]
        (said,) = warnings(TABLE, VECTOR, free, np.outer(std, std), TABLE.bounds())
        assert said.startswith(begin)


def test_values_of_a_map_are_counted():
    """They are no numbers to be read one by one: what is said of them is said once."""
    free = places("position_dependent_friction@cart.levels", "cart_gain")
    cov = np.diag([25.0, 1e-6, 25.0, 1e-4])
    cov[0, 2] = cov[2, 0] = 0.999 * 25.0
    said = warnings(TABLE, VECTOR, free, cov, TABLE.bounds())
    wanted = "The recordings hardly determine 2 of the 3 values of the levels of the"
    assert len(said) == 1 and said[0].startswith(wanted) and said[0].endswith("trust their shape, not their level.")


def test_a_number_without_a_unit_has_none():
    plant = make_plant(("sensor_scale", "psi_sensor", {"scale": 10.0}))
    table = ParameterTable(plant)
    free = np.array(table.positions("sensor_scale@psi_sensor.scale"))
    (said,) = warnings(table, np.array(table.ravel(plant)), free, np.array([[9.0]]), table.bounds())
    assert said.endswith("ended at its bound of 10.")


@pytest.mark.parametrize("value", [0.0, 0.9])
def test_a_number_at_either_bound_is_said(value):
    plant = make_plant(("load_dependent_friction", "cart", {"level": 1.0, "share": value}))
    table = ParameterTable(plant)
    free = np.array(table.positions("load_dependent_friction@cart.share"))
    (said,) = warnings(table, np.array(table.ravel(plant)), free, np.array([[1e-20]]), table.bounds())
    assert said.endswith(f"ended at its bound of {value:g} N/N.")


def test_a_bound_that_recordings_set_is_said():
    """A period may be no longer than what they show twice."""
    plant = make_plant(("torque_ripple", "cart_drive", {"amplitude": 0.1, "period": 0.3, "phase": 0.0}))
    table = ParameterTable(plant)
    name = "torque_ripple@cart_drive.period"
    bounds = Prior(largest={name: 0.3}).bounds(table)
    (said,) = warnings(
        table, np.array(table.ravel(plant)), np.array(table.positions(name)), np.array([[1e-20]]), bounds
    )
    assert "ended at its bound of 0.3 m" in said
