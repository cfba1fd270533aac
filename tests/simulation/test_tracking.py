"""Closed loops along references: shaped ones, and rivals compared."""

import dataclasses
import functools

import numpy as np
import pytest

from jbridge.control.compensation import Compensation
from jbridge.control.files import Controller
from jbridge.control.linear import Pid
from jbridge.control.shaping import Shaping
from jbridge.errors import InputError
from jbridge.model.files import Model
from jbridge.report.control.comparison_text import describe_rivals
from jbridge.simulation.tracking import check_limits, track
from jbridge.trajectory import smooth_path
from tests.problems import NUMBERS, make_plant

MODEL = Model(make_plant(), frozenset(), frozenset(NUMBERS), {}, "")
PID = Controller(Pid(40.0, 0.0, 2.0, 60.0, 20.0, 2.0, compensation=Compensation(hoist_bias=-0.468)), 0.02)


@functools.cache
def runs():
    """The same controller with a shaped reference and without, on half a metre of rope."""
    path = smooth_path([(0.2, 0.5), (0.8, 0.5)], speed=(0.9, 0.2), rest=4.0, period=0.02)
    shaped = dataclasses.replace(PID, shaping=Shaping("zvd", float(np.sqrt(9.81 / 0.5))))
    return {"plain": track(MODEL, PID, path), "shaped": track(MODEL, shaped, path)}


def test_a_shaped_reference_leaves_less_swing_and_is_measured_against_the_wanted_one():
    plain, shaped = (run.moves[0] for run in runs().values())
    assert plain.residual_swing > 0.03 and shaped.residual_swing < 0.2 * plain.residual_swing
    # A whole period of the swing late: 1.4 s at up to 0.6 m behind what is wanted.
    assert shaped.arrival == plain.arrival and shaped.itae["x"] > 2.0 * plain.itae["x"]
    assert len(runs()["shaped"].times) == len(runs()["plain"].times) + 71


@pytest.mark.parametrize(("width", "moves"), [(3.9, True), (4.0, False), (21.0, False)])
def test_a_limit_within_the_dead_zone_is_refused(width, moves):
    """The drives end where the controller says."""
    given = Controller(Pid(compensation=Compensation(cart_limit=4.0, hoist_limit=9.0)))
    plant = make_plant(("dead_zone", "cart_drive", {"positive": width, "negative": 30.0}))
    model = dataclasses.replace(MODEL, plant=plant, units={"u_x": "count"})
    if moves:
        check_limits(model, given)
    else:
        with pytest.raises(InputError, match=f"4 count at most, .* dead zone of {width:g} count, .* set cart_limit"):
            check_limits(model, given)


def test_the_papers_volts_are_no_limits_of_counts():
    with pytest.raises(InputError, match="3 V at most, but the model's u_x is in count; give a controller for count"):
        check_limits(dataclasses.replace(MODEL, units={"u_x": "count"}), PID)


def test_a_model_without_a_hoist_has_its_rope_locked():
    """A cart without dynamics of a hoist moves as beside one that holds the rope."""
    locked = dataclasses.replace(MODEL, given=MODEL.given - {"winch_mass", "hoist_gain"})
    path = smooth_path([(0.2, 0.5), (0.8, 0.5)], speed=(0.9, 0.2), rest=4.0, period=0.02)
    still = {"noise": (0.0, 0.0, 0.0)}
    run = track(locked, PID, path, **still)
    assert np.ptp(run.position["l"]) == 0.0 and run.moves[0].settling_time["x"] is not None
    heavy = dataclasses.replace(MODEL, plant=make_plant(winch_mass=1e6))
    np.testing.assert_allclose(track(heavy, PID, path, **still).position["psi"], run.position["psi"], atol=1e-5)
    with pytest.raises(InputError, match="the rope is locked; give a reference whose l is the rope's length"):
        track(locked, PID, smooth_path([(0.2, 0.5), (0.8, 0.6)], speed=(0.9, 0.2), rest=4.0, period=0.02))


def moved(run, **changes):
    return dataclasses.replace(run, moves=tuple(dataclasses.replace(move, **changes) for move in run.moves))


def test_the_rival_to_take_settles_the_most_moves():
    run = runs()["shaped"]
    quick = moved(run, settling_time={"x": 1.0, "l": 0.0, "load": 2.0}, travel={"x": 4.0, "l": 0.0})
    calm = moved(run, settling_time={"x": 1.0, "l": 0.0, "load": 3.0}, travel={"x": 1.0, "l": 0.0})
    never = moved(run, settling_time={"x": 1.0, "l": 0.0, "load": None})
    said = describe_rivals({"never": never, "calm": calm, "quick": quick})
    lines, text = said.splitlines(), " ".join(said.split())
    assert max(map(len, lines)) <= 80
    assert "Take quick: on this model it settles 1 of 1 moves, in 2.00 s on average." in text
    assert "calm settles as many with 25% of the travel of u_x." in text
    assert lines[0].split() == ["controller", "never", "calm", "quick"]
    assert lines[2].split() == ["load", "settled,", "s", "never", "3.00", "2.00"]
    alike = moved(run, settling_time={"x": 1.0, "l": 0.0, "load": 2.08}, travel={"x": 1.5, "l": 0.0})
    assert "Take alike: " in describe_rivals({"quick": quick, "alike": alike, "calm": calm})
    assert "none is recommended" in describe_rivals({"never": never})


def test_what_is_read_has_the_noise_of_encoders():
    """That of `tune` unless told: what a controller answers on a rig shows in its voltages."""
    run = runs()["plain"]
    for axis, size in zip(("x", "psi", "l"), run.noise, strict=True):
        assert np.std(run.measured[axis] - run.position[axis]) == pytest.approx(size, rel=0.2)
    path = smooth_path([(0.2, 0.5), (0.8, 0.5)], speed=(0.9, 0.2), rest=4.0, period=0.02)
    still = track(MODEL, PID, path, noise=(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(still.measured["x"], still.position["x"])
    assert run.moves[0].travel["x"] > 1.05 * still.moves[0].travel["x"]


@pytest.mark.parametrize("key", ["x", "l"])
def test_what_is_followed_begins_and_ends_where_wanted(key):
    plain, shaped = (run.reference[key] for run in runs().values())
    assert shaped[0] == plain[0] and shaped[-1] == pytest.approx(plain[-1], abs=1e-12)
