"""Sets put together point after point against the plain grid, with autodiff from the sets' degrees on."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.fuzzy.aggregation import Gridded, Swept
from jbridge.fuzzy.defuzzify import Centroid
from jbridge.fuzzy.membership import Bell, Gaussian, Trapezoidal, Triangular, as_number
from jbridge.fuzzy.norms import Maximum, Minimum, ProbabilisticSum, Product, Sum
from jbridge.fuzzy.rules import Clause, Variable

POINTS = 101
NORMS = [(Minimum(), Maximum()), (Product(), Maximum()), (Minimum(), Sum()), (Product(), ProbabilisticSum())]


def output(row):
    """Five overlapping sets of four kinds over a universe, from their 15 numbers and its two ends."""
    row = [row[i] for i in range(17)]
    sets = (
        Trapezoidal(*row[0:4]),
        Triangular(*row[4:7]),
        Triangular(*row[7:10]),
        Gaussian(*row[10:12]),
        Bell(*row[12:15]),
    )
    return Variable("y", row[15], row[16], ("a", "b", "c", "d", "e"), sets)


ROW = as_number([-9, -6, -5, -1.2, -4, -0.5, 3.1, 0.3, 4.4, 8, 1.1, 5.3, 2.0, 1.5, 8.7, -10.0, 11.0])
WEIGHTS = as_number([0.61, 0.83, 0.12, 0.64, 0.37])
CLAUSES = (Clause(0, 0), Clause(0, 1), Clause(0, 2, negated=True), Clause(0, 3), Clause(0, 4))


def gridded(row, weights, norms, softness):
    variable = output(row)
    grid = variable.grid(POINTS)
    degrees = [variable.sets[clause.label].degree(grid) for clause in CLAUSES]
    shapes = tuple(1.0 - d if clause.negated else d for d, clause in zip(degrees, CLAUSES, strict=True))
    return Gridded(shapes, grid, *norms, Centroid()).value([weights[i] for i in range(5)], softness)


def swept(row, weights, norms, softness):
    variable = output(row)
    sets = [(variable.sets[clause.label], clause.negated) for clause in CLAUSES]
    found = Swept.of(sets, variable.low, variable.high, POINTS, *norms)
    return found.value([weights[i] for i in range(5)], softness)


@pytest.mark.parametrize("softness", [None, 0.1])
@pytest.mark.parametrize("norms", NORMS, ids=lambda norms: "-".join(norm.name for norm in norms))
def test_point_after_point_the_same_value_and_gradients_come_out(norms, softness):
    """By strengths, by every number of every set and by both ends of the universe; in both modes of autodiff."""

    @functools.partial(jax.jit, static_argnums=0)
    def both(function, row, weights):
        run = functools.partial(function, norms=norms, softness=softness)
        value, slopes = jax.value_and_grad(run, argnums=(0, 1))(row, weights)
        return value, *slopes, *jax.jacfwd(run, argnums=(0, 1))(row, weights)

    wanted, found = both(gridded, ROW, WEIGHTS), both(swept, ROW, WEIGHTS)
    # Most numbers matter here, so that it is not nothing that is compared with nothing.
    assert (np.abs(wanted[1]) > 1e-6).sum() >= 11 and (np.abs(wanted[2]) > 1e-3).sum() >= 3
    for a, b in zip(wanted, found, strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("softness", [0.1, pytest.param(None, marks=pytest.mark.slow)])
def test_second_derivatives_come_out_too(softness):
    """Products, since where sets are clipped only the balance of areas bends."""
    norms = (Product(), ProbabilisticSum())
    wanted, found = (
        np.concatenate(
            [np.ravel(part) for part in jax.tree.leaves(jax.jit(jax.hessian(f, argnums=(0, 1)))(ROW, WEIGHTS))]
        )
        for f in (
            lambda row, weights: gridded(row, weights, norms, softness),
            lambda row, weights: swept(row, weights, norms, softness),
        )
    )
    assert (np.abs(wanted) > 1e-3).sum() > 100
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-10)


def test_each_rollout_of_a_batch_gets_its_own_gradient():
    rows = ROW[None] + 0.01 * np.random.default_rng(0).normal(size=(6, 17))
    weights = np.random.default_rng(1).uniform(0.1, 0.9, (6, 5))
    wanted, found = (
        jax.jit(jax.vmap(jax.grad(lambda row, weight, f=f: f(row, weight, NORMS[0], 0.1))))(rows, jnp.asarray(weights))
        for f in (gridded, swept)
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("place", range(5))
def test_a_strength_that_is_no_number_is_not_lost(place):
    assert np.isnan(swept(ROW, WEIGHTS.at[place].set(np.nan), NORMS[0], None))


@pytest.mark.parametrize("norm", [Minimum(), Maximum(), Product(), Sum(), ProbabilisticSum()], ids=lambda n: n.name)
def test_for_numbers_the_short_form_is_the_hard_one(norm):
    a, b = np.random.default_rng(0).uniform(size=(2, 50))
    b[:5] = a[:5]
    np.testing.assert_array_equal(norm.of_numbers(jnp.asarray(a), jnp.asarray(b)), norm(jnp.asarray(a), jnp.asarray(b)))


@pytest.mark.parametrize("place", range(15))
def test_a_set_whose_number_is_none_is_not_lost(place):
    assert np.isnan(swept(ROW.at[place].set(np.nan), WEIGHTS, NORMS[0], None))
