"""`simulate`: which parts move, where a run starts, and a cart against its closed form."""

import dataclasses

import numpy as np
import pytest

from jbridge import InputError, fit, load_model, load_recording, save_model, simulate
from jbridge.identification.evaluation.judge import make_judge
from jbridge.identification.setting import setting_of
from tests.identification.cases import DRY, cart_model, cart_recordings, make_recording
from tests.problems import make_lane, make_plant, make_state, measure, model_text
from tests.problems import simulate as engine

BRIDGE = model_text()
CART = "[bridge]\ncart_mass = 5.5\ncart_damping = 45.0\ncart_gain = 16.0\n"
ROPE_LOCKED = CART + "load_mass = 0.143\nswing_damping = 0.0015\n"
TIMES = np.arange(401) * 0.01


def volts(times):
    return np.where(times < 1.0, 2.0, np.where(times < 2.5, -1.5, 0.0))


@pytest.fixture
def files(tmp_path):
    """Writes a model, a recording and its sidecar; returns both as read."""

    def write(model: str, columns: dict, sidecar: str = ""):
        (tmp_path / "model.toml").write_text(model)
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(repr(float(cell)) for cell in row) for row in rows)]
        (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
        if sidecar:
            (tmp_path / "run.toml").write_text(sidecar)
        return load_model(tmp_path / "model.toml"), load_recording(tmp_path / "run.csv", inputs_only=True)

    return write


def closed_form(times, start):
    """`m x'' = K u - R x'` under held steps: each piece is an exponential approach to `K u / R`."""
    mass, damping, gain = 5.5, 45.0, 16.0
    x, v, t0 = start, 0.0, 0.0
    out = np.full_like(times, start)
    for until, u in ((1.0, 2.0), (2.5, -1.5), (np.inf, 0.0)):
        limit, rate = gain * u / damping, damping / mass
        inside = (times >= t0) & (times <= until)
        since = times[inside] - t0
        out[inside] = x + limit * since + (v - limit) * (1 - np.exp(-rate * since)) / rate
        span = until - t0
        if np.isfinite(span):
            x += limit * span + (v - limit) * (1 - np.exp(-rate * span)) / rate
            v = limit + (v - limit) * np.exp(-rate * span)
            t0 = until
    return out


def test_a_cart_is_its_closed_form(files):
    model, recording = files(CART, {"t": TIMES, "u_x": volts(TIMES)}, "[initial]\nx = 0.3\n")
    found = simulate(model, recording)
    assert list(found) == ["t", "u_x", "x"]
    np.testing.assert_array_equal(found["t"], recording.times)
    # Order four with steps of 2.5 ms against a time constant of 0.12 s.
    np.testing.assert_allclose(found["x"], closed_form(TIMES, 0.3), atol=1e-9)


def test_rows_may_be_missing_and_times_need_not_begin_at_0(files):
    keep = np.ones(len(TIMES), bool)
    keep[[50, 51, 52, 200, 301]] = False
    times = TIMES[keep] + 7.25
    model, recording = files(CART, {"t": times, "u_x": volts(TIMES)[keep]}, "[initial]\nx = 0.3\n")
    found = simulate(model, recording)
    np.testing.assert_array_equal(found["t"], times)
    np.testing.assert_allclose(found["x"], closed_form(TIMES, 0.3)[keep], atol=1e-9)


def test_the_parts_of_a_file_of_inputs_are_the_models(files):
    inputs = {"t": TIMES, "u_x": volts(TIMES), "u_l": 0 * TIMES - 0.4}
    model, recording = files(BRIDGE, inputs, "[initial]\nx = 0.3\npsi = 0.05\nl = 0.7\n")
    found = simulate(model, recording)
    assert list(found) == ["t", "u_x", "u_l", "x", "psi", "l"]
    assert (found["x"][0], found["psi"][0], found["l"][0]) == (0.3, 0.05, 0.7)
    lane = make_lane(np.stack([inputs["u_x"], inputs["u_l"]], axis=1)[:-1], 0.01)
    oracle = engine(make_plant(), make_state(0.3, 0.05, 0.7), lane, substeps=16)
    # Steps a quarter as long, so a difference of order four in what is left.
    np.testing.assert_allclose(found["psi"], np.asarray(measure(make_plant(), lane, oracle))[:, 1], atol=1e-7)


def test_without_a_hoist_input_the_rope_is_locked(files):
    model, recording = files(ROPE_LOCKED, {"t": TIMES, "u_x": volts(TIMES)}, "[initial]\nx = 0.3\npsi = 0.0\nl = 0.6\n")
    found = simulate(model, recording)
    np.testing.assert_array_equal(found["l"], 0.6)
    assert np.ptp(found["psi"]) > 0.01


def test_a_recording_says_its_parts_and_where_it_starts(files):
    columns = {"t": TIMES, "u_x": volts(TIMES), "x": 0.4 + 0 * TIMES}
    model, recording = files(BRIDGE, columns)
    found = simulate(model, recording, "first-row")
    # A cart alone, although the model has a load: the load must not slow it down.
    assert list(found) == ["t", "u_x", "x"]
    np.testing.assert_allclose(found["x"], closed_form(TIMES, 0.4), atol=1e-9)


def test_what_a_sidecar_sets_holds_for_this_run(files):
    inputs = {"t": TIMES, "u_x": volts(TIMES)}
    model, recording = files(CART, inputs, "[initial]\nx = 0.3\n[override]\ncart_gain = 32.0\n")
    twice = simulate(model, recording)["x"] - 0.3
    plain = simulate(model, dataclasses.replace(recording, override={}))["x"] - 0.3
    np.testing.assert_allclose(twice, 2 * plain, atol=1e-9)
    assert float(model.plant.bridge.cart_gain) == 16.0


def test_sensors_are_read(files):
    sensor = '[[effect]]\nkind = "sensor_offset"\nsite = "x_sensor"\noffset = 0.01\n'
    model, recording = files(CART + sensor, {"t": TIMES, "u_x": volts(TIMES)}, "[initial]\nx = 0.3\n")
    np.testing.assert_allclose(simulate(model, recording)["x"], closed_form(TIMES, 0.3) + 0.01, atol=1e-9)


def test_a_run_starts_where_its_sensors_read_the_first_sample(files):
    sensors = """
[[effect]]
kind = "sensor_scale"
site = "x_sensor"
scale = 3.0
[[effect]]
kind = "sensor_eccentricity"
site = "x_sensor"
amplitude = 0.004
period = 0.2
phase = 0.5
[[effect]]
kind = "sensor_offset"
site = "x_sensor"
offset = -0.02
"""

    def reading(way):
        return 3.0 * (way + 0.004 * np.sin(2.0 * np.pi * way / 0.2 + 0.5)) - 0.02

    columns = {"t": TIMES, "u_x": volts(TIMES), "x": 0.9 + 0.1 * TIMES}
    found = simulate(*files(CART + sensors, columns), "first-row")
    assert found["x"][0] == pytest.approx(0.9, abs=1e-9)
    ways = np.linspace(0.25, 0.35, 100_001)
    start = np.interp(0.9, reading(ways), ways)
    np.testing.assert_allclose(found["x"], reading(closed_form(TIMES, start)), atol=1e-7)


LAG = ("actuator_lag", "cart_drive", {"time_constant": 0.08})


def test_errors_are_those_of_a_report(tmp_path):
    """Also of a model that lacks something, on recordings that begin in motion and in the middle of a command."""
    *train, one, other = cart_recordings(make_plant(DRY, LAG, cart_damping=50.0), 4, seconds=4.0)
    holdout = [one.rows(slice(90, None)), other.rows(slice(135, 360))]
    fitted = fit(cart_model(), train, holdout)
    save_model(tmp_path / "model.toml", fitted.model)
    model = load_model(tmp_path / "model.toml")

    def error(initial):
        left = [simulate(model, recording, initial)["x"] - recording.x for recording in holdout]
        return np.sqrt(np.mean(np.concatenate(left) ** 2))

    assert error("estimated") == pytest.approx(fitted.holdout.free_run["x"], rel=0.003)
    assert error("first-row") != pytest.approx(fitted.holdout.free_run["x"], rel=0.05)


def test_a_fast_log_begins_where_its_report_does():
    """Reports look at every fourth of its rows; the simulation has all of them."""
    times = np.arange(3001) * 0.001
    lag = np.exp(-times / 0.12)
    recording = make_recording("fast.csv", times, u_x=2.0 + 0 * times, x=0.3 + 0.7 * times + 0.01 * lag)
    model = cart_model()
    found = simulate(model, recording)["x"]
    assert len(found) == len(times)
    setting = setting_of(model.plant, [recording]).thinned()
    [run] = make_judge(setting, setting.recordings).evaluate(model.plant).predicted
    # Steps of 1 ms in place of 4 ms.
    np.testing.assert_allclose(found[:3000:4], run[:750, 0], atol=2e-6)


def test_a_gap_is_simulated_through():
    """Points of the grid within a gap have no measurement, and a prediction all the same."""
    keep = np.ones(len(TIMES), bool)
    keep[100:140] = False
    recording = make_recording("gap.csv", TIMES[keep], u_x=volts(TIMES)[keep], x=closed_form(TIMES, 0.3)[keep])
    model = cart_model()
    [run] = make_judge(setting_of(model.plant, [recording]), [recording]).evaluate(model.plant).predicted
    assert np.abs(np.diff(run[: len(TIMES), 0])).max() < 0.02


@pytest.mark.parametrize(
    ("changes", "volts_l", "fate"),
    [({"cart_gain": 1e5}, 0.0, "it runs away"), ({}, -4.0, "it has no rope left")],
)
def test_a_simulation_from_an_estimated_state_may_be_lost(changes, volts_l, fate):
    columns = {"u_x": volts(TIMES), "x": 0.3 + 0.01 * TIMES}
    if volts_l:
        columns |= {"u_l": np.full(len(TIMES), volts_l), "l": 0.3 + 0.01 * TIMES, "psi": 0.05 * np.cos(TIMES)}
    with pytest.raises(InputError, match=fate):
        simulate(cart_model(**changes), make_recording("run.csv", TIMES, **columns))


def test_a_rope_needs_a_length(files):
    model, recording = files(ROPE_LOCKED, {"t": TIMES, "u_x": volts(TIMES)}, "[initial]\nx = 0.3\n")
    with pytest.raises(InputError, match=r"run\.csv: no rope length to start from"):
        simulate(model, recording)


def hanging(files, effect: str):
    """A bridge with one more effect at the hoist or swing, and a run of it."""
    volts_l = np.where(TIMES < 2.0, 0.4, -0.6)
    sidecar = "[initial]\nx = 0.3\nl = 0.7\npsi = 0.0\n"
    return files(BRIDGE + effect, {"t": TIMES, "u_x": volts(TIMES), "u_l": volts_l}, sidecar)


def test_a_steel_wire_is_nearly_rigid(files):
    wire = '[[effect]]\nkind = "rope_elasticity"\nsite = "hoist"\nstiffness = 1e6\ndamping = 50.0\n'
    rigid, stiff = (simulate(*hanging(files, effect)) for effect in ("", wire))
    for name, close in {"x": 2e-6, "psi": 2e-5, "l": 5e-6}.items():
        np.testing.assert_allclose(stiff[name], rigid[name], atol=close)


def test_a_run_that_no_step_resolves_is_refused(files):
    joint = '[[effect]]\nkind = "double_pendulum"\nsite = "swing"\nhook_mass = 0.001\nlink = 0.006\ndamping = 10.0\n'
    with pytest.raises(InputError, match=r"model\.toml: with the inputs of .*run\.csv it runs away"):
        simulate(*hanging(files, joint))


def test_a_winch_that_winds_in_all_of_its_rope_is_named(files):
    columns = {"t": TIMES, "u_x": volts(TIMES), "u_l": np.full(len(TIMES), -4.0)}
    with pytest.raises(InputError, match=r"it has no rope left .*correct hoist_gain"):
        simulate(*files(BRIDGE, columns, "[initial]\nx = 0.3\nl = 0.3\npsi = 0.05\n"))


def test_a_part_that_the_model_lacks_is_refused(files):
    columns = {"t": TIMES, "u_x": volts(TIMES), "x": 0.4 + 0 * TIMES, "psi": 0.01 * np.sin(TIMES)}
    model, recording = files(CART, columns, "[locked]\nl = 0.7\n")
    with pytest.raises(InputError, match="load_mass"):
        simulate(model, recording)
