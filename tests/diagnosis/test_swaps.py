"""What looks like an accepted explanation is refitted in its place, beside all the others, and the better one stays."""

import numpy as np
import pytest

from jbridge.diagnosis import ties
from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.search import Search
from jbridge.diagnosis.steps import Step
from jbridge.diagnosis.swaps import compare_look_alikes
from jbridge.diagnosis.trials import as_trial
from jbridge.identification.problem import make_setting
from jbridge.identify.lanes import make_batch
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


@pytest.mark.slow
def test_a_spring_beside_a_delay_is_not_left_to_a_map_of_friction():
    spring = ("spring_force", "cart", {"stiffness": 2.0, "rest": 0.6})
    runs = cart_recordings(make_plant(DRY, spring, LATE), 3, seconds=6.0)
    model = cart_model(DRY)
    search = Search(model.plant, model.known, make_setting(model, runs, ()), None)
    low, high = min(run.x.min() for run in runs), max(run.x.max() for run in runs)
    places = np.linspace(low, high, 5)
    force = spring[2]["stiffness"] * (places - spring[2]["rest"])
    levels = {"positive": force - force.min(), "negative": force.max() - force}
    both = ("position_direction_friction", "cart", {"knots": places} | levels)
    accepted = (
        Candidate(*both[:2], both[2], ("positive", "negative"), False),
        Candidate(*LATE[:2], LATE[2], ("delay",), False),
    )
    near = make_batch(runs, NOISE).initial
    state = search.polish(make_plant(DRY, both, LATE), model.known, near, accepted)
    assert state.chi < 3.0
    steps = [Step(i + 1, trial := as_trial(state, c, 10.0), [trial], {}) for i, c in enumerate(accepted)]
    found, told = compare_look_alikes(search, state, steps)
    assert found.chi < 1.1
    assert {candidate.name for candidate in found.accepted} == {spring[:2], LATE[:2]}
    assert {step.chosen.candidate.name for step in told} == {spring[:2], LATE[:2]}
    mended = next(effect for effect in found.plant.effects if effect.kind == "spring_force")
    assert mended.stiffness == pytest.approx(2.0, rel=0.05) and mended.rest == pytest.approx(0.6, abs=0.02)
