"""Derivatives of readings: forward and reverse mode against central differences, for every parameter there is.

The run is short, smooth at its samples, and moves every axis; no axis stops, and no knot is met to within the
differences' width. Three programs serve all effects but the mechanisms, which share three plants.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.model.parameters import ParameterTable, bridge_keys
from jbridge.rollout import MIDPOINT, readings, rollout
from tests.problems import MECHANISMS, PLACES, Everything, example, lively_inputs, make_lane, make_plant, make_state

COUNT = 60
LANE = make_lane(
    np.abs(lively_inputs(COUNT)) + [0.5, 1.0], start=0.2, history=np.abs(lively_inputs(140, seed=1)) + [0.5, 1.0]
)
WEIGHTS = np.random.default_rng(0).normal(size=(COUNT + 1, 3))
START = (0.3, -0.1, 0.7, 0.35, 1.2, 0.1)


class Programs(NamedTuple):
    """A weighted sum of readings, as a function of a plant's parameters and its initial state, and its derivatives."""

    table: ParameterTable
    value: Callable
    forward: Callable
    reverse: Callable


def programs(table: ParameterTable) -> Programs:
    def value(vector, start):
        plant = table.unravel(vector)
        motions = rollout(plant, start, LANE, substeps=1, method=MIDPOINT)
        return jnp.sum(jnp.asarray(WEIGHTS) * readings(plant, LANE, motions))

    def forward(vector, start, along):
        return jax.jvp(lambda v: value(v, start), (vector,), (along,))[1]

    return Programs(table, jax.jit(value), jax.jit(forward), jax.jit(jax.grad(value, argnums=(0, 1))))


@functools.cache
def everything() -> tuple[Everything, Programs]:
    all_of = Everything()
    return all_of, programs(all_of.table)


def check(of: Programs, vector: np.ndarray, start, places: list[int]) -> None:
    """Compares the three derivatives with respect to the numbers at these places."""
    vector, by_reverse = jnp.asarray(vector), np.array(of.reverse(jnp.asarray(vector), start)[0])
    assert np.all(np.isfinite(by_reverse))
    for place in places:
        name = of.table.entry(place).name
        along = jnp.zeros(of.table.size).at[place].set(1.0)
        step = 1e-5 * max(abs(float(vector[place])), 1e-2)
        differences = float(of.value(vector + step * along, start) - of.value(vector - step * along, start)) / (
            2 * step
        )
        by_forward = float(of.forward(vector, start, along))
        # Two modes of one program differ by rounding; a difference of values near 10 has 1e-15/step of it.
        assert by_forward == pytest.approx(by_reverse[place], rel=1e-9, abs=1e-12), name
        assert by_forward == pytest.approx(differences, rel=1e-5, abs=2e-14 / step), name


@pytest.mark.parametrize("kind, site", [pytest.param(*place, id="@".join(place)) for place in PLACES])
def test_effects(kind, site):
    all_of, of = everything()
    values = example(kind, site)
    places = [place for key in values for place in all_of.table.positions(f"{kind}@{site}.{key}")]
    vector = all_of.having(kind, site, values)
    check(of, vector, make_state(*START[:3], rates=START[3:]), places)
    # The effect is felt at all: else every derivative would be right.
    start = make_state(*START[:3], rates=START[3:])
    assert abs(of.value(jnp.asarray(vector), start) - of.value(jnp.asarray(all_of.null), start)) > 1e-6


def test_bridge_and_initial_state():
    all_of, of = everything()
    start = make_state(*START[:3], rates=START[3:])
    check(of, all_of.null, start, [all_of.table.positions(key)[0] for key in bridge_keys()])
    vector = jnp.asarray(all_of.null)
    by_reverse = of.reverse(vector, start)[1]
    for i, step in enumerate(1e-6 * np.eye(6)):
        differences = (of.value(vector, start + step) - of.value(vector, start - step)) / 2e-6
        assert float(by_reverse[i]) == pytest.approx(float(differences), rel=1e-5, abs=1e-7)


def test_every_gradient_is_finite_at_rest():
    """At rest, at null, with no input: where roots, divisions and comparisons have their edges."""
    all_of, of = everything()
    gradients = of.reverse(jnp.asarray(all_of.null), make_state())
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


HIDDEN = {
    "compliances": [1e-3, 0.02, -2e-3, 0.05, 0.1, -0.5],
    "play": [-5e-4, 0.05, 0.3],
    "play at the winch": [-2e-3, 0.05],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MECHANISMS)
def test_mechanisms(name):
    plant = make_plant(*MECHANISMS[name])
    table = ParameterTable(plant)
    start = make_state(*START[:3], rates=START[3:], hidden=HIDDEN[name])
    places = [place for entry in table.entries for place in table.positions(entry.name)]
    check(programs(table), np.array(table.ravel(plant)), start, places)
