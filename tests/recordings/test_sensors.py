"""Sensors that stop dead, say nothing, or have their zero where nothing hangs."""

from pathlib import Path

import numpy as np
import pytest

import jbridge
from jbridge import InputError

NAMES, *_ROWS = (Path(__file__).parent / "whole_bridge.csv").read_text().splitlines()
TRUTH = dict(zip(NAMES.split(","), np.array([row.split(",") for row in _ROWS], float).T, strict=True))
"""14 s of a whole bridge, simulated by another engine, at 100 rows a second."""


def notes(**changed) -> list[str]:
    recording = jbridge.Recording.from_arrays(**(TRUTH | changed))
    return [note for note in recording.notes if "stops dead" in note or "hangs at" in note]


def test_nothing_is_said_of_sensors_that_work():
    assert notes() == []


def test_an_angle_that_is_cut_off_stops_dead():
    psi = TRUTH["psi"]
    [note] = notes(psi=np.clip(psi, -0.5 * np.abs(psi).max(), 0.5 * np.abs(psi).max()))
    assert note.startswith("psi stops dead at ")


def test_a_position_that_is_cut_off_stops_dead():
    x = TRUTH["x"]
    fast = int(np.argmax(np.diff(x)))
    [note] = notes(x=np.minimum(x, x[fast]))
    assert note.startswith(f"x stops dead at {x[fast]:.4g} m at ")


@pytest.mark.parametrize("angle", [-0.2, 0.1, 0.4])
def test_the_angle_at_which_the_load_hangs_is_told(angle):
    [note] = notes(psi=TRUTH["psi"] + angle)
    assert float(note.split()[4]) == pytest.approx(angle, rel=0.1)


def test_an_angle_that_never_changes_beside_a_cart_that_moves_is_refused():
    dead = TRUTH | {"psi": 0.0 * TRUTH["psi"]}
    with pytest.raises(InputError, match="psi = false"):
        jbridge.Recording.from_arrays(**dead)
    assert jbridge.Recording.from_arrays(**dead, sidecar={"columns": {"psi": False}}).psi is None
