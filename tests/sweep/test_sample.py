"""Points of a sweep: any stretch without the others, spread as its kind says, and the same as SciPy's."""

import numpy as np
import pytest
from scipy.stats import kstest, qmc

from jbridge.sweep.sample import Axis, Design

AXES = (Axis("a", 1.0, 3.0), Axis("b", 0.01, 100.0, logarithmic=True), Axis("c", -1.0, 0.0))
SAMPLES = [Design(kind, AXES, 1000, 7) for kind in ("random", "latin", "sobol")]
GRID = Design("grid", (Axis("a", 0.0, 1.0, 5), Axis("b", 1.0, 9.0, values=(1.0, 2.0, 9.0))), 15, 0)


@pytest.mark.parametrize("design", [*SAMPLES, GRID], ids=lambda d: d.kind)
def test_any_stretch_is_a_part_of_the_whole(design):
    whole = design.points(0, design.count)
    assert whole.shape == (design.count, len(design.axes))
    for start, stop in ((0, 3), (3, 4), (5, 13), (design.count - 6, design.count + 50)):
        np.testing.assert_array_equal(design.points(start, stop), whole[start:stop])


@pytest.mark.parametrize("design", SAMPLES, ids=lambda d: d.kind)
def test_points_fill_their_ranges_evenly(design):
    points = design.points(0, design.count)
    for k, axis in enumerate(AXES):
        values = np.log(points[:, k]) if axis.logarithmic else points[:, k]
        low, high = np.log([axis.low, axis.high]) if axis.logarithmic else (axis.low, axis.high)
        assert kstest((values - low) / (high - low), "uniform").pvalue > 0.01
    assert np.abs(np.corrcoef(points.T) - np.eye(3)).max() < 0.12


def test_a_latin_hypercube_has_one_point_in_every_stratum():
    points = SAMPLES[1].points(0, 1000)
    for k, (low, high) in ((0, (1.0, 3.0)), (2, (-1.0, 0.0))):
        strata = np.floor((points[:, k] - low) / (high - low) * 1000).astype(int)
        np.testing.assert_array_equal(np.sort(strata), np.arange(1000))


def test_sobol_points_are_scipys():
    wanted = qmc.Sobol(3, scramble=True, rng=np.random.default_rng(7)).random(16)
    found = SAMPLES[2].points(0, 16)
    np.testing.assert_allclose(found[:, 0], 1.0 + 2.0 * wanted[:, 0], rtol=1e-12)


def test_a_grid_visits_every_combination():
    points = GRID.points(0, 15)
    assert {tuple(row) for row in points} == {(a, b) for a in np.linspace(0, 1, 5) for b in (1.0, 2.0, 9.0)}


def test_another_seed_gives_other_points():
    for design in SAMPLES:
        other = Design(design.kind, AXES, design.count, 8)
        assert not np.any(design.points(0, 50) == other.points(0, 50))
