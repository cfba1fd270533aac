"""The next experiment: inputs within limits, distances that mean what they say, and decisions that come out right."""

import dataclasses

import numpy as np
import pytest

from jbridge.diagnosis.experiment_design.discrimination import (
    Contender,
    Separation,
    as_recording,
    distance,
    guess,
    log_preferred,
    played,
)
from jbridge.diagnosis.experiment_design.inputs import FORMS, Play, Wave, library, start_of, variants
from jbridge.diagnosis.experiment_design.limits import Reach, Volts, reach_of
from jbridge.diagnosis.experiment_design.next_experiment import _gentlest, _separated_by, next_experiment
from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.estimation import fit_structure, make_problem
from jbridge.identification.setting import make_setting
from jbridge.model.files import Model
from tests.identification.cases import make_recording, play, steps
from tests.problems import CART_ALONE, LOCKED_ROPE, NUMBERS, make_plant

DRIVES = {"u_x": Volts(0.0, (0.3, -0.2), (3.0, -3.0)), "u_l": Volts(-0.4, (0.1, -1.0), (4.0, -4.0))}
REACH = Reach(
    0.005, 12.0, {"x": 0.2, "psi": -0.3, "l": 0.4}, {"x": 1.2, "psi": 0.3, "l": 0.9}, {"x": 0.5, "psi": 1.0, "l": 0.2},
    DRIVES,
)  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", [-0.2, 0.0, 0.5, 1.0])
def test_voltages_stay_within_what_was_recorded(form, size):
    times = np.arange(0.0, 12.0, 0.005)
    for drive in DRIVES.values():
        u = Wave(form, size, 2.0).volts(times, drive)
        assert drive.most[1] <= u.min() and u.max() <= drive.most[0]
        if size >= 0:
            # Both ways, from what just sets the axis in motion to the largest.
            assert u.max() > drive.rest and u.min() < drive.rest
    forwards = Wave("square", size, 2.0).volts(times, DRIVES["u_x"]).max()
    assert forwards == pytest.approx(0.3 + 2.7 * size if size >= 0 else 0.3 * (1 + size), abs=1e-3)


def test_what_the_catalogue_knows_to_separate_is_said():
    def rivals(*names):
        return [Contender(*name, 0.5, make_plant(), (), np.zeros((0, 0))) for name in names]

    pair = rivals(("sensor_offset", "l_sensor"), ("rod_inertia", "swing"))
    assert "several rope lengths" in _separated_by(pair)[0]
    assert _separated_by(rivals(("sensor_offset", "x_sensor"), ("rod_inertia", "swing"))) == []
    assert _separated_by(rivals(("wrong_value", "load_mass"), ("rod_inertia", "swing"))) == []


def test_a_library_is_about_what_the_rivals_are_about():
    assert all(set(p.waves) == {"u_x"} for p in library(REACH, {"x"}))
    assert all("u_l" in p.waves for p in library(REACH, {"l"}))
    both = library(REACH, {"psi"})
    assert any(set(p.waves) == {"u_x", "u_l"} for p in both) and any(set(p.waves) == {"u_x"} for p in both)
    alone = dataclasses.replace(REACH, drives={"u_x": DRIVES["u_x"]})
    assert {name for p in library(alone, {"psi", "l"}) for name in p.waves} == {"u_x"}
    assert library(dataclasses.replace(REACH, drives={}), {"psi"}) == []
    for axis in ("x", "l"):
        for p in both:
            assert REACH.low[axis] < p.start[axis] < REACH.high[axis]
    assert len({(p.waves["u_x"].size, p.waves["u_x"].period) for p in variants(both[0], REACH)}) > 3


def test_reach_is_what_was_recorded():
    times = np.arange(1000) * 0.01
    runs = [
        make_recording("a.csv", times, u_x=2.5 * np.sin(times), x=0.7 + 0.4 * np.sin(times)),
        make_recording("b.csv", times, u_x=-1.0 * np.sin(times), x=0.5 + 0.1 * np.sin(times)),
    ]
    model = Model(make_plant(), frozenset(("cart_mass",)), frozenset(NUMBERS), {}, "m.toml")
    setting = make_setting(model, runs, ())
    plants = [
        make_plant(("load_dependent_friction", "cart", {"level": 3.0, "share": 0.25})),
        make_plant(("dead_zone", "cart_drive", {"positive": 0.5, "negative": 0.5})),
    ]
    reach = reach_of(setting, plants)
    assert reach.period == 0.01 and reach.seconds == pytest.approx(9.99)
    assert 0.3 < reach.low["x"] < 0.34 and 1.06 < reach.high["x"] < 1.1
    # On average of 4 N, a quarter of which rubs, over 16 N/V and of half a volt.
    drive = reach.drives["u_x"]
    assert drive.most == (pytest.approx(2.5, abs=1e-3), pytest.approx(-2.5, abs=1e-3)) and drive.rest == 0.0
    assert drive.least[0] == pytest.approx(0.5 * (0.25 + 0.5))
    assert "u_l" not in reach.drives


def test_without_a_drive_nothing_is_played():
    times = np.arange(1000) * 0.01
    swing = make_recording("swing.csv", times, psi=0.1 * np.cos(3.7 * times))
    setting = make_setting(Model(make_plant(), frozenset(), frozenset(NUMBERS), {}, "m.toml"), [swing], ())
    problem = make_problem(setting, make_data([swing], (1.0,)))
    two = [
        Contender(kind, "swing", 0.5, make_plant((kind, "swing", {key: 1e-3})), (), np.zeros((0, 0)))
        for kind, key in (("coulomb_friction", "level"), ("load_drag", "coefficient"))
    ]
    assert next_experiment(two, problem, print) is None


def test_odds_of_today_count():
    # Without a new recording the likelier one is preferred, right or wrong.
    assert np.exp(log_preferred(9.0, 0.0)) == 0.0
    assert np.exp(log_preferred(1.0 / 9.0, 0.0)) == 1.0
    assert guess([0.9, 0.1]) == pytest.approx(0.1)
    # Of equal odds it is a matter of distance alone: half of it is two standard deviations here.
    assert np.exp(log_preferred(1.0, 16.0)) == pytest.approx(0.02275, rel=1e-3)


def one_way(plant, seed, active):
    """A cart that is only ever driven forwards, between one voltage and another."""
    u = 1.6 + 0.4 * np.abs(steps(600, seed))
    u = np.stack([u, 0 * u], axis=1)
    return play(plant, u, name=f"{seed}.csv", start={"x": 0.2}, seed=seed, noise=10.0, active=active)


def lively(plant, seed, active):
    """Pushes that are too strong to show what happens on the way from rest."""
    u = steps(600, seed, hold=100)
    u = np.stack([u, 0 * u], axis=1)
    return play(plant, u, name=f"{seed}.csv", start={"x": 0.8}, seed=seed, noise=30.0, active=active)


def rig(pair, truth, active=CART_ALONE, runs=one_way, noise=10.0, **numbers):
    """Recordings of one of a pair, both fitted to them, and what came of it."""
    known = frozenset(("cart_mass", "load_mass", "gravity"))
    plants = [make_plant(*effects, **numbers) for effects in pair]
    recordings = [runs(plants[truth], seed, active) for seed in range(3)]
    setting = make_setting(Model(plants[0], known, frozenset(NUMBERS), {}, "m.toml"), recordings, ())
    named = [plant.effects[-1] for plant in plants]
    found = [contender(e.kind, e.site, *fit(plant, known, setting)) for e, plant in zip(named, plants, strict=True)]
    return plants, known, setting, found


def fit(plant, known, setting, horizons=(1.0, WHOLE)):
    """The recordings with their criterion, and the plant fitted to them."""
    return fit_structure(make_problem(setting, make_data(setting.recordings, horizons, setting.noise)), plant, known)


def contender(kind, site, problem, fitted):
    [normal] = problem.normal(fitted.engine, [fitted.point])
    n = len(fitted.free)
    gram = np.einsum("wc,wcij->ij", problem.likelihood.weights(fitted.point.square), normal.products)[:n, :n]
    names = tuple(fitted.table.entry(int(p)).name for p in fitted.free)
    return Contender(kind, site, 0.5, fitted.plant, names, gram)


def squares(plant, known, setting):
    """Least sum of squares over the noise of whole recordings."""
    problem, fitted = fit(plant, known, setting, (WHOLE,))
    linear = dataclasses.replace(problem, likelihood=problem.likelihood.of_squares())
    [point] = linear.solve(fitted.engine, [fitted.point.start], 30)
    return float(np.sum(point.square * problem.windows.count))


def decide(pair, truth, **options):
    """Plays the proposed input on the truth and weighs both again: the criterion of the wrong one over the right's."""
    active = options.get("active", CART_ALONE)
    plants, known, setting, found = rig(pair, truth, **options)
    before = _apart(setting, known, plants, truth)
    problem = make_problem(setting, make_data(setting.recordings, (WHOLE,)))
    proposed = next_experiment(found, problem, lambda text: None)
    inputs = proposed.columns
    rest = np.zeros_like(inputs["t"])
    u = np.stack([inputs.get("u_x", rest), inputs.get("u_l", rest)], axis=1)[:-1]
    how = {"period": float(np.diff(inputs["t"])[0]), "start": dict(proposed.start), "active": active}
    new = play(plants[truth], u, name="new.csv", seed=77, noise=options.get("noise", 10.0), **how)
    again = dataclasses.replace(setting, recordings=(*setting.recordings, new))
    return proposed, new, setting, before, _apart(again, known, plants, truth)


def _apart(setting, known, plants, truth):
    problem, right = fit(plants[truth], known, setting)
    _, wrong = fit(plants[1 - truth], known, setting)
    return problem.likelihood.value(wrong.point.square) - problem.likelihood.value(right.point.square)


FRICTION = (("coulomb_friction", "cart", {"level": 4.0}),)
DEAD = (("dead_zone", "cart_drive", {"positive": 0.25, "negative": 0.25}),)
TILT = (("constant_force", "cart", {"level": -4.0}),)


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0, 1])
def test_friction_and_a_dead_zone_are_told_apart(truth):
    """What one direction of motion cannot tell, the proposed input decides, whichever is true."""
    proposed, new, setting, before, after = decide((FRICTION, DEAD), truth, cart_damping=30.0, cart_gain=16.0)
    assert abs(before) < 2.0 < 20.0 < after
    assert proposed.expected_wrong < 0.05 and proposed.start.keys() == {"x"}
    assert proposed.columns.keys() == {"t", "u_x"}
    assert proposed.separates == ("Coulomb friction at the cart", "dead zone at the cart drive")
    assert "x = " in proposed.purpose and "apart" in proposed.purpose
    # What was recorded is not left.
    low, high = (f([f(r.x) for r in setting.recordings]) for f in (np.min, np.max))
    assert low < new.x.min() and new.x.max() < high
    assert np.abs(proposed.columns["u_x"]).max() <= max(np.abs(r.u_x).max() for r in setting.recordings)


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0, 1])
def test_friction_and_a_tilted_rail_are_told_apart(truth):
    _, _, _, before, after = decide((FRICTION, TILT), truth, cart_damping=30.0, cart_gain=16.0)
    assert abs(before) < 2.0 < 20.0 < after


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0, 1])
def test_play_and_presliding_are_told_apart(truth):
    friction = ("coulomb_friction", "cart", {"level": 3.0})
    pair = (
        (friction, ("backlash", "cart", {"gap": 6e-4, "motor_mass": 1.0})),
        (("presliding_friction", "cart", {"level": 3.0, "stiffness": 5e3}),),
    )
    proposed, _, _, before, after = decide(pair, truth, runs=lively, noise=30.0)
    assert after > max(before, 0.0)
    assert after > 10.0 or proposed.expected_wrong > 0.02


@pytest.mark.slow
def test_an_encoder_offset_and_a_tilted_rail_are_told_apart():
    """Both with a load on a locked rope: the offset shows in the angle, the tilt in the cart."""
    pair = (
        (("coulomb_friction", "cart", {"level": 3.0}), ("sensor_offset", "psi_sensor", {"offset": 0.01})),
        (("coulomb_friction", "cart", {"level": 3.0}), ("constant_force", "cart", {"level": 0.4})),
    )
    proposed, _, _, before, after = decide(pair, 0, active=LOCKED_ROPE, runs=lively, noise=30.0)
    assert after > 20.0 and after >= before - 1.0
    assert set(proposed.start) == {"x", "psi", "l"}


@pytest.mark.slow
def test_the_distance_is_what_a_refit_leaves():
    """The linear distance against a full refit to noiseless readings of the other model and the old recordings."""
    plants, known, setting, _ = rig((FRICTION, DEAD), 0, cart_damping=30.0, cart_gain=16.0)
    found = []
    for plant in plants:
        problem, fitted = fit(plant, known, setting, (WHOLE,))
        [normal] = problem.normal(fitted.engine, [fitted.point])
        n = len(fitted.free)
        names = tuple(fitted.table.entry(int(p)).name for p in fitted.free)
        # As many samples as there are, since the recordings have white noise.
        found.append(Contender("", "", 0.5, fitted.plant, names, normal.products.sum(axis=(0, 1))[:n, :n]))
    reach = reach_of(setting, plants)
    # A small one, for which the linear model holds.
    (chosen, *_) = [p for p in library(reach, {"x"}) if p.waves["u_x"].form == "pulses"]
    recording = as_recording(chosen, reach, setting)
    data = make_data([recording], (WHOLE,), setting.noise)
    runs = [played(c, setting, data) for c in found]
    linear = distance(runs[0], runs[1], 0)
    exact = dataclasses.replace(recording, x=runs[0].predicted[0][:, 0])
    again = dataclasses.replace(setting, recordings=(*setting.recordings, exact))
    left = squares(plants[1], known, again) - squares(plants[1], known, setting)
    assert linear > 50.0
    assert left == pytest.approx(linear, rel=0.3)


def test_nothing_is_proposed_where_nothing_is_driven():
    times = np.arange(600) * 0.01
    still = [make_recording("a.csv", times, psi=0.1 * np.cos(4 * times))]
    model = Model(make_plant(), frozenset(("load_mass", "gravity")), frozenset(NUMBERS), {}, "m.toml")
    setting = make_setting(model, still, ())
    assert library(reach_of(setting, [model.plant]), {"psi"}) == []


def test_the_gentlest_of_those_that_decide_is_chosen():
    def separation(log_wrong, *sizes):
        waves = {name: Wave("pulses", size, 2.0) for name, size in zip(("u_x", "u_l"), sizes, strict=False)}
        return Separation(Play(waves, {}), log_wrong)

    strong, both = separation(-90.0, 0.9), separation(-80.0, 0.1, 0.1)
    gentle, unsure = separation(-20.0, 0.3), separation(-2.0, 0.1)
    assert _gentlest([strong, both, gentle, unsure]) is gentle
    assert _gentlest([unsure, separation(-1.0, 0.1)]) is unsure


def test_starts_are_in_the_middle_of_what_rests():
    start = start_of(REACH, {"u_x": Wave("stairs", 0.5, 4.0)})
    assert start["l"] == pytest.approx(0.65) and start["x"] == pytest.approx(0.2 + 0.2 * 1.0)
    assert start["psi"] == 0.0
