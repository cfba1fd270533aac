"""Models in C99, compiled with gcc, against the simulation that they come from."""

import re
import shutil
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.export.c_model import model_header, sampled_plant, samples
from jbridge.export.translate import Translator
from jbridge.model.effects.catalogue import make_effect
from jbridge.model.files import Model
from tests.export.c_compiler import compiled
from tests.problems import MECHANISMS, NUMBERS, PLACES, example, make_plant

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")

RIG = [
    ("coulomb_friction", "cart", {"level": 3.25}),
    ("position_dependent_friction", "hoist", {"knots": [0.2, 0.4, 0.6], "levels": [0.5, 1.0, 0.7]}),
    ("input_delay", "cart_drive", {"delay": 0.013}),
    ("start_delay", "cart_drive", {"delay": 0.027}),
    ("start_delay", "hoist_drive", {"delay": 0.02}),
    ("actuator_lag", "hoist_drive", {"time_constant": 0.06}),
    ("sensor_delay", "psi_sensor", {"delay": 0.017}),
]


def model_of(*effects, given=frozenset(NUMBERS)):
    return Model(make_plant(*effects), frozenset(), given, {})


def run(folder, header, *options):
    program = compiled(folder, header, "-DRIG_MAIN", *options)
    return subprocess.run([program], capture_output=True, text=True, check=False)


def agrees(folder, model, **options):
    header = model_header(model, "rig", **{"period": 0.01, "rope": 0.5} | options)
    for kind in ("double", "float"):
        told = run(folder, header, f"-DRIG_REAL={kind}")
        assert told.returncode == 0 and told.stdout.startswith("0 of 96"), told.stdout
    return header


def test_a_rig_moves_the_same_in_c(tmp_path):
    """With friction that sticks, delays, a lag and a table over the place; a changed constant is noticed."""
    header = agrees(tmp_path, model_of(*(make_effect(*each) for each in RIG)))
    assert "rig_C(3.25)" in header and not re.search(r"\b(malloc|calloc|realloc|free)\b", header)
    assert run(tmp_path, header.replace("rig_C(3.25)", "rig_C(3.5)")).returncode == 1


def test_parts_that_a_rig_lacks_stay(tmp_path):
    """A cart alone: nothing swings, and the rope keeps its length."""
    cart = model_of(given=frozenset({"cart_mass", "cart_gain"}))
    agrees(tmp_path, cart)
    _, _, readings = samples(sampled_plant(cart, 0.01), 0.5, 32, seed=0)
    assert np.ptp(readings[:, 0]) > 1e-3 and np.ptp(readings[:, 1]) == 0 and np.ptp(readings[:, 2]) == 0


@pytest.mark.slow
def test_the_whole_catalogue_in_c(tmp_path):
    """All effects at once, at values at which they show."""
    agrees(tmp_path, model_of(*(make_effect(kind, site, example(kind, site)) for kind, site in PLACES)))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*MECHANISMS, "speed loop"])
def test_mechanisms_in_c(tmp_path, name):
    loop = [("speed_drive", "cart_drive", {"time_constant": 0.03, "limit": 20.0})]
    effects = [make_effect(*each) for each in MECHANISMS.get(name, loop)]
    agrees(tmp_path, model_of(*effects), period=0.005)


def test_what_nothing_uses_is_left_out():
    translator = Translator()
    found = translator.call(lambda a, b: (a + b, a * b), np.asarray("a", object), np.asarray("b", object))
    translator.line(f"out = {found[1][()]};")
    assert [line.strip() for line in translator.lines] == ["const P_real v2 = a * b;", "out = v2;"]


def test_a_row_of_numbers_is_sorted():
    """By three exchanges of two neighbours, each a smaller and a larger one; what comes out are names of numbers."""
    translator = Translator()
    found = translator.call(jnp.sort, np.array(["a", "b", "c"], object))
    assert found.shape == (3,) and all(isinstance(each, str) for each in found)
    translator.line(f"return {', '.join(found)};")
    assert len(translator.lines) == 7
