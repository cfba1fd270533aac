"""Models in other languages: what MuJoCo simulates, what python-control computes, and which numbers MATLAB reads."""

import dataclasses
import functools
import re
import runpy

import control
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.cli import main
from jbridge.control.files import Controller, save_controller
from jbridge.control.paper_rules import paper_controller
from jbridge.export.c import controller_header
from jbridge.export.models import matlab_function, mujoco_xml, state_space, state_space_module
from jbridge.model.files import Model
from jbridge.model.parameters import ParameterTable
from jbridge.simulation.measurement import readings
from jbridge.simulation.rollout import rollout
from jbridge.simulation.runge_kutta import RK4
from jbridge.tuning.linear_designs import linear_model
from tests.problems import NUMBERS, make_lane, make_plant, make_state, model_text, null_effect

PERIOD = 0.01
TIMES = PERIOD * np.arange(151)
VOLTS = np.column_stack([2.5 * np.sin(4.0 * TIMES) + 0.8, -0.45 + 1.2 * np.sin(3.0 * TIMES)])
START = {"x": 0.5, "psi": 0.25, "l": 0.7}
FRICTION = {"cart": 4.0, "swing": 0.002, "hoist": 0.6}


@functools.cache
def friction():
    """A plant with dry friction of three levels, and its readings for any numbers."""
    plant = make_plant(*(null_effect("coulomb_friction", site) for site in FRICTION))
    table = ParameterTable(plant)
    lane, start = make_lane(VOLTS[:-1], PERIOD), make_state(**START)

    @jax.jit
    def run(vector):
        own = table.unravel(vector)
        return readings(own, lane, rollout(own, start, lane, substeps=4, method=RK4))

    return table, np.array(table.ravel(plant)), run


def model_of(plant):
    return Model(plant, frozenset(), frozenset(NUMBERS), {})


@pytest.mark.parametrize(("share", "tolerance"), [(0.0, 1e-6), (1.0, 2e-3)], ids=["viscous", "dry"])
def test_mujoco_simulates_the_same(share, tolerance):
    """With dry friction to 2 mm and 2 mrad: MuJoCo's is softened, and stops differ by some milliseconds."""
    mujoco = pytest.importorskip("mujoco")
    table, vector, run = friction()
    vector = vector.copy()
    for site, level in FRICTION.items():
        vector[table.positions(f"coulomb_friction@{site}.level")] = share * level
    wanted = np.asarray(run(jnp.asarray(vector)))
    scene = mujoco.MjModel.from_xml_string(mujoco_xml(model_of(table.unravel(jnp.asarray(vector))), START["l"]))
    data = mujoco.MjData(scene)
    data.qpos[:2] = START["x"], START["psi"]
    mujoco.mj_forward(scene, data)
    found = [data.sensordata.copy()]
    for volts in VOLTS[:-1]:
        data.ctrl[:] = volts
        mujoco.mj_step(scene, data, round(PERIOD / scene.opt.timestep))
        mujoco.mj_forward(scene, data)
        found.append(data.sensordata.copy())
    assert np.ptp(wanted, axis=0).min() > 0.05
    np.testing.assert_allclose(np.array(found), wanted, atol=tolerance)


def test_the_linear_system_is_that_of_textbooks():
    """A pendulum on a cart: frequencies and gains from the equations linearised by hand."""
    plant = make_plant()
    a, b = state_space(plant.bridge, 0.6)
    m1, m2, j, g = (NUMBERS[name] for name in ("cart_mass", "load_mass", "winch_mass", "gravity"))
    d, c, h = (NUMBERS[name] for name in ("cart_damping", "swing_damping", "hoist_damping"))
    k_x, k_l, l = NUMBERS["cart_gain"], NUMBERS["hoist_gain"], 0.6
    wanted = np.zeros((6, 6))
    wanted[:3, 3:] = np.eye(3)
    wanted[3] = [0, m2 * g / m1, 0, -d / m1, c / (m1 * l), 0]
    wanted[4] = [0, -(1 + m2 / m1) * g / l, 0, d / (m1 * l), -c / (m2 * l**2) * (1 + m2 / m1), 0]
    wanted[5, 5] = -h / (m2 + j)
    np.testing.assert_allclose(a, wanted, atol=1e-12)
    np.testing.assert_allclose(b[3:], [[k_x / m1, 0], [-k_x / (m1 * l), 0], [0, k_l / (m2 + j)]], atol=1e-12)


def test_python_control_samples_it_as_the_engine_does(tmp_path):
    plant = make_plant(null_effect("dead_zone", "cart_drive"))
    path = tmp_path / "bridge_statespace.py"
    path.write_text(state_space_module(model_of(plant), 0.6))
    found = runpy.run_path(str(path))
    assert "Without dead_zone at cart_drive" in path.read_text()
    assert found["AT_REST"]["u_l"] == pytest.approx(-0.143 * 9.81 / 3.0)
    sampled = control.sample_system(found["system"](), 0.02, method="zoh")
    a, b, _ = linear_model(plant, 0.6, 0.02)
    np.testing.assert_allclose(sampled.A, a, atol=2e-6)
    np.testing.assert_allclose(sampled.B, b, atol=2e-6)


def test_a_locked_rope_keeps_its_length(tmp_path):
    """As a winch that nothing moves: x and psi of the linear system, and no joint, motor or number of the hoist."""
    locked = dataclasses.replace(model_of(make_plant()), given=frozenset(NUMBERS) - {"winch_mass", "hoist_gain"})
    a, b = state_space(make_plant().bridge, 0.6)
    path = tmp_path / "bridge_statespace.py"
    path.write_text(state_space_module(locked, 0.6))
    system = runpy.run_path(str(path))["system"]()
    kept = [0, 1, 3, 4]
    np.testing.assert_allclose(system.A, a[np.ix_(kept, kept)], atol=1e-12)
    np.testing.assert_allclose(system.B, b[np.ix_(kept, [0])], atol=1e-12)
    assert system.input_labels == ["u_x"] and system.output_labels == ["x", "psi"]
    for text in (mujoco_xml(locked, 0.6), matlab_function(locked, "bridge", 0.6)):
        assert "u_l" not in text and "hoist" not in text and "The rope is locked at 0.6 m" in text


def test_matlab_has_every_number():
    effect = null_effect("position_direction_friction", "cart")
    plant = make_plant(effect, null_effect("coulomb_friction", "cart"))
    text = matlab_function(model_of(plant), "bridge", 0.6)
    for key, value in NUMBERS.items():
        (found,) = re.findall(rf"^model\.{key} = ([^;]*);", text, re.MULTILINE)
        assert float(found) == value
    assert "model.effect{1}.kind = 'position_direction_friction';" in text
    knots = re.search(r"model\.effect\{1\}\.knots = \[([^\]]*)\];", text)[1]
    np.testing.assert_array_equal([float(n) for n in knots.split(",")], np.asarray(effect.knots))
    assert float(re.search(r"model\.effect\{2\}\.level = ([^;]*);", text)[1]) == float(plant.effects[1].level)
    matrix = re.search(r"model\.A = \[([^\]]*)\];", text)[1]
    rows = [[float(n) for n in row.split(",")] for row in matrix.split(";")]
    np.testing.assert_array_equal(rows, state_space(plant.bridge, 0.6)[0])
    assert text.startswith("function model = bridge()\n") and text.endswith("end\n")
    assert "[N/V]" in text and "u_x [V], u_l [V]" in text
    counted = matlab_function(dataclasses.replace(model_of(plant), units={"u_x": "count"}), "bridge", 0.6)
    assert "[N/count]" in counted and "[N/V]" in counted and "u_x [count], u_l [V]" in counted


@pytest.mark.parametrize(
    ("to", "name"),
    [("c", "my_rig.h"), ("mujoco", "my_rig.xml"), ("statespace", "my_rig_statespace.py"), ("matlab", "my_rig.m")],
)
def test_the_command_writes_a_model(tmp_path, capsys, monkeypatch, to, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "for.toml").write_text(model_text())
    assert main(["export", "for.toml", "--to", "matlab", "--out", "."]) == 0
    # A word of the language itself names no function.
    assert capsys.readouterr().out == "bridge_for.m\n"
    (tmp_path / "my-rig.toml").write_text(model_text())
    assert main(["export", "my-rig.toml", "--to", to, "--out", "out"]) == 0
    assert capsys.readouterr().out == f"out/{name}\n" and (tmp_path / "out" / name).stat().st_size > 500


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["model.toml", "--to", "c", "--period", "0"], "--period 0: give the time between samples"),
        (["fuzzy.toml", "--to", "c", "--period", "0.02"], "a controller has its own period; leave out --period 0.02"),
        (["fuzzy.toml", "--to", "matlab"], "a controller, but only models are exported to matlab; choose --to c"),
        (["model.toml", "--to", "mujoco", "--rope", "0"], "--rope 0: give the length of the rope"),
        (["model.toml", "--to", "simulink"], "invalid choice"),
        (["cart.toml", "--to", "mujoco"], "no load_mass"),
        (["x.fis", "--to", "c"], 'a controller\'s TOML beside it names it: kind = "fuzzy" and cart = "x.fis"'),
    ],
)
def test_what_cannot_be_exported_is_said_in_one_line(tmp_path, capsys, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(model_text())
    (tmp_path / "x.fis").write_text("[System]\n")
    (tmp_path / "cart.toml").write_text("[bridge]\ncart_mass = 5.0\ncart_gain = 16.0\n")
    (tmp_path / "fuzzy.toml").write_text('kind = "fuzzy"\n')
    assert main(["export", *words, "--out", "out"]) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and complaint in told.err
    assert not (tmp_path / "out").exists()


def test_the_command_writes_a_controller(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_controller(tmp_path / "fuzzy.toml", Controller(paper_controller()))
    assert main(["export", "fuzzy.toml", "--to", "c", "--out", "out/deep"]) == 0
    assert capsys.readouterr().out == "out/deep/fuzzy.h\n"
    assert (tmp_path / "out/deep/fuzzy.h").read_text() == controller_header(Controller(paper_controller()), "fuzzy")
