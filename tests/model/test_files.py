"""Model files: what is written reads back to the last bit, and what cannot be a model is refused in one line."""

import datetime
import tomllib

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.model.effects.base import AbstractMechanism
from jbridge.model.effects.catalogue import KINDS
from jbridge.model.fields import options_of, parameters_of
from jbridge.model.files import Model, load_model, requires, save_model
from jbridge.model.parameters import ParameterTable, bridge_keys
from tests.problems import make_plant

FULL = """
[bridge]
cart_mass = 5.5
load_mass = 0.143
winch_mass = 0.1
gravity = 9.81
cart_damping = 45
swing_damping = 0.0015
hoist_damping = 25.0
cart_gain = 16.0
hoist_gain = 3.0
known = ["cart_mass", "load_mass", "coulomb_friction.level"]

[[effect]]
kind = "coulomb_friction"
site = "cart"
level = 4.0

[[effect]]
kind = "position_dependent_friction"
site = "hoist"
knots = [0.1, 0.5, 0.9]
levels = [1, 2.5, 0]

[[effect]]
kind = "end_stop"
site = "cart"
position = 1.2
stiffness = 5e2
damping = 4.0

[[effect]]
kind = "end_stop"
site = "cart"
position = -0.2
stiffness = 5e2
damping = 4.0
end = "low"

[[effect]]
kind = "length_dependent_damping"
site = "swing"
slope = -0.001

[uncertainty.cart_gain]
std = 0.1
low = 15.8
high = 16.2
"""


@pytest.fixture
def write(tmp_path):
    """Writes a model file and returns its path."""

    def to_file(content: str | bytes, name: str = "model.toml"):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return to_file


def numbers(model: Model) -> dict[str, float]:
    table = ParameterTable(model.plant)
    vector = np.asarray(table.ravel(model.plant))
    return {entry.name: float(vector[table.positions(entry.name)[0]]) for entry in table.entries}


def assert_same(one: Model, other: Model) -> None:
    """Bit for bit, where a reference length that was left out is not a number in both."""
    assert [(e.kind, e.site) for e in one.plant.effects] == [(e.kind, e.site) for e in other.plant.effects]
    np.testing.assert_array_equal(list(numbers(one).values()), list(numbers(other).values()))
    np.testing.assert_array_equal(
        ParameterTable(one.plant).ravel(one.plant), ParameterTable(other.plant).ravel(other.plant)
    )
    assert (one.known, one.given, one.uncertainty) == (other.known, other.given, other.uncertainty)
    assert (one.recorded, one.units) == (other.recorded, other.units)


def test_reading(write):
    model = load_model(write(FULL))
    values = numbers(model)
    assert values["cart_mass"] == 5.5 and values["cart_damping"] == 45.0 and values["swing_damping"] == 0.0015
    assert values["coulomb_friction@cart.level"] == 4.0
    assert [values[f"position_dependent_friction@hoist.levels[{i}]"] for i in range(3)] == [1.0, 2.5, 0.0]
    assert values["end_stop@cart.position"] == 1.2 and values["end_stop@cart#2.position"] == -0.2
    assert [float(effect.end) for effect in model.plant.effects[2:4]] == [0.0, 1.0]
    assert np.isnan(values["length_dependent_damping@swing.length"])
    assert model.known == {"cart_mass", "load_mass", "coulomb_friction@cart.level"}
    assert model.given == set(bridge_keys())
    assert model.uncertainty == {"cart_gain": {"std": 0.1, "low": 15.8, "high": 16.2}}


def test_left_out_numbers(write):
    """Dampings are 0 and gravity is the Earth's; what cannot be guessed is missed only by those who need it."""
    model = load_model(write("[bridge]\ncart_mass = 2.0\ncart_gain = 3.0\n"))
    values = numbers(model)
    assert values["gravity"] == 9.81
    assert values["cart_damping"] == values["swing_damping"] == values["hoist_damping"] == 0.0
    assert model.given == {"cart_mass", "cart_gain"}
    assert model.known == {"gravity", "winch_mass"}, "nobody asks to estimate what is not mentioned"
    requires(model, ())
    requires(model, ("x",))
    for axes, missing in [
        (("x", "psi"), ["load_mass"]),
        (("psi",), ["load_mass"]),
        (("x", "psi", "l"), ["load_mass", "winch_mass", "hoist_gain"]),
    ]:
        for key in missing:
            given = "".join(f"{name} = 1.0\n" for name in missing if name != key)
            lacking = load_model(write(f"[bridge]\ncart_mass = 2.0\ncart_gain = 3.0\n{given}"))
            with pytest.raises(InputError, match=rf"model.toml, \[bridge\]: no {key}.*add {key} = "):
                requires(lacking, axes)
    with pytest.raises(InputError, match="no cart_mass and no cart_gain, but there is a cart to move"):
        requires(load_model(write("[bridge]\nload_mass = 0.1\n")), ("x", "psi"))


def test_round_trip(write, tmp_path):
    model = load_model(write(FULL))
    save_model(tmp_path / "written.toml", model)
    again = load_model(tmp_path / "written.toml")
    assert_same(model, again)
    save_model(tmp_path / "twice.toml", again)
    assert (tmp_path / "twice.toml").read_bytes() == (tmp_path / "written.toml").read_bytes()
    text = (tmp_path / "written.toml").read_text()
    assert "length =" not in text, "a reference left to the recordings stays so"
    assert tomllib.loads(text)["effect"][3]["end"] == "low"


def test_round_trip_of_every_effect(tmp_path):
    """Random numbers with all their digits, for every kind at every site, of those that exclude each other one."""
    key = np.random.default_rng(0)
    effects = []
    for kind, cls in KINDS.items():
        if kind in ("backlash", "hoist_backlash", "presliding_friction"):
            continue
        for site in cls.sites:
            values = {}
            for name, info in parameters_of(cls).items():
                low = max(info.low, -5.0)
                value = key.uniform(low, min(info.high, low + 10.0), 4 if info.vector else None)
                if name in ("hook_mass", "motor_mass"):
                    value *= 0.01
                values[name] = np.sort(value).tolist() if info.vector and not info.fitted else value
            values |= {name: words[-1] for name, words in options_of(cls).items()}
            effects.append((kind, site, values))
    plant = make_plant(*effects, cart_mass=np.pi, gravity=9.8066500000000012)
    fitted = {"std": [0.1, 1 / 3], "low": [1e-300, -0.0], "high": [float("inf"), 1e16]}
    model = Model(
        plant,
        frozenset({"cart_mass", "gravity", "stribeck_friction@swing.velocity"}),
        frozenset(bridge_keys()),
        {"cart_gain": {"std": 0.1}, "position_dependent_friction@cart.levels": fitted},
        recorded={"x": (-1 / 3, 1e-300), "l": (0.7, 0.7), "u_x": (-255.0, 255.0)},
        units={"u_x": "count"},
    )
    save_model(tmp_path / "model.toml", model)
    assert_same(load_model(tmp_path / "model.toml"), model)


def test_round_trip_of_backlash(tmp_path):
    plant = make_plant(("backlash", "cart", {"gap": 1e-3 / 3, "motor_mass": 0.7, "encoder": "motor"}))
    model = Model(plant, frozenset({"backlash@cart.gap"}), frozenset(bridge_keys()), {})
    save_model(tmp_path / "model.toml", model)
    assert_same(load_model(tmp_path / "model.toml"), model)
    assert isinstance(plant.effects[0], AbstractMechanism)


def test_a_fitted_number_that_the_file_did_not_give_is_written(write, tmp_path):
    model = load_model(write("[bridge]\ncart_mass = 2.0\ncart_gain = 3.0\n"))
    moved = Model(make_plant(cart_mass=2.0, cart_gain=3.0, cart_damping=7.0), model.known, model.given, {})
    save_model(tmp_path / "fit.toml", moved)
    assert numbers(load_model(tmp_path / "fit.toml"))["cart_damping"] == 7.0


def test_uncertainty_is_kept_as_it_stands(write, tmp_path):
    text = """[bridge]
cart_mass = 1.0
[uncertainty."coulomb_friction@cart.level"]
std = 1
low = nan
note = "from a \\"fit\\", é, \\\\, \\u0000"
when = 2026-01-02T03:04:05Z
right = true
levels = [0.1, [2, 3], "x"]
inner = {a = 1.5, "b c" = false}
"""
    model = load_model(write(text))
    save_model(tmp_path / "again.toml", model)
    kept, read = load_model(tmp_path / "again.toml").uncertainty, model.uncertainty
    assert np.isnan(kept["coulomb_friction@cart.level"].pop("low"))
    assert np.isnan(read["coulomb_friction@cart.level"].pop("low"))
    assert kept == read
    assert isinstance(kept["coulomb_friction@cart.level"]["when"], datetime.datetime)


def test_saving_replaces_the_file_as_a_whole(write, tmp_path):
    path = write(FULL)
    model = load_model(path)
    path.write_text("something else")
    save_model(path, model)
    assert_same(load_model(path), model)
    assert [p.name for p in tmp_path.iterdir()] == ["model.toml"], "no scraps are left"
    with pytest.raises(InputError, match="cannot be written.*choose another place"):
        save_model(tmp_path / "nowhere" / "model.toml", model)
    with pytest.raises(InputError, match="cannot be written"):
        (tmp_path / "folder.toml").mkdir()
        save_model(tmp_path / "folder.toml", model)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder.toml", "model.toml"]


def test_known_names(write):
    def known(names: str, effects: str = "") -> frozenset[str]:
        return load_model(
            write(f"[bridge]\ncart_mass = 1.0\ngravity = 9.8\nwinch_mass = 0.1\nknown = {names}\n{effects}")
        ).known

    friction = '[[effect]]\nkind = "coulomb_friction"\nsite = "{}"\nlevel = 1.0\n'
    table = '[[effect]]\nkind = "position_dependent_friction"\nsite = "cart"\nknots = [0, 1]\nlevels = [1, 2]\n'
    assert known("[]") == frozenset()
    assert known('["gravity", "gravity"]') == {"gravity"}
    assert known('["hoist_gain"]') == {"hoist_gain"}, "a number of an absent part may be named"
    assert known('["coulomb_friction.level"]', friction.format("cart")) == {"coulomb_friction@cart.level"}
    both = friction.format("cart") + friction.format("hoist")
    assert known('["coulomb_friction@hoist.level"]', both) == {"coulomb_friction@hoist.level"}
    assert known('["position_dependent_friction.levels"]', table) == {"position_dependent_friction@cart.levels"}
    one = "position_dependent_friction@cart.levels[1]"
    assert known(f'["{one}"]', table) == {one}


def effect(text: str) -> str:
    return (
        "[bridge]\ncart_mass = 5.5\nload_mass = 0.143\nwinch_mass = 0.1\n\n[[effect]]\n"
        + text.replace("; ", "\n")
        + "\n"
    )


def bridge(text: str) -> str:
    return "[bridge]\n" + text + "\n"


FRICTION = 'kind = "coulomb_friction"; site = "cart"; level = 4.0'
TABLE = 'kind = "position_dependent_friction"; site = "cart"; '
BELT = 'kind = "belt_compliance"; site = "cart"; stiffness = 1e3; damping = 1.0; motor_mass = 1.0'
PLAY = 'kind = "backlash"; site = "cart"; gap = 1e-3; motor_mass = 1.0'
HOOK = 'kind = "double_pendulum"; site = "swing"; hook_mass = 0.05; link = 0.1; damping = 1e-3'
DAHL = 'kind = "presliding_friction"; site = "cart"; level = 1.0; stiffness = 1e3'
SPEED = 'kind = "speed_drive"; site = "cart_drive"; time_constant = 0.05; limit = 50.0; share = 1.0'
WINCH = 'kind = "hoist_backlash"; site = "hoist"; gap = 1e-3; motor_mass = 0.06'
CABLE = 'kind = "cable_drag"; site = "cart"; stiffness = 1.0; rest = 0.5; level = 0.2; travel = 0.05'
AGAIN = "; [[effect]]; "

REFUSED = {
    # what a file may hold, and what the one line says
    "empty": ("", ["the file is empty", "[bridge]"]),
    "blank": ("\n  \n# nothing\n", ["the file is empty"]),
    "not TOML": (bridge("cart_mass = 5,5"), ["not TOML", "line 2", "correct that line"]),
    "a table twice": ("[bridge]\n[bridge]\n", ["not TOML", "line 2"]),
    "a key twice": (bridge("gravity = 9.8\ngravity = 9.81"), ["not TOML", "line 3"]),
    "html": ("<!DOCTYPE html>\n<html></html>", ["not TOML", "line 1"]),
    "binary": (b"\x89PNG\r\n\x1a\n\x00\x00", ["not text", "UTF-8"]),
    "latin-1": ("# Höhe\n[bridge]\n".encode("latin-1"), ["not text in UTF-8"]),
    "brackets without end": ("a = " + "[" * 5000, ["nested more than 20 deep"]),
    "a number without end": (bridge("gravity = " + "9" * 5000), ["not TOML"]),
    "no bridge": ('[[effect]]\nkind = "coulomb_friction"\n', ["no [bridge] table", "cart_mass"]),
    "bridge is a number": ("bridge = 3\n", ["[bridge]", "not a table"]),
    "unknown section": ("[bridge]\n[efect]\n", ["unknown section 'efect'", "did you mean 'effect'?"]),
    "unknown key": (bridge("cart_mas = 5.5"), ["[bridge]", "unknown key 'cart_mas'", "did you mean 'cart_mass'?"]),
    "far key": (bridge("colour = 1"), ["unknown key 'colour'", "choose among cart_mass, load_mass", "known"]),
    "text": (bridge('cart_mass = "5.5"'), ["cart_mass = '5.5' is not a number", "cart_mass = 1.5", "kg"]),
    "true": (bridge("cart_mass = true"), ["cart_mass = true is not a number"]),
    "date": (bridge("cart_mass = 2026-01-01"), ["cart_mass = 2026-01-01 is not a number"]),
    "list": (bridge("cart_mass = [5.5]"), ["cart_mass = [5.5] is not a number"]),
    "nan": (bridge("cart_mass = nan"), ["cart_mass = nan is not a finite number"]),
    "infinite": (bridge("cart_gain = inf"), ["cart_gain = inf is not a finite number"]),
    "too large": (bridge("gravity = 1" + "0" * 400), ["'bridge.gravity'", "more than 64 bits", "decimal point"]),
    "negative mass": (bridge("load_mass = -0.143"), ["load_mass = -0.143 is negative", "load", "kg"]),
    "no mass": (bridge("winch_mass = 0"), ["winch_mass = 0.0 is below 0.0001"]),
    "negative damping": (bridge("swing_damping = -1e-3"), ["swing_damping = -0.001 is negative", "N m s"]),
    "no gravity": (bridge("gravity = 0.0"), ["gravity = 0.0 is below 0.1"]),
    "known is text": (bridge('known = "gravity"'), ["known is not a list of names", 'known = ["cart_mass"']),
    "known holds numbers": (bridge("known = [1]"), ["known is not a list of names"]),
    "known names nothing": (
        bridge('known = ["cart_maas"]'),
        ["known names 'cart_maas'", "no parameter of this model", "did you mean 'cart_mass'?"],
    ),
    "known names an effect that is not there": (
        bridge('known = ["coulomb_friction.level"]'),
        ["known names 'coulomb_friction.level'", "no parameter"],
    ),
    "known without the kind": (
        effect(FRICTION).replace("[bridge]", '[bridge]\nknown = ["level"]'),
        ["known names 'level'", "did you mean 'coulomb_friction@cart.level'?"],
    ),
    "known at another site": (
        effect(FRICTION).replace("[bridge]", '[bridge]\nknown = ["coulomb_friction@hoist.level"]'),
        ["known names 'coulomb_friction@hoist.level'", "did you mean 'coulomb_friction@cart.level'?"],
    ),
    "known in two places": (
        effect(FRICTION + AGAIN + FRICTION.replace("cart", "hoist")).replace(
            "[bridge]", '[bridge]\nknown = ["coulomb_friction.level"]'
        ),
        ["coulomb_friction@cart.level, coulomb_friction@hoist.level", "name one of them, or each"],
    ),
    "effect is one table": ('[bridge]\n[effect]\nkind = "wind"\n', ["not a list of tables", "[[effect]]"]),
    "effect is a list": ('effect = ["wind"]\n[bridge]\n', ["not a list of tables"]),
    "no kind": (effect('site = "cart"; level = 4.0'), ["[[effect]] 1:", "no kind", 'kind = "coulomb_friction"']),
    "kind is a number": (effect("kind = 3"), ["[[effect]] 1:", "kind = 3 is not a word"]),
    "unknown kind": (
        effect(FRICTION.replace("coulomb_friction", "coulomb")),
        ["unknown kind 'coulomb'", "did you mean 'coulomb_friction'?"],
    ),
    "far kind": (effect('kind = "magic"; site = "cart"'), ["unknown kind 'magic'", "wind", "sensor_eccentricity"]),
    "no site": (
        effect('kind = "wind"; force = 1.0; start = 1.0; stop = 2.0'),
        ["[[effect]] 1 (wind): no site", 'add site = "swing"'],
    ),
    "unknown site": (effect(FRICTION.replace('"cart"', '"carts"')), ["unknown site 'carts'", "did you mean 'cart'?"]),
    "site of another kind": (
        effect('kind = "dead_zone"; site = "cart"; positive = 1.0; negative = 1.0'),
        ["(dead_zone)", "unknown site 'cart'", "cart_drive"],
    ),
    "site is a list": (effect(FRICTION.replace('"cart"', '["cart"]')), ["site = ['cart'] is not a word"]),
    "unknown key of an effect": (
        effect(FRICTION + "; levle = 3.0"),
        ["[[effect]] 1 (coulomb_friction)", "unknown key 'levle'", "did you mean 'level'?"],
    ),
    "missing parameter": (
        effect('kind = "coulomb_friction"; site = "swing"'),
        ["no level; add level = ...", "sliding and holding level", "N m"],
    ),
    "missing vector": (effect(TABLE + "knots = [0.0, 1.0]"), ["no levels; add levels = [...]"]),
    "the second effect": (
        effect(FRICTION + AGAIN + FRICTION.replace("4.0", "-4.0")),
        ["[[effect]] 2 (coulomb_friction)", "level = -4.0 is negative"],
    ),
    "text in an effect": (effect(FRICTION.replace("4.0", '"4 N"')), ["level = '4 N' is not a number", "(N)"]),
    "beyond a bound": (
        effect('kind = "gain_asymmetry"; site = "cart_drive"; ratio = 1.2'),
        ["ratio = 1.2 is above 1"],
    ),
    "below a bound": (
        effect('kind = "sensor_scale"; site = "x_sensor"; scale = 0.01'),
        ["scale = 0.01 is below 0.1"],
    ),
    "a number for a vector": (effect(TABLE + "knots = [0.0, 1.0]; levels = 3.0"), ["levels = 3.0 is not a list"]),
    "empty vector": (effect(TABLE + "knots = []; levels = []"), ["knots is empty"]),
    "entry of a vector": (
        effect(TABLE + "knots = [0.0, 1.0]; levels = [1.0, -2.0]"),
        ["levels[1] = -2.0 is negative"],
    ),
    "text in a vector": (effect(TABLE + 'knots = [0.0, "a"]; levels = [1.0, 2.0]'), ["knots[1] = 'a' is not a number"]),
    "knots that fall": (effect(TABLE + "knots = [0.0, 0.5, 0.4]; levels = [1, 1, 1]"), ["knots do not increase"]),
    "equal knots": (effect(TABLE + "knots = [0.5, 0.5]; levels = [1, 1]"), ["knots do not increase"]),
    "too few levels": (
        effect(TABLE + "knots = [0.0, 0.5, 0.9]; levels = [1, 1]"),
        ["levels has 2 numbers for 3 knots"],
    ),
    "too many speeds": (
        effect(
            'kind = "residual_force"; site = "cart"; places = [0, 1]; by_place = [0, 0]'
            "; speeds = [0, 1]; by_speed = [1, 2, 3]"
        ),
        ["by_speed has 3 numbers for 2 speeds"],
    ),
    "unknown option": (
        effect(BELT + '; encoder = "carts"'),
        ["unknown encoder 'carts'", "did you mean 'cart'?"],
    ),
    "option by number": (effect(BELT + "; encoder = 1"), ["encoder = 1 is not a word in quotes", "cart, motor"]),
    "two belts": (effect(BELT + AGAIN + BELT), ["at most one belt_compliance", "delete"]),
    "two hooks": (effect(HOOK + AGAIN + HOOK), ["at most one double_pendulum"]),
    "two speed drives": (effect(SPEED + AGAIN + SPEED), ["at most one speed_drive at cart_drive"]),
    "two Dahl frictions": (effect(DAHL + AGAIN + DAHL), ["at most one presliding_friction"]),
    "Dahl friction and cable": (effect(DAHL + AGAIN + CABLE), ["presliding_friction and cable_drag", "keep one"]),
    "play at both drives": (effect(PLAY + AGAIN + WINCH), ["hoist_backlash and backlash", "keep one"]),
    "heavy winch motor": (effect(WINCH.replace("0.06", "0.2")), ["motor_mass = 0.2 of hoist", "winch_mass = 0.1"]),
    "belt and play": (effect(BELT + AGAIN + PLAY), ["belt_compliance and backlash", "keep one"]),
    "heavy hook": (
        effect(HOOK.replace("0.05", "0.2")),
        ["hook_mass = 0.2 of double_pendulum", "not below load_mass = 0.143"],
    ),
    "all of the load in the hook": (effect(HOOK.replace("0.05", "0.143")), ["hook_mass", "not below load_mass"]),
    "heavy motor": (effect(BELT.replace("mass = 1.0", "mass = 6.0")), ["motor_mass = 6.0", "cart_mass = 5.5"]),
    "heavy motor behind a play": (effect(PLAY.replace("mass = 1.0", "mass = 5.5")), ["motor_mass = 5.5 of backlash"]),
    "uncertainty is a number": ("uncertainty = 1\n[bridge]\n", ["uncertainty does not hold tables"]),
    "uncertainty without a name": ("[bridge]\n[uncertainty]\nstd = 1\n", ["[uncertainty.cart_mass]"]),
    "escapes": (bridge('"\\u001b[31mred" = 1\n'), ["unknown key"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name, write):
    content, said = REFUSED[name]
    path = write(content)
    with pytest.raises(InputError) as caught:
        load_model(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert message.splitlines() == [message] and message.isprintable()
    for part in said:
        assert part in message, message
    assert caught.value.__cause__ is None


def test_refused_paths(tmp_path):
    with pytest.raises(InputError, match="missing.toml: no such file; give the path of a model TOML"):
        load_model(tmp_path / "missing.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load_model(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        load_model("model\0.toml")


def test_a_byte_order_mark_does_no_harm(write):
    assert load_model(write(b"\xef\xbb\xbf[bridge]\ncart_mass = 1.0\n")).given == {"cart_mass"}


def test_masses_of_absent_parts_are_not_compared(write):
    """A belt's motor can only be heavier than a cart that the file gives."""
    load_model(
        write("[bridge]\nload_mass = 0.1\n[[effect]]\n" + BELT.replace("; ", "\n").replace("mass = 1.0", "mass = 9.0"))
    )


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("x = [1.0, 0.0]", r"x = .* does not go from least to most"),
        ("x = [0.0, inf]", "does not go from least to most"),
        ("x = [0.0, nan]", "does not go from least to most"),
        ("l = [true, 2]", "does not go from least to most"),
        ("l = 0.7", "does not go from least to most"),
        ("psi = [0.0, 1.0]", "psi"),
        ('u_x = "counts"', r"u_x = .*counts.* is no unit of an input; write one of V, A, %, count, N, N m"),
        ("u_l = [0.0, 1.0]", "is no unit of an input"),
    ],
)
def test_what_is_wrong_with_a_recorded_range_is_said(write, line, complaint):
    with pytest.raises(InputError, match=complaint) as found:
        load_model(write(f"[bridge]\ncart_mass = 1.0\n[recorded]\n{line}\n"))
    assert "[recorded]" in str(found.value) and "\n" not in str(found.value)
