"""The program that all models of a search share."""

import numpy as np

from jbridge.diagnosis.structures.space import make_space
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import make_problem
from jbridge.identification.sensitivity.engine import Job
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import play, steps
from tests.problems import EVERY_AXIS, NUMBERS, make_plant


def test_a_model_is_the_same_beside_any_others():
    """Simulations of a call have every effect that one of them has, the others at the numbers at which it is absent."""
    plant = make_plant(("coulomb_friction", "cart", {"level": 3.0}), swing_damping=0.01)
    runs = [
        play(
            plant,
            np.stack([steps(count, i), 0.7 * steps(count, 5 + i) - 0.3], axis=1),
            name=f"{i}.csv",
            active=EVERY_AXIS,
            start={"x": 0.6, "psi": 0.1},
            seed=i,
        )
        for i, count in enumerate((150, 120))
    ]
    known = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})
    model = Model(plant, known, frozenset(NUMBERS), {}, "")
    problem = make_problem(make_setting(model, runs, []), make_data(runs, (WHOLE,)))
    space = make_space(problem, plant, known)
    space.engine.lanes = 8
    table, owners = space.table, space.table.owners()
    # Each recording has windows of its own length; what follows the shorter one's end is not looked at.
    [_, short] = problem.data.tilings
    own = Job(space.absent, short.recording, short.begins, short.states)
    [alone] = space.engine.predict([own])
    others = []
    for effect in range(len(plant.effects), len(space.plant.effects)):
        vector = space.absent.copy()
        vector[np.flatnonzero(owners == effect)] += 1e-3
        others.append(own._replace(vector=vector))
    assert len(others) > 40 and table.size > len(others)
    count = problem.data.grids[short.recording].intervals + 1
    for first in range(0, len(others), 7):
        [beside, *_] = space.engine.predict([own, *others[first : first + 7]])
        np.testing.assert_allclose(beside[:count], alone[:count], rtol=0.0, atol=1e-12)
