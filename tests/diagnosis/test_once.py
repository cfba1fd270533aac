"""Recordings that are met badly where all the others are met well."""

import numpy as np
import pytest

from jbridge.diagnosis.once import happened_once
from jbridge.identify.evaluate import Run
from jbridge.identify.lanes import make_batch
from jbridge.identify.result import Errors
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
