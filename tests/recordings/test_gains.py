"""An input in another unit moves a rig by another amount than in its other recordings."""

import re

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import Recording, drive_gains, inspect_recordings, load_recording, load_recordings
from tests.recordings.test_slips import TRUTH, scaled, table


def write(folder, name, columns):
    path = folder / name
    path.write_text(table(columns), encoding="utf-8")
    return path


def test_a_gain_is_that_of_the_equation_of_motion():
    """A cart of 2 kg with 3 N/V and a damping of 4 N s/m: 1.5 m/s² per volt."""
    t = np.arange(0.0, 20.0, 0.01)
    u = np.where(np.sin(2.1 * t) + np.sin(1.3 * t) > 0, 2.0, -2.0)
    x, v, places = 0.0, 0.0, []
    for volts in u:
        places.append(x)
        for _ in range(10):
            x, v = x + 0.001 * v, v + 0.001 * (3.0 * volts - 4.0 * v) / 2.0
    recording = Recording.from_arrays(t=t, u_x=u, x=np.array(places))
    assert drive_gains(recording, "u_x")["force"] == pytest.approx(1.5, rel=0.05)  # means over cells smooth the steps


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mV"), (20000.0, "...")])
def test_one_recording_in_another_unit(tmp_path, factor, unit):
    """Each recording alone tells nothing."""
    paths = [write(tmp_path, "monday.csv", TRUTH), write(tmp_path, "tuesday.csv", scaled(u_x=factor))]
    for path in paths:
        load_recording(path)
    with pytest.raises(
        InputError, match=rf"tuesday\.csv, column u_x: .*monday.*unit = \"{re.escape(unit)}\""
    ) as caught:
        load_recordings(paths)
    assert len(load_recordings(paths, force=True)) == 2
    assert inspect_recordings(paths)[-1].problems == (str(caught.value),)


def test_another_gain_that_is_declared_is_no_slip(tmp_path):
    paths = [write(tmp_path, "monday.csv", TRUTH), write(tmp_path, "tuesday.csv", scaled(u_x=1000.0))]
    (tmp_path / "tuesday.toml").write_text("[override]\ncart_gain = 0.5\n")
    assert len(load_recordings(paths)) == 2
