"""The linear screen: where a search for an effect starts."""

import numpy as np
import pytest

from jbridge.diagnosis.selection.screening import AmongAll, screened
from jbridge.diagnosis.structures.space import make_space, proposals
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.setting import make_setting
from jbridge.identification.solver import Start
from jbridge.model.files import Model
from tests.identification.cases import DRY, play, steps
from tests.problems import CART_ALONE, NUMBERS, PERIOD, make_plant


def test_a_step_of_a_sensor_is_looked_for_at_its_own_moment():
    """Its time has a tangent within one sample alone, and places to start are tenths of a second apart."""
    lost = {"jump": 0.001, "time": 1.2337}
    true, plant = make_plant(DRY, ("missed_counts", "x_sensor", lost)), make_plant(DRY)
    inputs = np.stack([steps(600, 1), np.zeros(600)], axis=1)
    runs = [play(true, inputs, active=CART_ALONE, period=PERIOD, start={"x": 0.6})]
    known = frozenset({"cart_mass"})
    setting = make_setting(Model(plant, known, frozenset(NUMBERS), {}, ""), runs, [])
    problem, fitted = fit_structure(make_problem(setting, make_data(runs, (1.0, WHOLE))), plant, known)
    both = fitted.plant.adding(*make_plant(("missed_counts", "x_sensor", {"jump": 0.0, "time": 1.0})).effects)
    space = make_space(problem, both, known, shared=False)
    free = np.array([space.table.positions(fitted.table.entry(int(p)).name)[0] for p in fitted.free])
    [point] = problem.evaluate(space.engine, [Start(space.absent, free, fitted.point.states)])
    seeds = [c for c in proposals(setting, plant, known) if c.name == ("missed_counts", "x_sensor")]
    found = screened(problem, AmongAll(space, point), seeds)
    _, _, start = min(found, key=lambda each: each[0])
    [time] = space.table.positions("missed_counts@x_sensor.time")
    assert start.vector[time] == pytest.approx(lost["time"], abs=PERIOD)
