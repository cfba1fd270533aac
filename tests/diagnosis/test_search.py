"""Parts of the search: numbers that move between models, levels that are counted once, and left-out recordings."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.diagnosis.candidates import Candidate
from jbridge.diagnosis.levels import anchored, settle_levels, simpler_laws, taking_over
from jbridge.diagnosis.mechanisms import stiffer, worst_met
from jbridge.diagnosis.screen import Screened
from jbridge.diagnosis.shortlist import with_simpler
from jbridge.diagnosis.ties import ties
from jbridge.diagnosis.trials import beyond_belief, transfer
from jbridge.identify.lanes import make_batch
from jbridge.identify.left_out import cross_validated, smoothness
from jbridge.model.effects.catalogue import make_effect
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Plant
from jbridge.rollout import RK4
from tests.identify.cases import NOISE, make_recording, steps
from tests.problems import CART_ALONE, make_lane, make_plant, make_state, paths, simulate

COULOMB = ("coulomb_friction", "cart", {"level": 3.0})
ADDED = {
    "direction_dependent_friction": {"positive": 0.7, "negative": 1.2},
    "position_dependent_friction": {"knots": [0.4, 0.6, 0.8], "levels": [0.9, 0.4, 1.4]},
    "position_direction_friction": {"knots": [0.4, 0.6, 0.8], "positive": [0.9, 0.4, 1.4], "negative": [1.0, 0.5, 0.8]},
    "stribeck_friction": {"level": 0.6, "breakaway": 1.5, "velocity": 0.05},
}


def with_added(kind):
    plant = make_plant(COULOMB, (kind, "cart", ADDED[kind]))
    table = ParameterTable(plant)
    return plant, table, np.array(table.ravel(plant))


def test_hidden_effects_are_sought_where_the_model_errs_most():
    runs = [
        make_recording(f"{seconds}.csv", np.arange(0, seconds, 0.01), x=np.arange(0, seconds, 0.01))
        for seconds in (10.0, 12.0, 60.0, 11.0)
    ]
    worst = worst_met(runs, [10.0, 30.0, 900.0, 28.0])
    assert [run.name for run in worst] == ["11.0.csv", "12.0.csv"], "by the second, and none that is long"
    assert worst_met(runs[:1], [10.0]) == (runs[0],)


@pytest.mark.parametrize("kind", ADDED)
def test_settled_levels_are_the_same_physics(kind):
    plant, table, vector = with_added(kind)
    settled = settle_levels(table, vector)
    lane = make_lane(np.stack([steps(300, 1), np.zeros(300)], axis=1), 0.01, active=CART_ALONE)
    runs = [
        paths(simulate(table.unravel(v), make_state(0.6), lane, substeps=4, method=RK4))[0] for v in (vector, settled)
    ]
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-12)
    assert np.ptp(runs[0][:, 0]) > 0.05
    keys = [k for k in ADDED[kind] if k not in ("knots", "velocity", "breakaway")]
    least = min(settled[p] for k in keys for p in table.positions(f"{kind}@cart.{k}"))
    assert least == 0.0
    # Twice is once.
    np.testing.assert_allclose(settle_levels(table, settled), settled)


@pytest.mark.parametrize("kind", ADDED)
def test_the_smallest_level_is_held(kind):
    _, table, vector = with_added(kind)
    (place,) = anchored(table, settle_levels(table, vector))
    assert settle_levels(table, vector)[place] == 0.0
    assert table.entry(int(place)).name.startswith(kind)


def test_alone_an_added_friction_keeps_its_levels():
    plant = make_plant(("direction_dependent_friction", "cart", ADDED["direction_dependent_friction"]))
    table = ParameterTable(plant)
    vector = np.array(table.ravel(plant))
    np.testing.assert_array_equal(settle_levels(table, vector), vector)
    assert len(anchored(table, vector)) == 0


def test_numbers_move_between_models_by_name():
    source = make_plant(
        COULOMB,
        ("end_stop", "cart", {"position": 1.2, "stiffness": 300.0, "damping": 4.0, "end": "low"}),
        cart_gain=20.0,
    )
    target = make_plant(
        ("end_stop", "cart", {"position": 0.0, "stiffness": 1.0, "damping": 0.0}),
        ("quadratic_drag", "cart", {"coefficient": 7.0}),
        COULOMB,
    )
    a, b = ParameterTable(source), ParameterTable(target)
    moved = transfer(a, np.array(a.ravel(source)), b, np.array(b.ravel(target)))
    plant = b.unravel(moved)
    assert float(plant.bridge.cart_gain) == 20.0
    assert float(plant.effects[0].position) == 1.2 and float(plant.effects[0].end) == 1.0
    assert float(plant.effects[1].coefficient) == 7.0


def test_cross_validation_of_a_linear_model_is_exact():
    """In a linear model one step from the joint optimum is the optimum without a recording."""
    key = np.random.default_rng(0)
    lanes, count, samples = 4, 2, 60
    design = key.standard_normal((lanes, samples, count))
    data = design @ [1.0, -2.0] + 0.3 * key.standard_normal((lanes, samples))
    found, residual = left_out(design, data, (np.zeros((count, count)), np.zeros(count)))
    wanted = 0.0
    for r in range(lanes):
        others = np.delete(np.arange(lanes), r)
        own = np.linalg.lstsq(design[others].reshape(-1, count), data[others].reshape(-1), rcond=None)[0]
        wanted += float(((design[r] @ own - data[r]) ** 2).sum())
    assert found == pytest.approx(wanted, rel=1e-5)
    assert found > float((residual**2).sum())


def test_knots_that_one_recording_alone_knows_follow_their_neighbours_without_it():
    key = np.random.default_rng(1)
    levels, lanes, samples = [2.0, 2.2, 2.5, 2.6], 4, 80
    plant = make_plant(
        ("position_dependent_friction", "cart", {"knots": [0.2, 0.5, 0.8, 1.1], "levels": levels}), COULOMB
    )
    table = ParameterTable(plant)
    free = np.array(table.positions("position_dependent_friction@cart.levels"))
    design = np.abs(key.standard_normal((lanes, samples, 4)))
    design[1:, :, 3] = 0.0
    data = design @ levels + 0.1 * key.standard_normal((lanes, samples))
    best = np.linalg.lstsq(design.reshape(-1, 4), data.reshape(-1), rcond=None)[0]
    vector = np.array(table.ravel(plant))
    vector[free] = best
    found, residual = left_out(design, data, smoothness(table, vector, free))
    # The same with a row for each difference: none is expected, give or take as much as there is.
    differences = np.diff(np.eye(4), axis=0) / np.sqrt(np.mean(np.diff(best) ** 2))
    wanted = 0.0
    for r in range(lanes):
        others = np.delete(np.arange(lanes), r)
        rows = np.concatenate([design[others].reshape(-1, 4), differences])
        own = np.linalg.lstsq(rows, np.append(data[others].reshape(-1), np.zeros(3)), rcond=None)[0]
        wanted += float(((design[r] @ own - data[r]) ** 2).sum())
    assert found == pytest.approx(wanted, rel=1e-4)
    assert found > float((residual**2).sum())


def left_out(design, data, smooth):
    """Cost of each lane under what the others give, and the residuals of the joint optimum."""
    lanes, samples, count = design.shape
    best = np.linalg.lstsq(design.reshape(-1, count), data.reshape(-1), rcond=None)[0]
    residual = design @ best - data
    # Initial states, which nothing depends on here.
    table = np.concatenate([design.swapaxes(1, 2), np.zeros((lanes, 6, samples)), residual[:, None]], axis=1)
    products = table @ table.swapaxes(1, 2)
    times = np.arange(100) * 0.01
    runs = [make_recording(f"{i}.csv", times, u_x=np.sin(times), x=np.cos(times)) for i in range(lanes)]
    batch = make_batch(runs, NOISE)
    return cross_validated(products, count, count, batch.initial, batch, batch.recording, smooth), residual


def test_what_rings_is_tried_faster_than_its_seeds_with_either_encoder():
    seeds = [
        Candidate("belt_compliance", "cart", {"stiffness": k, "encoder": encoder}, ("stiffness",), True)
        for encoder in ("cart", "motor")
        for k in (2e3, 12e3)
    ]
    found = [(s.values["stiffness"], s.values["encoder"]) for s in stiffer(seeds)]
    assert found == [(factor * 12e3, encoder) for factor in (2.5, 7, 20) for encoder in ("cart", "motor")]


def screened(kind, site, cost):
    return Screened(Candidate(kind, site, {}, (), False), cost, 1.0 - cost, (), np.zeros(0), np.zeros(0))


def test_plain_friction_is_tried_beside_every_law():
    """A law with more levels expects a little more of itself, and would crowd out the plain one that is the truth."""
    law, drag = screened("direction_dependent_friction", "hoist", 0.10), screened("quadratic_drag", "cart", 0.11)
    plain, elsewhere = (screened("coulomb_friction", site, 0.12) for site in ("hoist", "cart"))
    ranked = [law, drag, plain, elsewhere]
    assert with_simpler([law, drag], ranked) == [law, drag, plain]
    assert with_simpler([law, plain], ranked) == [law, plain]
    assert with_simpler([drag], ranked) == [drag]


def test_what_is_expected_to_explain_the_same_is_tied():
    """Laws that contain the winner crowd out others, but are no rivals of it themselves."""
    winner = Candidate("coulomb_friction", "cart", {}, (), False)
    none = (), np.zeros(0), np.zeros(0)
    crowd = [
        Screened(Candidate(kind, "cart", {}, (), False), 99.0, 0.0, *none)
        for kind in ("direction_dependent_friction", "stribeck_friction")
    ]
    plain, tilt, dead = (
        screened(kind, site, cost)
        for kind, site, cost in (
            ("coulomb_friction", "cart", 100.0),
            ("constant_force", "cart", 101.0),
            ("dead_zone", "cart_drive", 101.5),
        )
    )
    far = screened("spring_force", "cart", 150.0)
    ranked = [*crowd, plain, tilt, dead, far]
    assert ties(ranked, winner, [winner.name]) == [tilt, dead]
    assert ties(ranked, winner, [winner.name, tilt.candidate.name]) == [dead]
    assert ties(ranked[1:2], winner, []) == []


@pytest.mark.parametrize(
    ("kind", "simpler"),
    [
        ("stribeck_friction", ["coulomb_friction"]),
        ("direction_dependent_friction", ["coulomb_friction"]),
        ("position_dependent_friction", ["coulomb_friction"]),
        (
            "position_direction_friction",
            ["coulomb_friction", "direction_dependent_friction", "position_dependent_friction"],
        ),
    ],
)
def test_a_law_contains_simpler_ones(kind, simpler):
    """Each lies between the levels of the law that contains it."""
    plant, _, _ = with_added(kind)
    effect = plant.effects[-1]
    found = simpler_laws(effect)
    assert [name for name, _ in found] == simpler
    numbers = np.concatenate([np.ravel(v) for k, v in ADDED[kind].items() if k not in ("knots", "velocity")])
    for name, values in found:
        made = make_effect(name, "cart", values)
        low, high = (
            float(np.min(np.asarray(made.levels(*map(jnp.asarray, (0.0, x, v)))))) for x, v in ((0.5, 0.3), (0.5, -0.3))
        )
        assert numbers.min() - 1e-12 <= min(low, high) and max(low, high) <= numbers.max() + 1e-12


def test_a_smooth_effect_contains_no_simpler_law():
    assert simpler_laws(make_effect("quadratic_drag", "cart", {"coefficient": 1.0})) == []


@pytest.mark.parametrize(("kind", "site", "times", "believed"), [
    ("wrong_value", "winch_mass", 12.0, False),
    ("wrong_value", "winch_mass", 0.1, False),
    ("wrong_value", "winch_mass", 2.5, True),
    ("coulomb_friction", "cart", 12.0, True),
])  # fmt: skip
def test_a_known_number_is_wrong_by_a_factor_of_four_at_most(kind, site, times, believed):
    """A lag of the winch's drive is fitted well by a winch of ten times its mass, which nobody has."""
    given = make_plant(COULOMB)
    heavier = dataclasses.replace(given.bridge, winch_mass=given.bridge.winch_mass * times)
    said = beyond_belief(Candidate(kind, site, {}, (), False), given, dataclasses.replace(given, bridge=heavier))
    assert (said == "") == believed and (believed or f"{times:.2g} times" in said)


@pytest.mark.parametrize("kind", sorted(ADDED))
def test_a_law_takes_over_the_level_of_the_plain_friction_that_is_taken_away(kind):
    plain, other = (
        make_plant(COULOMB, (kind, "cart", ADDED[kind])),
        make_effect("coulomb_friction", "hoist", {"level": 0.5}),
    )
    alone = Plant(plain.bridge, taking_over(plain.effects, plain.effects[0]))
    assert [effect.kind for effect in alone.effects] == [kind]
    lane = make_lane(np.stack([steps(200, 1), np.zeros(200)], axis=1), active=CART_ALONE)
    before, after = (simulate(plant, make_state(0.6), lane, substeps=2, method=RK4) for plant in (plain, alone))
    np.testing.assert_allclose(after.q.x, before.q.x, atol=1e-9)
    assert np.ptp(before.q.x) > 0.01
    # And back, but for a level that is known.
    (again,) = taking_over(plain.effects, plain.effects[1])
    mean = dict(simpler_laws(plain.effects[1]))["coulomb_friction"]["level"]
    assert float(again.level) == pytest.approx(3.0 + mean)
    assert taking_over(plain.effects, plain.effects[1], ["coulomb_friction@cart.level"]) == plain.effects[:1]
    # Of another axis nothing is taken over.
    assert taking_over((other, *alone.effects), other) == alone.effects
