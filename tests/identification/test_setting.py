"""What a fit is made ready with: recordings that cannot be right are refused, and forces get a scale."""

import dataclasses

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.identification.operating_range import scene_of
from jbridge.identification.setting import make_setting, prepared, setting_of, with_a_scale
from jbridge.model.files import Model
from jbridge.model.parameters import ParameterTable
from jbridge.recordings import Recording
from tests.identification.cases import DRY, FULL, TIMES, make_recording
from tests.problems import make_plant

GIVEN = frozenset({
    "cart_mass", "load_mass", "winch_mass", "gravity", "cart_damping", "swing_damping", "hoist_damping", "cart_gain",
    "hoist_gain",
})  # fmt: skip
KNOWN = frozenset({"cart_mass", "load_mass", "winch_mass", "gravity"})
MODEL = Model(make_plant(DRY), KNOWN, GIVEN, {}, "")


RESTING = 0.5 + 0.2 * np.sin(np.maximum(TIMES - 1.0, 0.0))


def recorded(name: str, *left_out: str, **changed: np.ndarray):
    return make_recording(name, TIMES, **{k: v for k, v in (FULL | changed).items() if k not in left_out})


@pytest.mark.parametrize(
    ("axis", "cause"), [("x", "u_x does"), ("psi", "the cart moves"), ("l", "u_l does")], ids=["x", "psi", "l"]
)
def test_a_sensor_that_never_changes_is_refused(axis, cause):
    dead = recorded("dead.csv", **{axis: np.full(len(TIMES), 0.6)})
    with pytest.raises(InputError, match=f"dead.csv, column {axis}: it never changes, although {cause}: check"):
        make_setting(MODEL, [dead], [])
    # One run in which nothing happens is no dead sensor.
    make_setting(MODEL, [dead, recorded("alive.csv")], [])


def test_a_cart_that_hardly_moves_need_not_swing_its_load():
    creep = recorded("creep.csv", x=0.5 + 0.01 * np.sin(TIMES), psi=np.zeros(len(TIMES)))
    make_setting(MODEL, [creep], [])


def test_what_recordings_cover_says_how_fast_axes_move_and_turn_round():
    swing = recorded("swing.csv", x=0.5 + 0.2 * np.sin(2.0 * TIMES))
    scene = scene_of(make_setting(MODEL, [swing], []), MODEL.plant)
    assert scene.speed["x"] == pytest.approx(0.4, rel=0.02)
    assert scene.acceleration["x"] == pytest.approx(0.8, rel=0.02)
    alone = scene_of(make_setting(MODEL, [recorded("cart.csv", "psi", "l", "u_l")], []), MODEL.plant)
    assert alone.acceleration["psi"] == 0.1


def test_a_hold_out_with_a_part_of_which_no_recording_tells_is_refused():
    locked = recorded("locked.csv", "u_l", "l")
    with pytest.raises(InputError, match="wound.csv: a driven hoist, which no other recording has, so hoist_gain"):
        make_setting(MODEL, [locked], [recorded("wound.csv")])
    told = dataclasses.replace(MODEL, known=KNOWN | {"hoist_gain", "hoist_damping"})
    make_setting(told, [locked], [recorded("wound.csv")])
    make_setting(MODEL, [recorded("wound.csv")], [locked])


def test_a_copy_of_a_recording_proves_nothing():
    with pytest.raises(
        InputError, match="again.csv: the same samples as run.csv; the hold-out needs another recording"
    ):
        make_setting(MODEL, [recorded("run.csv")], [recorded("again.csv")])


def test_a_mass_is_held_where_nothing_tells_how_large_forces_are():
    axes = ("x", "psi", "l")
    model, (told,) = with_a_scale(dataclasses.replace(MODEL, known=frozenset({"gravity"})), axes)
    assert model.known == {"gravity", "cart_mass"} and "cart_mass is taken as known" in told
    pendulum, _ = with_a_scale(dataclasses.replace(MODEL, known=frozenset({"gravity"})), ("psi",))
    assert pendulum.known == {"gravity", "load_mass"}
    # What is known of a part that no recording has tells nothing.
    cart, _ = with_a_scale(dataclasses.replace(MODEL, known=frozenset({"winch_mass", "gravity"})), ("x",))
    assert "cart_mass" in cart.known


@pytest.mark.parametrize("name", ["cart_gain", "load_mass", "coulomb_friction@cart.level"])
def test_one_known_force_is_scale_enough(name):
    given = dataclasses.replace(MODEL, known=frozenset({"gravity", name}))
    assert with_a_scale(given, ("x", "psi", "l")) == (given, ())


@pytest.mark.parametrize(
    ("column", "gain", "unit"),
    [({"unit": "N"}, 1.0, "N/N"), ({"unit": "N m", "radius": 0.028}, 1.0 / 0.028, "N/(N m)")],
    ids=["force", "torque"],
)
def test_the_gain_of_an_input_that_is_a_force_is_known(column, gain, unit):
    """Also with a model that knows nothing else: then no mass is held."""
    columns = {name: FULL[name] for name in ("u_x", "u_l", "x", "psi", "l")}
    run = Recording.from_arrays(t=TIMES, **columns, sidecar={"columns": {"u_x": column}}, force=True)
    assert run.override == {"cart_gain": pytest.approx(gain)}
    assert any(f"cart_gain = {gain:.6g} is known" in note for note in run.notes)
    model, setting, told = prepared(dataclasses.replace(MODEL, known=frozenset({"gravity"})), [run])
    assert float(model.plant.bridge.cart_gain) == pytest.approx(gain)
    assert model.known == {"gravity", "cart_gain"} and "cart_gain" in told[-1]
    assert not any("mass was taken" in sentence for sentence in told)
    entries = {entry.name: entry.unit for entry in ParameterTable(model.plant, setting.units).entries}
    assert entries["cart_gain"] == unit


def test_what_all_recordings_set_alike_is_known():
    heavy = [
        dataclasses.replace(recorded(f"{k}.csv", x=RESTING + 1e-3 * k), override={"load_mass": 0.25}) for k in (0, 1)
    ]
    model, _, told = prepared(dataclasses.replace(MODEL, known=KNOWN - {"load_mass"}), heavy)
    assert float(model.plant.bridge.load_mass) == 0.25 and model.known == KNOWN
    assert told == ("All recordings set load_mass = 0.25: it is taken as known.",)
    other = dataclasses.replace(heavy[1], override={"load_mass": 0.3})
    assert prepared(MODEL, [heavy[0], other])[0].plant.bridge.load_mass == MODEL.plant.bridge.load_mass


def test_each_recording_has_a_slot_of_its_own_on_the_clock_of_events():
    """By what it is, not by its name, which two may have; and later pieces of one run need none."""
    runs = [recorded("run.csv"), recorded("run.csv"), recorded("other.csv")]
    later = dataclasses.replace(recorded("run.csv"), begun=100.0)
    blow = {"force": 1.0, "start": 150.0, "stop": 300.0}
    setting = setting_of(make_plant(("wind", "swing", blow)), [*runs, later], [recorded("run.csv")])
    # What the model file gives stays where it is.
    assert setting.when(blow["start"]) == (None, blow["start"]) and setting.when(blow["stop"]) == (None, blow["stop"])
    for run in runs:
        for moment in (-1.0, 0.0, 3.9):
            where, when = setting.when(setting.starts(run) + moment)
            assert where is run and when == pytest.approx(moment)
    assert setting.starts(later) == setting.starts(recorded("run.csv")) == np.inf
    assert setting.when(4.0 * setting.slot + 1.0)[0] is None and setting.when(np.inf)[0] is None
    alone = setting_of(make_plant(), [runs[0]])
    assert alone.starts(runs[0]) == np.inf and alone.when(1e6) == (None, 1e6)
