"""What can never matter in a rule base: the paper's own case, and cases where nothing is idle."""

import jax.numpy as jnp
import pytest

from jbridge.control.paper_rules import cart_system, hoist_system
from jbridge.fuzzy.check import idle_parts, outdone_rules
from jbridge.fuzzy.inference import Mamdani
from jbridge.fuzzy.norms import Sum
from jbridge.fuzzy.rules import rule


def with_rules(system, *texts, weights=None, **options):
    weights = weights or [1.0] * len(texts)
    rules = tuple(rule(text, system.inputs, system.outputs, weight=w) for text, w in zip(texts, weights, strict=True))
    return Mamdani(system.inputs, system.outputs, rules, **options)


@pytest.mark.parametrize("system", [cart_system(), hoist_system()], ids=["cart", "hoist"])
def test_the_papers_rules_5_and_6(system):
    """Under minimum and maximum they never matter, so the velocity has no influence and its sets no gradient."""
    idle = idle_parts(system)
    assert idle.rules == ((4, 2), (5, 3))
    assert {"input velocity.NB.right", "input velocity.PB.left", "input velocity.ZE.width"} <= set(idle.parameters)
    assert "input error.NS.peak" not in idle.parameters and "output voltage.PB.left" not in idle.parameters
    said = " ".join(idle.sentences)
    assert "Rule 5 (if error is NS and velocity is PB then voltage is NS) can never change the output: rule 3" in said
    assert "The input velocity has no influence" in said


def test_corners_at_the_end_of_a_universe_have_no_gradient():
    assert "input error.NB.left" in idle_parts(cart_system()).parameters


SMALL, AND, OR = (
    "if error is NS then voltage is NS",
    "if error is NS and angle is P then voltage is NS",
    "if error is NS or angle is P then voltage is NS",
)


@pytest.mark.parametrize(
    ("texts", "weights", "idle"),
    [
        ((SMALL, AND), (1.0, 1.0), ((1, 0),)),
        ((SMALL, AND), (0.5, 1.0), ()),
        ((SMALL, OR), (1.0, 1.0), ((0, 1),)),
        ((AND, OR), (1.0, 1.0), ()),
        ((SMALL, SMALL), (1.0, 1.0), ((0, 1),)),
        ((SMALL, "if error is NS and angle is P then voltage is NB"), (1.0, 1.0), ()),
    ],
)
def test_which_rule_outdoes_which(texts, weights, idle):
    assert outdone_rules(with_rules(cart_system(), *texts, weights=weights)) == idle


def test_added_conclusions_always_matter():
    """Where sets are summed, a second rule adds to the first."""
    zero = "if error is ZE then voltage is ZE"
    both = with_rules(cart_system(), SMALL, AND, zero, aggregation=Sum())
    one = with_rules(cart_system(), SMALL, zero, aggregation=Sum())
    assert outdone_rules(both) == ()
    values = jnp.array([-0.002, 0.0, 20.0])
    assert float(both.infer(values).output[0]) < float(one.infer(values).output[0]) - 0.01
    assert "rule 2.weight" not in idle_parts(both).parameters
