"""The linear screen: where a search for an effect starts."""

import numpy as np
import pytest

from jbridge.diagnosis.selection.screening import AmongAll, screened
from jbridge.diagnosis.structures.space import make_space, proposals
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.setting import make_setting
from jbridge.identification.solver import Start
from jbridge.model.effects.catalogue import make_effect
from jbridge.model.files import Model
from tests.identification.cases import DRY, play, steps
from tests.problems import CART_ALONE, LOCKED_ROPE, NUMBERS, PERIOD, make_plant


def begun_nearest(plant, run, kind, site):
    """Where the screen would start an effect that a recording's model lacks, by the effect's keys."""
    known = frozenset({"cart_mass", "load_mass", "gravity", "swing_damping"})
    setting = make_setting(Model(plant, known, frozenset(NUMBERS), {}, ""), [run], [])
    problem, fitted = fit_structure(make_problem(setting, make_data([run], (1.0, WHOLE))), plant, known)
    [seed, *_] = seeds = [c for c in proposals(setting, plant, known) if c.name == (kind, site)]
    both = fitted.plant.adding(make_effect(kind, site, seed.values))
    space = make_space(problem, both, known, shared=False)
    free = np.array([space.table.positions(fitted.table.entry(int(p)).name)[0] for p in fitted.free])
    [point] = problem.evaluate(space.engine, [Start(space.absent, free, fitted.point.states)])
    _, _, start = min(screened(problem, AmongAll(space, point), seeds), key=lambda each: each[0])
    return {key: start.vector[space.table.positions(seed.group(key))[0]] for key in seed.free}


@pytest.mark.slow
def test_a_step_of_a_sensor_is_looked_for_at_its_own_moment():
    """Its time has a tangent within one sample alone, and places to start are tenths of a second apart."""
    lost = {"jump": 0.001, "time": 1.2337}
    true = make_plant(DRY, ("missed_counts", "x_sensor", lost))
    inputs = np.stack([steps(600, 1), np.zeros(600)], axis=1)
    run = play(true, inputs, active=CART_ALONE, period=PERIOD, start={"x": 0.6})
    begun = begun_nearest(make_plant(DRY), run, "missed_counts", "x_sensor")
    assert begun["time"] == pytest.approx(lost["time"], abs=PERIOD)


def test_a_push_on_the_load_is_looked_for_as_what_a_pendulum_makes_of_it():
    push = {"force": 0.02, "start": 2.53, "stop": 6.11}
    inputs = np.stack([steps(2000, 1), np.zeros(2000)], axis=1)
    start = {"x": 0.6, "l": 0.7}
    run = play(make_plant(("wind", "swing", push)), inputs, active=LOCKED_ROPE, period=PERIOD, start=start)
    begun = begun_nearest(make_plant(), run, "wind", "swing")
    assert begun["start"] == pytest.approx(push["start"], abs=0.05)
    assert begun["stop"] == pytest.approx(push["stop"], abs=0.05)
