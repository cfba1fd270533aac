"""The last fit, with the engine's own error taken off, on recordings played by another method with finer steps."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest

from jbridge.identify.finer import LastFit, fit_finely, less_own_error
from jbridge.identify.lanes import make_batch
from jbridge.identify.linearise import Engine
from jbridge.identify.solve import solve
from tests.identify.cases import NOISE, play, steps
from tests.problems import EVERY_AXIS, make_plant, make_state

TRUTH = make_plant(
    ("coulomb_friction", "cart", {"level": 3.0}),
    ("coulomb_friction", "hoist", {"level": 2.0}),
    ("sensor_delay", "x_sensor", {"delay": 0.0008}),
)
FREE = ("cart_damping", "cart_gain", "coulomb_friction@cart.level", "sensor_delay@x_sensor.delay")
COLUMNS = 8


def noiseless(count=2, size=600):
    runs = []
    for i in range(count):
        u = np.stack([steps(size, i), 0.7 * steps(size, 5 + i) - 0.3], axis=1)
        start = {"x": 0.6, "psi": 0.1}
        runs.append(play(TRUTH, u, name=f"{i}.csv", active=EVERY_AXIS, period=0.005, start=start, noise=0.0))
    return runs


@pytest.fixture(scope="module")
def coarse():
    """A fit at the usual steps, from the truth."""
    engine = Engine(TRUTH)
    vector = np.array(engine.table.ravel(TRUTH))
    batch = make_batch(noiseless(), NOISE, size=engine.table.size, step=0.0051)
    free = np.array([engine.table.positions(name)[0] for name in FREE])
    fits = solve(engine, batch, vector[None], [free], columns=COLUMNS, iterations=20)
    return LastFit(engine, fits.vectors[0], free, fits.initial[0], fits.gram, batch)


def test_own_error_is_what_keeps_the_truth_from_fitting(coarse):
    vector = np.array(coarse.engine.table.ravel(TRUTH))
    places = coarse.free[None]
    initial = np.tile(np.array(make_state(x=0.6, psi=0.1)), (coarse.batch.count, 1))
    usual = coarse.engine.gram(vector[None], places, initial[None], coarse.batch, columns=COLUMNS)
    corrected, _ = less_own_error(coarse.engine, vector, initial, coarse.batch, usual.predicted[0])
    fine = coarse.engine.gram(vector[None], places, initial[None], corrected, columns=COLUMNS)
    assert float(fine.cost.sum()) < 0.2 * float(usual.cost.sum())


def test_a_delay_is_found_that_is_shorter_than_a_step(coarse):
    place, delay = coarse.free[-1], 0.0008
    last = fit_finely(coarse)
    assert last.finer
    assert abs(last.vector[place] - delay) < 0.35 * abs(coarse.vector[place] - delay)
    assert abs(last.vector[place] - delay) < 0.02 * delay
    assert last.cost < coarse.cost
    # What was measured stays what it was.
    assert np.array_equal(np.asarray(coarse.batch.lanes.weight), np.asarray(last.batch.lanes.weight))


def test_a_difference_that_is_no_correction_is_left_alone(coarse, monkeypatch):
    def torn(vector, initial, batch, *, finer=1):
        predicted = coarse.gram.predicted[0]
        return None, predicted + 50 * np.array(list(NOISE.values())) * np.sin(np.arange(predicted.shape[1]))[:, None]

    monkeypatch.setattr(coarse.engine, "motions", torn)
    assert fit_finely(coarse) is coarse


def test_nothing_is_taken_off_where_nothing_was_measured(coarse):
    weight = np.asarray(coarse.batch.lanes.weight).copy()
    weight[:, ::2] = 0.0
    lanes = eqx.tree_at(lambda lanes: lanes.weight, coarse.batch.lanes, weight)
    batch = dataclasses.replace(coarse.batch, lanes=lanes)
    predicted = coarse.gram.predicted[0]
    corrected, _ = less_own_error(coarse.engine, coarse.vector, coarse.initial, batch, predicted)
    changed = np.asarray(corrected.lanes.y) != np.asarray(batch.lanes.y)
    assert changed.any() and not changed[:, ::2].any()
