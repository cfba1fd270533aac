"""Whatever is written reads back as the same controller, and what connects its inputs are their names."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge import InputError
from jbridge._types import Axes
from jbridge.control.base import Differences, Reference
from jbridge.control.compensation import Compensation
from jbridge.control.files import Controller, load_controller, save_controller
from jbridge.control.fuzzy import FuzzyController
from jbridge.control.linear import ObserverFeedback, Pid, StateFeedback
from jbridge.control.paper_rules import cart_system, paper_controller
from jbridge.control.shaping import Shaping
from jbridge.fuzzy.files.fis_writer import save_fis
from jbridge.fuzzy.rules import as_number
from tests.fuzzy.systems import any_system


def command(law):
    measured = Axes(*map(jnp.asarray, (0.3, 0.05, 0.4)))
    state = law.start(Axes(*map(jnp.asarray, (0.302, 0.06, 0.401))))
    return law.command(state, measured, Reference(*map(jnp.asarray, (0.31, 0.41, 0.0, 0.0))), 0.02)[0]


@pytest.mark.parametrize("seed", range(4))
def test_any_controller_comes_back(tmp_path, seed):
    rng = np.random.default_rng(seed)
    for _ in range(8):
        every = ["error", "velocity", "angle"]
        cart = any_system(rng, [name for name in every if rng.random() < 0.7] or every)
        hoist = any_system(rng, ["error", "velocity"])
        scales = as_number(rng.lognormal()), as_number(rng.lognormal())
        given = Compensation(*map(as_number, rng.lognormal(size=6))) if rng.random() < 0.5 else None
        law = FuzzyController(cart, hoist, *scales, compensation=given, relative_speed=bool(rng.random() < 0.5))
        save_controller(tmp_path / "c.toml", Controller(law, float(rng.uniform(1e-4, 1.0))))
        assert eqx.tree_equal(load_controller(tmp_path / "c.toml").law, law)


def test_labels_used_twice_lie_in_a_fis_file(tmp_path):
    law = paper_controller()
    error = dataclasses.replace(law.cart.inputs[0], labels=("N", "N", "ZE", "P", "P"))
    law = dataclasses.replace(law, cart=dataclasses.replace(law.cart, inputs=(error, *law.cart.inputs[1:])))
    save_controller(tmp_path / "c.toml", Controller(law))
    assert (tmp_path / "c-cart.fis").exists() and not (tmp_path / "c-hoist.fis").exists()
    assert eqx.tree_equal(load_controller(tmp_path / "c.toml").law, law)


def test_inputs_are_connected_by_name(tmp_path):
    save_controller(tmp_path / "c.toml", Controller(paper_controller()))
    head, *tables = (tmp_path / "c.toml").read_text().split("\n[cart.input.")
    blocks = {"error": 0, "velocity": 2, "angle": 4}
    parts = {name: tables[at : at + 2] for name, at in blocks.items()}
    angle, rest = parts["angle"][1].split("\n\n", 1)
    parts["angle"][1] = angle + "\n"
    text = "\n[cart.input.".join([head, *parts["angle"], *parts["velocity"], *parts["error"]]) + "\n" + rest
    assert text.index("cart.input.angle") < text.index("cart.input.error")
    (tmp_path / "c.toml").write_text(text)
    assert eqx.tree_equal(load_controller(tmp_path / "c.toml").law, paper_controller())


def test_a_fis_file_has_its_inputs_named_in_the_controllers_file(tmp_path):
    """And its angles in rad, if so it says."""
    cart = cart_system()
    names = dict(zip(("error", "velocity", "angle"), ("e", "de", "phi"), strict=True))
    in_rad = dataclasses.replace(
        cart.inputs[2],
        low=jnp.deg2rad(cart.inputs[2].low),
        high=jnp.deg2rad(cart.inputs[2].high),
        sets=tuple(type(s)(*(jnp.deg2rad(n) for n in s.parameters())) for s in cart.inputs[2].sets),
    )
    inputs = tuple(dataclasses.replace(v, name=names[v.name]) for v in (*cart.inputs[:2], in_rad))
    save_fis(tmp_path / "a.fis", dataclasses.replace(cart, inputs=inputs))
    save_controller(tmp_path / "c.toml", Controller(paper_controller()))
    text = (tmp_path / "c.toml").read_text()
    begin, end = text.index("\n[cart]"), text.index("\n[hoist]")
    text = (text[:begin] + text[end:]).replace('angle_unit = "deg"', 'angle_unit = "rad"')

    def read(line):
        (tmp_path / "c.toml").write_text(line + "\n" + text)
        return load_controller(tmp_path / "c.toml").law

    law = read('cart = {fis = "a.fis", inputs = ["error", "velocity", "angle"]}')
    np.testing.assert_allclose(command(law), command(paper_controller()), rtol=1e-12)
    with pytest.raises(InputError, match="the input 'e' is none .* or say which they are"):
        read('cart = "a.fis"')
    with pytest.raises(InputError, match="inputs has 2 names for the 3 inputs"):
        read('cart = {fis = "a.fis", inputs = ["error", "velocity"]}')


def test_what_a_file_cannot_hold_is_not_written(tmp_path):
    law = paper_controller()
    for broken, complaint in (
        (eqx.tree_at(lambda s: s.cart.rules[0].weight, law, as_number(np.nan)), "rule 1 has the weight nan"),
        (eqx.tree_at(lambda s: s.cart.inputs[0].sets[0].left, law, as_number(np.nan)), "'NB' of error .*NaN"),
        (eqx.tree_at(lambda s: s.hoist_scale, law, as_number(np.inf)), "hoist_scale is inf"),
        (dataclasses.replace(law, softness=0.1), "a smooth controller is for tuning only"),
        (dataclasses.replace(law, compensation=Compensation(cart=np.nan)), r"\[compensation\] cart is nan"),
    ):
        with pytest.raises(InputError, match=complaint):
            save_controller(tmp_path / "none.toml", Controller(broken))
    with pytest.raises(InputError, match="the period is nan s, which is not from 0.0001 to 1"):
        save_controller(tmp_path / "none.toml", Controller(law, np.nan))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (('angle_unit = "deg"', ""), 'no angle_unit.* add angle_unit = "deg" or "rad"'),
        (('angle_unit = "deg"', 'angle_unit = "grad"'), "unknown angle_unit 'grad'"),
        (("[cart.input.velocity", "[cart.input.speed"), "'velocity' is none of error, speed, angle"),
        (('"if error is NB then', "\"if 'error is NB then"), "NB"),
    ],
)
def test_what_is_wrong_with_inputs_is_said(tmp_path, change, complaint):
    path = tmp_path / "c.toml"
    save_controller(path, Controller(paper_controller()))
    text = path.read_text()
    assert change[0] in text
    path.write_text(text.replace(*change))
    with pytest.raises(InputError, match=complaint):
        load_controller(path)


LINEAR = {
    "pid": Pid(1.0, 0.0, -1 / 3, 1e-300, 5.0, 2.0, Differences(as_number(0.03)), Compensation(cart=0.3), 0.5),
    "feedback": StateFeedback(jnp.arange(12.0).reshape(2, 6) / 7.0, compensation=Compensation(hoist_bias=-0.5)),
    "observer": ObserverFeedback(
        jnp.arange(12.0).reshape(2, 6) / 7.0,
        jnp.arange(36.0).reshape(6, 6) / 3.0,
        jnp.arange(12.0).reshape(6, 2) - 1e-300,
        jnp.arange(18.0).reshape(6, 3) / -9.0,
        Compensation(cart=0.3),
    ),
    "fuzzy": paper_controller(),
}


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("shaping", [None, Shaping("zvd", 4.4), Shaping("zv", 1 / 3, 0.1)])
def test_rivals_of_fuzzy_controllers_come_back(tmp_path, name, shaping):
    given = Controller(LINEAR[name], 0.015, shaping=shaping)
    save_controller(tmp_path / "c.toml", given)
    found = load_controller(tmp_path / "c.toml")
    assert eqx.tree_equal(found.law, given.law) and (found.period, found.shaping) == (0.015, shaping)


@pytest.mark.parametrize(
    ("name", "change", "complaint"),
    [
        ("pid", ("p = 1.0", 'p = "1"'), r"\[cart\]: p = '1' is not a number"),
        ("pid", ("cart = {", "trolley = {"), "unknown key 'trolley'"),
        ("pid", ("{p = 1.0,", "{k = 1.0,"), r"\[cart\]: unknown key 'k'"),
        ("pid", ("cart = {p = 1.0, i = 0.0, d = -0.3333333333333333}", ""), "no gains of the cart; add cart = {p"),
        ("feedback", ("cart = [0.0, ", "cart = ["), "is not a list of six gains"),
        ("feedback", ("cart = [0.0", "cart = [nan"), r"cart\[0\] = nan is not a number"),
        ("observer", ("cart = [0.0, ", "cart = ["), "is not a list of six gains"),
        (
            "observer",
            ("drive = [\n    [", "drive = [\n    [1.0, "),
            "drive = .* is not a list of six rows of 2 numbers",
        ),
        (
            "observer",
            ("drive = [\n", "drive = [\n    5,\n"),
            "drive = .* is not a list of six rows of 2 numbers",
        ),
        (
            "observer",
            ("transition = [\n    [0.0", 'transition = [\n    ["0"'),
            r"transition\[0\]\[0\] = '0' is not a number",
        ),
        ("observer", ("correction", "corection"), "unknown key 'corection'"),
        ("feedback", ('"zvd"', '"zvdd"'), "unknown kind 'zvdd'"),
        ("feedback", ("frequency = 4.4", ""), "no frequency; add frequency = 4.4"),
        ("feedback", ("damping = 0.0", "damping = 1.0"), "damping = 1 is no damping ratio"),
    ],
)
def test_what_is_wrong_with_a_rival_is_said(tmp_path, name, change, complaint):
    path = tmp_path / "c.toml"
    save_controller(path, Controller(LINEAR[name], shaping=Shaping("zvd", 4.4)))
    text = path.read_text()
    assert change[0] in text, text
    path.write_text(text.replace(*change))
    with pytest.raises(InputError, match=complaint):
        load_controller(path)


def test_a_rival_that_no_file_can_hold_is_not_written(tmp_path):
    for law, complaint in (
        (eqx.tree_at(lambda s: s.cart_p, LINEAR["pid"], as_number(np.nan)), "cart.p is nan"),
        (eqx.tree_at(lambda s: s.gains, LINEAR["feedback"], jnp.full((2, 6), np.inf)), r"cart\[0\] is inf"),
        (eqx.tree_at(lambda s: s.drive, LINEAR["observer"], jnp.full((6, 2), np.nan)), r"drive\[0\]\[0\] is nan"),
    ):
        with pytest.raises(InputError, match=complaint):
            save_controller(tmp_path / "c.toml", Controller(law))
    assert not list(tmp_path.iterdir())
