"""Measured recordings from rigs of other people, read where they lie."""

import os
from pathlib import Path

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import constant_inputs, load_recording, load_recordings

RIGS = Path(os.environ.get("JBRIDGE_RECORDINGS", Path(__file__).parents[2].parent / "shared")) / "recordings"
GANTRY = RIGS / "gantry_crane_napitupulu"
BELT = RIGS / "cart_pendulum_aau"
ARM = RIGS / "pendulum_multiarm_uw"

pytestmark = pytest.mark.skipif(not RIGS.is_dir(), reason=f"the recordings are not there: {RIGS}")

DECLARED = """
["trolley_*.csv".columns]
u_x = {column = "pwm_trolley", unit = "count"}
psi = {sign = -1}
["[hc]*.csv".columns]
u_x = {column = "pwm_trolley", unit = "count"}
u_l = {column = "pwm_hoist", unit = "count"}
psi = {sign = -1}
"""
BELT_DECLARED = """
["cart_*.csv".columns]
u_x = {column = "i_a", unit = "A"}
["swingup_*.csv".columns]
u_x = {column = "i_a", unit = "A"}
psi = {column = "theta", offset = 3.141592653589793}
["swingup_*.csv".locked]
l = 0.3169
["pendulum1_*.csv".columns]
psi = {column = "theta", offset = 3.141592653589793}
["pendulum1_*.csv".locked]
l = 0.3169
"""
ARM_DECLARED = """
["*.csv".columns]
psi = {column = "theta", offset = 3.141592653589793}
["*.csv".locked]
l = 0.1477
"""


@pytest.fixture
def read(tmp_path):
    """Reads recordings with declarations that lie elsewhere, since their folder is not ours."""

    def from_folder(folder: Path, pattern: str, declared: str):
        (tmp_path / "declared.toml").write_text(declared)
        paths = sorted(folder.glob(pattern))
        assert paths
        return load_recordings(paths, sidecar=tmp_path / "declared.toml")

    return from_folder


def rate(recording, name: str) -> float:
    """Returns new samples per second."""
    return np.count_nonzero(recording.fresh[name]) / recording.duration


def test_the_camera_and_the_encoder_of_the_gantry_crane_are_held(read):
    """About 30 Hz in a log at 145 Hz, says its documentation, the cart's encoder included."""
    for recording in read(GANTRY, "trolley_*.csv", DECLARED):
        assert recording.units == {"u_x": "count"}
        assert recording.locked_length == pytest.approx(np.median(recording.l))
        assert 25 < rate(recording, "x") < 32
        assert 28 < rate(recording, "psi") < 32
        assert recording.resolution["x"] == pytest.approx(1.5 / 27000, rel=0.01)
        assert recording.resolution["psi"] == pytest.approx(1e-3, rel=1e-3)
    for recording in read(GANTRY, "hoist_*.csv", DECLARED):
        assert recording.has_hoist
        assert 28 < rate(recording, "l") < 32
        assert recording.resolution["l"] == pytest.approx(1e-3, rel=1e-3)


def test_all_three_are_held_under_control(read):
    """The encoder comes faster there, and still more slowly than the log's 138 rows per second."""
    for recording in read(GANTRY, "closedloop_*.csv", DECLARED):
        assert 28 < rate(recording, "psi") < 32
        assert 28 < rate(recording, "l") < 32
        assert 60 < rate(recording, "x") < 100


def test_rest_learns_from_motion(read):
    for recording in read(GANTRY, "[ht]*.csv", DECLARED):
        assert max(rate(recording, name) for name in ("psi", "l")) < 32


def test_the_trolley_is_not_driven_in_the_hoist_runs(read):
    assert constant_inputs(read(GANTRY, "hoist_*.csv", DECLARED)) == {"u_x"}
    assert constant_inputs(read(GANTRY, "[ht]*.csv", DECLARED)) == set()


def test_the_encoders_of_the_belt_drive_are_not_held(read):
    """2000 counts per turn of a pulley of 28 mm; the angle's encoder rests for long and still is not held."""
    for recording in read(BELT, "cart_*.csv", BELT_DECLARED):
        assert (recording.has_cart, recording.has_swing) == (True, False)
        assert recording.units == {"u_x": "A"}
        assert recording.fresh["x"].all()
        assert recording.resolution["x"] == pytest.approx(2 * np.pi * 0.028 / 2000, rel=0.005)
    (decay,) = read(BELT, "pendulum1_*.csv", BELT_DECLARED)
    assert decay.fresh["psi"].all()
    assert decay.resolution["psi"] == pytest.approx(np.pi / 1000, rel=1e-3)


def test_swing_ups_are_in_radians(read):
    for recording in read(BELT, "swingup_*.csv", BELT_DECLARED):
        assert recording.locked_length == 0.3169
        assert all(fresh.all() for fresh in recording.fresh.values())


def test_an_arm_on_a_fixed_cart(read):
    for recording in read(ARM, "*.csv", ARM_DECLARED):
        assert (recording.has_cart, recording.has_swing, recording.has_hoist) == (False, True, False)
        assert recording.fresh["psi"].all()


@pytest.mark.parametrize("name", ["trolley_pwm750_run1.csv", "swingup_swing1.csv", "single_free_swing.csv"])
def test_degrees_are_refused(write, name):
    """The smallest swing of the three is 0.07 rad."""
    (path,) = RIGS.glob(f"*/{name}")
    header, *rows = path.read_text().splitlines()
    data = dict(zip(header.split(","), np.array([row.split(",") for row in rows], dtype=float).T, strict=True))
    angle = data.get("psi", data.get("theta"))
    columns = {"t": data["t"], "psi": np.rad2deg(angle), "l": np.full(angle.size, 0.35)}
    with pytest.raises(InputError, match="degrees"):
        load_recording(write(columns))


def test_a_table_without_time_is_no_recording():
    with pytest.raises(InputError, match=r"no column t for the time; the columns are 'x', 'f_pos_dir', 'f_neg_dir'"):
        load_recording(BELT / "published_friction_table.csv")


SIDECARS = Path(__file__).parents[2] / "experiments/real_rigs"
REWRITTEN = {
    "a spreadsheet's export": lambda n: ("\ufeff" + "\r\n".join(n).replace(",", ";").replace(".", ",")).encode(),
    "Unicode text": lambda n: "\n".join(n).replace(",", "\t").encode("utf-16"),
    "blanks": lambda n: "\n".join(n).replace(",", "  ").encode(),
    "comments": lambda n: "\n".join(["# rig 2", n[0], "% begins", *n[1:], "// ends"]).encode(),
    "a separator behind each row": lambda n: "\n".join(row + "," for row in n).encode(),
    "a data frame's rows": lambda n: "\n".join(["," + n[0], *(f"{k},{row}" for k, row in enumerate(n[1:]))]).encode(),
}
"""How other programs write the same table."""
WRONG = {
    "position in mm": ("position", lambda v: 1e3 * v, r'x = \{column = "position", unit = "mm"'),
    "angle in degrees": ("angle", np.degrees, r'psi = \{column = "angle", unit = "deg"'),
    "angle turned": ("angle", lambda v: -v, r'psi = \{column = "angle", unit = "rad"\}'),
    "input turned": ("voltage", lambda v: -v, r'u_x = \{column = "voltage", unit = "V", sign = -1'),
    "time in ms": ("t", lambda v: 1e3 * v, r't = \{column = "t", unit = "ms"'),
    "repeated times": ("t", lambda v: np.floor(10 * v) / 10, r"the time of the row above; export .* more digits"),
}
"""What is done to a column of a student's crane, and the remedy that is offered."""


@pytest.mark.parametrize("rewrite", REWRITTEN.values(), ids=REWRITTEN)
@pytest.mark.parametrize(
    "name", ["emps/emps.csv", "crane_aau_student/step4v.csv", "pendulum_multiarm_uw/single_free_swing.csv"]
)
def test_other_programs_write_the_same(tmp_path, name, rewrite):
    sidecar = SIDECARS / Path(name).parent / "recordings.toml"
    path = tmp_path / Path(name).name
    path.write_bytes(rewrite((RIGS / name).read_text(encoding="utf-8").splitlines()))
    found, wanted = (load_recording(each, sidecar=sidecar) for each in (path, RIGS / name))
    for channel in ("times", "u_x", "x", "psi"):
        np.testing.assert_array_equal(getattr(found, channel), getattr(wanted, channel))


@pytest.mark.parametrize(("column", "change", "remedy"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_in_a_measured_recording_is_found(tmp_path, column, change, remedy):
    header, *rows = (RIGS / "crane_aau_student/step4v.csv").read_text(encoding="utf-8").splitlines()
    names, values = header.split(","), np.array([row.split(",") for row in rows], float)
    values[:, names.index(column)] = change(values[:, names.index(column)])
    path = tmp_path / "step4v.csv"
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in values.tolist())]))
    with pytest.raises(InputError, match=remedy) as caught:
        load_recording(path, sidecar=SIDECARS / "crane_aau_student/recordings.toml")
    assert "step4v.csv" in str(caught.value)
