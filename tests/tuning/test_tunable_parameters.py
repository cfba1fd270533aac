"""Coordinates of controllers: nothing changes at zero, and order and symmetry survive everything."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.control.compensation import Compensation
from jbridge.control.extended_rules import extended_controller
from jbridge.control.linear import Pid, StateFeedback
from jbridge.control.paper_rules import paper_controller
from jbridge.fuzzy.membership import Gaussian, Trapezoidal, Triangular
from jbridge.tuning.tunable_parameters import FuzzyKnobs, knobs_of

LAWS = {
    "paper": paper_controller,
    "extended": extended_controller,
    "compensated": lambda: extended_controller(Compensation(cart=0.3, hoist=1.0, hoist_bias=-0.5)),
}


def variables(law):
    for axis in ("cart", "hoist"):
        system = getattr(law, axis)
        yield from (*system.inputs, *system.outputs)


@pytest.mark.parametrize("name", LAWS)
def test_at_zero_the_controller_is_as_given(name):
    law = LAWS[name]()
    same = FuzzyKnobs(law).set(jnp.zeros(len(FuzzyKnobs(law).knobs)))
    for given, found in zip(variables(law), variables(same), strict=True):
        for a, b in zip(given.sets, found.sets, strict=True):
            assert type(a) is type(b)
            for field in dataclasses.fields(a):
                np.testing.assert_allclose(getattr(a, field.name), getattr(b, field.name), rtol=1e-12, atol=1e-12)
    assert float(same.cart_scale) == float(law.cart_scale)
    if law.compensation is not None:
        np.testing.assert_allclose(jax.tree.leaves(same.compensation), jax.tree.leaves(law.compensation), rtol=1e-12)
    assert [float(r.weight) for r in same.cart.rules] == [float(r.weight) for r in law.cart.rules]


@pytest.mark.parametrize("name", LAWS)
def test_order_and_symmetry_survive_everything(name):
    law = LAWS[name]()
    knobs = FuzzyKnobs(law)
    low, high = knobs.bounds()
    rng, law_at = np.random.default_rng(3), eqx.filter_jit(knobs.set)
    for _ in range(50):
        found = law_at(jnp.asarray(rng.uniform(low, high)))
        for variable in variables(found):
            middle = float(variable.middle)
            for member, twin in zip(variable.sets, reversed(variable.sets), strict=True):
                if isinstance(member, Gaussian):
                    assert float(member.width) > 0
                    assert float(member.centre) - middle == pytest.approx(middle - float(twin.centre), abs=1e-9)
                    continue
                assert isinstance(member, Triangular | Trapezoidal)
                corners = [float(getattr(member, f.name)) for f in dataclasses.fields(member)]
                mirrored = [2 * middle - float(getattr(twin, f.name)) for f in dataclasses.fields(twin)][::-1]
                assert corners == sorted(corners)
                np.testing.assert_allclose(corners, mirrored, atol=1e-9)
                assert float(variable.low) <= corners[0] and corners[-1] <= float(variable.high)
        assert all(0 < float(rule.weight) <= 1 for rule in (*found.cart.rules, *found.hoist.rules))


def test_corners_that_coincide_go_on_coinciding():
    """Where the error's ZE ends, NS and PS peak, and NB and PB begin."""
    knobs = FuzzyKnobs(paper_controller())
    z = np.zeros(len(knobs.knobs))
    names = [knob.name for knob in knobs.knobs]
    z[names.index("cart.error.breakpoint 1")] = 0.7
    error = knobs.set(jnp.asarray(z)).cart.inputs[0]
    big, small, zero = error.sets[4], error.sets[3], error.sets[2]
    moved = 0.004 * np.exp(0.7)
    for corner in (big.left, small.peak, zero.right):
        assert float(corner) == pytest.approx(moved, rel=1e-12)
    # The next breakpoint keeps its distance.
    assert float(big.top_left) == pytest.approx(moved + 0.076, rel=1e-12)


def test_gains_are_multiplied_and_zeros_left_alone():
    knobs = knobs_of(Pid(cart_i=0.0))
    assert [knob.name for knob in knobs.knobs] == ["cart_p", "cart_d", "hoist_p", "hoist_i", "hoist_d"]
    found = knobs.set(jnp.asarray([np.log(2.0), 0.0, 0.0, 0.0, 0.0]))
    assert float(found.cart_p) == pytest.approx(20.0) and float(found.cart_i) == 0.0


def test_gains_in_an_array_keep_signs_and_zeros():
    gains = jnp.array([[2.0, -3.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 5.0, 0.0, 0.0, 0.0]])
    knobs = knobs_of(StateFeedback(gains))
    assert [knob.name for knob in knobs.knobs] == ["gains[0][0]", "gains[0][1]", "gains[0][4]", "gains[1][2]"]
    found = knobs.set(jnp.log(jnp.array([1.0, 2.0, 0.5, 3.0]))).gains
    np.testing.assert_allclose(found, [[2.0, -6.0, 0.0, 0.0, 0.5, 0.0], [0.0, 0.0, 15.0, 0.0, 0.0, 0.0]])
    # A gain grows by itself times what its logarithm grows by.
    slopes = jax.grad(lambda z: knobs.set(z).gains.sum())(jnp.zeros(4))
    np.testing.assert_allclose(slopes, [2.0, -3.0, 1.0, 5.0])


def test_a_law_without_numbers_is_refused():
    with pytest.raises(TypeError, match="nothing to tune"):
        knobs_of(StateFeedback(jnp.zeros((2, 6))))


def test_a_compensation_is_tuned_and_what_holds_the_load_left_alone():
    law = LAWS["compensated"]()
    knobs = FuzzyKnobs(law)
    z = np.zeros(len(knobs.knobs))
    z[[knob.name for knob in knobs.knobs].index("hoist.compensation")] = -np.log(2.0)
    found = knobs.set(jnp.asarray(z)).compensation
    assert [float(v) for v in (found.cart, found.hoist, found.hoist_bias)] == pytest.approx([0.3, 0.5, -0.5])
