"""Diagnoses folder by folder: a report each, a table of all, nothing done twice."""

import csv
import json

import numpy as np
import pytest

import jbridge
from jbridge.__main__ import main
from tests.report.cases import cart_alone

MODEL = "[bridge]\ncart_mass = 2.0\ncart_damping = 10.0\ncart_gain = 5.0\nknown = ['cart_mass']\n"


def write_run(path, seed, seconds=4.0):
    """A cart with a constant force that the model lacks, in closed form between changes of the input."""
    key, period = np.random.default_rng(seed), 0.01
    count = int(seconds / period)
    volts = np.repeat(key.uniform(-2, 2, count // 40 + 1), 40)[:count]
    x, v, rows = 0.5, 0.0, []
    fade = np.exp(-10.0 / 2.0 * period)
    for k in range(count):
        rows.append((k * period, volts[k], x + 1e-5 * key.standard_normal()))
        steady = (5.0 * volts[k] + 1.5) / 10.0
        x, v = x + steady * period + (v - steady) * (1 - fade) * 2.0 / 10.0, steady + (v - steady) * fade
    np.savetxt(path, rows, "%.8f", ",", header="t,u_x,x", comments="")


@pytest.fixture
def rigs(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL)
    for rig in range(2):
        folder = tmp_path / f"rig-{rig}"
        folder.mkdir()
        for name in ("a", "b", "holdout"):
            write_run(folder / f"{name}.csv", [rig, len(name), ord(name[0])])
    return tmp_path


@pytest.mark.slow
def test_every_folder_has_a_report_and_a_row(rigs, monkeypatch, capsys):
    given = []

    def canned(model, recordings, holdout, budget, progress):
        given.append(([r.name for r in recordings], [r.name for r in holdout], sorted(model.given)))
        return cart_alone()

    monkeypatch.setattr("jbridge.report.many_rigs.diagnose", canned)
    (rigs / "rig-1" / "model.toml").write_text(MODEL.replace("cart_damping = 10.0\n", ""))
    (rigs / "bad").mkdir()
    (rigs / "bad" / "a.csv").write_text("t,u_x,x\n0,1\n")
    out, folders = rigs / "out", [str(rigs / name) for name in ("rig-0", "bad", "rig-1")]
    words = ["diagnose", str(rigs / "model.toml"), "--each", *folders, "--workers", "0", "--out", str(out)]
    assert main(words) == 0
    assert [g[:2] for g in given] == [(["a.csv", "b.csv"], ["holdout.csv"])] * 2
    assert "cart_damping" in given[0][2] and "cart_damping" not in given[1][2]
    with open(out / "each.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["folder"] for row in rows] == ["rig-0", "bad", "rig-1"]
    assert [row["verdict"] for row in rows] == [cart_alone().verdict, "", cart_alone().verdict]
    assert "bad/a.csv" in rows[1]["statement"]
    for name in ("rig-0", "rig-1"):
        assert json.loads((out / name / "report.json").read_text())["verdict"] == cart_alone().verdict
    assert "bad: not read" in capsys.readouterr().out

    # Again: only what changed is done.
    assert main([*words, "--json"]) == 0
    assert len(given) == 2
    assert [row["folder"] for row in json.loads(capsys.readouterr().out)["folders"]] == ["rig-0", "bad", "rig-1"]
    write_run(rigs / "rig-1" / "b.csv", 5)
    assert main(words) == 0
    assert len(given) == 3


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--each", "none"], "none: no such folder"),
        (["--each", "empty"], "empty: holds no recordings"),
        (["--each", "rig-0", "other/rig-0"], "rig-0: two folders are called so"),
        (["rig-0/a.csv", "--each", "rig-1"], "--each takes folders in place of recordings"),
        ([], "name recordings to learn from"),
    ],
)
def test_refusals(rigs, monkeypatch, capsys, words, complaint):
    monkeypatch.chdir(rigs)
    (rigs / "empty").mkdir()
    (rigs / "other" / "rig-0").mkdir(parents=True)
    write_run(rigs / "other" / "rig-0" / "a.csv", 1)
    assert main(["diagnose", "model.toml", *words, "--out", "out"]) == 2
    told = capsys.readouterr().err
    assert complaint in told and told.count("\n") == 1
    assert not (rigs / "out").exists()


@pytest.mark.slow
def test_workers_diagnose_folders(rigs):
    pytest.importorskip("distributed")
    found = jbridge.diagnose_each(
        rigs / "model.toml", [rigs / "rig-0", rigs / "rig-1"], rigs / "out", budget=300.0, workers=2
    )
    assert [each.verdict for each in found] == ["missing_physics"] * 2
    assert all("constant_force at cart" in each.effects for each in found)
