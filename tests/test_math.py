"""Elementary functions in units in the last place against arithmetic with fifty digits."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jbridge._math import decay, materialise, sincos

mpmath.mp.dps = 50


def ulps(ours: np.ndarray, exact: list) -> np.ndarray:
    """Distance from the exact values, in spacings of float64 there."""
    return np.array(
        [abs(float(mpmath.mpf(float(o)) - e)) / np.spacing(abs(float(e))) for o, e in zip(ours, exact, strict=True)]
    )


KEY = np.random.default_rng(0)
ANGLES = {
    "small": KEY.uniform(-1, 1, 800) * 10.0 ** KEY.uniform(-12, 0, 800),
    "a turn": KEY.uniform(-2 * np.pi, 2 * np.pi, 1500),
    "many turns": KEY.uniform(-1e5, 1e5, 1500),
    "quadrants": np.concatenate(
        [[0.0, -0.0], (np.arange(-20, 21) * np.pi / 4), np.nextafter(np.arange(-20, 21) * np.pi / 4, 9)]
    ),
}


@pytest.mark.parametrize("name", ANGLES)
def test_sincos(name):
    angles = ANGLES[name]
    sine, cosine = map(np.asarray, jax.jit(sincos)(jnp.asarray(angles)))
    assert ulps(sine, [mpmath.sin(mpmath.mpf(float(a))) for a in angles]).max() < 2.0
    assert ulps(cosine, [mpmath.cos(mpmath.mpf(float(a))) for a in angles]).max() < 2.0


def test_sincos_near_its_zeros():
    """Next to far multiples of pi/2 the result is a difference of nearly equal numbers: still right to 1e-26 or so."""
    k = np.concatenate([np.arange(1, 200), KEY.integers(200, 63_000, 800)]).astype(float)
    angles = k * np.pi / 2
    sine, cosine = map(np.asarray, jax.jit(sincos)(jnp.asarray(angles)))
    for ours, function in ((sine, mpmath.sin), (cosine, mpmath.cos)):
        exact = [function(mpmath.mpf(float(a))) for a in angles]
        error = [abs(float(mpmath.mpf(float(o)) - e)) for o, e in zip(ours, exact, strict=True)]
        assert all(d <= 4.4e-16 * abs(float(e)) + 1e-26 for d, e in zip(error, exact, strict=True))


def test_decay():
    x = np.concatenate([[0.0, 1e-300, 1e-16, 690.0], KEY.uniform(0, 690, 2000), 10.0 ** KEY.uniform(-10, 1, 800)])
    assert ulps(np.asarray(jax.jit(decay)(jnp.asarray(x))), [mpmath.exp(-mpmath.mpf(float(a))) for a in x]).max() < 4.0


def test_decay_beyond_its_range():
    """Negative arguments count as 0; what is smaller than any force is 0, and nothing overflows on the way."""
    x = jnp.array([-3.0, -1e300, 700.1, 1e300, jnp.inf])
    np.testing.assert_array_equal(decay(x), [1.0, 1.0, 0.0, 0.0, 0.0])
    assert 0 < float(decay(jnp.asarray(699.9))) < 1e-300


def test_derivatives():
    angles, slopes = jnp.asarray(ANGLES["a turn"]), jnp.asarray(KEY.normal(size=1500))
    (sine, cosine), (d_sine, d_cosine) = jax.jvp(sincos, (angles,), (slopes,))
    np.testing.assert_allclose(d_sine, np.cos(angles) * slopes, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(d_cosine, -np.sin(angles) * slopes, rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(sincos(angles)[0], sine)
    np.testing.assert_array_equal(sincos(angles)[1], cosine)

    x = jnp.asarray(KEY.uniform(0, 600, 200))
    value, slope = jax.jvp(decay, (x,), (jnp.ones(200),))
    np.testing.assert_allclose(slope, -np.exp(-np.asarray(x)), rtol=1e-12)
    # Reverse mode and second derivatives follow from the same rule.
    one = jnp.asarray(0.7)
    assert float(jax.grad(lambda a: sincos(a)[0])(one)) == pytest.approx(np.cos(0.7), rel=1e-15)
    assert float(jax.grad(jax.grad(lambda a: sincos(a)[0]))(one)) == pytest.approx(-np.sin(0.7), rel=1e-15)
    assert float(jax.grad(jax.grad(decay))(one)) == pytest.approx(np.exp(-0.7), rel=1e-14)


def test_one_pass_keeps_shapes_and_batches():
    grid = jnp.asarray(KEY.uniform(-3, 3, (3, 4)))
    together = sincos(grid)
    rows = jax.vmap(jax.vmap(sincos))(grid)
    for a, b in zip(together, rows, strict=True):
        assert a.shape == (3, 4)
        np.testing.assert_array_equal(a, b)


def test_materialise_is_the_identity():
    """For values, tangents and batches alike: it is about how a compiler fuses, not about numbers."""
    tree = {"a": jnp.arange(3.0), "b": (jnp.asarray(2.0),)}
    go = jnp.asarray(True)
    for ours, given in zip(jax.tree.leaves(materialise(tree, go)), jax.tree.leaves(tree), strict=True):
        np.testing.assert_array_equal(ours, given)

    def square(x):
        return materialise(x * x, jnp.asarray(True))

    np.testing.assert_array_equal(jax.vmap(jax.grad(square))(jnp.arange(4.0)), 2 * np.arange(4.0))
