"""A model, its numbers held, is judged by how it meets recordings: its own starts must not stand in its way."""

import numpy as np
import pytest

from jbridge.identification.problem import make_setting
from jbridge.identify.evaluate import evaluate
from jbridge.model.files import Model
from tests.identify.cases import play, steps
from tests.problems import CART_ALONE, FIXED_CART, LOCKED_ROPE, NUMBERS, make_plant

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


BENT = ("presliding_friction", "cart", {"level": 3.5, "stiffness": 2e3})
"""Slides after some 2 mm: where a window begins, the spring is anywhere between its ends."""
HOOK = ("double_pendulum", "swing", {"hook_mass": 0.05, "link": 0.08, "damping": 2e-5})


@pytest.mark.parametrize(
    ("effect", "active", "volts"), [(BENT, CART_ALONE, 0.6), (HOOK, LOCKED_ROPE, 2.0)], ids=["spring", "hook"]
)
def test_windows_begin_with_what_is_hidden_where_it_is(effect, active, volts):
    """The true model leaves noise in windows as well, each of which begins in the middle of a motion."""
    plant = make_plant(effect)
    u = np.stack([steps(800, 3, hold=25, volts=volts), np.zeros(800)], axis=1)
    run = play(plant, u, active=active, start={"x": 0.6}, seed=2)
    setting = make_setting(Model(plant, frozenset(NUMBERS), frozenset(NUMBERS), {}, "model.toml"), [run], ())
    found = evaluate(plant, setting, setting.recordings).errors
    for axis in found.free_run:
        assert found.free_run[axis] < 1.1 * setting.noise[axis]
        assert found.window[axis] < 1.2 * setting.noise[axis]


def test_windows_begin_with_a_load_that_bounces_on_its_rope():
    """It stretches the rope by 10 mm; friction holds the winch where windows begin, so only its next move tells."""
    plant = make_plant(
        ("rope_elasticity", "hoist", {"stiffness": 140.0, "damping": 0.35}),
        ("coulomb_friction", "hoist", {"level": 4.0}),
    )
    times = np.arange(800) * 0.01
    on = (times % 2 > 0.8) & (times % 2 < 1.95)
    u = np.stack([np.zeros(800), np.where(on, np.where(times // 2 % 2, -4.0, 4.0), 0.0)], axis=1)
    run = play(plant, u, active=FIXED_CART, start={"x": 0.6}, seed=2)
    setting = make_setting(Model(plant, frozenset(NUMBERS), frozenset(NUMBERS), {}, "model.toml"), [run], ())
    found = evaluate(plant, setting, setting.recordings).errors
    for axis in ("psi", "l"):
        assert found.window[axis] < 1.2 * setting.noise[axis]


def test_windows_begin_where_a_late_sensor_does_not_read():
    """In the middle of a motion what is late reads tens of millimetres from where the cart is."""
    plant = make_plant(("coulomb_friction", "cart", {"level": 3.5}), ("sensor_delay", "x_sensor", {"delay": 0.04}))
    u = np.stack([steps(800, 3, hold=40, volts=3.0), np.zeros(800)], axis=1)
    run = play(plant, u, active=CART_ALONE, start={"x": 0.6}, seed=2)
    setting = make_setting(Model(plant, frozenset(NUMBERS), frozenset(NUMBERS), {}, "model.toml"), [run], ())
    found = evaluate(plant, setting, setting.recordings).errors
    assert found.free_run["x"] < 1.1 * setting.noise["x"]
    assert found.window["x"] < 1.6 * setting.noise["x"]
