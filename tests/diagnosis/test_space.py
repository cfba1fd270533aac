"""The program that all models of a search share."""

import functools

import jax
import numpy as np
import pytest

from jbridge.diagnosis.structures.space import is_apart, make_space
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import make_problem
from jbridge.identification.sensitivity.engine import Job
from jbridge.identification.sensitivity.windowed_rollout import Lanes, _readings
from jbridge.identification.setting import make_setting
from jbridge.model.effects.catalogue import CATALOGUE
from jbridge.model.files import Model
from tests.identification.cases import play, steps
from tests.problems import EVERY_AXIS, NUMBERS, make_plant, null_effect

PLANT = make_plant(("coulomb_friction", "cart", {"level": 3.0}), swing_damping=0.01)
KNOWN = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})


@pytest.fixture(scope="module")
def problem():
    runs = [
        play(
            PLANT,
            np.stack([steps(count, i), 0.7 * steps(count, 5 + i) - 0.3], axis=1),
            name=f"{i}.csv",
            active=EVERY_AXIS,
            start={"x": 0.6, "psi": 0.1},
            seed=i,
        )
        for i, count in enumerate((150, 120))
    ]
    model = Model(PLANT, KNOWN, frozenset(NUMBERS), {}, "")
    return make_problem(make_setting(model, runs, []), make_data(runs, (WHOLE,)))


@pytest.mark.parametrize("kind", [kind for kind in CATALOGUE if is_apart(kind)])
def test_what_has_a_program_of_its_own_stands_beside_all_others(kind, problem):
    """As it does in the round after it was found. Nothing is computed: the program need only be made."""
    engine = make_space(problem, PLANT.adding(null_effect(kind, CATALOGUE[kind].sites[0])), KNOWN).engine
    shape = (1, engine.samples)
    present = np.zeros(len(engine.table.unravel(np.zeros(engine.table.size)).effects), bool)
    courses = jax.tree.map(lambda leaf: leaf[:1], engine._courses)
    lanes = Lanes(np.zeros((1, engine.table.size)), courses, np.zeros(shape), np.zeros((*shape, 6)), present)
    made = jax.eval_shape(functools.partial(_readings, engine.table, steps=engine.steps.predictions), lanes)
    assert made.shape == (*shape, 3)


def test_a_model_is_the_same_beside_any_others(problem):
    """Simulations of a call have every effect that one of them has, the others at the numbers at which it is absent."""
    space = make_space(problem, PLANT, KNOWN)
    space.engine.lanes = 8
    table, owners = space.table, space.table.owners()
    # Each recording has windows of its own length; what follows the shorter one's end is not looked at.
    [_, short] = problem.data.tilings
    own = Job(space.absent, short.recording, short.begins, short.states)
    [alone] = space.engine.predict([own])
    others = []
    for effect in range(len(PLANT.effects), len(space.plant.effects)):
        vector = space.absent.copy()
        vector[np.flatnonzero(owners == effect)] += 1e-3
        others.append(own._replace(vector=vector))
    assert len(others) > 40 and table.size > len(others)
    count = problem.data.grids[short.recording].intervals + 1
    for first in range(0, len(others), 7):
        [beside, *_] = space.engine.predict([own, *others[first : first + 7]])
        np.testing.assert_allclose(beside[:count], alone[:count], rtol=0.0, atol=1e-12)
