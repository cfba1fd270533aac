"""The real rigs' sidecars, models and drawing; what needs the recordings skips where they are not."""

import json

import numpy as np
import pytest

import jbridge
from experiments.real_rigs import figures, run
from experiments.real_rigs.cases import AAU, CART_MAP_TRAIN, CASES, GANTRY, LEVELS, PUBLISHED, SOURCES, UW, runs
from experiments.real_rigs.friction import levels_by_place
from jbridge.model.bridge import Bridge
from jbridge.model.effects.catalogue import make_effect
from jbridge.model.plant import Plant

needs_recordings = pytest.mark.skipif(
    not run.RECORDINGS.is_dir(), reason="the recordings of real rigs (../shared/recordings) are not here"
)


def test_it_skips_with_one_line_where_the_recordings_are_absent(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(run, "RECORDINGS", tmp_path / "nowhere")
    monkeypatch.setattr(run, "FIGURES", tmp_path / "figures")
    monkeypatch.setattr("sys.argv", ["run.py"])
    run.main()
    said = capsys.readouterr()
    assert said.out.startswith("skipped: ") and said.out.count("\n") == 1
    assert said.err == "" and list(tmp_path.iterdir()) == []


def test_every_model_is_read():
    models = sorted(run.HERE.glob("*/*.toml"))
    read = [jbridge.load_model(path) for path in models if "[bridge]" in path.read_text()]
    assert len(read) == 9
    assert all((run.HERE / case.rig / case.model).is_file() for case in CASES)


@needs_recordings
@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.rig}-{case.name}")
def test_recordings_of_a_case_are_read_with_its_sidecars(case):
    everything = [run.load(case.rig, piece) for piece in (*case.train, *case.holdout)]
    names = [recording.name for recording in everything]
    assert len(set(names)) == len(names)
    for recording in everything:
        assert 2.0 < recording.duration < 16.0
        if case.name.startswith("pendulum"):
            assert abs(float(np.mean(recording.psi))) < 0.3  # it hangs at zero


@needs_recordings
def test_all_gantry_runs_are_cut_before_the_motor_is_off():
    for axis, levels in LEVELS.items():
        for piece in runs(axis, levels, (1, 2, 3)):
            recording = run.load(GANTRY, piece)
            assert recording.duration <= 15.01
            if axis == "trolley":
                assert np.all(recording.u_x[-5:] > 0)
                assert recording.units == {"u_x": "count"}
                # A load that lags an accelerating trolley swings to the negative side in this project's signs.
                assert 0.33 < recording.locked_length < 0.39


@needs_recordings
def test_the_gantry_angle_is_turned_round():
    recording = run.load(GANTRY, runs("trolley", (750,), (1,))[0])
    early = recording.times < 0.7
    assert recording.psi[early].min() < -0.01


@needs_recordings
def test_the_map_has_recordings_along_the_whole_rail():
    covered = np.concatenate([run.load(AAU, piece).x for piece in CART_MAP_TRAIN])
    assert covered.min() < 0.05 and covered.max() > 0.7


def test_levels_by_place_count_a_constant_force_as_a_difference_by_direction():
    plant = Plant(
        Bridge(),
        (
            make_effect("coulomb_friction", "cart", {"level": 3.0}),
            make_effect("constant_force", "cart", {"level": 1.0}),
        ),
    )
    positive, negative = levels_by_place(plant, np.array([0.1, 0.5]))
    np.testing.assert_allclose(positive, 2.0)
    np.testing.assert_allclose(negative, 4.0)


def test_table_and_pictures_come_from_kept_numbers(tmp_path):
    kept = {"levels": {}}
    for (axis, level), published in PUBLISHED.items():
        error = {channel: 0.5 * min(both) for channel, both in published.items()}
        entry = {"axis": axis, "level": level, "stop": [5.0] * 3, "cut": [error] * 3, "whole": [error] * 3}
        kept["levels"][f"{axis} {level}"] = entry
    t = np.linspace(0.0, 9.0, 90)
    shown = {"measured": [None, *np.sin(t[1:])], "before": np.cos(t), "after": np.sin(t)}
    curve = {"recording": "a.csv", "t": t, "psi": shown | {"rmse": {"before": 1.0, "after": 0.1}}}
    rival = {"kind": "load_drag", "site": "swing"}
    level = {"value": 0.004, "low": 0.0038, "high": 0.0042, "unit": "N m"}
    effect = {"kind": "coulomb_friction", "site": "swing", "probability": 0.9, "equivalents": [rival]}
    effect["parameters"] = {"level": level, "chosen": {"value": 0.7, "low": None, "high": None, "unit": "m"}}
    both = {"before": {"psi": 1.0}, "after": {"psi": 0.1}}
    row = {"rig": UW, "name": "pendulum", "train": ["a.csv"], "holdout": ["b.csv"], "published": "0.0147 rad"}
    row |= {"verdict": "missing_physics", "statement": "It rubs.", "effects": [effect], "curves": [curve, curve]}
    kept["cases"] = {f"{UW}/pendulum": row | {"fit": {"holdout": both, "window": {"holdout": both}}}}
    law = {"positive": 2.0 + 0.0 * t, "negative": 4.0 - 0.2 * t}
    knots = {"value": [2.0, 4.0], "low": [1.9, 3.9], "high": [2.1, 4.1]}
    distance = {key: {"mean": 0.1, "rms": 0.2, "correlation": 0.9} for key in law}
    found = {
        "x": t,
        "found": law,
        "published": law,
        "diagnosed": law,
        "distance": distance,
        "cart_mass": 6.2,
        "window": 0.5,
    }
    kept["map"] = {"cart": found | {"knots": [0.0, 9.0], "knot_positive": knots, "knot_negative": knots}}
    rows = figures.level_rows(kept["levels"])
    assert len(rows) == 20 and all(row["beaten_held_out"] for row in rows)
    text = figures.table(kept)
    assert "beats the better published figure in 20 of 20 rows" in " ".join(text.split())
    assert figures.levels_table(rows).count("| yes |") == 20
    assert all(source in text for source in SOURCES.values())
    assert "coulomb friction@swing (p 0.90; or load drag@swing)" in text
    assert "- coulomb friction at swing: level 0.004 N m (0.0038 to 0.0042)\n" in text
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "real-rigs.json").write_text(json.dumps(run.rounded(kept)))
    figures.draw(tmp_path)
    drawn = {path.name for path in tmp_path.glob("*.png")}
    assert drawn == {"real-rigs-friction-map.png", "real-rigs-gantry.png", "real-rigs-pendulum-multiarm-uw.png"}


def test_of_what_has_no_name_it_is_said_what_is_known():
    place = {"variable": "x", "low": 0.2, "high": 0.4, "share": 0.8}
    row = {"verdict": "unknown", "effects": [], "location": {"where": [place]}}
    row["missing_force"] = {
        "evidence": {"swing": 10.0, "cart": 250.0},
        "likeness": {"statement": "It takes energy out."},
    }
    lines = figures._known(row)
    assert "cart 250, swing 10" in lines[0] and lines[1] == "- It takes energy out."
    assert lines[2] == "- 80 % of it lies where x is between 0.2 and 0.4."
    assert figures._known(row | {"verdict": "missing_physics"}) == []
    assert figures._known(row | {"missing_force": None}) == []
