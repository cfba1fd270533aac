"""One recording of several that something happened in: it stands out, and the others' model meets it until then."""

import numpy as np
import pytest

from jbridge.diagnosis.aside import event, stands_out
from jbridge.diagnosis.diagnose import diagnose
from jbridge.diagnosis.words import aside_sentence
from jbridge.identification.problem import make_setting
from tests.diagnosis.test_once import run
from tests.identify.cases import DRY, NOISE, cart_model, cart_recordings, play
from tests.problems import make_plant


@pytest.mark.parametrize(
    ("sizes", "odd"),
    [
        ([2.7, 4.3, 9.3, 2.1, 1.9], 2),
        ([1.0, 1.0, 1.0, np.inf], 3),
        ([1.0, 1.0, np.inf, np.inf], None),
        # Wandering friction, a law that shows in half of them, and too few to spare one.
        ([1.4, 2.9, 2.0, 1.0], None),
        ([9.0, 30.0, 17.0, 1.0, 1.2], None),
        ([1.0, 30.0, 1.0], None),
        ([0.2, 0.3, 1.2, 0.4], None),
    ],
)
def test_a_recording_stands_out_by_twice_the_next_one(sizes, odd):
    met = run(sizes)
    assert stands_out(met.batch, met.predicted) == odd


MODEL = cart_model(DRY, cart_damping=30.0)


def found(runs, plant=MODEL.plant):
    return event(plant, make_setting(MODEL, runs, ()), runs[-1], runs[:-1])


def test_a_jump_is_timed_and_sized():
    runs = cart_recordings(MODEL.plant, 4)
    runs[-1].x[312:] += 2e-3
    when, channel, ratio, beyond = found(runs)
    assert when.recording == runs[-1].name and channel == "x" and beyond is None
    assert when.start == pytest.approx(3.12, abs=0.02) and when.stop == pytest.approx(6.0, abs=0.02)
    assert ratio == pytest.approx(2e-3 / NOISE["x"], rel=0.1)


def test_a_law_is_not_taken_for_something_that_happened():
    """What is met well throughout, and what is off from the start, are no events."""
    runs = cart_recordings(MODEL.plant, 4)
    assert found(runs) is None
    assert found(runs, cart_model(DRY, cart_damping=36.0).plant) is None
    runs[-1].x[40:] += 2e-3
    assert found(runs) is None


def test_what_begins_where_no_other_recording_goes_may_be_a_law():
    """A spring that only the last recording reaches."""
    runs = cart_recordings(MODEL.plant, 4)
    reach = max(run.x.max() for run in runs)
    bumper = ("end_stop", "cart", {"position": reach + 0.05, "stiffness": 4000.0, "damping": 0.0})
    push = np.zeros((600, 2))
    push[:, 0] = np.concatenate([np.tile(np.repeat([1.0, -1.0], 50), 2), np.full(400, 2.0)])
    runs[-1] = play(make_plant(DRY, bumper, cart_damping=30.0), push, name="far.csv")
    begun = float(runs[-1].times[np.argmax(runs[-1].x > reach + 0.05)])
    when, channel, _, beyond = found(runs)
    assert channel == "x" and beyond == "x" and when.start == pytest.approx(begun, abs=0.2)
    told = aside_sentence("far.csv", when.start, channel, 60.0, beyond)
    assert "cart position is beyond that of any other recording" in told and "--with" in told


def test_a_glitch_is_not_the_instant():
    """One sample that is off before a reading jumps for good, and noise somewhat larger than in the other runs."""
    runs = cart_recordings(MODEL.plant, 4)
    runs[-1].x[150] += 8 * NOISE["x"]
    assert found(runs) is None
    runs[-1].x[:] += 0.7 * NOISE["x"] * np.random.default_rng(1).standard_normal(len(runs[-1].x))
    runs[-1].x[312:] += 2e-3
    assert found(runs).when.start == pytest.approx(3.12, abs=0.02)


def test_a_law_that_begins_at_a_speed_may_be_one():
    """Drag of a cart that the same voltage drives longer, and therefore faster, than in the other recordings."""
    to_and_fro = np.tile(np.repeat([2.0, -2.0], 20), 15)
    longer = np.concatenate([to_and_fro[:200], np.full(80, 2.0), np.full(80, -2.0), to_and_fro[:240]])
    slow, fast = (np.stack([u, np.zeros(600)], axis=1) for u in (to_and_fro, longer))
    plant = make_plant(DRY, cart_damping=30.0)
    runs = [play(plant, slow, name=f"slow-{i}.csv", seed=i, start={"x": 0.6}) for i in range(3)]
    top = max(np.abs(np.diff(run.x[::10])).max() for run in runs)
    odd = play(plant, fast, name="fast.csv", seed=9, start={"x": 0.6})
    assert np.abs(np.diff(odd.x[::10])).max() > 1.2 * top
    odd.x[250:] += np.linspace(0.0, 0.02, 351)
    assert found([*runs, odd]).beyond in ("x", "x_rate")


def test_the_sentence_says_what_when_and_how_large():
    told = aside_sentence("run-3.csv", 6.351, "x", 41.2, None)
    assert told.startswith("run-3.csv was set aside") and "until 6.35 s" in told
    assert "41 times the noise in the cart position" in told


@pytest.mark.slow
def test_others_are_asked_alone_where_one_spoils_a_law():
    """A tilted rail in all recordings, and a reading that jumps in one of them: by itself it would get names, too."""
    tilt = ("constant_force", "cart", {"level": 1.0})
    runs = cart_recordings(make_plant(DRY, tilt, cart_damping=30.0), 7)
    runs[2].x[330:] += 4e-3
    told = diagnose(cart_model(DRY, cart_damping=25.0), runs[:5], runs[5:])
    assert told.verdict == "missing_physics" and len(told.effects) == 1
    assert tilt[:2] in {(e.kind, e.site) for e in (told.effects[0], *told.effects[0].equivalents)}
    assert f"{runs[2].name} was set aside" in told.statement and told.aside == runs[2].name
    odd = [trace for trace in told.traces if trace.role == "aside"]
    assert [trace.recording for trace in odd] == [runs[2].name] and runs[2].name not in told.holdout
    assert [i.start for i in told.location.when if i.recording == runs[2].name] == [pytest.approx(3.3, abs=0.02)]
    left = (odd[0].measured["x"] - odd[0].after["x"])[:330]
    assert np.sqrt(np.nanmean(left**2)) < 1.5 * NOISE["x"]
    assert told.holdout_after.free_run["x"] < 1.5 * NOISE["x"]
