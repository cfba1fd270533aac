"""Tuning: objectives against NumPy, gradients against differences, and a law that gets better where it counts."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jbridge import Axes, InputError
from jbridge.control.base import AbstractController, Reference
from jbridge.control.compensation import Compensation
from jbridge.control.extended_rules import extended_controller
from jbridge.control.files import Controller
from jbridge.control.linear import Pid
from jbridge.control.move_metrics import moves
from jbridge.control.paper_rules import paper_controller
from jbridge.model.files import Model
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Motion
from jbridge.simulation.closed_loop import Response
from jbridge.simulation.tracking import track
from jbridge.trajectory import smooth_path
from jbridge.tuning.compensation import compensation_for, drive_limits
from jbridge.tuning.cost import Cost, measure
from jbridge.tuning.ensemble import Course, Legs, Region, Scatter, late, mixed_legs, paper_legs, random_legs, scattered
from jbridge.tuning.linear_designs import linear_model, lqg_controller, lqr_controller, pid_for
from jbridge.tuning.objectives import (
    AbstractObjective,
    Chatter,
    Goal,
    Itae,
    Leg,
    Overshoot,
    ResidualSwing,
    Reversals,
    Settling,
    Travel,
    usual_goal,
)
from jbridge.tuning.tunable_parameters import AbstractKnobs, FuzzyKnobs, Knob, knobs_of
from jbridge.tuning.tune import common_slope, descend, tune
from tests.problems import NUMBERS, make_plant

DRY = ("coulomb_friction", "cart", {"level": 3.0})
LAG = ("actuator_lag", "hoist_drive", {"time_constant": 0.06})
PLANT = make_plant(DRY, ("coulomb_friction", "hoist", {"level": 2.0}), LAG)
MODEL = Model(PLANT, frozenset(), frozenset(NUMBERS), {}, "")
SHORT = Legs(np.array([[0.2, 0.4]]), np.array([[0.5, 0.5]]), (0.4, 0.2), 2.0)
PID = Pid(compensation=Compensation(cart=0.15, hoist=0.5, hoist_bias=-0.5))


def response(x, psi, l, u, times):
    zero = jnp.zeros_like(jnp.asarray(x))
    axes = Axes(*(jnp.asarray(values) for values in (x, psi, l)))
    q = Motion(*axes)
    wanted = Reference(zero + 1.0, zero + 0.5, zero, zero)
    return Response(q, q, axes, jnp.asarray(u), jnp.asarray(times), wanted)


class Effort(AbstractObjective):
    """Mean square voltage of both drives, which summaries have as well [V²]."""

    def __call__(self, response, leg):
        return jnp.mean(jnp.sum(response.command**2, axis=1))


def test_objectives_are_what_they_say():
    times = np.arange(0.0, 6.0, 0.02)
    x = 1.0 - np.exp(-times) * np.cos(2 * times)
    psi, l = 0.05 * np.exp(-0.3 * times) * np.sin(6 * times), np.full_like(times, 0.5)
    u = np.stack([np.sin(times), np.cos(3 * times)], axis=1)
    leg = Leg(jnp.asarray([0.0, 0.5]), jnp.asarray([1.0, 0.5]), jnp.asarray(2.0))
    found = response(x, psi, l, u, times)
    assert float(Itae()(found, leg)) == pytest.approx(np.sum(times * np.abs(x - 1.0)) * 0.02, rel=0.03)
    away = np.abs(x + l * np.sin(psi) - 1.0) > 0.01
    assert float(Settling(0.0005)(found, leg)) == pytest.approx(away.sum() * 0.02, abs=0.05)
    late = times >= 2.0 + 0.75 * (times[-1] - 2.0)
    assert float(ResidualSwing()(found, leg)) == pytest.approx(np.sqrt(np.mean(psi[late] ** 2)), rel=1e-3)
    assert float(Overshoot()(found, leg)) == pytest.approx(np.max(x - 1.0), rel=1e-12)
    assert float(Chatter()(found, leg)) == pytest.approx(np.mean(np.sum(np.diff(u, axis=0) ** 2, axis=1)), rel=1e-12)
    # Drives of 0.1 s are behind commands that change by so many volts a second.
    assert float(Travel(0.1, 1e-6)(found, leg)) == pytest.approx(
        0.1 * np.mean(np.sum(np.abs(np.diff(u, axis=0)), axis=1)) / 0.02, rel=1e-3
    )
    changes = np.sum(np.diff(np.sign(u), axis=0) != 0)
    assert float(Reversals(0.1, 1e-4)(found, leg)) == pytest.approx(0.1 * changes, abs=0.06)
    both = Goal((Overshoot(), Chatter()), (2.0, 3.0))
    assert float(both(found, leg)) == pytest.approx(
        2 * float(Overshoot()(found, leg)) + 3 * float(Chatter()(found, leg))
    )
    with pytest.raises(ValueError, match="1 weights for 2 objectives"):
        Goal((Overshoot(), Chatter()), (1.0,))


def test_bridges_scatter_as_told():
    rows = scattered(PLANT, 200, 1, Scatter(friction=0.2, load_mass=0.5, lag=0.1))
    base = rows[0]
    np.testing.assert_array_equal(base, scattered(PLANT, 2, 5)[0])
    np.testing.assert_array_equal(rows, scattered(PLANT, 200, 1, Scatter(friction=0.2, load_mass=0.5, lag=0.1)))
    table = ParameterTable(PLANT)
    for name, share in (
        ("coulomb_friction@cart.level", 0.2),
        ("cart_damping", 0.2),
        ("load_mass", 0.5),
        ("actuator_lag@hoist_drive.time_constant", 0.1),
        ("cart_gain", 0.0),
        ("gravity", 0.0),
    ):
        (place,) = table.positions(name)
        factors = rows[1:, place] / base[place]
        assert np.abs(factors - 1).max() <= share + 1e-12
        assert share == 0.0 or np.abs(factors - 1).max() > 0.9 * share


def test_bridges_scatter_by_a_models_own_uncertainty():
    known = {
        "cart_damping": {"std": 9.0, "low": 27.0, "high": 63.0},
        "coulomb_friction@cart.level": {"std": 0.01},
        "load_mass": {"std": 1e-6},
        "hoist_damping": {"low": 1.0},
        "dead_zone@cart_drive.positive": {"std": 0.1},
    }
    rows, plain = scattered(PLANT, 4000, 1, uncertainty=known), scattered(PLANT, 4000, 1)
    table = ParameterTable(PLANT)
    np.testing.assert_array_equal(rows[0], plain[0])
    # A normal distribution cut off at twice its deviation has 0.95 of it; a certain number keeps a twentieth of itself.
    for name, std in (("cart_damping", 9.0), ("coulomb_friction@cart.level", 0.05 * 3.0)):
        (place,) = table.positions(name)
        away = rows[1:, place] - rows[0, place]
        assert np.std(away) == pytest.approx(0.95 * std, rel=0.05) and np.abs(away).max() <= 2.0 * std + 1e-12
    same = np.setdiff1d(
        np.arange(table.size), [*table.positions("cart_damping"), *table.positions("coulomb_friction@cart.level")]
    )
    np.testing.assert_array_equal(rows[:, same], plain[:, same])


def test_drives_may_answer_later_than_the_models():
    """The model itself stays as it is, and its other numbers scatter as without."""
    plant = late(PLANT)
    rows, table = scattered(plant, 200, 1, Scatter(late=0.01)), ParameterTable(plant)
    places = [table.positions(f"input_delay@{site}.delay")[0] for site in ("cart_drive", "hoist_drive")]
    assert not rows[0, places].any() and 0.0095 < rows[1:, places].max() <= 0.01 and rows[1:, places].min() >= 0.0
    rest = np.setdiff1d(np.arange(table.size), places)
    np.testing.assert_array_equal(rows[:, rest], scattered(PLANT, 200, 1))
    assert len(late(plant).effects) == len(plant.effects)
    # A late bridge ends elsewhere than the model, and a bridge with no delay where it does.
    law, legs = Controller(Pid(), 0.02).law, paper_legs(3.0)
    course = Course(plant, np.stack([rows[0], rows[0] + 0.01 * np.isin(np.arange(table.size), places)]), legs, 0.02)
    ends = [
        np.asarray(jax.jit(course.run)(law, jnp.asarray(row), jax.tree.map(lambda leaf: leaf[0, 0], course.moves)).q.x)
        for row in course.rows
    ]
    alone = Course(PLANT, scattered(PLANT, 1, 0), legs, 0.02)
    plain = jax.jit(alone.run)(law, jnp.asarray(alone.rows[0]), jax.tree.map(lambda leaf: leaf[0, 0], alone.moves)).q.x
    np.testing.assert_allclose(ends[0], plain, atol=1e-9)
    assert np.abs(ends[1] - ends[0]).max() > 1e-4


@pytest.mark.parametrize("law", [
    ("coulomb_friction", "cart", {"level": 3.0}),
    ("stribeck_friction", "cart", {"level": 2.0, "breakaway": 3.0, "velocity": 0.02}),
    ("direction_dependent_friction", "hoist", {"positive": 2.0, "negative": 3.0}),
    ("position_direction_friction", "cart", {"knots": [0.0, 1.2], "positive": [1.0, 3.0], "negative": [2.0, 4.0]}),
], ids=lambda law: law[0])  # fmt: skip
def test_every_law_of_dry_friction_is_scattered(law):
    """Its levels together, by up to a third, and nothing else of it."""
    plant = make_plant(law)
    rows, table = scattered(plant, 100, 3), ParameterTable(plant)
    kind, site, values = law
    for key in values:
        places = table.positions(f"{kind}@{site}.{key}")
        factors = rows[:, places] / np.array(table.ravel(plant))[places].clip(1e-12)
        if key in ("knots", "velocity"):
            assert np.ptp(rows[:, places], axis=0).max() == 0.0
        else:
            assert np.ptp(factors, axis=1).max() < 1e-9 and 0.5 < np.ptp(factors[:, 0]) < 0.67


class Reader(AbstractController):
    """Commands what it reads."""

    def start(self, measured):
        return measured.x

    def command(self, state, measured, reference, period):
        return jnp.stack([measured.x, state]), measured.psi


def test_readings_have_the_noise_that_is_told():
    legs = dataclasses.replace(SHORT, seconds=20.0)
    plain, noisy = (Course(PLANT, scattered(PLANT, 1, 0), legs, 0.02, noise=n) for n in ((0.0,) * 3, (0.02, 0.3, 0.0)))
    for course, wanted in ((plain, (0.0, 0.0)), (noisy, (0.02, 0.3))):
        found = course.run(Reader(), jnp.asarray(course.rows[0]), jax.tree.map(lambda leaf: leaf[0, 0], course.moves))
        away = found.command[:, 0] - found.measured.x, found.command[1:, 1] - found.measured.psi[:-1]
        # A thousand samples tell a standard deviation to 2 % of it and a mean to 3 %; four times that.
        for values, size in zip(away, wanted, strict=True):
            assert float(jnp.std(values)) == pytest.approx(size, rel=0.09) and len(values) >= 1000
            assert abs(float(jnp.mean(values))) <= 0.13 * size


def test_random_moves_stay_in_their_region():
    region = Region((-0.3, 0.4), (0.3, 0.5))
    legs = random_legs(30, 1, bridges=4, region=region)
    for ends in (legs.start, legs.goal):
        assert ends[..., 0].min() > -0.3 and ends[..., 0].max() < 0.4
        assert ends[..., 1].min() > 0.3 and ends[..., 1].max() < 0.5
    assert np.abs(legs.start[..., 0] - legs.goal[..., 0]).min() >= 0.25 * 0.7


def test_moves_are_the_papers_or_random():
    np.testing.assert_array_equal(paper_legs().goal, [[1.2, 0.6], [0.5, 0.3]])
    legs = random_legs(20, 4)
    assert len(legs) == 20 and np.all(np.abs(legs.start[:, 0] - legs.goal[:, 0]) >= 0.3)
    np.testing.assert_array_equal(legs.start, random_legs(20, 4).start)


@pytest.mark.slow
def test_every_bridge_may_have_moves_of_its_own():
    legs = mixed_legs(5, 4)
    assert len(legs) == 2 and legs.start.shape == (5, 2, 2)
    np.testing.assert_array_equal(legs.goal[:, 0], paper_legs().goal[[0, 1, 0, 1, 0]])
    assert len(np.unique(legs.start[:, 1], axis=0)) == 5
    own = random_legs(3, 4, bridges=2)
    np.testing.assert_array_equal(own.goal.reshape(6, 2), random_legs(6, 4).goal)
    # What a bridge does on its own move is what it does there with nobody beside it.
    course = Course(PLANT, scattered(PLANT, 2, 0), dataclasses.replace(own, seconds=1.0), 0.02)
    alone = Legs(own.start[1, 2:], own.goal[1, 2:], own.speed, 1.0)
    single = Course(PLANT, course.rows[1:], alone, 0.02)
    found, wanted = measure(course, PID), measure(single, PID)
    assert found["itae_x"].shape == (2, 3)
    assert found["itae_x"][1, 2] == pytest.approx(wanted["itae_x"][0, 0], rel=1e-9)
    assert course.path(2, 1).x[0] == own.start[1, 2, 0]
    cost, one = (Cost(c, Goal((Effort(),), (1.0,)), knobs_of(PID)) for c in (course, single))
    assert cost.count == 6
    efforts = found["effort_x"] + found["effort_l"]
    assert cost.hard(np.zeros(8)) == pytest.approx(efforts.mean(), rel=1e-9)
    assert one.hard(np.zeros(8)) == pytest.approx(efforts[1, 2], rel=1e-9)


@pytest.fixture(scope="module")
def pid_cost():
    course = Course(PLANT, scattered(PLANT, 3, 0), SHORT, 0.02)
    return Cost(course, usual_goal(), knobs_of(PID))


def test_the_gradient_is_that_of_the_cost(pid_cost):
    z = np.array([0.1, -0.2, 0.3, 0.1, -0.1, 0.2, -0.1, 0.1])
    values, slopes = pid_cost.gradients(z, 0.1)
    value, slope = values.mean(), slopes.mean(axis=0)
    assert len(values) == pid_cost.count == 3 and value == pytest.approx(
        pid_cost.hard(z), rel=1e-12
    )  # a PID has nothing that is blurred
    for i in range(len(z)):
        step = np.zeros(len(z))
        step[i] = 1e-5
        difference = (pid_cost.smooth(z + step, 0.1) - pid_cost.smooth(z - step, 0.1)) / 2e-5
        assert slope[i] == pytest.approx(difference, rel=1e-4, abs=1e-6)


def test_blocks_do_not_matter(pid_cost, monkeypatch):
    from jbridge.tuning import cost

    monkeypatch.setattr(cost, "_ABREAST", 1)
    single = Cost(pid_cost.course, usual_goal(), knobs_of(PID))
    z = np.full(8, 0.1)
    assert single.hard(z) == pytest.approx(pid_cost.hard(z), rel=1e-9)


def tuned():
    """Twelve steps from gains that are too low."""
    given = Controller(dataclasses.replace(PID, cart_p=jnp.asarray(2.0), hoist_p=jnp.asarray(8.0)), 0.02)
    with jax.numpy_dtype_promotion("standard"):  # optax counts its steps in integers
        return tune(MODEL, given, plants=3, held_out=2, steps=12, starts=1, legs=SHORT, seed=2)


@pytest.mark.slow
def test_tuning_makes_a_law_better():
    found = tuned()
    before, after = found.costs["train"]
    assert after < 0.95 * before
    assert len(found.history) == 12 and found.rollouts > 3 * 12
    shapes = {name: found.measures[name][1]["itae_x"].shape for name in ("train", "held_out")}
    assert shapes == {"train": (3, 1), "held_out": (2, 4)}
    with pytest.raises(InputError, match="give at least 1"):
        tune(MODEL, found.given, steps=0)


def test_a_rope_that_is_locked_has_one_length():
    locked = dataclasses.replace(MODEL, given=MODEL.given - {"winch_mass", "hoist_gain"})
    with pytest.raises(InputError, match="the rope is locked; give its length as both ends of the rope's region"):
        tune(locked, Controller(PID, 0.02), region=Region(rail=(0.2, 0.8), rope=(0.3, 0.4)))
    region, small = Region(rail=(0.2, 0.8), rope=(0.4, 0.4)), {"plants": 2, "held_out": 2, "steps": 2, "starts": 1}
    with jax.numpy_dtype_promotion("standard"):  # optax counts its steps in integers
        found = tune(locked, Controller(PID, 0.02), region=region, **small)
    assert not found.measures["train"][1]["itae_l"].any() and found.measures["train"][1]["itae_x"].all()


@pytest.mark.slow
def test_the_same_call_tunes_to_the_same_controller():
    found, again = tuned(), tuned()
    assert found.coordinates == again.coordinates and found.costs == again.costs


def test_an_lqr_is_that_of_python_control():
    """Gains against another solver, and a loop that is stable."""
    control = pytest.importorskip("control")
    law = lqr_controller(MODEL, length=0.5).law
    a, b, _ = linear_model(PLANT, 0.5, 0.02)
    degree = np.radians(1.0)
    q = np.diag(np.array([0.01, degree, 0.01, 0.1, 5 * degree, 0.1]) ** -2.0)
    wanted, _, poles = control.dlqr(a, b, q, np.diag([1.0, 1 / 9.0]))
    np.testing.assert_allclose(law.gains, wanted, rtol=1e-6, atol=1e-7)
    assert np.abs(poles).max() < 1.0


def test_a_kalman_filter_is_that_of_python_control():
    """Corrections against another solver, and an estimate that comes to what moves."""
    control = pytest.importorskip("control")
    law = lqg_controller(MODEL, length=0.5).law
    a, b, _ = linear_model(PLANT, 0.5, 0.02)
    # Places and lengths about the working point move alike, so that the estimate needs no offset; the slow motion about
    # which the bridge is linearised couples the rest by 1e-6.
    np.testing.assert_allclose(a[:, [0, 2]], np.eye(6)[:, [0, 2]], atol=2e-6)
    degree = np.radians(1.0)
    unforeseen = np.diag(np.square([0.01, degree, 0.01]))
    read = np.diag(np.square([1e-4, 0.05 * degree, 1e-4]))
    into, c = np.eye(6, 3, -3), np.eye(3, 6)
    predicting, _, poles = control.dlqe(a, into, c, unforeseen, read)
    np.testing.assert_allclose(a @ law.correction, predicting, rtol=1e-6, atol=1e-9)
    assert np.abs(poles).max() < 1.0
    state, estimate = np.array([0.5, 0.02, 0.4, 0.1, 0.3, -0.1]), law.start(Axes(*map(jnp.asarray, (0.5, 0.02, 0.4))))
    for _ in range(50):
        measured = Axes(*map(jnp.asarray, state[:3]))
        asked, estimate = law.command(estimate, measured, Reference(*map(jnp.asarray, (0.5, 0.4, 0.0, 0.0))), 0.02)
        np.testing.assert_allclose(estimate.given, asked)
        last, state = state, a @ state + b @ np.asarray(asked)
    np.testing.assert_allclose(estimate.state, last, atol=1e-6)


def test_measures_agree_with_those_of_one_run():
    """Against `control.move_metrics`, which takes the samples themselves."""
    course = Course(PLANT, scattered(PLANT, 2, 0), SHORT, 0.02)
    firm = dataclasses.replace(PID, cart_p=jnp.asarray(40.0), cart_i=jnp.asarray(0.0), hoist_i=jnp.asarray(0.0))
    long = dataclasses.replace(SHORT, seconds=12.0, speed=(0.08, 0.08))  # so slowly that nothing swings
    course = Course(PLANT, scattered(PLANT, 2, 0), long, 0.02)
    found = measure(course, firm)
    path = course.path(0)
    one = course.run(firm, jnp.asarray(course.rows[1]), jax.tree.map(lambda leaf: leaf[1, 0], course.moves))
    position = np.stack([np.asarray(a) for a in one.q.axes], axis=1)
    (told,) = moves(path.times, np.stack([path.x, path.l], 1), position, np.asarray(one.command))
    assert found["itae_x"][1, 0] == pytest.approx(told.itae["x"], rel=0.02)
    assert found["residual_swing"][1, 0] == pytest.approx(told.residual_swing, rel=1e-9)
    for name in ("x", "l"):
        assert found[f"sign_changes_{name}"][1, 0] == told.sign_changes[name]
        assert found[f"saturation_{name}"][1, 0] == pytest.approx(told.saturation[name], abs=1e-12)
        # The samples of the leg leave out the first change, before the reference moves.
        assert found[f"chatter_{name}"][1, 0] == pytest.approx(told.travel[name], rel=0.05)
    for name in ("x", "l", "load"):
        assert told.settling_time[name] is not None
        assert found[f"settling_{name}"][1, 0] == pytest.approx(told.settling_time[name], abs=0.021)


def test_a_loop_that_runs_away_has_not_settled():
    """Where positions are no numbers any more, nothing is near."""
    wrong = dataclasses.replace(PID, hoist_p=jnp.asarray(-40.0))
    found = measure(Course(PLANT, scattered(PLANT, 2, 0), dataclasses.replace(SHORT, seconds=4.0), 0.02), wrong)
    assert np.isnan(found["itae_l"]).any()
    lost = np.isnan(found["itae_l"])
    assert np.isnan(found["settling_load"][lost]).all() and np.isnan(found["settling_l"][lost]).all()
    with pytest.raises(InputError, match="runs away .* s after its start"):
        track(
            MODEL,
            Controller(wrong, 0.02),
            smooth_path([(0.2, 0.4), (0.5, 0.5)], speed=(0.3, 0.2), rest=3.0, period=0.02),
        )


@pytest.mark.slow
def test_the_smooth_fuzzy_loop_has_the_gradient_of_its_cost():
    course = Course(PLANT, scattered(PLANT, 2, 0), SHORT, 0.02)
    knobs = FuzzyKnobs(paper_controller())
    cost = Cost(course, usual_goal(), knobs)
    z = 0.1 * np.random.default_rng(0).standard_normal(len(knobs.knobs))
    slope = cost.gradients(z, 0.3)[1].mean(axis=0)
    rng = np.random.default_rng(1)
    for _ in range(6):
        way = rng.standard_normal(len(z))
        way /= np.linalg.norm(way)
        difference = (cost.smooth(z + 1e-6 * way, 0.3) - cost.smooth(z - 1e-6 * way, 0.3)) / 2e-6
        assert slope @ way == pytest.approx(difference, rel=1e-4, abs=1e-4 * np.linalg.norm(slope))


def test_the_linear_bridge_is_the_equations_linearised():
    """By hand, with the input held: cart and swing coupled, the rope alone."""
    length, period, n = 0.45, 0.02, NUMBERS
    # (M + m) x'' + m l psi'' = K u - d x', l psi'' + x'' = -g psi - c / (m l) psi', (m + w) l'' = K u + m g - d l'
    m, big, c = n["load_mass"], n["cart_mass"], n["swing_damping"]
    mass = np.array([[big + m, m * length, 0.0], [1.0, length, 0.0], [0.0, 0.0, m + n["winch_mass"]]])
    stiff = np.zeros((3, 3))
    stiff[1, 1] = -n["gravity"]
    drag = np.diag([-n["cart_damping"], -c / (m * length), -n["hoist_damping"]])
    push = np.array([[n["cart_gain"], 0.0], [0.0, 0.0], [0.0, n["hoist_gain"]]])
    whole = np.zeros((8, 8))
    whole[:3, 3:6] = np.eye(3)
    whole[3:6, :3], whole[3:6, 3:6] = np.linalg.solve(mass, stiff), np.linalg.solve(mass, drag)
    whole[3:6, 6:] = np.linalg.solve(mass, push)
    exact = expm(whole * period)
    a, b, rest = linear_model(PLANT, length, period)
    np.testing.assert_allclose(a, exact[:6, :6], atol=2e-5)
    np.testing.assert_allclose(b, exact[:6, 6:], atol=2e-5)
    np.testing.assert_allclose(rest, [0.0, -m * n["gravity"] / n["hoist_gain"]], rtol=1e-12)


def test_a_gradient_that_explodes_does_not_count_for_the_others():
    slopes = np.ones((10, 2))
    slopes[3], slopes[4], slopes[5] = 1e20, np.nan, -2.0
    np.testing.assert_allclose(common_slope(slopes), (7 * 1.0 + 3.0 - 2.0) / 10, rtol=1e-12)
    np.testing.assert_array_equal(common_slope(np.full((3, 2), np.inf)), 0.0)


def test_a_models_own_losses_are_compensated():
    """By hand: friction over gain, half of both dead zones, and the load's weight."""
    plant = make_plant(
        DRY,
        ("position_direction_friction", "cart", {"knots": [0.0, 1.2], "positive": [1.0, 3.0], "negative": [2.0, 4.0]}),
        ("dead_zone", "cart_drive", {"positive": 0.2, "negative": 0.4}),
        ("stribeck_friction", "hoist", {"level": 1.0, "breakaway": 2.0, "velocity": 0.01}),
        ("load_dependent_friction", "hoist", {"level": 0.4, "share": 0.25}),
    )
    found, n = compensation_for(plant, 0.5), NUMBERS
    np.testing.assert_allclose(found.cart, 0.5 * (0.3 + (3.0 + 2.5) / n["cart_gain"]), rtol=1e-9)
    np.testing.assert_allclose(found.hoist, 0.5 * 2.4 / 0.75 / n["hoist_gain"], rtol=1e-9)
    np.testing.assert_allclose(found.hoist_bias, -n["load_mass"] * n["gravity"] / n["hoist_gain"], rtol=1e-12)


@pytest.mark.parametrize("law", ["extended", "pid", "lqr"])
def test_a_rig_in_counts_is_the_same_rig(law):
    """What begins a tuning moves it alike, and costs the same, whatever the unit of its inputs."""

    def begun(scale):
        numbers = {name: NUMBERS[name] / scale for name in ("cart_gain", "hoist_gain")}
        model = dataclasses.replace(MODEL, plant=make_plant(DRY, **numbers))
        given = compensation_for(model.plant, limits=(3.0 * scale, 10.0 * scale))
        make = {"extended": extended_controller, "pid": pid_for, "lqr": lambda given: lqr_controller(model, given).law}
        return Cost(Course(model.plant, scattered(model.plant, 1, 0), SHORT, 0.02), usual_goal()).of(make[law](given))

    assert begun(85.0) == pytest.approx(begun(1.0), rel=1e-6)


@pytest.mark.parametrize(("recorded", "limits"), [({}, None), ({"u_x": (-200.0, 255.0)}, (255.0, 10.0))])
def test_limits_in_counts_are_those_of_the_recordings(recorded, limits):
    model = dataclasses.replace(MODEL, units={"u_x": "count"}, recorded=recorded)
    if limits:
        assert drive_limits(model) == limits
    else:
        with pytest.raises(InputError, match="u_x is in count, .* such as --limits 255 255"):
            drive_limits(model)


class OneKnob(AbstractKnobs):
    knobs = (Knob("a", -9.0, 9.0),)

    def set(self, coordinates, softness=None):
        raise NotImplementedError


class Astray(Cost):
    """A bowl about 1; in the middle of a descent its slopes point the wrong way, as those of a chattering loop may."""

    def __init__(self):
        self.asked, self.count = 0, 1

    def hard(self, z):
        return float(np.sum((z - 1.0) ** 2)) + 0.1

    def smooth(self, z, softness):
        return self.hard(z)

    def gradients(self, z, softness):
        self.asked += 1
        way = -1.0 if 50 <= self.asked < 60 else 1.0
        return np.array([self.hard(z)]), way * 2.0 * (z - 1.0)[None]


class Nowhere(Astray):
    """The same bowl, whose beginning has no cost."""

    def smooth(self, z, softness):
        return float("nan") if np.all(z == 0.0) else self.hard(z)

    def gradients(self, z, softness):
        return np.array([self.hard(z)]), 2.0 * (z - 1.0)[None]


def test_a_descent_leaves_a_place_without_a_cost():
    """It would be sent back there at every comparison, and never come near."""
    with jax.numpy_dtype_promotion("standard"):
        best, _, _, _ = descend(Nowhere(), OneKnob(), 30, 1, 0, lambda text: None)
    np.testing.assert_allclose(best, 1.0, atol=0.2)


def test_a_descent_led_astray_goes_back():
    told = []
    with jax.numpy_dtype_promotion("standard"):
        best, history, softness, rollouts = descend(Astray(), OneKnob(), 100, 1, 0, told.append)
    assert any("back to the best" in text for text in told)
    np.testing.assert_allclose(best, 1.0, atol=0.05)
    # Not only the best place is kept: from there the descent goes on.
    assert history[49:61].max() > 0.12 and history[-1] < 0.11
    assert len(history) == len(softness) == 100 and rollouts > 100
