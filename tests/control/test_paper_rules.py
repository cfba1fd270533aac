"""The paper's rule bases: their universes, and what can be proved about their rules."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.control.paper_rules import RULES, cart_system, hoist_system, paper_controller
from jbridge.fuzzy.inference import Mamdani
from jbridge.fuzzy.rules import in_words

infer = jax.jit(lambda system, values: system.infer(values).output[0])


def ranges(system):
    return [(v.name, float(v.low), float(v.high)) for v in (*system.inputs, *system.outputs)]


def test_universes_are_those_of_table_2():
    """The error's is normalised to [-1, 1] by the 3 m of the table."""
    assert ranges(cart_system()) == [
        ("error", -1.0, 1.0), ("velocity", -0.7, 0.7), ("angle", -45.0, 45.0), ("voltage", -3.0, 3.0)
    ]  # fmt: skip
    assert ranges(hoist_system()) == [("error", -1.0, 1.0), ("velocity", -0.7, 0.7), ("voltage", -10.0, 10.0)]
    assert float(paper_controller().cart_scale) == 3.0


def test_rules_are_those_of_the_paper():
    for system, count in ((cart_system(), 9), (hoist_system(), 7)):
        assert [in_words(r, system.inputs, system.outputs) for r in system.rules] == list(RULES[:count])


@pytest.mark.parametrize("system", [cart_system(), hoist_system()], ids=["cart", "hoist"])
def test_velocity_is_inert(system):
    """Rules 3 and 4 fire at least as strongly as 5 and 6, with the same conclusion."""
    key = np.random.default_rng(0)
    without = Mamdani(system.inputs, system.outputs, tuple(r for i, r in enumerate(system.rules) if i not in (4, 5)))
    lows, highs = (np.array([float(getattr(v, end)) for v in system.inputs]) for end in ("low", "high"))
    for _ in range(40):
        values = jnp.asarray(key.uniform(lows, highs) * np.array([0.05, 1.0, 1.0])[: len(lows)])
        assert infer(system, values) == infer(without, values)
        assert infer(system, values) == infer(system, values.at[1].set(0.0))


def test_the_angle_weakens_the_voltage_on_both_sides_alike():
    system = cart_system()
    for error in (-0.3, -0.05, 0.01, 0.2):
        straight, ahead, behind = (float(infer(system, jnp.array([error, 0.0, angle]))) for angle in (0.0, 15.0, -15.0))
        assert ahead == pytest.approx(behind, abs=1e-12)
        assert abs(ahead) < abs(straight) and ahead * straight > 0


def test_the_voltage_is_odd_in_the_error():
    for system in (cart_system(), hoist_system()):
        others = [0.0] * (len(system.inputs) - 1)
        volts = [float(infer(system, jnp.array([e, *others]))) for e in (-0.5, -0.02, 0.0, 0.02, 0.5)]
        np.testing.assert_allclose(volts, -np.array(volts)[::-1], atol=1e-9)
        assert volts == sorted(volts)
