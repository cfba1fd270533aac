"""Recordings that are met badly where all the others are met well."""

import numpy as np
import pytest

from jbridge.diagnosis.once import Once, happened_once, timed
from jbridge.identify.evaluate import Run
from jbridge.identify.lanes import make_batch
from jbridge.identify.latent import Force, Latent
from jbridge.identify.result import Errors, Trace
from tests.identify.cases import NOISE, make_recording

TIMES = np.arange(200) * 0.01
NAMES = ["a.csv", "b.csv", "c.csv", "d.csv", "e.csv", "f.csv"]


def run(sizes):
    """Free runs that miss each recording's position by so many times its noise."""
    runs = [make_recording(name, TIMES, u_x=np.sin(TIMES), x=np.cos(TIMES)) for name in NAMES[: len(sizes)]]
    batch = make_batch(runs, NOISE)
    predicted = np.asarray(batch.lanes.y).copy()
    predicted[: len(sizes), :, 0] += np.array(sizes)[:, None] * NOISE["x"]
    return Run(batch, predicted, Errors({}, {}))


@pytest.mark.parametrize(
    ("sizes", "odd"),
    [
        ([1.0, 1.1, 30.0, 1.0, 1.2, 1.0], ("c.csv",)),
        ([1.0, 9.0, 30.0, 1.0, 1.2, 1.0], ("c.csv", "b.csv")),
        ([1.0, np.inf, 1.0], ("b.csv",)),
        # Friction that wanders makes some recordings worse than others, and a law that is missing shows in most.
        ([1.4, 1.1, 2.0, 1.0, 1.2, 1.0], None),
        ([5.0, 9.0, 30.0, 1.0, 1.2, 1.0], None),
        ([1.0, 30.0], None),
        ([1.0, 1.0, 1.0], None),
    ],
)
def test_the_odd_ones_are_few_and_clearly_worse(sizes, odd):
    found = happened_once(run(sizes), NAMES[: len(sizes)])
    if odd is None:
        assert found is None
    else:
        assert found.recordings == odd and found.channel == "x"
        assert found.others == pytest.approx(max(s for s in sizes if s < 2))


def test_a_push_is_timed_on_the_axis_that_it_moved():
    """The swing is what the evidence points to; the cart is pulled along, and its error need not be the smaller one."""
    times = np.arange(1600) * 0.01
    forces, traces = [], []
    for i, name in enumerate(NAMES[:4]):
        key = np.random.default_rng(i)
        mean = 0.003 * key.standard_normal((1600, 3))
        if name == "c.csv":
            mean[(times > 5.2) & (times < 7.1), 1] += 0.15
        forces.append(Force(times, mean, np.full((1600, 3), 0.003) * np.linspace(1.0, 1.01, 1600)[:, None]))
        swing = {"x": 0.7 + 0.2 * np.sin(times + i), "psi": 0.1 * np.sin(3 * times + i)}
        speed = {axis: np.gradient(values, times) for axis, values in swing.items()}
        u = {"u_x": 2 * np.sin(times + i)}
        traces.append(Trace(name, "train", times, u, swing, swing, swing, swing, speed, {}, {}))
    latent = Latent({"swing": 900.0, "psi_sensor": 850.0, "cart": 100.0}, tuple(forces))
    found = timed(Once("x", "x", ("c.csv",), 1.2), latent, traces)
    assert found.channel == "x" and found.axis == "psi"
    (when,) = found.when
    assert when.recording == "c.csv" and when.start == pytest.approx(5.2, abs=0.3)
    assert when.stop == pytest.approx(7.1, abs=0.3)
