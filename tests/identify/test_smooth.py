"""Ties between neighbouring levels of a map: against plain least squares, and what they are worth."""

import numpy as np
import pytest

from jbridge.identify.base import columns_for
from jbridge.identify.lanes import make_batch
from jbridge.identify.left_out import costs_left_out
from jbridge.identify.linearise import Engine
from jbridge.identify.smooth import POOR, smoothed
from jbridge.identify.solve import solve
from jbridge.model.parameters import ParameterTable
from tests.identify.cases import DRY, NOISE, make_recording, play, steps
from tests.problems import make_plant

KNOTS = np.array([0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1])
MAP = "position_dependent_friction"


@pytest.mark.parametrize("strength", [1e-6, 1e-2, 1.0])
def test_what_is_foreseen_of_a_linear_model_is_least_squares_without_each_recording(strength):
    key = np.random.default_rng(2)
    lanes, samples, levels = 4, 80, np.array([2.0, 2.2, 2.9, 2.6])
    plant = make_plant((MAP, "cart", {"knots": [0.2, 0.5, 0.8, 1.1], "levels": levels}), DRY)
    table = ParameterTable(plant)
    free = np.array(table.positions(f"{MAP}@cart.levels"))
    design = np.abs(key.standard_normal((lanes, samples, 4)))
    design[1:, :, 3] *= 0.1  # a place that one recording alone knows well
    data = design @ levels + 0.1 * key.standard_normal((lanes, 1)) + 0.1 * key.standard_normal((lanes, samples))
    vector = np.array(table.ravel(plant))
    residual = design @ vector[free] - data
    stacked = np.concatenate([design.swapaxes(1, 2), np.zeros((lanes, 6, samples)), residual[:, None]], axis=1)
    times = np.arange(100) * 0.01
    runs = [make_recording(f"{i}.csv", times, u_x=np.sin(times), x=np.cos(times)) for i in range(lanes)]
    batch = make_batch(runs, NOISE)
    products = stacked @ stacked.swapaxes(1, 2)
    found = costs_left_out(table, vector, free, products, 4, batch.initial, batch, [strength])[strength]
    weight = np.sqrt(strength * np.einsum("lsi,lsi->i", design, design).max())
    wanted = 0.0
    for r in range(lanes):
        others = np.delete(np.arange(lanes), r)
        rows = np.concatenate([design[others].reshape(-1, 4), weight * np.diff(np.eye(4), axis=0)])
        own = np.linalg.lstsq(rows, np.append(data[others].reshape(-1), np.zeros(3)), rcond=None)[0]
        wanted += float(((design[r] @ own - data[r]) ** 2).sum())
    assert found == pytest.approx(wanted, rel=1e-5)


def fitted_map(truth):
    """A map with nothing beside it, fitted to recordings of a cart whose friction is the same everywhere."""
    given = make_plant((MAP, "cart", {"knots": KNOTS, "levels": np.full(7, 3.0)}))
    volts = {k: np.stack([steps(800, k, hold=45, volts=2.5), np.zeros(800)], axis=1) for k in (0, 2, 3)}
    runs = [play(truth, u, seed=k) for k, u in volts.items()]
    engine = Engine(given)
    batch = make_batch(runs, NOISE, size=engine.table.size)
    free = np.array(engine.table.positions(f"{MAP}@cart.levels"))
    start = np.array(engine.table.ravel(given))[None]
    return engine, batch, solve(engine, batch, start, [free], columns=columns_for(7), iterations=30)


def test_levels_that_take_up_what_is_not_theirs_are_smoothed():
    """A gain that is wrong by a fifth is no friction of any place, and what a fit makes of it holds nowhere else."""
    engine, batch, fits = fitted_map(make_plant(DRY, cart_gain=20.0))
    chi = np.sqrt(fits.cost[0] / (np.asarray(batch.lanes.weight) > 0).sum())
    assert chi > POOR
    smooth = smoothed(engine, batch, fits, columns_for(7))
    free = fits.free[0]
    rough, even = (float(np.abs(np.diff(f.vectors[0, free])).max()) for f in (fits, smooth))
    assert even < 0.5 * rough

    elsewhere = play(
        make_plant(DRY, cart_gain=20.0), np.stack([steps(800, 7, hold=45, volts=2.5), np.zeros(800)], axis=1)
    )
    proof = make_batch([elsewhere] * 3, NOISE, size=engine.table.size, like=batch)
    errors = [
        engine.gram(f.vectors, np.array([free]), proof.initial[None], proof, columns=columns_for(7)).cost.sum()
        for f in (fits, smooth)
    ]
    assert errors[1] < 0.8 * errors[0]


def test_levels_that_are_known_stay_as_they_are():
    levels = np.array([3.0, 3.5, 4.5, 4.0, 3.0, 3.0, 3.0])
    engine, batch, fits = fitted_map(make_plant((MAP, "cart", {"knots": KNOTS, "levels": levels})))
    assert smoothed(engine, batch, fits, columns_for(7)) is fits
