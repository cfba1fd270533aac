"""What the report on a tuned controller warns of in its first lines."""

import numpy as np

from jbridge.control.files import Controller
from jbridge.control.linear import Pid
from jbridge.report.control.tuning import warnings
from jbridge.simulation.summaries import UNITS
from jbridge.tuning.tune import Tuning


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
        rollouts=0,
        seconds=0.0,
    )


def test_nothing_that_is_no_worse_is_warned_of():
    assert warnings(tuning(chatter_x=np.full((2, 2), 2.0), settling_load=np.zeros((2, 2)))) == []


def test_more_than_twice_the_travel_or_sign_changes_is_warned_of():
    (said,) = warnings(tuning(chatter_x=np.array([[1.0, 1.0], [1.0, 6.0]])))
    assert said == "travel of u_x went from 1.00 to 2.25 V/s on average, more than twice."
    (said,) = warnings(tuning(sign_changes_l=np.full((2, 2), 40.0)))
    assert said == "sign changes of u_l went from 1.00 to 40.0 on average, more than twice."
    # A loop that runs away has no numbers.
    assert len(warnings(tuning(chatter_l=np.full((2, 2), np.nan)))) == 1


def test_moves_that_never_settle_are_warned_of():
    (said,) = warnings(tuning(settling_load=np.array([[1.0, np.nan], [np.nan, 2.0]])))
    assert said == "the load does not settle in 2 of 4 moves (0 as given)."
