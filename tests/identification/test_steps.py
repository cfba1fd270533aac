"""Steps of a fit in what motions are nearly linear in."""

import numpy as np
import pytest

from jbridge.identification.prior import Prior
from jbridge.identification.solver.gauss_newton import _promise, _stepped
from jbridge.identification.solver.prediction_errors import Point
from jbridge.identification.solver.variable_projection import Normal
from jbridge.model.parameters import ParameterTable
from tests.problems import make_plant

BELT = ("belt_compliance", "cart", {"stiffness": 8000.0, "damping": 10.0, "motor_mass": 2.0})


@pytest.mark.parametrize("wanted", [500.0, 20000.0])
def test_a_deflection_finds_its_springs_stiffness_in_one_step(wanted):
    """A force of 30 N deflects a spring by 30 N over its stiffness, stiffer or far softer than the start."""
    plant = make_plant(BELT)
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant))
    [place] = table.positions("belt_compliance@cart.stiffness")
    tangent, left = -30.0 / 8000.0**2, 30.0 / 8000.0 - 30.0 / wanted
    row = np.array([tangent, left])
    products = np.zeros((1, 3, 2, 2))
    products[0, 0] = np.outer(row, row)
    normal = Normal(products, np.zeros((1, 6)), np.zeros((1, 6, 1)))
    point = Point(vector, np.array([place]), (), np.zeros((1, 3)), 0.0, 0.0)
    after, along = _stepped(table, normal, np.array([[1.0, 0.0, 0.0]]), Prior(), point, 0.0)
    assert after[place] == pytest.approx(wanted, rel=1e-6)
    assert tangent * along[0] == pytest.approx(-left, rel=1e-6)


def test_a_spring_and_a_damping_are_found_together():
    """Two readings, each of the compliance and the damping; half of what they leave, squared, is promised."""
    plant = make_plant(BELT)
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant))
    places = np.array([table.positions(f"belt_compliance@cart.{key}")[0] for key in ("stiffness", "damping")])
    mix, wanted = np.array([[3e4, 1.0], [-1e4, 2.0]]), np.array([1.0 / 2000.0, 4.0])
    away = mix @ (np.array([1.0 / 8000.0, 10.0]) - wanted)
    rows = np.concatenate([mix * [-1.0 / 8000.0**2, 1.0], away[:, None]], axis=1)
    products = np.zeros((1, 3, 3, 3))
    products[0, 0] = rows.T @ rows
    normal = Normal(products, np.zeros((1, 6)), np.zeros((1, 6, 2)))
    point = Point(vector, places, (), np.zeros((1, 3)), 0.0, 0.0)
    weight = np.array([[1.0, 0.0, 0.0]])
    assert _promise(table, normal, weight, Prior(), point) == pytest.approx(0.5 * away @ away, rel=1e-6)
    after, _ = _stepped(table, normal, weight, Prior(), point, 0.0)
    assert after[places] == pytest.approx([2000.0, 4.0], rel=1e-6)


def test_a_spring_gets_no_stiffer_than_a_thousandfold_at_once():
    plant = make_plant(BELT)
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant))
    [place] = table.positions("belt_compliance@cart.stiffness")
    products = np.zeros((1, 3, 2, 2))
    products[0, 0] = np.outer([-1e-3, 100.0], [-1e-3, 100.0])
    normal = Normal(products, np.zeros((1, 6)), np.zeros((1, 6, 1)))
    point = Point(vector, np.array([place]), (), np.zeros((1, 3)), 0.0, 0.0)
    after, _ = _stepped(table, normal, np.array([[1.0, 0.0, 0.0]]), Prior(), point, 0.0)
    assert after[place] == pytest.approx(8e6)
