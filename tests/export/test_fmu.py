"""Models as functional mock-up units: FMPy checks and simulates them, against the simulation that they come from."""

import io
import math
import shutil
import subprocess
import zipfile

import numpy as np
import pytest

from jbridge import InputError, save_model
from jbridge.export.c_model import sampled_plant, samples
from jbridge.export.fmu import model_unit
from jbridge.export.save import save_export
from jbridge.model.effects.catalogue import make_effect
from jbridge.model.files import Model
from tests.problems import NUMBERS, make_plant

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")

PERIOD = 0.01
RIG = [
    ("coulomb_friction", "cart", {"level": 0.5}),
    ("input_delay", "cart_drive", {"delay": 0.013}),
    ("actuator_lag", "hoist_drive", {"time_constant": 0.06}),
    ("sensor_delay", "psi_sensor", {"delay": 0.017}),
]


@pytest.fixture(scope="module")
def model():
    return Model(make_plant(*(make_effect(*each) for each in RIG)), frozenset(), frozenset(NUMBERS), {})


@pytest.fixture(scope="module")
def unit(model, tmp_path_factory):
    """The unit as the command writes it."""
    folder = tmp_path_factory.mktemp("unit")
    save_model(folder / "crane.toml", model)
    return save_export(folder, folder / "crane.toml", "fmu", rope=0.4, period=PERIOD)


@pytest.fixture
def instance(unit, tmp_path):
    description = fmpy.read_model_description(unit)
    numbers = {variable.name: variable.valueReference for variable in description.modelVariables}
    messages = []
    slave = FMU3Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(unit, tmp_path),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="crane",
    )
    slave.instantiate(logMessage=lambda *said: messages.append(said[-1].decode()))
    slave.enterInitializationMode()
    yield slave, numbers, messages
    slave.freeInstance()


def test_it_satisfies_the_standard(unit):
    assert validate_fmu(unit) == []


def test_it_moves_as_the_simulation_does(model, unit):
    begin, inputs, readings = samples(sampled_plant(model, PERIOD), 0.4, 60, seed=1)
    rows = [(PERIOD * k, *command) for k, command in enumerate([*inputs, inputs[-1]])]
    signals = np.array(rows, [(name, float) for name in ("time", "u_x", "u_l")])
    found = fmpy.simulate_fmu(
        unit,
        stop_time=PERIOD * len(inputs),
        output_interval=PERIOD,
        input=signals,
        start_values=dict(zip(("x_start", "psi_start", "l_start"), begin, strict=True)),
        output=["x", "psi", "l"],
    )
    played = np.stack([found[name] for name in ("x", "psi", "l")], axis=1)
    assert np.ptp(readings, axis=0).min() > 3e-3
    # Encoders are read with a delay, so their first reading is where the rig starts.
    np.testing.assert_allclose(played[0], begin, atol=1e-12)
    np.testing.assert_allclose(played[1:], readings, atol=1e-9, rtol=0)


def test_a_state_is_kept_and_set_again(instance):
    slave, numbers, _ = instance
    outputs = [numbers[name] for name in ("x", "psi", "l")]
    slave.setFloat64([numbers["psi_start"]], [0.2])
    assert slave.getFloat64(outputs) == pytest.approx([0.0, 0.2, 0.4])
    slave.exitInitializationMode()
    slave.setFloat64([numbers["u_x"]], [5.0])
    slave.doStep(0.0, 10 * PERIOD)
    kept = slave.serializeFMUState(slave.getFMUState())
    later = []
    for _ in range(2):
        slave.setFMUState(slave.deserializeFMUState(kept))
        slave.doStep(0.1, 20 * PERIOD)
        later.append(slave.getFloat64([*outputs, numbers["time"]]))
    assert later[0] == later[1] and later[0][0] != 0.0 and later[0][3] == pytest.approx(0.3)
    slave.reset()
    assert slave.getFloat64(outputs) == [0.0, 0.0, 0.4]


def test_it_starts_on_a_rope_with_a_length(instance):
    slave, numbers, messages = instance
    for length in (-1.0, 0.0, math.nan):
        with pytest.raises(Exception, match="status 3"):
            slave.setFloat64([numbers["l_start"]], [length])
    assert all("a rope longer than 0" in message for message in messages)
    slave.setFloat64([numbers["l_start"]], [0.3])
    assert slave.getFloat64([numbers["l"]]) == pytest.approx([0.3])


def test_what_it_cannot_do_is_said(instance):
    slave, numbers, messages = instance
    slave.exitInitializationMode()
    for refused in (
        lambda: slave.doStep(0.0, 1.5 * PERIOD),
        lambda: slave.setFloat64([numbers["psi_start"]], [0.1]),
        lambda: slave.getFloat64([99]),
        slave.enterEventMode,
    ):
        with pytest.raises(Exception, match="status 3"):
            refused()
    assert len(messages) == 4 and "multiple of fixedInternalStepSize" in messages[0]


def test_without_a_compiler_it_holds_the_same_sources(model, unit, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    sources = model_unit(model, "crane", period=PERIOD, rope=0.4)
    with zipfile.ZipFile(unit) as one, zipfile.ZipFile(io.BytesIO(sources)) as other:
        assert {name.split("/")[0] for name in set(one.namelist()) - set(other.namelist())} == {"binaries"}
        assert all(one.read(name) == other.read(name) for name in other.namelist())


def test_its_sources_compile_without_a_warning(unit, tmp_path):
    fmpy.extract(unit, tmp_path)
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-fsyntax-only"]
    subprocess.run(["gcc", *strict, tmp_path / "sources" / "fmi3.c"], check=True)


def test_a_compiler_that_fails_is_named(model, monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(InputError, match=r"false cannot compile the model .*set CC"):
        model_unit(model, "crane", period=PERIOD, rope=0.4)


def test_an_unknown_language_is_refused(tmp_path):
    with pytest.raises(ValueError, match="unknown target 'simulink'; choose among c, fmu, mujoco, statespace, matlab"):
        save_export(tmp_path, tmp_path / "crane.toml", "simulink")
