"""Two laws that hold on recordings left out only together: the first is taken for a try, and given back if in vain."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis import rounds
from jbridge.diagnosis.ahead import Before, leading
from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.rounds import accept_effects
from jbridge.diagnosis.screen import Screen
from jbridge.diagnosis.search import Search
from jbridge.diagnosis.trials import NOT_HELD, State, Trial, accepts
from jbridge.identification.problem import make_setting
from jbridge.identify.base import BaseFit
from jbridge.identify.lanes import make_batch
from jbridge.identify.linearise import Engine
from jbridge.model.files import Model
from tests.identify.cases import NOISE, make_recording
from tests.problems import make_plant

TIMES = np.arange(100) * 0.01
PLANT = make_plant()
ENGINE = Engine(PLANT)
RUNS = [make_recording(f"{name}.csv", TIMES, u_x=np.sin(TIMES), x=np.cos(TIMES)) for name in "ab"]
BATCH = make_batch(RUNS, NOISE, size=ENGINE.table.size)
GIVEN = frozenset({"cart_mass", "cart_gain"})
NOISE_ALONE = 202.0
FIELDS = dict(
    plant=PLANT,
    known=frozenset(),
    engine=ENGINE,
    batch=BATCH,
    vector=np.array(ENGINE.table.ravel(PLANT)),
    free=np.zeros(0, np.int64),
    initial=BATCH.initial,
)


def fitted(cost, left_out):
    return FIELDS | {"cost": cost, "cross_validated": left_out, "ratios": {"x": float(np.sqrt(cost / NOISE_ALONE))}}


def state(cost, left_out, *accepted):
    return State(**fitted(cost, left_out), accepted=accepted)


def trial(kind, cost, left_out):
    candidate = Candidate(kind, "cart", {}, ("level",), False)
    return Trial(**fitted(cost, left_out), candidate=candidate, z=50.0, extra=1)


DRY, DRAG, TILT = "coulomb_friction", "quadratic_drag", "constant_force"


def test_the_leader_failed_on_nothing_but_recordings_left_out():
    trials = [trial(TILT, 2e3, 1e4), trial(DRY, 3e3, 2e4), trial(DRAG, 4e3, 2e4)]
    reasons = {(TILT, "cart"): "its interval includes its absence"} | {(k, "cart"): NOT_HELD for k in (DRY, DRAG)}
    assert leading(state(1e4, 1e4), trials, reasons) == trials[1:]
    # What explains less than half of it may be anything.
    assert leading(state(5e3, 1e4), trials, reasons) == []
    # Nor is it one that may as well be absent, or cannot be.
    faint = dataclasses.replace(trials[1], z=1.0)
    assert accepts(state(1e4, 1e4), trials[1], 0.3, 0.03, NOISE_ALONE) == NOT_HELD
    assert accepts(state(1e4, 1e4), faint, 0.3, 0.03, NOISE_ALONE) == "its interval includes its absence"


def test_both_hold_together_against_the_model_without_either():
    before = Before(state(1e4, 1e4), (), Screen([], 0.0), 0.0, [])
    assert before.holds(trial(DRAG, 1e3, 4e3), 0.3, NOISE_ALONE)
    assert not before.holds(trial(DRAG, 1e3, 8e3), 0.3, NOISE_ALONE)


@pytest.mark.parametrize(("left_out", "named"), [(3e3, [DRY, DRAG]), (9e3, [])])
def test_a_leader_is_named_only_with_what_bears_it_out(monkeypatch, left_out, named):
    """Beside the dry friction drag always helps; whether both help on recordings left out decides."""
    weighed = {
        (): [trial(DRY, 4e3, 3e4), trial(DRAG, 9.5e3, 2e4)],
        (DRY,): [trial(DRAG, 210.0, left_out)],
        (DRY, DRAG): [],
    }
    polished = {(DRY,): (4e3, 3e4), (DRY, DRAG): (210.0, left_out)}
    search = Search(PLANT, frozenset(), make_setting(Model(PLANT, frozenset(), GIVEN, {}, "cart.toml"), RUNS, ()), 2.0)
    monkeypatch.setattr(
        search,
        "polish",
        lambda plant, known, near, accepted: state(*polished[tuple(a.kind for a in accepted)], *accepted),
    )
    monkeypatch.setattr(search, "smooth", lambda state: state)
    monkeypatch.setattr(rounds, "nothing_accepted", lambda search, base: state(1e4, 1e4))
    monkeypatch.setattr(
        rounds, "_weigh", lambda search, state: (Screen([], 0.1), weighed[tuple(a.kind for a in state.accepted)])
    )
    for name in ("simplify", "finer", "coarser", "prune", "_back_to_free_runs"):
        monkeypatch.setattr(rounds, name, lambda search, state, place=-1: state)
    monkeypatch.setattr(rounds, "compare_look_alikes", lambda search, state, steps: (state, steps))
    found = accept_effects(search, object.__new__(BaseFit), True)  # nothing of it is asked
    assert [candidate.kind for candidate in found.state.accepted] == named
    assert [step.chosen.candidate.kind for step in found.steps] == named
    if named:
        # What holds on recordings left out repeats: (1e4 - 3e3) of what is not noise.
        assert found.learnable == pytest.approx(7e3 / (1e4 - NOISE_ALONE), rel=0.01)
    else:
        assert found.learnable == 0.1
        assert [why for _, why in found.refused] == [NOT_HELD, NOT_HELD]
