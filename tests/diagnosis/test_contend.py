"""A diagnosis that goes on: what is left of what could not be told apart, and a whole one played on another engine."""

import dataclasses
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from jbridge import diagnose
from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.contend import continued, explanations, nearest
from jbridge.diagnosis.result import Former, NamedEffect, Rival
from jbridge.diagnosis.steps import Step, as_simplified, weights_of
from jbridge.diagnosis.trials import State, Trial
from jbridge.identify.lanes import make_batch
from jbridge.identify.linearise import Engine
from jbridge.model.files import Model
from tests.identify.cases import NOISE, make_recording
from tests.problems import NUMBERS, make_plant

NAMES = {"dead": ("dead_zone", "cart_drive"), "dry": ("coulomb_friction", "cart"), "tilt": ("constant_force", "cart")}


def former(*names):
    rows = ({"kind": NAMES[n][0], "site": NAMES[n][1], "probability": 1 / len(names)} for n in names)
    return Former(tuple(rows))


def named(first, *rivals):
    others = tuple(Rival(*NAMES[n], 0.1, {}, {}) for n in rivals)
    return (NamedEffect(*NAMES[first], 0.8, {}, others, ""),)


@pytest.mark.parametrize(
    ("before", "now", "told"),
    [
        (("dead", "dry"), ("dry",), "1 of 2 explanations is left: Coulomb friction at the cart."),
        (("dead", "dry"), ("dry", "dead"), "2 of 2 explanations are left"),
        (
            ("dead", "dry"),
            ("tilt",),
            "none of the 2 former explanations is left; now it is constant force at the cart.",
        ),
        (("dead", "dry"), ("dry", "tilt"), "New among them: constant force at the cart."),
        (("dead",), (), "none of the 1 former explanations is left."),
        ((), ("dry",), "what had no name has one: Coulomb friction at the cart."),
        ((), (), "nothing is named"),
    ],
)
def test_what_is_left_is_told(before, now, told):
    earlier = former(*before) if before else Former(())
    found = continued(earlier, named(*now) if now else (), ["next.csv"])
    assert told in found.statement and "next.csv" in found.statement
    assert found.before == earlier.explanations and found.recordings == ("next.csv",)
    assert [(row["kind"], row["site"]) for row in found.after] == [NAMES[n] for n in now]


def test_explanations_are_what_was_named_and_its_rivals():
    rows = explanations(named("dry", "dead", "tilt"))
    assert [row["probability"] for row in rows] == [0.8, 0.1, 0.1]
    assert Former(rows).names == {NAMES["dry"], NAMES["dead"], NAMES["tilt"]}


def trial(kind, values, extra):
    """A trial of a law, all of which leave the same cost."""
    plant = make_plant((kind, "cart", values))
    engine = Engine(plant)
    times = np.arange(100) * 0.01
    batch = make_batch(
        [make_recording("a.csv", times, u_x=np.sin(times), x=np.cos(times))], NOISE, size=engine.table.size
    )
    return Trial(
        plant=plant,
        known=frozenset(),
        engine=engine,
        batch=batch,
        vector=np.array(engine.table.ravel(plant)),
        free=np.zeros(0, np.int64),
        initial=batch.initial,
        cost=100.0,
        cross_validated=100.0,
        ratios={"x": 1.0},
        candidate=Candidate(kind, "cart", {}, (), False),
        z=9.0,
        extra=extra,
    )


def test_a_law_that_contains_the_chosen_one_is_no_rival():
    dry = trial("coulomb_friction", {"level": 3.0}, 1)
    drift = trial("friction_drift", {"level": 3.0, "rate": 0.0}, 2)
    tilt = trial("constant_force", {"level": 3.0}, 2)
    assert Step(1, dry, [dry, drift, tilt], {}).passed == [dry, tilt]
    assert Step(1, tilt, [dry, drift, tilt], {}).passed == [dry, tilt]
    assert Step(1, drift, [dry, drift, tilt], {}).passed == [dry, drift, tilt]
    assert Step(1, dry, [dry, drift, tilt], {tilt.candidate.name: "gains too little"}).passed == [dry]


def test_a_simpler_law_weighs_as_the_one_in_whose_place_it_is():
    """It holds as well on recordings left out, where the other one's further numbers do not repeat."""
    places = {"knots": [0.2, 0.8], "levels": [2.0, 4.0]}
    found = trial("position_dependent_friction", places, 2)
    drift = dataclasses.replace(trial("friction_drift", {"level": 3.0, "rate": 0.0}, 2), cost=130.0)
    tilt = dataclasses.replace(trial("constant_force", {"level": 3.0}, 1), cost=140.0)
    dry = dataclasses.replace(trial("coulomb_friction", {"level": 3.0}, 1), cost=150.0)
    state = State(**dry.shared(), accepted=(dry.candidate,))
    step = as_simplified(Step(1, found, [found, drift, tilt, dry], {}), state)
    weights = weights_of(step)
    assert step.chosen.cost == 150.0 and step.chosen.candidate == dry.candidate
    # The map and the drift contain it, and what is left are two things that it could be.
    assert set(weights) == {NAMES["dry"], NAMES["tilt"]} and weights[NAMES["dry"]] > 0.999


def test_of_what_has_no_name_the_nearest_explanations_contend():
    """Refused explanations that gain a tenth, each kind once, none likelier than another."""
    dry, tilt = trial("coulomb_friction", {"level": 3.0}, 1), trial("constant_force", {"level": 3.0}, 1)
    far = dataclasses.replace(trial("quadratic_drag", {"coefficient": 1.0}, 1), cost=950.0)
    without = dataclasses.replace(State(**dry.shared()), cost=1000.0)
    refused = [(t, "gains too little") for t in (far, dry, tilt, dry)]
    found = nearest(without, refused)
    assert {(c.kind, c.site) for c in found} == {NAMES["dry"], NAMES["tilt"]}
    assert [c.probability for c in found] == [0.5, 0.5]
    assert nearest(without, refused[:2]) == []


TRUTH = {"positive": 0.25, "negative": 0.25}
BRIDGE = {
    "cart_mass": 5.5, "load_mass": 0.143, "winch_mass": 0.1, "gravity": 9.81, "cart_damping": 40.0,
    "swing_damping": 0.0015, "hoist_damping": 25.0, "cart_gain": 16.0, "hoist_gain": 3.0,
}  # fmt: skip


def mujoco_cart(u_x, start, seed, name):
    """A recording of a cart alone that MuJoCo plays, with a dead zone and encoders."""
    pytest.importorskip("mujoco")
    here = str(Path(__file__).parents[2] / "experiments" / "concealed")
    if here not in sys.path:
        sys.path.insert(0, here)  # the scripts of an experiment import their neighbours by plain names
    rig = importlib.import_module("rig")
    truth = {
        "bridge": BRIDGE,
        "effects": [{"kind": "dead_zone", "site": "cart_drive", **TRUTH}],
        "parts": "cart",
        "rope": "locked",
    }
    volts = np.stack([u_x, np.zeros_like(u_x)], axis=1)
    table = rig.simulate(truth, volts, rig.SAMPLE * (len(u_x) - 1), seed, {"x": start})
    return make_recording(name, table["t"], u_x=table["u_x"], x=table["x"])


@pytest.mark.slow
def test_the_proposed_input_decides_on_another_engine():
    """Driven one way only, a cart does not tell friction from a dead zone or a tilt; the proposed input does."""
    key = np.random.default_rng(4)
    runs = [mujoco_cart(np.repeat(key.uniform(0.8, 2.0, 12), 100), 0.1, seed, f"run-{seed}.csv") for seed in range(4)]
    plant = make_plant(cart_damping=36.0, cart_gain=17.5)
    model = Model(plant, frozenset(("cart_mass", "gravity")), frozenset(NUMBERS), {}, "model.toml")
    first = diagnose(model, runs[:3], runs[3:])
    assert first.verdict == "missing_physics"
    before = explanations(first.effects)
    assert {(row["kind"], row["site"]) for row in before} >= {NAMES["dead"], NAMES["dry"]}
    proposed = first.next_experiment
    assert proposed is not None and proposed.expected_wrong < 0.05
    new = mujoco_cart(np.asarray(proposed.columns["u_x"]), proposed.start["x"], 9, "next.csv")
    again = diagnose(model, runs[:3], runs[3:], new=[new], former=Former(before))
    assert again.continued is not None and again.continued.before == before
    left = {(row["kind"], row["site"]) for row in again.continued.after}
    assert NAMES["dead"] in left and len(left) < len(before)
    assert (again.effects[0].kind, again.effects[0].site) == NAMES["dead"]
    width = again.effects[0].parameters["positive"]
    assert abs(width.value - 0.25) < 0.01
