"""Which runs count as repeats of one experiment."""

import dataclasses

import numpy as np
import pytest

from jbridge.identification.data.windows import WHOLE, make_data
from jbridge.identification.evaluation.repeats import scatter
from tests.identification.cases import NOISE, make_recording

TIMES = np.arange(600) * 0.01
INPUTS = {"u_x": np.sin(3 * TIMES), "u_l": 200.0 * np.sign(np.cos(2 * TIMES))}


def run(seed, swing=0.0, rope=0.6, **inputs):
    """A bridge by formula with noise; how it starts to swing is given."""
    noise = np.random.default_rng(seed).standard_normal((3, len(TIMES)))
    motion = {
        "x": 0.5 + 0.2 * (1 - np.cos(TIMES)),
        "psi": 0.1 * (1 - np.cos(4 * TIMES)) + swing * np.cos(4 * TIMES),
        "l": rope + 0.1 * (1 - np.cos(TIMES)),
    }
    noisy = {axis: y + NOISE[axis] * noise[k] for k, (axis, y) in enumerate(motion.items())}
    return make_recording(f"run-{seed}.csv", TIMES, **(INPUTS | inputs), **noisy)


def scattered(*runs):
    return scatter(make_data(runs, (WHOLE,), NOISE), 1.0)


def test_repeated_runs_differ_by_their_noise():
    found = scattered(run(1), run(2), run(3, u_x=np.sin(5 * TIMES)))
    for axis, noise in NOISE.items():
        # With the noise of the first samples, from which both are counted.
        assert found[axis] == pytest.approx(np.sqrt(1.5) * noise, rel=0.15)


@pytest.mark.parametrize(
    "other",
    [
        run(2, u_x=np.sin(5 * TIMES)),  # beside an input in counts, which is larger by hundreds
        run(2, swing=0.3),
        run(2, rope=0.4),
        dataclasses.replace(run(2), override={"load_mass": 1.5}),
    ],
    ids=["input", "swings at the start", "rope", "load"],
)
def test_another_experiment_is_no_repeat(other):
    assert scattered(run(1), other) is None
