"""`fit`: from wrong starts to the truth, honest intervals, and the complete result."""

import math

import numpy as np
import pytest

import jbridge
from jbridge import InputError, fit
from tests.identification.cases import DRY, NOISE, ROOT, cart_model, cart_recordings, make_recording, scaled, values
from tests.problems import make_plant

DEAD = ("dead_zone", "cart_drive", {"positive": 0.2, "negative": 0.15})
TRUTH = make_plant(DRY, DEAD, cart_damping=50.0, cart_gain=15.0)
FREE = (
    "cart_damping",
    "cart_gain",
    "coulomb_friction@cart.level",
    "dead_zone@cart_drive.positive",
    "dead_zone@cart_drive.negative",
)
WRONG = dict(zip(FREE, (0.75, 1.25, 1.25, 0.75, 1.25), strict=True))


@pytest.fixture(scope="module")
def found():
    truth = cart_model(DRY, DEAD, cart_damping=50.0, cart_gain=15.0)
    recordings = cart_recordings(TRUTH, 4)
    return fit(scaled(truth, WRONG), recordings[:3], recordings[3:])


def test_the_truth_is_recovered_and_intervals_cover_it(found):
    truth = values(TRUTH)
    for name in FREE:
        e = found.estimates[name]
        # Five intervals of one fit: three standard deviations for each, so that the test does not hang on its seed.
        assert abs(e.value - truth[name]) < 3.2 * e.std, name
        assert e.std < 0.05 * truth[name], name
        assert e.low == pytest.approx(e.value - 1.96 * e.std, rel=1e-4)
        assert e.high == pytest.approx(e.value + 1.96 * e.std, rel=1e-4)


def test_free_runs_are_left_with_the_noise(found):
    for errors in (found.train, found.holdout):
        assert errors.free_run["x"] < 1.5 * NOISE["x"] and errors.window["x"] < 1.2 * NOISE["x"]
    # At 100 samples a second nine of them span 80 ms, in which a motion is not quite a parabola.
    assert NOISE["x"] < found.noise["x"] < 1.3 * NOISE["x"]


def test_the_model_says_where_its_recordings_went(found):
    runs = cart_recordings(TRUTH, 4)[:3]
    places = np.concatenate([run.x for run in runs])
    inputs = np.concatenate([run.u_x for run in runs])
    assert found.model.recorded == {"x": (places.min(), places.max()), "u_x": (inputs.min(), inputs.max())}
    assert np.ptp(places) > 0.1


def test_the_result_is_complete(found):
    assert found.model.known == {"cart_mass", "gravity"}
    assert set(found.model.uncertainty) == set(FREE)
    # What is known and what belongs to absent parts stays as it was.
    start = values(scaled(cart_model(DRY, DEAD), {}).plant)
    fitted = values(found.model.plant)
    assert {name for name in fitted if fitted[name] != start[name]} == set(FREE)
    assert all(found.estimates[name].std is None for name in fitted if name not in FREE)
    assert [(t.recording, t.role) for t in found.traces] == [
        ("run-1.csv", "train"),
        ("run-2.csv", "train"),
        ("run-3.csv", "train"),
        ("run-4.csv", "holdout"),
    ]
    trace = found.traces[0]
    assert len(trace.times) == len(trace.measured["x"]) == len(trace.before["x"]) == len(trace.after["x"])
    assert np.nanmax(np.abs(trace.after["x"] - trace.measured["x"])) < 8 * NOISE["x"]
    assert np.nanmax(np.abs(trace.before["x"] - trace.measured["x"])) > 100 * NOISE["x"]
    assert found.window == 2.0 and found.seconds > 0
    assert not any("hardly determine" in warning for warning in found.warnings)


def test_the_fitted_model_survives_its_file(found, tmp_path):
    jbridge.save_model(tmp_path / "model.toml", found.model)
    again = jbridge.load_model(tmp_path / "model.toml")
    assert values(again.plant) == values(found.model.plant)
    assert again.uncertainty["cart_gain"]["std"] == found.estimates["cart_gain"].std


@pytest.mark.slow
def test_forces_without_a_scale_go_with_a_mass():
    """A free mass, gain, damping and friction scale together: only their ratios show in the motion."""
    recordings = cart_recordings(TRUTH, 2, seconds=4.0)
    model = cart_model(DRY, DEAD, cart_damping=50.0, cart_gain=15.0)
    free = type(model)(model.plant, frozenset({"gravity"}), model.given, {}, "")
    found = fit(free, recordings)
    assert any("cart_mass is taken as known" in note for note in found.notes)
    gain = found.estimates["cart_gain"]
    assert gain.std < 0.02 * gain.value


def test_windows_that_suit_no_recording_are_refused():
    times = np.arange(300) * 0.01
    short = make_recording("short.csv", times, u_x=np.sin(3 * times), x=0.5 + 0.1 * np.sin(times))
    with pytest.raises(
        InputError, match=r"short.csv: windows of 2 s are too long for .* of 2.99 s .* \(at most 1.8 s\)"
    ):
        fit(cart_model(), [short], window=2.0)


def test_a_gain_without_an_input_is_refused():
    times = np.arange(200) * 0.01
    still = make_recording("still.csv", times, u_x=np.zeros(200), x=np.full(200, 0.5))
    with pytest.raises(InputError, match="still.csv: u_x never changes, so cart_gain cannot be estimated"):
        fit(cart_model(), [still])


@pytest.mark.slow
def test_windows_tell_as_much_where_starts_are_unknown():
    """Half a second at a time, each from a start of its own: the truth all the same, less sharply."""
    truth = cart_model(DRY, DEAD, cart_damping=50.0, cart_gain=15.0)
    found = fit(scaled(truth, WRONG), cart_recordings(TRUTH, 2), window=0.5)
    for name in FREE:
        e = found.estimates[name]
        assert abs(e.value - values(TRUTH)[name]) < 4 * e.std, name
        assert e.std < 0.1 * values(TRUTH)[name], name
    assert found.notes[0] == "Fitted to windows of 0.5 s, not to whole recordings."
    with pytest.raises(InputError, match=r"run-1.csv: a window of 0.05 s is shorter than ten of its samples \(0.1 s\)"):
        fit(truth, cart_recordings(TRUTH, 2), window=0.05)


@pytest.mark.slow
def test_recovery_on_another_engine_with_true_stick_slip(monkeypatch):
    """The bridge with winch, dry friction on both axes, dead zones and lag, as another engine moves it."""
    monkeypatch.syspath_prepend(str(ROOT / "experiments" / "concealed"))
    rig = pytest.importorskip("rig")
    truth = {
        "bridge": {
            "cart_mass": 5.5,
            "load_mass": 0.143,
            "winch_mass": 0.1,
            "gravity": 9.81,
            "cart_damping": 50.0,
            "swing_damping": 0.0015,
            "hoist_damping": 25.0,
            "cart_gain": 16.0,
            "hoist_gain": 3.0,
        },
        "effects": [
            {"kind": "coulomb_friction", "site": "cart", "level": 3.5},
            {"kind": "coulomb_friction", "site": "hoist", "level": 3.0},
            {"kind": "dead_zone", "site": "cart_drive", "positive": 0.25, "negative": 0.25},
            {"kind": "dead_zone", "site": "hoist_drive", "positive": 0.45, "negative": 0.45},
            {"kind": "actuator_lag", "site": "hoist_drive", "time_constant": 0.06},
        ],
        "parts": "full",
        "rope": "winch",
    }
    recordings = []
    for i in range(5):
        key = np.random.default_rng(i)
        count = 3201
        cart = np.repeat(key.uniform(0.9, 1.8, 41) * np.where(np.arange(41) % 2, -1, 1), 80)[:count]
        hoist = np.repeat(key.uniform(2.2, 3.2, 41) * np.where((np.arange(41) // 2) % 2, -1, 1), 80)[:count]
        hoist = np.where(hoist < 0, hoist - 0.9, hoist)
        columns = rig.simulate(truth, np.stack([cart, hoist], axis=1), 16.0, i)
        times = columns.pop("t")
        run = make_recording(f"rig-{i}.csv", times, **columns)
        run.resolution.update({"x": 1e-4, "psi": 2 * math.pi / 4096, "l": 1e-4})
        assert columns["l"].min() > 0.2 and np.ptp(columns["x"]) > 0.1
        recordings.append(run)
    effects = [
        (e["kind"], e["site"], {k: v for k, v in e.items() if k not in ("kind", "site")}) for e in truth["effects"]
    ]
    right = cart_model(*effects, known=("load_mass", "winch_mass"), **truth["bridge"])
    names = [n for n in values(right.plant) if n not in ("cart_mass", "load_mass", "winch_mass", "gravity")]
    key = np.random.default_rng(7)
    start = scaled(right, {n: 1.25 if key.random() < 0.5 else 0.75 for n in names})
    found = fit(start, recordings[:4], recordings[4:])
    for axis, noise in NOISE.items():
        assert found.train.free_run[axis] < 1.5 * noise, axis
        assert found.holdout.free_run[axis] < 1.5 * noise, axis
    wanted = values(right.plant)
    off = {name: abs(found.estimates[name].value / wanted[name] - 1) for name in names}
    # Both engines step in time, and the winch's damping, gain and friction nearly trade: 2.5 % was the worst.
    assert max(off.values()) < 0.05, off
    assert np.median(list(off.values())) < 0.01, off
