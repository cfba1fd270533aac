"""What is written reads back to the last bit, and a file appears whole or not at all."""

import os

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import load_recording, save_csv


def test_round_trip(tmp_path, columns):
    random = np.random.default_rng(0)
    columns["x"] = random.normal(size=400) * 10.0 ** random.integers(-12, 3, 400)
    columns["t"] = columns["t"] + random.uniform(0, 1e-9, 400)
    save_csv(tmp_path / "out.csv", {**columns, "x_ref": columns["x"]})
    recording = load_recording(tmp_path / "out.csv", force=True)  # no cart goes that far
    np.testing.assert_array_equal(recording.times, columns["t"])
    np.testing.assert_array_equal(recording.x, columns["x"])
    np.testing.assert_array_equal(recording.extras["x_ref"], columns["x"])


def test_the_text_is_plain(tmp_path):
    columns = {"t": np.array([0, 1]), "x": np.array([0.1, 1e-7]), "a,b": np.array([True, False])}
    save_csv(tmp_path / "out.csv", columns)
    assert (tmp_path / "out.csv").read_bytes() == b't,x,"a,b"\n0.0,0.1,1.0\n1.0,1e-07,0.0\n'


def test_an_existing_file_is_replaced_and_nothing_else_is_left(tmp_path):
    save_csv(tmp_path / "out.csv", {"t": np.arange(3.0)})
    save_csv(str(tmp_path / "out.csv"), {"t": np.arange(2.0)})
    assert (tmp_path / "out.csv").read_text() == "t\n0.0\n1.0\n"
    assert os.listdir(tmp_path) == ["out.csv"]


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    save_csv(tmp_path / "out.csv", {"t": np.arange(3.0)})

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match=r"out\.csv: cannot be written \(No space left on device\)"):
        save_csv(tmp_path / "out.csv", {"t": np.arange(2.0)})
    assert (tmp_path / "out.csv").read_text() == "t\n0.0\n1.0\n2.0\n"
    assert os.listdir(tmp_path) == ["out.csv"]


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"out\.csv: cannot be written"):
        save_csv(tmp_path / "absent" / "out.csv", {"t": np.arange(2.0)})


@pytest.mark.parametrize(
    "columns",
    [{}, {"t": np.arange(3), "x": np.arange(2)}, {"t": np.eye(2)}],
    ids=["none", "lengths", "matrix"],
)
def test_a_table_has_columns_of_one_length(tmp_path, columns):
    with pytest.raises(ValueError, match="columns of one length"):
        save_csv(tmp_path / "out.csv", columns)
    assert os.listdir(tmp_path) == []
