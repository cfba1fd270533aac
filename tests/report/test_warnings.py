"""What reports on a controller warn of in their first lines."""

import dataclasses
import re

import numpy as np
import pytest

from jbridge.control.files import Controller
from jbridge.control.linear import Pid
from jbridge.model.files import Model
from jbridge.report.control.tracking import describe_tracking
from jbridge.report.control.warnings import tracking_warnings
from jbridge.report.control.warnings import tuning_warnings as warnings
from jbridge.simulation.move_summary import UNITS
from jbridge.simulation.tracking import track
from jbridge.trajectory import smooth_path
from jbridge.tuning.compensation import compensation_for
from jbridge.tuning.tune import Tuning
from tests.problems import NUMBERS, make_plant


def tuning(**after):
    """One with measures of 1 before and after, but for those given."""
    before = {name: np.ones((2, 2)) for name in UNITS}
    measures = {"train": (before, before), "held_out": (before, before | after)}
    none = np.zeros(1)
    given = Controller(Pid())
    return Tuning(
        controller=given,
        given=given,
        coordinates={},
        history=none,
        softness=none,
        costs={},
        measures=measures,
        responses=({}, {}),
        reached={"x": (0.0, 1.2), "l": (0.185, 0.7)},
        recorded={},
        units={},
        rollouts=0,
        seconds=0.0,
    )


def test_nothing_that_is_no_worse_is_warned_of():
    assert warnings(tuning(chatter_x=np.full((2, 2), 2.0), settling_load=np.zeros((2, 2)))) == []


def test_more_than_twice_the_travel_or_sign_changes_is_warned_of():
    (said,) = warnings(tuning(chatter_x=np.array([[1.0, 1.0], [1.0, 6.0]])))
    assert said == "travel of u_x rose from 1.00 to 2.25 V/s on average, by more than a factor of two."
    (said,) = warnings(tuning(sign_changes_l=np.full((2, 2), 40.0)))
    assert said == "sign changes of u_l rose from 1.00 to 40.0 on average, by more than a factor of two."
    (said,) = warnings(tuning(saturation_x=np.full((2, 2), 2.5)))
    assert said == "time of u_x at the limit rose from 100 to 250 % on average, by more than a factor of two."
    # A loop that runs away has no numbers.
    assert len(warnings(tuning(chatter_l=np.full((2, 2), np.nan)))) == 1


def test_moves_that_never_settle_are_warned_of():
    (said,) = warnings(tuning(settling_load=np.array([[1.0, np.nan], [np.nan, 2.0]])))
    assert said == "the load does not settle in 2 of 4 moves (0 as given)."


def test_moves_outside_of_the_recordings_are_warned_of():
    within = dataclasses.replace(tuning(), recorded={"x": (0.005, 1.3), "l": (0.1, 0.695)})
    assert warnings(within) == []
    (said,) = warnings(dataclasses.replace(within, recorded={"x": (0.1, 0.9), "l": (0.1, 0.8)}))
    assert said == (
        "the moves go from 0 to 1.2 m in cart position, but the recordings behind the model cover 0.1 to 0.9 m; "
        "outside of that the model extrapolates."
    )


def test_a_reference_outside_of_the_recordings_is_warned_of_first():
    model = Model(make_plant(), frozenset(), frozenset(NUMBERS), {}, recorded={"x": (0.0, 1.0), "l": (0.3, 0.6)})
    path = smooth_path([(0.2, 0.4), (0.7, 0.5)], speed=(0.3, 0.2), rest=4.0, period=0.02)
    pid = Controller(Pid(cart_p=60.0, hoist_p=60.0, compensation=compensation_for(model.plant)))
    assert not any("extrapolates" in line for line in describe_tracking(track(model, pid, path)).splitlines())
    path = smooth_path([(0.2, 0.4), (0.7, 0.65)], speed=(0.3, 0.2), rest=4.0, period=0.02)
    warned = [line for line in describe_tracking(track(model, pid, path)).splitlines() if "Warning" in line]
    assert warned[-1].startswith("Warning: the reference goes from 0.4 to 0.65 m in rope length")
    assert describe_tracking(track(model, pid, path)).startswith("Warning: ")


def run_of(*, recorded=None, units=None, **changed):
    """One along 0.2 to 0.7 m, with positions and commands replaced."""
    model = Model(make_plant(), frozenset(), frozenset(NUMBERS), {}, recorded=recorded or {})
    pid = Controller(Pid(cart_p=60.0, hoist_p=60.0, compensation=compensation_for(model.plant)))
    run = track(model, pid, smooth_path([(0.2, 0.4), (0.7, 0.5)], speed=(0.3, 0.2), rest=4.0, period=0.02))
    run = dataclasses.replace(run, units=units or {})
    own = {"x": run.position, "u_x": run.command}
    for key, change in changed.items():
        name = "position" if key == "x" else "command"
        run = dataclasses.replace(run, **{name: {**own[key], key: change(run.times, own[key][key])}})
    return run


@pytest.mark.parametrize(
    ("run", "said"),
    [
        ({}, "^$"),
        ({"x": lambda t, x: x - 2.0 * t}, "the run goes from -1.* m in cart position, the reference from 0.2 to 0.7 m"),
        (
            {"x": lambda t, x: x + 0.1, "recorded": {"x": (0.1, 0.75)}},
            "the run goes from 0.3 to 0.8.* but the recordings behind the model cover 0.1 to 0.75 m",
        ),
        ({"u_x": lambda t, u: np.where(t < 4.0, 3.0, 0.0)}, "u_x is at its limit of 3.00 V in .. % of the time"),
        ({"u_x": lambda t, u: 3.0 * np.sign(np.sin(20.0 * t))}, "u_x chatters: it travels .. V/s and changes its sign"),
    ],
)
def test_a_dangerous_run_is_warned_of(run, said):
    """A cart beyond the rail, a drive that is at its limit most of the time, and one that cannot follow."""
    warned = [line for line in tracking_warnings(run_of(**run)) if "settle" not in line]
    assert re.search(said, " ".join(warned))


def test_numbers_are_written_without_exponents_and_in_the_inputs_own_unit():
    run = run_of(x=lambda t, x: x - 2.0 * t, units={"u_x": "count", "u_l": "count"})
    text = describe_tracking(run)
    assert "count/s" in text and "V/s" not in text and not re.search(r"\de[+-]\d", text)
