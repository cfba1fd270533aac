"""Unknown forces: the filter against dense Gaussian formulas, and the whole on a rig with a force of known course."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from jbridge.identify.kalman import Prior, Steps, evidence, smoothed
from jbridge.identify.lanes import make_batch
from jbridge.identify.latent import unknown_forces
from jbridge.identify.linearise import Engine
from jbridge.identify.solve import solve
from tests.identify.cases import NOISE, play, steps
from tests.problems import EVERY_AXIS, make_plant

COUNT, STEP = 60, 0.02


def matern(times, size, length):
    away = np.sqrt(3.0) * np.abs(times[:, None] - times[None]) / length
    return size**2 * (1 + away) * np.exp(-away)


def cart_alone(force):
    """A mass on which a force acts: place and velocity, place measured; a few readings are missing."""
    rng = np.random.default_rng(3)
    a = np.array([[1.0, STEP], [0.0, 0.97]])
    b = np.array([[0.5 * STEP**2, 0.0, 0.0], [STEP, 0.0, 0.0]])
    weight = np.zeros((COUNT, 3))
    weight[:, 0] = 1e3
    weight[20:25, 0] = 0.0
    error = np.zeros((COUNT, 3))
    error[:, 0] = 0.01 * rng.standard_normal(COUNT)
    return Steps(
        np.repeat(a[None], COUNT, 0),
        np.repeat(b[None], COUNT, 0),
        np.repeat(np.array([[[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]]), COUNT, 0),
        np.full(COUNT, STEP),
        error,
        weight,
        force,
        np.diag([4e-6, 9e-4]),
        np.array([1e-3, -0.02]),
    )


def dense(steps, size, length, signal):
    """How readings depend on the start, their mean, covariance, and covariance with the unknown: all times at once."""
    times = STEP * np.arange(COUNT + 1)
    kernel = matern(times, size, length)
    a, b = np.asarray(steps.a[0]), np.asarray(steps.b[0])[:, 0]
    to_start = np.array([np.linalg.matrix_power(a, k + 1)[0] for k in range(COUNT)])
    to_force = np.zeros((COUNT, COUNT + 1))
    for k in range(COUNT):
        for j in range(k + 1):
            to_force[k, j] = (np.linalg.matrix_power(a, k - j) @ b)[0]
    mean = to_start @ np.asarray(steps.start) - to_force[:, :COUNT] @ np.asarray(steps.force)[:, 0]
    response = np.eye(COUNT, COUNT + 1, 1) if signal else to_force
    cov = to_start @ np.asarray(steps.spread) @ to_start.T + response @ kernel @ response.T
    return to_start, mean, cov, kernel @ response.T, np.diag(kernel)


@pytest.mark.parametrize("signal", [False, True], ids=["force", "signal"])
def test_filter_and_smoother_are_gaussian_regression(signal):
    size, length = (2.0, 0.3) if not signal else (0.01, 0.2)
    force = np.zeros((COUNT, 3))
    force[:, 0] = np.sin(np.arange(COUNT) / 9)
    steps = cart_alone(force)
    here, none = np.eye(3)[[0]], np.zeros((1, 3))
    prior = Prior(none if signal else here, here if signal else none, np.array([size]), np.array([length]))
    to_start, mean, cov, cross, variance = dense(steps, size, length, signal)
    used = np.asarray(steps.weight)[:, 0] > 0
    noisy = cov[np.ix_(used, used)] + 1e-6 * np.eye(used.sum())
    measured = np.asarray(steps.error)[used, 0]
    wanted = multivariate_normal(mean[used], noisy).logpdf(measured)
    # The filter leaves out what no prior changes: the noise's own normalisation.
    constant = -0.5 * used.sum() * np.log(2 * np.pi * 1e-6)
    assert float(evidence(prior, steps)) == pytest.approx(wanted - constant, rel=1e-8)
    gain = cross[:, used] @ np.linalg.inv(noisy)
    told, std, before, first = (np.asarray(part) for part in smoothed(prior, steps))
    np.testing.assert_allclose(np.append(before, told), gain @ (measured - mean[used]), atol=1e-7 * size)
    left = variance - np.einsum("ij,ij->i", gain, cross[:, used])
    np.testing.assert_allclose(std[:, 0], np.sqrt(left[1:]), rtol=1e-5)
    spread = np.asarray(steps.spread)
    began = np.asarray(steps.start) + spread @ to_start[used].T @ np.linalg.solve(noisy, measured - mean[used])
    np.testing.assert_allclose(first, began, rtol=1e-6, atol=1e-12)


DRY = (("coulomb_friction", "cart", {"level": 2.0}), ("coulomb_friction", "hoist", {"level": 1.0}))
MODEL = make_plant(*DRY, swing_damping=0.01)


def found(*effects):
    """Evidence and forces where the model lacks some effects."""
    rig = make_plant(*DRY, *effects, swing_damping=0.01)
    runs = []
    for seed in range(2):
        u = np.stack([2.0 * steps(400, seed), steps(400, 5 + seed) - 0.5], axis=1)
        start = {"x": 0.6, "psi": 0.1}
        runs.append(play(rig, u, name=f"{seed}.csv", active=EVERY_AXIS, start=start, seed=seed))
    engine = Engine(MODEL)
    batch = make_batch(runs, NOISE, size=engine.table.size, substeps=4)
    vector = np.array(engine.table.ravel(MODEL))
    started = solve(engine, batch, vector[None], [np.zeros(0, np.int64)], columns=8)
    return runs, unknown_forces(engine.table, vector, batch, started.initial[0], np.array([2.0, 0.05, 2.0]))


def test_a_force_is_found_where_it_acts_and_as_it_goes():
    runs, latent = found(("spring_force", "cart", {"stiffness": 6.0, "rest": 0.5}))
    assert max(latent.evidence, key=lambda site: latent.evidence[site]) == "cart"
    assert latent.evidence["cart"] > 100.0
    for run, force in zip(runs, latent.forces, strict=True):
        true = -6.0 * (np.interp(force.times, run.times - run.times[0], run.x) - 0.5)
        known = force.std[:, 0] < 0.6  # elsewhere dry friction holds the cart
        assert known.mean() > 0.7 and np.all(np.diff(force.times) > 0)
        off = force.mean[known, 0] - true[known]
        assert np.sqrt(np.mean(off**2)) < 0.25 * np.sqrt(np.mean(true[known] ** 2))
        # The other axes need nothing.
        assert np.abs(force.mean[:, 1]).mean() < 0.01


def test_a_torque_on_the_load_is_not_taken_for_the_cart():
    _, latent = found(("wind", "swing", {"force": 0.05, "start": 1.0, "stop": 2.5}))
    ranked = sorted(latent.evidence, key=lambda site: -latent.evidence[site])
    assert ranked[0] == "swing"


def test_a_sensor_that_jumps_is_no_force():
    _, latent = found(("missed_counts", "x_sensor", {"jump": 0.004, "time": 1.7}))
    assert max(latent.evidence, key=lambda site: latent.evidence[site]) == "x_sensor"


def test_where_nothing_is_missing_there_is_no_evidence():
    _, latent = found()
    assert max(latent.evidence.values()) < 10.0
