"""Moves of the search that change a law and not a set of effects."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.selection.mechanisms import with_mechanisms
from jbridge.diagnosis.selection.moves import refinements, replacements, simplifications
from jbridge.diagnosis.structures.space import make_space, proposals
from jbridge.diagnosis.structures.structure import (
    Structure,
    base_structure,
    from_larger,
    in_equal_steps,
    weighed,
    with_own_levels,
)
from jbridge.identification.data.windows import make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.sensitivity.windowed_rollout import Steps
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import play, steps
from tests.problems import NUMBERS, make_plant

NAME = ("position_direction_friction", "cart")
KNOTS = [0.2, 0.5, 0.8]
FINER = [0.2, 0.35, 0.5, 0.65, 0.8]
KNOWN = frozenset({"cart_mass", "cart_gain"})


def make_case(true, name, values, free):
    """A problem of one recording, its base, and a model with one effect beside it."""
    plants = [make_plant(), make_plant((*name, values))]
    inputs = np.stack([steps(400, 1), np.zeros(400)], axis=1)
    run = play(make_plant(true), inputs, start={"x": 0.5}, seed=1)
    setting = make_setting(Model(plants[0], KNOWN, frozenset(NUMBERS), {}, "m.toml"), [run], [])
    problem = make_problem(setting, make_data([run], (1.0,)))
    problem, given = fit_structure(problem, plants[0], KNOWN)
    base = base_structure(problem, make_space(problem, plants[0], KNOWN, shared=False), given.point)
    problem, fitted = fit_structure(problem, plants[1], KNOWN)
    space = make_space(problem, plants[1], KNOWN, shared=False)
    structure = Structure(space=space, names=(name,), keys={name: free}, choices={name: 0.0}, point=fitted.point)
    return problem, base, weighed(problem, structure)


@pytest.fixture(scope="module")
def found():
    """A map beside the base; the rig's own friction has twice as many places."""
    law = {"knots": KNOTS, "positive": [3.0, 4.0, 5.0], "negative": [5.0, 4.0, 3.0]}
    true = {"knots": FINER, "positive": [3.0, 5.0, 4.0, 6.0, 5.0], "negative": [5.0, 3.0, 4.0, 2.0, 3.0]}
    return make_case((*NAME, true), NAME, law, ("positive", "negative"))


def test_a_model_that_stands_elsewhere_goes_to_where_a_larger_one_leads(found):
    """It has its own optimum there; one that stands at it stays."""
    problem, base, now = found
    assert from_larger(problem, base, now) is base
    far = dataclasses.replace(base.point.start, vector=base.point.vector.copy())
    far.vector[base.point.free[0]] *= 3.0
    [there] = problem.evaluate(base.space.engine, [far])
    left = dataclasses.replace(base, point=there)
    assert left.value > base.value + 10.0
    assert from_larger(problem, left, now).value < base.value + 1.0


def test_shorter_steps_are_no_merit_of_a_law(found):
    """A model gains nothing over itself in other steps."""
    problem, base, _ = found
    engine = base.space.engine.predicting_in(Steps(1))
    [point] = problem.solve(engine, [base.point.start])
    other = dataclasses.replace(base, space=dataclasses.replace(base.space, engine=engine), point=point)
    better, worse = sorted((base, other), key=lambda s: s.value)
    assert better.value < worse.value - 1.0
    [same, without] = in_equal_steps(problem, worse, [better, worse])
    assert same.value == pytest.approx(worse.value, abs=0.2) and without is worse


def test_what_was_added_last_is_compared_with_its_runner_up_again(found):
    """A model that leaves less judges more closely."""
    problem, base, now = found
    name = ("coulomb_friction", "cart")
    space = make_space(problem, make_plant((*name, {"level": 3.0})), KNOWN, shared=False)
    point = dataclasses.replace(now.point, vector=np.array(space.table.ravel(space.plant), float))
    other = dataclasses.replace(now, space=space, names=(name,), keys={name: ("level",)}, point=point)
    [move] = replacements(problem, base, now, {NAME: other})
    assert move.names == (name,) and "coulomb_friction@cart.level" in move.numbers
    assert [e.kind for e in move.space.plant_of(move.start.vector, move.names).effects] == [name[0]]


def test_a_finer_map_starts_from_the_same_law(found):
    problem, base, now = found
    [move] = refinements(problem, base, now, [])
    [law] = move.space.table.unravel(move.start.vector).effects
    np.testing.assert_allclose(law.knots, FINER)
    assert len(move.start.free) == len(now.point.free) + 4
    [point] = problem.evaluate(move.space.engine, [move.start])
    assert point.value == pytest.approx(now.point.value, abs=1e-6)


def test_a_finer_map_competes_on_its_own_axis_alone(found):
    problem, base, now = found
    [move] = refinements(problem, base, now, [])
    other = dataclasses.replace(move, promise=3.0 * move.promise)
    assert move.promise > 0.0 and refinements(problem, base, now, [other]) == []
    beside = dataclasses.replace(other, names=(("coulomb_friction", "swing"),))
    assert len(refinements(problem, base, now, [beside])) == 1


def test_a_law_that_loses_more_than_a_map_costs_is_not_tried(found):
    problem, base, now = found
    assert now.price < 100.0 and simplifications(problem, base, now) == []


def test_levels_beside_a_plain_friction_are_told_from_it(found):
    """The sums stay; the smallest added level is 0 and no longer estimated."""
    problem, _, now = found
    law = {"knots": KNOTS, "positive": [3.0, 4.0, 5.0], "negative": [5.0, 2.0, 3.0]}
    space = make_space(
        problem, make_plant(("coulomb_friction", "cart", {"level": 1.5}), (*NAME, law)), KNOWN, shared=False
    )
    names = ["coulomb_friction@cart.level", f"{NAME[0]}@cart.positive", f"{NAME[0]}@cart.negative"]
    free = np.array([p for name in names for p in space.table.positions(name)], np.int64)
    point = dataclasses.replace(now.point, vector=np.array(space.table.ravel(space.plant), float), free=free)
    after = with_own_levels(dataclasses.replace(now, space=space, point=point))
    plain, added = after.plant.effects
    assert float(plain.level) == 3.5
    np.testing.assert_allclose(added.positive, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(added.negative, [3.0, 0.0, 1.0])
    assert set(free) - set(after.point.free) == {space.table.positions(names[2])[1]}
    assert weighed(problem, after).price > 0.0


def test_a_law_of_which_one_level_is_held_keeps_the_other(found):
    problem, _, now = found
    name, law = ("direction_dependent_friction", "cart"), {"positive": 2.0, "negative": 0.0}
    plant = make_plant(("coulomb_friction", "cart", {"level": 1.5}), (*name, law))
    space = make_space(problem, plant, KNOWN, shared=False)
    names = ["coulomb_friction@cart.level", "direction_dependent_friction@cart.positive"]
    free = np.array([p for entry in names for p in space.table.positions(entry)], np.int64)
    point = dataclasses.replace(now.point, vector=np.array(space.table.ravel(space.plant), float), free=free)
    keys = {name: ("positive",)}
    after = with_own_levels(dataclasses.replace(now, space=space, names=(name,), keys=keys, point=point))
    assert float(after.plant.effects[1].positive) == 2.0
    np.testing.assert_array_equal(after.point.free, free)


CHAIN, SPRING = ("cable_drag", "cart"), ("spring_force", "cart")
CHAIN_KEYS, SPRING_KEYS = ("stiffness", "rest", "level", "travel"), ("stiffness", "rest")


@pytest.mark.slow
def test_a_law_takes_the_place_of_one_that_it_contains():
    true = {"stiffness": 8.0, "rest": 0.4, "level": 2.0, "travel": 0.02}
    problem, _, now = make_case((*CHAIN, true), SPRING, {"stiffness": 1.0, "rest": 0.5}, SPRING_KEYS)
    apart = [c for c in proposals(problem.setting, now.plant, KNOWN) if c.name == CHAIN]
    [move] = with_mechanisms(problem, problem, now, apart, {CHAIN: 0.0}, None)
    assert move.names == (CHAIN,) and [e.kind for e in move.space.plant.effects] == ["cable_drag"]
    assert move.keys == {CHAIN: CHAIN_KEYS} and not any("spring_force" in name for name in move.numbers)
    [point] = problem.solve(move.space.engine, [move.start], 8)
    [found] = move.space.table.unravel(point.vector).effects
    assert found.level == pytest.approx(true["level"], rel=0.1) and found.travel == pytest.approx(0.02, rel=0.3)


@pytest.mark.slow
def test_a_cable_without_a_loop_becomes_a_spring():
    true = {"stiffness": 8.0, "rest": 0.4}
    start = {"stiffness": 4.0, "rest": 0.5, "level": 0.2, "travel": 0.05}
    problem, base, now = make_case((*SPRING, true), CHAIN, start, CHAIN_KEYS)
    [move] = simplifications(problem, base, now)
    assert move.names == (SPRING,) and move.keys == {SPRING: SPRING_KEYS}
    [point] = problem.solve(move.space.engine, [move.start], 4)
    [found] = move.space.table.unravel(point.vector).effects
    assert found.stiffness == pytest.approx(true["stiffness"], rel=0.05)
