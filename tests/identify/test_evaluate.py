"""A model, its numbers held, is judged by how it meets recordings: its own starts must not stand in its way."""

import numpy as np
import pytest

from jbridge.identify.evaluate import evaluate
from jbridge.identify.setting import make_setting
from jbridge.model.files import Model
from tests.identify.cases import play
from tests.problems import FIXED_CART, NUMBERS, make_plant

OFFSET = 0.055


def test_a_rope_sensor_that_is_off_does_not_pull_the_start_away():
    """Dry friction holds the winch wherever a fit puts it, so a start that is pulled away stays where it was pulled."""
    plant = make_plant(
        ("coulomb_friction", "hoist", {"level": 3.0}),
        ("sensor_offset", "l_sensor", {"offset": OFFSET}),
    )
    run = play(plant, np.zeros((300, 2)), active=FIXED_CART, start={"psi": 0.1, "l": 0.8}, seed=1)
    setting = make_setting(Model(plant, frozenset(NUMBERS), frozenset(NUMBERS), {}, "model.toml"), [run], ())
    found = evaluate(plant, setting, setting.recordings, windows=False)
    assert found.predicted[0, 0, 2] == pytest.approx(0.8 + OFFSET, abs=2e-5)
    assert found.errors.free_run["l"] < 1.05 * setting.noise["l"]
