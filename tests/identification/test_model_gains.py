"""An input in another unit moves a rig by another amount than its model says."""

from pathlib import Path

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.identification.gains import check_model_gains
from jbridge.identification.setting import prepared
from jbridge.model.files import load_model
from jbridge.recordings import Recording

DEMO = Path(__file__).parents[2] / "jbridge" / "demo_data"


@pytest.mark.parametrize(
    ("factor", "known", "doubted"), [(1, True, False), (1, False, False), (0.1, True, True), (10, True, False)]
    + [(300, False, True), (1 / 300, False, True)],
)  # fmt: skip
def test_an_input_is_held_against_the_model(tmp_path, factor, known, doubted):
    lines = (
        (DEMO / "model.toml").read_text().replace('known = ["', 'known = ["cart_gain", "' if known else 'known = ["')
    )
    (tmp_path / "model.toml").write_text(lines)
    model = load_model(tmp_path / "model.toml")
    assert ("cart_gain" in model.known) == known
    rows = np.loadtxt(DEMO / "train-1.csv", delimiter=",", skiprows=1).T
    columns = dict(zip(("t", "u_x", "x", "psi"), rows * [[1], [factor], [1], [1]], strict=True))
    recording = Recording.from_arrays(**columns, name="run.csv", sidecar={"locked": {"l": 0.7}})
    *_, told = prepared(model, [recording])
    assert any("run.csv, column u_x" in sentence for sentence in told) == doubted
    if not (doubted and known):  # a guess is where a fit begins
        check_model_gains(model, [recording])
        return
    with pytest.raises(InputError, match=r"run\.csv, column u_x: the rig moves .* correct cart_gain; --force"):
        check_model_gains(model, [recording])
