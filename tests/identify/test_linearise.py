"""Tangents of free runs against central differences, through sticking, reversals, lag and dead zone."""

import dataclasses

import jax
import numpy as np
import pytest

import jbridge.identify.linearise as linearise
from jbridge.identify.lanes import make_batch
from jbridge.identify.linearise import Engine
from tests.identify.cases import NOISE, play, steps
from tests.problems import EVERY_AXIS, make_plant

SMOOTH = make_plant(swing_damping=0.01)
DRY = make_plant(
    ("coulomb_friction", "cart", {"level": 3.0}),
    ("coulomb_friction", "hoist", {"level": 2.0}),
    ("dead_zone", "cart_drive", {"positive": 0.2, "negative": 0.25}),
    ("actuator_lag", "hoist_drive", {"time_constant": 0.06}),
    swing_damping=0.01,
)
EVERY_STAGE = make_plant(
    ("stribeck_friction", "cart", {"level": 2.0, "breakaway": 3.0, "velocity": 0.05}),
    ("dead_zone", "cart_drive", {"positive": 0.2, "negative": 0.25}),
    ("input_delay", "cart_drive", {"delay": 0.021}),
    ("actuator_lag", "hoist_drive", {"time_constant": 0.06}),
    ("drum_radius_change", "hoist_drive", {"slope": 0.3, "length": 0.5}),
    ("double_pendulum", "swing", {"hook_mass": 0.05, "link": 0.15, "damping": 0.0002}),
    ("quadratic_drag", "hoist", {"coefficient": 4.0}),
    ("sensor_delay", "psi_sensor", {"delay": 0.013}),
    ("sensor_eccentricity", "x_sensor", {"amplitude": 0.002, "period": 0.1, "phase": 0.4}),
    ("sensor_scale", "l_sensor", {"scale": 1.03}),
    swing_damping=0.01,
)
"""With effects that act before the loop over time, in it, behind it, and in several of them."""
STEP = 1e-5
"""Relative step of the differences: rounding is far below it, and few reversals change intervals within it."""


def two_runs(plant):
    runs = []
    for i in range(2):
        u = np.stack([steps(150, i), 0.7 * steps(150, 5 + i) - 0.3], axis=1)
        runs.append(play(plant, u, name=f"{i}.csv", active=EVERY_AXIS, start={"x": 0.6, "psi": 0.1}, seed=i))
    return runs


@pytest.mark.parametrize(
    ("plant", "tolerance"),
    [
        (SMOOTH, 1e-6),
        # Along a path that sticks, the stops' times move, and a step of the difference crosses some of them.
        (DRY, 2e-2),
        (EVERY_STAGE, 2e-2),
    ],
    ids=["smooth", "dry", "every_stage"],
)
def test_tangents_against_central_differences(plant, tolerance):
    engine = Engine(plant)
    vector = np.array(engine.table.ravel(plant))
    batch = make_batch(two_runs(plant), NOISE, size=engine.table.size, hidden=plant.hidden)
    free = np.flatnonzero(engine.table.fitted())
    columns = len(free)

    def gram(at, initial, keep=False):
        return engine.gram(at[None], free[None], initial[None], batch, columns=columns, keep=keep)

    tangents = gram(vector, batch.initial, keep=True).tangents[0]
    weight = np.asarray(batch.lanes.weight)

    def check(name, column, up, down, size):
        difference = (up.predicted[0] - down.predicted[0]) / (2 * size) * weight
        wanted = difference.reshape(batch.count, -1)
        scale = np.linalg.norm(wanted)
        assert scale > 0 or name == "winch", name
        assert np.linalg.norm(tangents[:, column] - wanted) <= tolerance * scale + 1e-9, name

    for column, place in enumerate(free):
        size = STEP * max(abs(vector[place]), 0.01)
        change = np.zeros_like(vector)
        change[place] = size
        entry = engine.table.entry(int(place))
        check(entry.name, column, gram(vector + change, batch.initial), gram(vector - change, batch.initial), size)
    for state in range(batch.initial.shape[1]):
        change = np.zeros_like(batch.initial)
        change[:, state] = STEP
        up, down = gram(vector, batch.initial + change), gram(vector, batch.initial - change)
        check(f"state {state}", columns + state, up, down, STEP)


def test_products_are_those_of_the_tangents():
    engine = Engine(SMOOTH)
    vector = np.array(engine.table.ravel(SMOOTH))
    batch = make_batch(two_runs(SMOOTH), NOISE, size=engine.table.size)
    free = np.flatnonzero(engine.table.fitted())
    found = engine.gram(vector[None], free[None], batch.initial[None], batch, columns=len(free), keep=True)
    residual = (found.predicted[0] - np.asarray(batch.lanes.y)) * np.asarray(batch.lanes.weight)
    table = np.concatenate([found.tangents[0], residual.reshape(batch.count, 1, -1)], axis=1)
    np.testing.assert_allclose(found.products[0], table @ table.swapaxes(1, 2), rtol=1e-12)
    np.testing.assert_allclose(found.cost[0], (residual**2).sum(axis=(1, 2)), rtol=1e-12)


def test_lanes_that_would_take_much_memory_are_run_some_at_a_time(monkeypatch):
    engine = Engine(DRY)
    vector = np.array(engine.table.ravel(DRY))
    batch = make_batch(two_runs(DRY), NOISE, size=engine.table.size, window=0.4)
    lanes = jax.tree.map(lambda leaf: leaf[:7], batch.lanes)
    batch = dataclasses.replace(batch, lanes=lanes, initial=batch.initial[:7])
    free = np.flatnonzero(engine.table.fitted())
    vectors = vector * np.linspace(1.0, 1.02, 5)[:, None]
    asked = (vectors, np.stack([free] * 5), np.stack([batch.initial] * 5), batch)
    whole = engine.gram(*asked, columns=len(free), keep=True)
    calls = []
    run = linearise.stages.tangents

    def counted(table, vectors, free, initial, lanes, substeps):
        calls.append(initial.shape[:2])
        return run(table, vectors, free, initial, lanes, substeps)

    monkeypatch.setattr(linearise.stages, "tangents", counted)
    steps = batch.lanes.lane.dt.shape[1] * batch.substeps
    monkeypatch.setattr(linearise, "_MOST", 8 * steps * (len(free) + batch.initial.shape[1]) * 7 // 4 + 1)
    parts = engine.gram(*asked, columns=len(free), keep=True)
    # Neither five rows nor seven lanes go up in shares of one size.
    assert calls == [(4, 2)] * 8
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(one).max())
