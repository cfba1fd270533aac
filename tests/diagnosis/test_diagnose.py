"""A whole diagnosis of a cart: an effect that is missing, none that is, and the same answer twice."""

import dataclasses

import numpy as np
import pytest

from jbridge import diagnose
from jbridge.diagnosis.attempt import _refuted, as_good
from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.holdout import split_off
from jbridge.diagnosis.rounds import Explained
from jbridge.diagnosis.screen import Screen, Screened
from jbridge.diagnosis.search import Search, state_of
from jbridge.diagnosis.steps import Step
from jbridge.diagnosis.trials import State
from jbridge.identification.problem import make_setting
from jbridge.identify.base import base_fit, columns_for
from jbridge.identify.solve import solve
from tests.identify.cases import DRY, NOISE, cart_model, cart_recordings, scaled, values
from tests.problems import make_plant

DRAG = 60.0
"""Drag [N s^2/m^2] that takes half of the force at the highest speed."""
START = {"cart_damping": 0.9, "cart_gain": 1.1, "coulomb_friction@cart.level": 0.9}


def model():
    return scaled(cart_model(DRY, cart_damping=30.0, cart_gain=16.0), START)


def rig(*more):
    return cart_recordings(make_plant(DRY, *more, cart_damping=30.0, cart_gain=16.0), 4, seed=3)


@pytest.fixture(scope="module")
def missing():
    runs = rig(("quadratic_drag", "cart", {"coefficient": DRAG}))
    return diagnose(model(), runs[:3], runs[3:])


def test_missing_physics_is_named_with_its_number(missing):
    assert missing.verdict == "missing_physics" and missing.adequacy.alarm
    assert missing.adequacy.p_value <= 0.01 and missing.adequacy.learnable_before >= 0.3
    (effect,) = missing.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    found = effect.parameters["coefficient"]
    assert found.low <= DRAG <= found.high or abs(found.value - DRAG) < 0.05 * DRAG
    assert missing.location.site == "cart" and missing.location.equation == "cart"
    assert sum(missing.location.sites.values()) == pytest.approx(1.0, abs=1e-3)


def test_the_missing_force_is_a_drag(missing):
    assert max(missing.location.evidence, key=lambda site: missing.location.evidence[site]) == "cart"
    likeness = missing.location.likeness
    # Beside a viscous damping that was refitted without it, and that takes up half of it.
    assert likeness.odd > 0.9 and max(likeness.by["v_x"], likeness.by["x, direction"]) > 0.25
    assert [force.recording for force in missing.location.forces] == ["run-1.csv", "run-2.csv", "run-3.csv"]


def test_the_hold_out_proves_it(missing):
    before, after = missing.holdout_before.free_run["x"], missing.holdout_after.free_run["x"]
    assert before > 5 * NOISE["x"] and after < 1.5 * NOISE["x"]
    assert missing.holdout == ("run-4.csv",)
    assert {t.role for t in missing.traces if t.recording == "run-4.csv"} == {"holdout"}


def test_what_was_tried_is_told(missing):
    assert [row["kind"] for row in missing.trials if row["accepted"]] == ["quadratic_drag"]
    assert all(row["why"] for row in missing.trials if not row["accepted"])
    assert len(missing.trials) >= 2


def test_the_final_model_has_the_effect(missing):
    assert [e.kind for e in missing.model.plant.effects] == ["coulomb_friction", "quadratic_drag"]
    assert [e.kind for e in missing.before.plant.effects] == ["coulomb_friction"]
    assert [e.kind for e in missing.model_effects] == ["coulomb_friction"]


def test_what_was_not_named_has_limits(missing):
    """Every effect of a cart once, but for what was named and what the model has."""
    kinds = {(row.kind, row.site) for row in missing.not_seen}
    assert {
        ("dead_zone", "cart_drive"),
        ("end_stop", "cart"),
        ("backlash", "cart"),
        ("wrong_value", "cart_mass"),
    } <= kinds
    assert not kinds & {("quadratic_drag", "cart"), ("coulomb_friction", "cart"), ("coulomb_friction", "hoist")}
    rows = {(row.kind, row.parameter): row for row in missing.not_seen}
    # A cart's readings tell nothing of where its zero is, and little stays hidden of a constant force.
    assert rows["sensor_offset", "offset"].limit is None and rows["sensor_offset", "offset"].notable
    assert 0 < rows["constant_force", "level"].limit < 0.05 and not rows["constant_force", "level"].notable


def test_wrong_numbers_alone_raise_no_alarm():
    runs = rig()
    found = diagnose(model(), runs[:3], runs[3:])
    assert found.verdict == "adequate" and not found.adequacy.alarm
    assert found.effects == () and found.location.site is None and found.location.equation == "none"
    assert found.holdout_after.free_run["x"] < 1.5 * NOISE["x"]
    again = diagnose(model(), runs[:3], runs[3:])
    assert _plain(found) == _plain(again)


@pytest.mark.slow
def test_the_same_call_gives_the_same_report(missing):
    runs = rig(("quadratic_drag", "cart", {"coefficient": DRAG}))
    assert _plain(diagnose(model(), runs[:3], runs[3:])) == _plain(missing)


def _plain(found):
    """Everything that a report tells, but for the seconds."""
    left_out = ("seconds", "traces", "model", "before")
    told = {f.name: getattr(found, f.name) for f in dataclasses.fields(found) if f.name not in left_out}
    curves = [[t.after[axis].tolist() for axis in t.after] for t in found.traces]
    return repr(told), values(found.model.plant), values(found.before.plant), curves


def test_without_a_hold_out_the_last_quarter_is_one():
    runs = rig()
    kept, held, note = split_off(runs)
    assert [r.name for r in held] == ["run-4.csv"] and len(kept) == 3 and "run-4.csv" in note
    (first,), (last,), note = split_off(runs[:1])
    assert last.times[0] == pytest.approx(4.5, abs=0.02) and first.times[-1] < last.times[0]
    assert len(first.times) + len(last.times) == len(runs[0].times)
    # Drift and wind go by the time since the run began.
    assert first.begun == 0.0 and last.begun == pytest.approx(4.5, abs=0.02)


def test_only_parts_of_the_method_can_be_left_out():
    runs = rig()
    with pytest.raises(ValueError, match="can do without .*, and not without hold-out"):
        diagnose(model(), runs, leave_out=("hold-out",))


def test_without_rescreening_the_first_ranking_stands(monkeypatch):
    def told(kind, cost, step):
        candidate = Candidate(kind, "cart", {}, ("level",), False)
        return Screened(candidate, cost, 1.0 - cost, (), np.zeros(0), np.array([step]))

    rounds = [
        Screen(
            [told("constant_force", 0.2, 1.0), told("quadratic_drag", 0.5, 2.0), told("spring_force", 0.7, 3.0)], 0.5
        ),
        Screen([told("spring_force", 0.1, 4.0), told("quadratic_drag", 0.6, 5.0)], 0.4),
    ]
    monkeypatch.setattr(Search, "_screen", lambda search, state: rounds[len(state.accepted)])
    setting = make_setting(model(), rig(), ())
    less, whole = (
        Search(make_plant(), frozenset(), setting, None, leave_out=frozenset(part)) for part in (["rescreening"], [])
    )
    state = object.__new__(State)  # of a state only what was accepted matters here
    object.__setattr__(state, "accepted", ())
    assert less.look(state).ranked == rounds[0].ranked
    object.__setattr__(state, "accepted", (rounds[0].ranked[0].candidate,))
    found = less.look(state)
    # The order and what is expected stay; where a refit starts is of today.
    assert [(s.candidate.kind, s.cost, float(s.own_step[0])) for s in found.ranked] == [
        ("quadratic_drag", 0.5, 5.0), ("spring_force", 0.7, 4.0),
    ]  # fmt: skip
    assert found.learnable == 0.4
    assert whole.look(state).ranked == rounds[1].ranked


def test_a_better_start_is_no_missing_physics():
    """A fit that stopped short leaves errors, and an effect's refit takes them up with steps of the model's own."""
    far, runs = scaled(cart_model(DRY, cart_damping=30.0, cart_gain=16.0), {"cart_gain": 1.5}), rig()
    good = base_fit(far.plant, far.known, make_setting(far, runs, ()))
    start, width = np.array(good.engine.table.ravel(far.plant)), columns_for(len(good.free))
    fits = solve(good.engine, good.free_run, start[None], [good.free], columns=width, iterations=2)
    short = dataclasses.replace(good, vector=fits.vectors[0], fits=fits)
    assert short.chi > 1.5 * good.chi
    state = state_of(good.engine, good.free_run, good.fits, far.known)
    step = object.__new__(Step)  # what was accepted does not matter here, only that something was
    for base, told, better in (
        (short, Explained(state, [step], 0.5, 0.0, None, []), True),
        (short, Explained(state_of(short.engine, short.free_run, fits, far.known), [], 0.5, 0.5, None, []), False),
        (good, Explained(dataclasses.replace(state, cost=0.5 * state.cost), [step], 0.5, 0.0, None, []), False),
        (good, Explained(state, [step], 0.5, 0.5, None, []), False),
    ):
        found = as_good(base, told)
        assert (found is not None) == better
        assert found is None or found.chi < 1.01 * good.chi


def test_what_is_withdrawn_leaves_the_model_as_given_on_the_lanes_that_are_compared():
    """A curve is then fitted beside it on the same lanes."""
    own, runs = model(), rig()
    setting = make_setting(own, runs, ())
    base = base_fit(own.plant, own.known, setting)
    whole = state_of(base.engine, base.free_run, base.fits, own.known)
    for window, lanes in ((2.0, base.windows), (None, base.free_run)):
        search = Search(own.plant, own.known, setting, window)
        found = _refuted(Explained(whole, [], 0.5, 0.0, None, []), search, base)
        assert found.state.batch.count == lanes.count and not found.steps
        assert found.state.chi < 1.2
