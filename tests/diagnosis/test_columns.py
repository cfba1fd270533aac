"""The linear screen's columns against simulations of the whole bridge with a little of each effect.

The oracle shares the engine but nothing of the linearisation: it simulates twice with the effect in the model and
takes the difference.
"""

import numpy as np
import pytest

from jbridge.diagnosis.candidates import WRONG_VALUE, candidates
from jbridge.diagnosis.columns import candidate_columns
from jbridge.identification.problem import Setting, scene_of
from jbridge.identify.lanes import make_batch
from jbridge.identify.linearise import Engine
from jbridge.model.effects.base import parameters_of
from jbridge.model.effects.catalogue import CATALOGUE
from tests.identify.cases import NOISE, play, steps
from tests.problems import EVERY_AXIS, Everything, make_plant

DRY = (
    ("coulomb_friction", "cart", {"level": 3.0}),
    ("coulomb_friction", "swing", {"level": 0.004}),
    ("coulomb_friction", "hoist", {"level": 2.0}),
)
"""Dry friction on every axis: what is small beside it may be of either sign."""
BASE = make_plant(*DRY, swing_damping=0.01)
SETTING_AXES = ("x", "psi", "l")
COUNT = 200
"""Two seconds: as long as a window of the screen."""


def run(seed):
    u = np.stack([1.3 * steps(COUNT, seed), steps(COUNT, 5 + seed) - 0.3], axis=1)
    return play(BASE, u, name=f"{seed}.csv", active=EVERY_AXIS, start={"x": 0.6, "psi": 0.15}, seed=seed)


RUNS = (run(0), run(1))
SETTING = Setting(RUNS, (), NOISE, SETTING_AXES, {}, 0.7)
SCENE = scene_of(SETTING, BASE)


def screened():
    """One null seed for each effect that the screen weighs."""
    found = {}
    for candidate in candidates(BASE, frozenset(), SETTING, SCENE):
        if candidate.kind != WRONG_VALUE and not candidate.unscreened and not candidate.finite:
            # The last seed: a Stribeck friction's first is narrower than the velocity changes within a step.
            found[candidate.name] = candidate
    return list(found.values())


SCREENED = screened()


@pytest.fixture(scope="module")
def columns():
    engine = Engine(BASE)
    vector = np.array(engine.table.ravel(BASE))
    batch = make_batch(RUNS, NOISE, size=engine.table.size)
    found = candidate_columns(engine.table, vector, batch, batch.initial, SCREENED)
    return {c.name: (c, column) for c, column in zip(SCREENED, found, strict=True)}


@pytest.fixture(scope="module")
def whole():
    """The bridge with every effect, so that one program simulates them all."""
    everything = Everything(swing_damping=0.01)
    for kind, site, values in DRY:
        everything.null = everything.having(kind, site, values)
    engine = Engine(everything.plant)
    batch = make_batch(RUNS, NOISE, size=engine.table.size)
    weight = np.asarray(batch.lanes.weight)

    def readings(vector):
        return (np.asarray(engine.motions(vector, batch.initial, batch)[1]) * weight).reshape(batch.count, -1)

    return everything, engine.table, readings


ONE_SIDED = {"input_delay", "sensor_delay", "dead_zone", "friction_drift"}
"""Less than their null value is nothing."""
SIZES = {"input_delay": 1e-4, "sensor_delay": 1e-3, "dead_zone": 2e-3, "drum_radius_change": 1e-2}
"""Of the differences, where the default would leave or cross a kink."""


def named(candidate):
    return pytest.param(candidate.name, id="-".join(candidate.name))


@pytest.mark.parametrize("name", [named(candidate) for candidate in SCREENED])
def test_predicted_change_of_the_readings(name, columns, whole):
    candidate, predicted = columns[name]
    everything, table, readings = whole
    kind, site = name
    infos = parameters_of(CATALOGUE[kind])
    places = {key: table.positions(f"{kind}@{site}.{key}") for key in candidate.values if key in infos}
    # The table of everything has three knots where a seed has eight: shapes are compared by their common level.
    vector = everything.null.copy()
    for key, at in places.items():
        value = np.asarray(candidate.values[key], dtype=float)
        if value.ndim == 0:
            vector[at] = value
    start = 0
    seen = 0
    for key in candidate.free:
        count = np.size(candidate.values.get(key, infos[key].null))
        own = np.zeros_like(predicted[:, 0])
        if key in candidate.linear:
            own = predicted[:, start : start + count].sum(axis=1)
            start += count
        if candidate.harmonic and key == "phase":
            # The second column is the wave's cosine.
            vector[places["phase"]] = np.pi / 2
            key = "amplitude"
        at = table.positions(f"{kind}@{site}.{key}")
        size = SIZES.get(kind, 1e-3)
        change = np.zeros_like(vector)
        change[at] = size
        base = vector if kind in ONE_SIDED else vector - change
        span = size if kind in ONE_SIDED else 2 * size
        wanted = (readings(vector + change) - readings(base)) / span
        scale = np.linalg.norm(wanted)
        if scale < 1e-9:
            # A place or a time of something that is absent, as those that a screen is told to leave out.
            assert np.linalg.norm(own) < 1e-6
            continue
        seen += 1
        # An effect is judged at the middle of each interval, so what changes within 10 ms is a little off; a late
        # input's sign changes where the winch stops, and these runs begin with it at rest.
        off = 0.15 if kind == "input_delay" else 0.08
        assert np.linalg.norm(own - wanted) < off * scale, f"{key}: {np.linalg.norm(own - wanted) / scale:.3f}"
    assert seen
