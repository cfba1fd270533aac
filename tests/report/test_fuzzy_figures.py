"""Figures of fuzzy systems: what is drawn is what the controller does."""

import jax.numpy as jnp
import numpy as np
import pytest

from jbridge import Controller, Model, extended_controller, paper_controller, smooth_path, track
from jbridge._types import Axes
from jbridge.control.base import Reference
from jbridge.report.control.tracking import rule_pictures
from jbridge.report.figures.control import fuzzy
from tests.problems import NUMBERS, make_plant


@pytest.fixture(scope="module")
def run():
    model = Model(make_plant(("coulomb_friction", "cart", {"level": 3.0})), frozenset(), frozenset(NUMBERS), {}, "")
    controller = Controller(paper_controller(), 0.02)
    path = smooth_path(((0.2, 0.4), (0.5, 0.5)), speed=(0.4, 0.2), rest=0.5, period=0.02)
    return track(model, controller, path), controller


def test_inputs_of_a_run_give_its_commands(run):
    tracking, controller = run
    law = controller.law
    measured = Axes(*(jnp.asarray(tracking.measured[axis]) for axis in ("x", "psi", "l")))
    still = jnp.zeros_like(measured.x)
    wanted = Reference(jnp.asarray(tracking.reference["x"]), jnp.asarray(tracking.reference["l"]), still, still)
    for system, values, name in zip((law.cart, law.hoist), law.inputs(measured, wanted, 0.02), ("u_x", "u_l")):
        said = [float(system.infer(row).output[0]) for row in values[:60:6]]
        np.testing.assert_allclose(said, tracking.command[name][:60:6], atol=1e-9)


def test_a_surface_is_what_the_rules_say():
    system = extended_controller().cart
    error, angle, volts = fuzzy.surface(system, 0, 2, (0.3, 30.0))
    assert volts.shape == (len(angle), len(error)) and np.ptp(volts) > 0.5
    for i, j in ((0, 0), (10, 50), (60, 31)):
        wanted = float(system.infer(jnp.asarray([error[j], 0.0, angle[i]])).output[0])
        assert volts[i, j] == pytest.approx(wanted, abs=1e-12)


def test_pictures_are_drawn(run):
    pictures = rule_pictures(*run)
    assert [p.name for p in pictures] == ["rules-cart", "surface-cart", "rules-hoist", "surface-hoist"]
    before, after = paper_controller().cart, extended_controller().cart
    pictures += (
        fuzzy.draw_changed_sets("sets", "Sets", before, after, (3.0, 1.0)),
        fuzzy.draw_descent("descent", "Cost", np.linspace(3.0, 1.0, 9), np.geomspace(0.3, 0.03, 9)),
        fuzzy.draw_ensemble("ensemble", "Spread", {"a": {"s": np.array([[1.0, np.nan]])}}, {"s": ("settled [s]", 1.0)}),
    )
    assert all(p.png.startswith(b"\x89PNG") and len(p.png) > 5000 for p in pictures)


def test_silence_is_told():
    """Where no set covers an input, no rule fires, and the picture says for how long."""
    import dataclasses

    whole = paper_controller().cart
    error = dataclasses.replace(whole.inputs[0], sets=(whole.inputs[0].sets[0],) * 5)
    rules = whole.rules[:1]
    deaf = dataclasses.replace(whole, inputs=(error, *whole.inputs[1:]), rules=rules)
    values = np.zeros((10, 3))
    values[5:, 0] = -0.5
    found = fuzzy.silent_share(deaf, values)
    assert found == pytest.approx(0.5)
    assert fuzzy.silent_share(whole, values) == 0.0
