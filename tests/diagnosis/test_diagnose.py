"""A whole diagnosis of a cart: an effect that is missing, none that is, and the same answer twice."""

import dataclasses

import numpy as np
import pytest

from jbridge import diagnose, simulate
from jbridge.diagnosis.validation.holdout import split_off
from tests.identification.cases import DRY, NOISE, cart_model, cart_recordings, make_recording, scaled, values
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
    assert missing.verdict == "missing_physics" and missing.complete and missing.adequacy.alarm
    assert missing.stopped == "criterion" and missing.explained["x"] > 0.98 and missing.explained["all"] > 0.98
    assert missing.adequacy.repeatable_before >= 0.3
    (effect,) = missing.effects
    assert (effect.kind, effect.site) == ("quadratic_drag", "cart")
    found = effect.parameters["coefficient"]
    assert found.low <= DRAG <= found.high or abs(found.value - DRAG) < 0.05 * DRAG
    assert missing.location.site == "cart" and missing.location.equation == "cart"
    assert sum(missing.location.sites.values()) == pytest.approx(1.0, abs=1e-3)


def test_the_missing_force_is_a_drag(missing):
    likeness = missing.location.likeness
    # Beside a viscous damping that was refitted without it, and that takes up half of it.
    assert likeness.odd > 0.9 and max(likeness.by["v_x"], likeness.by["x, direction"]) > 0.25
    assert [force.recording for force in missing.location.forces] == ["run-1.csv", "run-2.csv", "run-3.csv"]


def test_whoever_runs_the_model_gets_the_reported_errors(missing):
    run = rig(("quadratic_drag", "cart", {"coefficient": DRAG}))[3]
    for model, errors in ((missing.before, missing.holdout_before), (missing.model, missing.holdout_after)):
        # The same recording, state and steps: what is left is rounding.
        assert simulate(model, run).errors["x"] == pytest.approx(errors.free_run["x"], rel=1e-3)


def test_the_hold_out_proves_it(missing):
    before, after = missing.holdout_before.free_run["x"], missing.holdout_after.free_run["x"]
    assert before > 5 * NOISE["x"] and after < 1.5 * NOISE["x"]
    assert missing.holdout == ("run-4.csv",)
    assert {t.role for t in missing.traces if t.recording == "run-4.csv"} == {"holdout"}
    (effect,) = missing.effects
    assert effect.status == "confirmed" and effect.explained > 0.9
    assert [row.seconds for row in missing.horizons] == [0.1, 0.3, 1.0, 2.0, 3.0]
    assert all(row.after["x"] < 1.5 * NOISE["x"] for row in missing.horizons)


def test_what_was_tried_is_told(missing):
    assert [row["kind"] for row in missing.trials if row["accepted"]] == ["quadratic_drag"]
    assert all(row["gain"] > row["price"] for row in missing.trials if row["accepted"])
    # A model with one effect more meets its recordings at least as well.
    assert all(row["gain"] > -1e-6 for row in missing.trials if row["change"] == "added")


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
        ("wrong_value", "cart_mass"),
    } <= kinds
    assert not kinds & {("quadratic_drag", "cart"), ("coulomb_friction", "cart"), ("coulomb_friction", "hoist")}
    rows = {(row.kind, row.parameter): row for row in missing.not_seen}
    # A cart's readings tell nothing of its mass, and little stays hidden of a constant force.
    assert rows["wrong_value", "value"].limit is None and rows["wrong_value", "value"].notable
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


def test_what_one_recording_alone_shows_is_learned():
    runs = rig()
    times = runs[0].times
    hoist = make_recording("hoist.csv", times, u_l=np.sin(times), l=0.6 + 0.1 * np.sin(times))
    kept, held, note = split_off([*runs, hoist])
    assert [r.name for r in held] == ["run-4.csv"] and kept[-1] is hoist and "run-4.csv" in note


@pytest.mark.parametrize("when", ["round 1", "leaving out"])
def test_an_interrupt_leaves_what_was_found(missing, when):
    def stop(text):
        if str(text).startswith(when):
            raise KeyboardInterrupt

    runs = rig(("quadratic_drag", "cart", {"coefficient": DRAG}))
    found = diagnose(model(), runs[:3], runs[3:], progress=stop)
    assert found.stopped == "interrupted" and found.verdict is None and not found.horizons
    kinds = [effect.kind for effect in found.effects]
    assert kinds == ([] if when == "round 1" else ["quadratic_drag"])
    assert [e.kind for e in found.model.plant.effects] == ["coulomb_friction", *kinds]


def test_without_a_hold_out_the_last_quarter_is_one():
    runs = rig()
    kept, held, note = split_off(runs)
    assert [r.name for r in held] == ["run-4.csv"] and len(kept) == 3 and "run-4.csv" in note
    (first,), (last,), note = split_off(runs[:1])
    assert last.times[0] == pytest.approx(4.5, abs=0.02) and first.times[-1] < last.times[0]
    assert len(first.times) + len(last.times) == len(runs[0].times)
    # Drift and wind go by the time since the run began.
    assert first.begun == 0.0 and last.begun == pytest.approx(4.5, abs=0.02)


@pytest.mark.slow
def test_what_happens_in_one_recording_is_an_event_of_that_one():
    """Counts that one run misses, beside a drag that all of them show, and beside nothing else."""
    for more, verdict in (((("quadratic_drag", "cart", {"coefficient": DRAG}),), "missing_physics"), ((), "adequate")):
        runs = rig(*more)
        lost = dataclasses.replace(runs[1], x=np.where(runs[1].times >= 3.13, runs[1].x + 0.004, runs[1].x))
        found = diagnose(model(), [runs[0], lost, runs[2]], runs[3:])
        assert found.verdict == verdict and found.complete
        event = found.effects[-1]
        assert (event.kind, event.site, event.status) == ("missed_counts", "x_sensor", "event")
        assert event.recording == "run-2.csv" in found.effects[-1].statement and not event.in_model
        assert event.parameters["jump"].value == pytest.approx(0.004, rel=0.05)
        assert event.parameters["time"].value == pytest.approx(3.13, abs=0.02)
        assert 2.9 < event.parameters["time"].low < 3.13 < event.parameters["time"].high < 3.4
        # The event is no part of the model, and bends none of its numbers.
        assert [e.kind for e in found.model.plant.effects] == ["coulomb_friction", *(kind for kind, *_ in more)]
        assert float(found.model.plant.bridge.cart_damping) == pytest.approx(30.0, rel=0.01)
        assert {e.kind for e in found.effects[:-1]} == {kind for kind, *_ in more}
        assert ("run-2.csv" in found.statement) == (verdict == "adequate")
