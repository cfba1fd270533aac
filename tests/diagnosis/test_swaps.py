"""What looks like an accepted explanation is refitted in its place, beside all the others, and the better one stays."""

import pytest

from jbridge.diagnosis import ties
from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.search import Search
from jbridge.diagnosis.steps import Step
from jbridge.diagnosis.swaps import compare_look_alikes
from jbridge.diagnosis.trials import as_trial
from jbridge.identify.lanes import make_batch
from jbridge.identify.setting import make_setting
from tests.identify.cases import DRY, NOISE, cart_model, cart_recordings
from tests.problems import make_plant

DRAG = ("quadratic_drag", "cart", {"coefficient": 30.0})
SPRING = ("spring_force", "cart", {"stiffness": 20.0, "rest": 0.6})
LATE = ("input_delay", "cart_drive", {"delay": 0.02})


@pytest.mark.slow
@pytest.mark.parametrize(("true", "taken"), [(DRAG, SPRING), (DRAG, DRAG)])
def test_the_better_of_two_that_look_alike_stays(monkeypatch, true, taken):
    monkeypatch.setattr(ties, "_ALIKE", (DRAG[:2], SPRING[:2]))
    runs = cart_recordings(make_plant(DRY, true, LATE), 3, seconds=6.0)
    model = cart_model(DRY)
    setting = make_setting(model, runs, ())
    search = Search(model.plant, model.known, setting, None)
    accepted = tuple(Candidate(kind, site, numbers, tuple(numbers), False) for kind, site, numbers in (taken, LATE))
    near = make_batch(runs, NOISE).initial
    state = search.polish(make_plant(DRY, taken, LATE), model.known, near, accepted)
    steps = [Step(i + 1, trial := as_trial(state, c, 10.0), [trial], {}) for i, c in enumerate(accepted)]
    found, told = compare_look_alikes(search, state, steps)
    names = {true[:2], LATE[:2]}
    assert {candidate.name for candidate in found.accepted} == names
    assert {step.chosen.candidate.name for step in told} == names and [step.number for step in told] == [1, 2]
    assert found.chi < 1.1 and found.cost <= state.cost
    tried = {trial.candidate.name: trial.cost for trial in told[0].trials}
    assert set(tried) == {DRAG[:2], SPRING[:2]} and tried[SPRING[:2]] > 1.5 * tried[DRAG[:2]]
    assert told[1] is steps[1]
