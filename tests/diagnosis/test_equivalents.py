"""Which explanations are weighed against a named effect: those that were tried in its place."""

import numpy as np
import pytest

from jbridge.diagnosis.equivalents import Naming, named_effect, round_of
from jbridge.diagnosis.selection.search import Search
from jbridge.diagnosis.structures.space import make_space
from jbridge.diagnosis.structures.structure import Structure
from jbridge.diagnosis.validation.confirmation import Checked
from jbridge.diagnosis.validation.refits import exchanged, of_its_own
from jbridge.identification.estimation import Problem, start_of
from jbridge.identification.setting import Setting
from tests.diagnosis.test_moves import KNOWN, make_case
from tests.problems import MECHANISMS, NUMBERS, example, make_plant

DRY, STRIBECK, SPRING = ("coulomb_friction", "cart"), ("stribeck_friction", "cart"), ("spring_force", "cart")
DRAG, PIVOT = ("load_drag", "swing"), ("coulomb_friction", "swing")
MECHANISMS_ALONE = {kind: values for group in MECHANISMS.values() for kind, _, values in group}


def only(cls, **fields):
    """An object with some of its fields, as no more of it is looked at."""
    found = object.__new__(cls)
    for name, value in fields.items():
        object.__setattr__(found, name, value)
    return found


def model(*names):
    return only(Structure, names=names, blocks=np.zeros(3))


def searched(held, tried, axes=("x", "psi", "l")):
    return only(Search, held=held, tried=tried, problem=only(Problem, setting=only(Setting, axes=axes)))


def members(search, name):
    found = round_of(search, name)
    return None if found is None else [name for name, _ in found]


def test_those_that_were_tried_when_it_was_added():
    held = (model(), model(DRY), model(DRY, PIVOT))
    tried = ((model(SPRING), model(DRY), model(DRAG)), (model(DRY, PIVOT), model(DRY, SPRING)), ())
    search = searched(held, tried)
    # Drag acts where the final model has another effect.
    assert members(search, DRY) == [DRY, SPRING]
    assert members(search, ("wind", "swing")) is None


def test_one_that_took_the_place_of_another_was_tried_where_that_was_added():
    held = (model(), model(DRY), model(DRY, PIVOT), model(PIVOT, STRIBECK))
    tried = (
        (model(DRY), model(STRIBECK), model(SPRING), model(PIVOT)),
        (model(DRY, PIVOT), model(DRY, STRIBECK)),
        (model(PIVOT, STRIBECK),),
        (),
    )
    search = searched(held, tried)
    assert members(search, STRIBECK) == [STRIBECK, DRY, SPRING]
    assert members(search, PIVOT) == [PIVOT]


def test_what_the_catalogue_calls_alike_may_act_on_another_axis():
    offset, clock = ("sensor_offset", "l_sensor"), ("clock_scale", "clock")
    held = (model(), model(offset), model(offset, PIVOT))
    search = searched(held, ((model(offset), model(clock), model(DRAG)), (model(offset, PIVOT),), ()))
    assert members(search, offset) == [offset, clock]


@pytest.mark.parametrize(("axes", "rivals"), [(("x", "psi"), [("load_drag", "swing")]), (("x", "psi", "l"), [])])
def test_the_length_of_a_locked_rope_is_one_with_what_acts_on_the_swing(axes, rivals):
    offset = ("sensor_offset", "l_sensor")
    held = (model(), model(offset), model(offset, PIVOT))
    search = searched(held, ((model(offset), model(DRAG)), (model(offset, PIVOT),), ()), axes)
    assert members(search, offset) == [offset, *rivals]


def test_one_of_a_pair_was_tried_beside_the_other():
    held = (model(), model(PIVOT, DRAG))
    singles = (model(PIVOT), model(DRAG), model(("sensor_scale", "l_sensor")))
    pairs = (model(PIVOT, DRAG), model(("power_law_damping", "swing"), DRAG), model(PIVOT, ("wind", "swing")))
    search = searched(held, ((*singles, *pairs), ()))
    assert members(search, PIVOT) == [PIVOT, ("power_law_damping", "swing")]
    assert members(search, DRAG) == [DRAG, ("wind", "swing")]


@pytest.mark.slow
def test_a_rival_is_one_that_serves_in_the_final_model():
    """What came near in a round, before something else was found, is fitted beside that: a law that contains the
    effect serves as well, and what only looked like it does not."""
    true = {"positive": 4.0, "negative": 4.0}
    problem, base, now = make_case(("direction_dependent_friction", "cart", true), DRY, {"level": 4.0}, ("level",))
    both = ("direction_dependent_friction", "cart")
    structures = []
    for name, values in (
        (DRY, {"level": 3.0}),
        (both, {"positive": 3.0, "negative": 3.0}),
        (SPRING, {"stiffness": 0.1}),
    ):
        plant = make_plant((*name, values))
        space = make_space(problem, plant, KNOWN, shared=False)
        start = start_of(problem, space.engine, plant, KNOWN)
        [point] = problem.evaluate(space.engine, [start])
        # In that round they all came equally near.
        price = 3.0 * len(values)
        by_block = np.full(3, -price / 3.0)
        structures.append(
            Structure(
                space=space,
                names=(name,),
                keys={name: tuple(values)},
                choices={name: 0.0},
                point=point,
                blocks=by_block,
                price=price,
            )
        )
    search = only(Search, problem=problem, held=(base, now, now), tried=(tuple(structures), (), ()))
    of = Naming(search, base, {}, lambda model: {})
    found = named_effect(of, Checked(DRY, "confirmed", 1.0, 5.0), of_its_own(problem, now), in_model=True)
    assert [(r.kind, r.site) for r in found.equivalents] == [both]
    assert 0.05 < found.probability < 0.95 and found.equivalents[0].parameters["positive"].value > 3.5


@pytest.mark.parametrize(
    "rest, other",
    [
        (("belt_compliance", "cart"), ("backlash", "cart")),
        (("cable_drag", "cart"), ("presliding_friction", "cart")),
        (("cable_drag", "cart"), SPRING),
        (SPRING, ("cable_drag", "cart")),
    ],
    ids=str,
)
def test_a_model_has_no_room_for_a_law_that_it_contains_and_for_a_second_drive_train(rest, other):
    plant = make_plant((*DRY, {"level": 3.0}), (*rest, MECHANISMS_ALONE.get(rest[0]) or example(*rest)))
    theirs = make_plant((*other, MECHANISMS_ALONE.get(other[0]) or example(*other)))
    assert exchanged(plant, make_plant(), (rest, other), DRY, theirs) is None


def test_another_effect_takes_the_place_of_one():
    plant = make_plant((*DRY, {"level": 3.0}), (*PIVOT, {"level": 1e-3}), load_mass=0.3)
    mass = ("wrong_value", "load_mass")
    found = exchanged(plant, make_plant(), (PIVOT, mass, SPRING), DRY, make_plant((*SPRING, example(*SPRING))))
    assert [e.kind for e in found.effects] == ["coulomb_friction", "spring_force"]
    assert found.effects[0].site == "swing" and float(found.bridge.load_mass) == pytest.approx(0.3)
    found = exchanged(plant, make_plant(), (PIVOT, DRY, SPRING), mass, make_plant((*SPRING, example(*SPRING))))
    assert len(found.effects) == 3 and float(found.bridge.load_mass) == pytest.approx(NUMBERS["load_mass"])
    found = exchanged(plant, make_plant(), (PIVOT, mass), DRY, make_plant(load_mass=0.4))
    assert len(found.effects) == 1 and float(found.bridge.load_mass) == pytest.approx(0.4)
