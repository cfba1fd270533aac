"""Derivatives of readings: forward and reverse mode against central differences, for every parameter there is.

The run is short, smooth at its samples, and moves every axis; no axis stops, and no knot is met to within the
differences' width. Two programs serve all effects but the mechanisms, which share three plants; that in reverse mode
takes half a minute to compile.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jbridge.model.parameters import ParameterTable, bridge_keys
from jbridge.simulation.measurement import readings
from jbridge.simulation.rollout import rollout
from jbridge.simulation.runge_kutta import MIDPOINT
from tests.problems import MECHANISMS, PLACES, Everything, example, lively_inputs, make_lane, make_plant, make_state

COUNT = 60
BEFORE = np.abs(lively_inputs(140, seed=1)) + [0.5, 1.0]
BEFORE[-3:] = 0.0  # so that there is a start
LANE = make_lane(np.abs(lively_inputs(COUNT)) + [0.5, 1.0], start=0.2, history=BEFORE)
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

    @jax.jit
    def both(vector, start, along):
        return jax.jvp(lambda v: value(v, start), (vector,), (along,))

    def value_alone(vector, start):
        return both(vector, start, jnp.zeros_like(vector))[0]

    def forward(vector, start, along):
        return both(vector, start, along)[1]

    return Programs(table, value_alone, forward, jax.jit(jax.grad(value, argnums=(0, 1))))


@functools.cache
def everything() -> tuple[Everything, Programs]:
    all_of = Everything()
    return all_of, programs(all_of.table)


def check_forward(of: Programs, vector: np.ndarray, start, places: list[int]) -> dict[int, float]:
    """Compares forward mode with central differences for the numbers at these places, and returns its derivatives."""
    found = {}
    for place in places:
        along = jnp.zeros(of.table.size).at[place].set(1.0)
        step = 1e-5 * max(abs(float(vector[place])), 1e-2)
        ahead, behind = (float(of.value(vector + sign * step * along, start)) for sign in (1.0, -1.0))
        found[place] = float(of.forward(vector, start, along))
        # A difference of values near 10 has 1e-15/step of rounding.
        differences = pytest.approx((ahead - behind) / (2 * step), rel=1e-5, abs=2e-14 / step)
        assert found[place] == differences, of.table.entry(place).name
    return found


def check_reverse(of: Programs, vector: np.ndarray, start, by_forward: dict[int, float]) -> None:
    """Compares reverse mode with forward mode: two modes of one program differ by rounding."""
    by_reverse = np.array(of.reverse(jnp.asarray(vector), start)[0])
    assert np.all(np.isfinite(by_reverse))
    for place, derivative in by_forward.items():
        assert by_reverse[place] == pytest.approx(derivative, rel=1e-9, abs=1e-12), of.table.entry(place).name


def places_of(all_of: Everything, kind: str, site: str) -> list[int]:
    return [place for key in example(kind, site) for place in all_of.table.positions(f"{kind}@{site}.{key}")]


EFFECTS = pytest.mark.parametrize("kind, site", [pytest.param(*place, id="@".join(place)) for place in PLACES])


@EFFECTS
def test_effects(kind, site):
    all_of, of = everything()
    vector = jnp.asarray(all_of.having(kind, site, example(kind, site)))
    start = make_state(*START[:3], rates=START[3:])
    check_forward(of, vector, start, places_of(all_of, kind, site))
    # The effect is felt at all: else every derivative would be right.
    assert abs(of.value(vector, start) - of.value(jnp.asarray(all_of.null), start)) > 1e-6


@pytest.mark.slow
@EFFECTS
def test_effects_in_reverse(kind, site):
    all_of, of = everything()
    vector = jnp.asarray(all_of.having(kind, site, example(kind, site)))
    start = make_state(*START[:3], rates=START[3:])
    places = places_of(all_of, kind, site)
    by_forward = {
        place: float(of.forward(vector, start, jnp.zeros(of.table.size).at[place].set(1.0))) for place in places
    }
    check_reverse(of, vector, start, by_forward)


def check_bridge_and_initial_state(of: Programs, vector: jax.Array) -> None:
    start = make_state(*START[:3], rates=START[3:])
    check_reverse(
        of, vector, start, check_forward(of, vector, start, [of.table.positions(k)[0] for k in bridge_keys()])
    )
    by_reverse = of.reverse(vector, start)[1]
    for i, step in enumerate(1e-6 * np.eye(6)):
        differences = (of.value(vector, start + step) - of.value(vector, start - step)) / 2e-6
        assert float(by_reverse[i]) == pytest.approx(float(differences), rel=1e-5, abs=1e-7)


def test_bridge_and_initial_state():
    plant = make_plant()
    table = ParameterTable(plant)
    check_bridge_and_initial_state(programs(table), table.ravel(plant))


@pytest.mark.slow
def test_bridge_and_initial_state_beside_all_effects():
    all_of, of = everything()
    check_bridge_and_initial_state(of, jnp.asarray(all_of.null))


@pytest.mark.slow
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
    of, vector = programs(table), jnp.asarray(table.ravel(plant))
    check_reverse(of, vector, start, check_forward(of, vector, start, places))
