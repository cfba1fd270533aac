"""Sensors that stop dead, say nothing, or have their zero where nothing hangs."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
@pytest.mark.parametrize("column", ['unit = "rad"', 'unit = "deg", sign = -1, offset = 10'])
def test_the_line_in_the_note_makes_the_load_hang_straight(tmp_path, angle, column):
    name, sidecar = tmp_path / "run.csv", tmp_path / "run.toml"
    read = TRUTH["psi"] + angle
    raw = read if "rad" in column else 10.0 - np.rad2deg(read)
    write(name, **TRUTH | {"psi": raw})
    sidecar.write_text(f'[columns]\npsi = {{column = "psi", {column}}}\n')
    [note] = [each for each in jbridge.load_recording(name).notes if "hangs at" in each]
    sidecar.write_text("[columns]\n" + re.search(r"declare (psi = \{.*\})", note)[1] + "\n")
    mended = jbridge.load_recording(name)
    assert not any("hangs at" in each for each in mended.notes)
    np.testing.assert_allclose(mended.psi, TRUTH["psi"], atol=0.1 * abs(angle))


def free_swing(zero: float, seed: int, release: float = 0.3) -> dict[str, np.ndarray]:
    """Two minutes of a pendulum that dry friction slows down, as read by a sensor with another zero."""
    t = np.arange(0.0, 120.0, 0.03)
    law = lambda _, s: [s[1], -9.81 * np.sin(s[0]) - 0.02 * s[1] - 0.01 * np.tanh(s[1] / 1e-3)]  # noqa: E731
    psi = solve_ivp(law, (0.0, 120.0), [release, 0.0], t_eval=t, rtol=1e-6, max_step=0.02).y[0]
    return {"t": t, "psi": psi + zero + 3e-4 * np.random.default_rng(seed).standard_normal(t.size)}


@pytest.mark.parametrize(
    ("zeros", "told"),
    [
        ((0.004, 0.004, 0.03), [2]),
        ((0.03, 0.03, 0.0), [0, 1]),
        ((0.0, 0.03), [1]),
        ((0.0, 0.08), [1]),
        ((0.03, 0.03, 0.03), []),
    ],
)
def test_zeros_that_differ_are_told_with_the_lines_that_mend_them(tmp_path, zeros, told):
    paths = [tmp_path / f"run{k}.csv" for k in range(len(zeros))]
    for k, (path, zero) in enumerate(zip(paths, zeros, strict=True)):
        write(path, **free_swing(zero, k))
    common = '["*.csv".locked]\nl = 1.0\n'
    (tmp_path / "recordings.toml").write_text(common)
    hangs = [[n for n in r.notes if "hangs at" in n] for r in jbridge.load_recordings(paths)]
    assert [k for k, own in enumerate(hangs) if own] == told
    tables = []
    for k in told:
        [note] = hangs[k]
        line, table = re.search(r"declare (psi = \{.*\}) for .* alone, under (\[.*?\.columns\])", note).groups()
        tables.append(f"{table}\n{line}\n")
    (tmp_path / "recordings.toml").write_text(common + "".join(tables))
    mended = jbridge.load_recordings(paths)
    assert not any("hangs at" in n for r in mended for n in r.notes)
    assert np.ptp([np.mean(r.psi) for r in mended]) < 5e-3


def test_swings_of_all_sizes_show_the_same_zero(tmp_path):
    paths = [tmp_path / f"run{k}.csv" for k in range(3)]
    for k, path in enumerate(paths):
        write(path, **free_swing(0.045, k, release=(0.3, 0.3, 2.5)[k]))
    (tmp_path / "recordings.toml").write_text('["*.csv".locked]\nl = 1.0\n')
    assert not any("hangs at" in n for r in jbridge.load_recordings(paths) for n in r.notes)


def test_an_angle_that_is_refused_tells_nothing_of_the_others(tmp_path):
    columns = free_swing(0.0, 0)
    write(tmp_path / "good.csv", **columns)
    write(tmp_path / "upright.csv", **columns | {"psi": columns["psi"] + np.pi - 0.02})
    (tmp_path / "recordings.toml").write_text('["*.csv".locked]\nl = 1.0\n')
    good, upright = jbridge.inspect_recordings([tmp_path / "good.csv", tmp_path / "upright.csv"])
    assert upright.problems and not any("hangs at" in n for n in good.recording.notes)


def swing(  # noqa: PLR0913
    length: float,
    declared: float,
    push: float = 0.0,
    scale: float = 1.0,
    *,
    damping: float = 0.05,
    begun: float = 0.4,
    cart: bool = True,
    columns: dict | None = None,
) -> list[str]:
    """Notes on a load that swings below a cart, by SciPy's solver, on a rope of another length than declared, under a
    push that varies [m/s²], where the angle is read too large by a factor."""
    t = np.arange(0.0, 12.0, 0.01)
    way = 0.2 if cart else 0.0
    x = way * np.sin(1.3 * t)

    def fall(now: float, state: np.ndarray) -> list[float]:
        pull = 9.81 * np.sin(state[0]) - way * 1.3**2 * np.sin(1.3 * now) * np.cos(state[0]) + push * np.sin(2.1 * now)
        return [state[1], -pull / length - damping * state[1]]

    psi = solve_ivp(fall, (0.0, 12.0), [begun, 0.0], t_eval=t, rtol=1e-9, atol=1e-9).y[0]
    noise = 1e-4 * np.random.default_rng(0).standard_normal((2, t.size))
    channels = {"psi": scale * (psi + noise[1])} | ({"x": x + noise[0], "u_x": np.cos(1.3 * t)} if cart else {})
    sidecar = {"locked": {"l": declared}, "columns": columns or {}}
    return list(jbridge.Recording.from_arrays(t=t, **channels, sidecar=sidecar).notes)


def swings_like(length: float, declared: float) -> list[float]:
    """Lengths that these notes name."""
    found = (re.search(r"swings as on a rope of (\S+) m", note) for note in swing(length, declared))
    return [float(match[1]) for match in found if match]


@pytest.mark.parametrize("length", [0.15, 0.4, 1.2])
def test_the_length_on_which_a_load_swings_is_told_where_another_one_is_declared(length):
    assert swings_like(length, length) == []
    for declared in (0.8, 1.25):
        [found] = swings_like(length, declared * length)
        assert found == pytest.approx(length, rel=0.01)


@pytest.mark.parametrize(("turn", "unit"), [(360, 'unit = "deg"'), (400, 'unit = "count", scale = 0.0157')])
def test_gon_are_told_from_degrees(turn, unit):
    with pytest.raises(InputError, match=re.escape(f'psi = {{column = "psi", {unit}}}')):
        swing(0.4, 0.4, scale=turn / (2 * np.pi), damping=0.0)


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_length_of_another_unit_is_told_with_the_line_that_mends_it(factor):
    [note] = [each for each in swing(0.4, 0.4 * factor) if "on a rope of" in each]
    assert "declare l = 0.4 under [locked]" in note


@pytest.mark.parametrize("factor", [60.0, 100.0, 1000.0])
def test_a_length_that_no_laboratory_has_is_refused_with_the_one_that_swings(factor):
    with pytest.raises(InputError, match=r"longer than any laboratory; declare its length in m, such as l = 0\.4"):
        swing(0.4, 0.4 * factor)


@pytest.mark.parametrize(("factor", "push"), [(0.4, 0.1), (2.5, 0.0), (2.5, 0.06), (5.0, 0.06), (-0.4, 0.1)])
def test_a_scale_of_the_angle_that_its_cart_speaks_against_is_told_with_a_line_that_mends_it(factor, push):
    [note] = [each for each in swing(0.4, 0.4, push, factor) if "the motion of its cart" in each]
    assert float(re.search(r"swings (\S+) times", note)[1]) == pytest.approx(abs(factor), rel=0.1)
    assert ("the other way" in note) == (factor < 0)
    line = tomllib.loads(re.search(r"or (psi = \{.*?\})", note)[1])
    mended = swing(0.4, 0.4, push, factor, columns=line)
    assert not any("the motion of its cart" in each for each in mended)


@pytest.mark.parametrize("factor", [0.4, 5.0])
def test_such_a_scale_is_refused_where_nothing_else_moves_the_load(factor):
    with pytest.raises(InputError, match="for the swing of its load"):
        swing(0.4, 0.4, scale=factor, damping=0.0)


def test_a_wide_swing_about_a_fixed_pivot_says_nothing_of_a_cart():
    """The length is wrong by more than two."""
    notes = swing(0.9, 0.4, begun=1.0, cart=False)
    assert not any("the motion of its cart" in each for each in notes)


def test_a_pendulum_above_its_pivot_does_not_hang():
    assert notes(psi=TRUTH["psi"] + 3.0, force=True) == []


def write(path: Path, **columns: np.ndarray) -> None:
    np.savetxt(path, np.stack(list(columns.values()), axis=1), delimiter=",", header=",".join(columns), comments="")


def test_an_angle_that_never_changes_beside_a_cart_that_moves_is_refused():
    dead = TRUTH | {"psi": 0.0 * TRUTH["psi"]}
    with pytest.raises(InputError, match="psi = false"):
        jbridge.Recording.from_arrays(**dead)
    assert jbridge.Recording.from_arrays(**dead, sidecar={"columns": {"psi": False}}).psi is None
