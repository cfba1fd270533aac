"""The linear screen looks closely where two seeds have much between them."""

import pytest

from jbridge.diagnosis.search import Search, state_of
from jbridge.identification.problem import make_setting
from jbridge.identify.base import base_fit
from tests.identify.cases import DRY, cart_model, cart_recordings
from tests.problems import make_plant


@pytest.mark.slow
def test_a_jump_is_timed_to_a_sample():
    """Seeds lie 0.14 s apart here, and a fit that starts between two samples would not move from there."""
    jump = ("missed_counts", "x_sensor", {"jump": 1.4e-3, "time": 3.274})
    runs = cart_recordings(make_plant(DRY, jump, cart_damping=50.0, cart_gain=15.0), 3, seconds=6.0)
    model = cart_model(DRY, cart_damping=50.0, cart_gain=15.0)
    setting = make_setting(model, runs, ())
    base = base_fit(model.plant, model.known, setting)
    found = Search(model.plant, model.known, setting, None).look(
        state_of(base.engine, base.free_run, base.fits, model.known)
    )
    best = found.ranked[0]
    assert best.candidate.name == ("missed_counts", "x_sensor")
    assert best.candidate.values["time"] == pytest.approx(3.274, abs=runs[0].period)
    assert best.own_step[0] == pytest.approx(1.4e-3, rel=0.1)
