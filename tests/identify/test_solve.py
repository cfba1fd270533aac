"""The solver against the full normal equations and against optimistix, on problems small enough for both."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from scipy.optimize import lsq_linear

from jbridge.identify.lanes import make_batch
from jbridge.identify.linearise import Engine
from jbridge.identify.solve import Reduced, bounded_step, reduce, solve
from jbridge.rollout import MIDPOINT, readings, rollout
from tests.identify.cases import NOISE, cart_recordings, play, steps
from tests.problems import LOCKED_ROPE, make_plant

TRUTH = make_plant(cart_damping=50.0, cart_gain=17.0)
"""Without friction: a smooth problem has one optimum, and both solvers must find it to many digits."""
FREE = ("cart_damping", "cart_gain")


@pytest.fixture(scope="module")
def problem():
    engine = Engine(make_plant(cart_damping=38.0, cart_gain=13.0))
    batch = make_batch(cart_recordings(TRUTH, 2, seconds=3.0), NOISE, size=engine.table.size)
    vector = np.array(engine.table.ravel(make_plant(cart_damping=38.0, cart_gain=13.0)))
    free = np.array([engine.table.positions(name)[0] for name in FREE])
    return engine, batch, vector, free


def solved(problem, **options):
    engine, batch, vector, free = problem
    return solve(engine, batch, vector[None], [free], columns=8, iterations=30, tolerance=1e-10, **options)


def test_the_optimum_is_that_of_optimistix(problem):
    engine, batch, vector, free = problem
    found = solved(problem)
    loose = np.isfinite(batch.prior)
    scale = np.array([10.0, 3.0])

    def residuals(unknown, _):
        parameters, states = unknown
        numbers = jnp.asarray(vector).at[free].set(parameters * scale)
        initial = jnp.asarray(batch.initial).at[loose].set(states)

        def one(start, lanes):
            plant = engine.table.unravel(numbers)
            motions = rollout(plant, start, lanes.lane, substeps=batch.substeps, method=MIDPOINT)
            return (readings(plant, lanes.lane, motions) - lanes.y) * lanes.weight

        prior = (states - jnp.asarray(batch.initial[loose])) * jnp.asarray(batch.prior[loose])
        return jax.vmap(one)(initial, batch.lanes), prior

    start = (jnp.asarray(vector[free] / scale), jnp.asarray(batch.initial[loose]))
    solver = optimistix.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
    oracle = optimistix.least_squares(residuals, solver, start, max_steps=100)
    np.testing.assert_allclose(found.vectors[0, free], np.asarray(oracle.value[0]) * scale, rtol=1e-6)
    np.testing.assert_allclose(found.initial[0][loose], np.asarray(oracle.value[1]), rtol=1e-5, atol=1e-7)
    values, prior = residuals(oracle.value, None)
    assert float(found.cost[0]) == pytest.approx(float(jnp.sum(values**2)), rel=1e-6)
    # The recordings hold noise of the size that was told, so the optimum stands at one.
    count = (np.asarray(batch.lanes.weight) > 0).sum()
    assert float(found.cost[0]) / count == pytest.approx(1.0, abs=0.15)


def test_a_start_that_a_sensor_misreads_may_move_as_far_as_it_misreads():
    """An offset of 40 times the noise, from rest: the first guess of the angle is what the sensor reads."""
    offset = ("sensor_offset", "psi_sensor", {"offset": 0.03})
    truth, given = make_plant(offset), make_plant(("sensor_offset", "psi_sensor", {"offset": 0.0}))
    volts = [np.stack([np.append(np.zeros(30), steps(570, k)), np.zeros(600)], axis=1) for k in range(2)]
    runs = [play(truth, u, active=LOCKED_ROPE, start={"x": 0.5, "l": 0.7}, seed=k) for k, u in enumerate(volts)]
    engine = Engine(given)
    batch = make_batch(runs, NOISE, size=engine.table.size, altered=["psi"])
    place = engine.table.positions("sensor_offset@psi_sensor.offset")
    vector = np.array(engine.table.ravel(given))
    found = solve(engine, batch, vector[None], [np.array(place)], columns=8, iterations=30)
    assert found.vectors[0, place[0]] == pytest.approx(0.03, abs=2e-4)
    assert np.abs(found.initial[0][:2, 1]).max() < 2e-3 and np.abs(batch.initial[:2, 1] - 0.03).max() < 2e-3


def test_rows_are_fits_of_their_own(problem):
    engine, batch, vector, free = problem
    other = vector.copy()
    other[free] *= [1.4, 1.3]
    both = solve(engine, batch, np.array([vector, other]), [free, free[:1]], columns=8, iterations=30, tolerance=1e-10)
    alone = solved(problem)
    np.testing.assert_allclose(both.vectors[0, free], alone.vectors[0, free], rtol=1e-7)
    # The second row may not change its gain.
    assert both.vectors[1, free[1]] == other[free[1]] and both.cost[1] > both.cost[0]


def test_a_start_that_runs_away_is_left_where_it_is(problem):
    """A negative damping without measure: infinite within the run, and no harm to the fit of another row."""
    engine, batch, vector, free = problem
    wild = vector.copy()
    wild[free[0]] = -1e6
    both = solve(engine, batch, np.array([wild, vector]), [free, free], columns=8, iterations=30, tolerance=1e-10)
    np.testing.assert_array_equal(both.vectors[0], wild)
    assert not np.isfinite(both.cost[0])
    np.testing.assert_allclose(both.vectors[1], solved(problem).vectors[0], rtol=1e-9)


def random_products(key, lanes, columns, states):
    tables = key.standard_normal((lanes, columns + states + 1, 40))
    return tables @ tables.swapaxes(1, 2), tables


def test_elimination_gives_the_step_of_the_full_equations():
    key = np.random.default_rng(0)
    lanes, count, states = 3, 4, 2
    products, tables = random_products(key, lanes, count, states)
    guess, initial = key.standard_normal((2, lanes, states))
    prior = key.uniform(0.5, 2.0, (lanes, states))
    prior[2, 1] = np.inf
    reduced = reduce(products, count, count, initial, guess, prior)
    step = np.linalg.solve(reduced.matrix, -reduced.gradient)
    moved = reduced.back @ step + reduced.shift
    # The same as one stacked least-squares problem.
    rows, right = [], []
    for lane in range(lanes):
        block = np.zeros((40, count + lanes * states))
        block[:, :count] = tables[lane, :count].T
        for s in range(states):
            if np.isfinite(prior[lane, s]):
                at = count + lane * states + s
                block[:, at] = tables[lane, count + s]
                pull = np.zeros((1, count + lanes * states))
                pull[0, at] = prior[lane, s]
                rows.append(pull)
                right.append(-prior[lane, [s]] * (initial[lane, s] - guess[lane, s]))
        rows.append(block)
        right.append(-tables[lane, -1])
    wanted = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    np.testing.assert_allclose(step, wanted[:count], rtol=1e-8)
    np.testing.assert_allclose(moved.reshape(-1), wanted[count:], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_a_bounded_step_is_the_best_within_its_bounds(seed):
    key = np.random.default_rng(seed)
    root = key.standard_normal((5, 5))
    matrix, gradient = root @ root.T + 0.1 * np.eye(5), 3 * key.standard_normal(5)
    none = np.zeros((0, 5, 5))
    reduced = Reduced(matrix, gradient, np.diag(matrix).copy(), none, none[:, 0], none, none[:, 0])
    low, high = np.full(5, -0.3), np.full(5, 0.4)
    step = bounded_step(reduced, np.zeros(5), low, high, 0.0)
    assert np.all(step >= low) and np.all(step <= high)
    best = lsq_linear(root_of(matrix), -np.linalg.solve(root_of(matrix).T, gradient), bounds=(low, high)).x

    def gain(s):
        return gradient @ s + 0.5 * s @ matrix @ s

    assert gain(step) <= gain(best) + 1e-3 * abs(gain(best))


def test_units_do_not_matter_to_a_step():
    """A stiffness of 1e4 N/m beside a gain in N/count, an offset in metres and a moment: 24 orders of magnitude."""
    key = np.random.default_rng(1)
    root = key.standard_normal((4, 4))
    matrix, gradient = root @ root.T + 0.1 * np.eye(4), key.standard_normal(4)
    none = np.zeros((0, 4, 4))
    unit = np.array([1.0, 1e7, 1e-5, 1e3])
    low, high = np.array([-0.2, -9.0, -9.0, -9.0]), np.full(4, 9.0)

    def step(units):
        scaled = matrix * np.outer(units, units)
        given = Reduced(scaled, gradient * units, np.diag(scaled).copy(), none, none[:, 0], none, none[:, 0])
        return bounded_step(given, np.zeros(4), low / units, high / units, 1e-6) * units

    np.testing.assert_allclose(step(unit), step(np.ones(4)), rtol=1e-6, atol=1e-9)


def root_of(matrix):
    return np.linalg.cholesky(matrix).T


def test_states_of_a_simulation_that_nearly_runs_away_are_eliminated():
    """Sensitivities of 1e120 and 1, and two that are the same: no traceback, and the rest as without that state."""
    key = np.random.default_rng(0)
    tangents = key.standard_normal((200, 9))
    tangents[:, 2] *= 1e120
    tangents[:, 4] = tangents[:, 3]
    products = (tangents.T @ tangents)[None]
    start = np.zeros((1, 6))
    found = reduce(products, 2, 2, start, start, np.zeros((1, 6)))
    assert np.isfinite(found.matrix).all() and np.isfinite(found.gradient).all()
    mild = tangents.copy()
    mild[:, 2] /= 1e120
    wanted = reduce((mild.T @ mild)[None], 2, 2, start, start, np.zeros((1, 6)))
    np.testing.assert_allclose(found.matrix, wanted.matrix, rtol=1e-6)


def test_places_that_no_recording_passes_take_the_level_of_those_beside_them():
    """A map of friction along a rail of which one end is not crossed: the visited part is found as if alone."""
    knots = np.array([0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1])
    levels = np.array([3.0, 3.5, 4.5, 4.0, 3.0, 3.0, 3.0])
    kind, site = "position_dependent_friction", "cart"
    truth = make_plant((kind, site, {"knots": knots, "levels": levels}))
    start = np.where(knots > 1.0, 400.0, 3.0)
    given = make_plant((kind, site, {"knots": knots, "levels": start}))
    volts = {k: np.stack([steps(800, k, hold=45, volts=2.5), np.zeros(800)], axis=1) for k in (0, 2, 3)}
    runs = [play(truth, u, seed=k) for k, u in volts.items()]
    furthest = max(float(r.x.max()) for r in runs)
    assert 0.8 < furthest < 0.95
    engine = Engine(given)
    batch = make_batch(runs, NOISE, size=engine.table.size)
    free = np.array(engine.table.positions(f"{kind}@{site}.levels"))
    found = solve(engine, batch, np.array(engine.table.ravel(given))[None], [free], columns=8, iterations=30)
    assert float(found.cost[0]) / (np.asarray(batch.lanes.weight) > 0).sum() == pytest.approx(1.0, abs=0.15)
    got = found.vectors[0, free]
    passed = knots < furthest
    np.testing.assert_allclose(got[passed], levels[passed], atol=0.05)
    # What the last visited stretch says of its far end, 0.95 m, goes on behind it.
    np.testing.assert_allclose(got[-1], got[-2], rtol=1e-3)
