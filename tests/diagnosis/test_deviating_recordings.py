"""A number that one recording asks for and the others do not."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.structures.space import make_space
from jbridge.diagnosis.structures.structure import base_structure
from jbridge.diagnosis.validation.deviating_recordings import own_numbers
from jbridge.diagnosis.validation.refits import of_its_own
from jbridge.identification.data.windows import make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import DRY, play, steps
from tests.problems import NUMBERS, make_plant


def asked(plants, train, overrides=()):
    """Numbers that runs of some plants ask for, beside a viscous model that is fitted to the first ones."""
    runs = [
        play(plant, np.stack([steps(500, i), np.zeros(500)], axis=1), name=f"run-{i}.csv", start={"x": 0.6}, seed=i)
        for i, plant in enumerate(plants)
    ]
    for i, numbers in dict(overrides).items():
        runs[i] = dataclasses.replace(runs[i], override=numbers)
    known = frozenset({"cart_mass"})
    setting = make_setting(Model(make_plant(), known, frozenset(NUMBERS), {}, "m.toml"), runs[:train], runs[train:])
    problem, fitted = fit_structure(make_problem(setting, make_data(runs[:train])), make_plant(), known)
    base = base_structure(problem, make_space(problem, fitted.plant, known, shared=False), fitted.point)
    every = make_problem(setting, make_data(runs, noise=setting.noise))
    return own_numbers(every, of_its_own(problem, base))


@pytest.mark.parametrize(
    ("number", "factor", "place"), [("cart_gain", 1.4, 1), ("cart_gain", -1.0, 4), ("cart_mass", 2.0, 4)]
)
def test_a_number_that_was_another_once_is_found(number, factor, place):
    """Among the recordings, which pull the model's own number, and in the hold-out."""
    plants = [make_plant(**{number: (factor if i == place else 1.0) * NUMBERS[number]}) for i in range(5)]
    [apart] = asked(plants, 3)
    found = apart.numbers[0]
    assert (apart.recording, found.number, found.axis) == (f"run-{place}.csv", number, "x")
    assert found.value == pytest.approx(factor * NUMBERS[number], rel=0.02)
    assert found.value / found.others == pytest.approx(factor, rel=0.05)
    assert found.closed > 0.9


def test_what_a_sidecar_says_already_is_not_said_again():
    plants = [make_plant(cart_gain=(1.4 if i == 1 else 1.0) * NUMBERS["cart_gain"]) for i in range(5)]
    assert asked(plants, 3, {1: {"cart_gain": 1.4 * NUMBERS["cart_gain"]}}) == []


def test_what_is_missing_everywhere_is_no_recordings_own():
    assert asked([make_plant(DRY)] * 5, 3) == []


def test_three_recordings_are_too_few_to_disagree():
    assert asked([make_plant(), make_plant(), make_plant(cart_gain=1.4 * NUMBERS["cart_gain"])], 2) == []
