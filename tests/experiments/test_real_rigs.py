"""The real rigs' models, sidecars and drawing; what needs the recordings skips where they are not."""

import json

import numpy as np
import pytest

import jbridge
from experiments.real_rigs import figures, planted, run

RIGS = run.rigs()
TRUTHS = {truth.kind: truth for truth in planted.TRUTHS}
needs_recordings = pytest.mark.skipif(
    not (run.SHARED / "recordings").is_dir(), reason="the recordings of real rigs (../shared) are not here"
)


def test_it_skips_with_one_line_where_the_recordings_are_absent(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(run, "SHARED", tmp_path / "nowhere")
    monkeypatch.setattr("sys.argv", ["run.py"])
    run.main()
    said = capsys.readouterr()
    assert said.out.startswith("skipped: ") and said.out.count("\n") == 1
    assert said.err == "" and list(tmp_path.iterdir()) == []


def test_a_rig_that_is_not_there_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["run.py", "nothing"])
    with pytest.raises(SystemExit) as refused:
        run.main()
    assert refused.value.code == 2 and "no rig is called nothing" in capsys.readouterr().err


@needs_recordings
@pytest.mark.parametrize("name", RIGS)
def test_a_rig_is_read(name):
    rig = RIGS[name]
    jbridge.load_model(run.model_file(rig))
    pieces = [*rig["train"], *rig.get("holdout", ())]
    everything = [run.load(rig, piece) for piece in pieces]
    for piece, recording in zip(pieces, everything, strict=True):
        assert recording.duration > 4.0
        if isinstance(piece, dict):
            assert recording.begun == pytest.approx(piece.get("start", 0.0), abs=0.01)
            assert recording.begun + recording.duration < piece.get("stop", np.inf)
        if recording.psi is not None:
            assert abs(float(np.mean(recording.psi))) < 0.3  # it hangs at zero
        if "trolley_" in recording.name:
            # A load that lags an accelerating trolley swings to the negative side in this project's signs.
            assert float(recording.psi[: len(recording.psi) // 3].min()) < -0.01
            assert np.all(recording.u_x[-5:] > 0)  # cut before the motor is off


NUMBER = {"value": 20.4, "std": 0.1, "low": 20.2, "high": 20.6, "unit": "N"}
KEPT = {
    "verdict": "missing_physics", "complete": False, "explained": {"all": 0.9, "x": 0.9}, "stopped": "criterion",
    "effects": [{
        "kind": "coulomb_friction", "site": "cart", "status": "confirmed", "explained": 0.9, "equivalents": [],
        "parameters": {"level": NUMBER},
    }],
    "bridge": {"cart_mass": NUMBER | {"value": 95.1, "unit": "kg"}, "cart_gain": NUMBER | {"std": 0.0}},
    "fit": {"noise": {"x": 1e-5}, "horizons": [
        {"seconds": s, "typical": {"before": {"x": 1e-3}, "after": {"x": 2e-5}}} for s in (0.1, 1.0, 3.0)
    ]},
    "seconds": 60, "gigabytes": 1.234, "code": "0123456789ab",
}  # fmt: skip


def test_table_and_picture_are_drawn_from_kept_numbers(tmp_path):
    figures.draw({"emps": KEPT}, RIGS, tmp_path)
    [row] = [line for line in (tmp_path / "real-rigs-table.md").read_text().splitlines() if line.startswith("| emps")]
    assert "`missing_physics`, x 90 %" in row
    assert "coulomb friction cart (confirmed; 90 %): level 20.4 N; cart mass 95.1 kg |" in row
    assert "| x 100 to 2 | 60 | 1.2 |" in row
    assert (tmp_path / "real-rigs.png").stat().st_size > 1000


def test_what_is_kept_is_of_rigs_that_are_there():
    assert set(json.loads(run.KEPT.read_text())) <= set(RIGS)


SIMULATED = """
[bridge]
cart_mass = 5.5
load_mass = 0.15
gravity = 9.81
cart_damping = 45.0
swing_damping = 0.002
cart_gain = 16.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("truth", TRUTHS.values(), ids=TRUTHS)
def test_altered_recordings_are_those_of_a_rig_with_the_effect(truth, tmp_path):
    times = np.arange(801) * 0.01
    volts = 2.0 * np.sign(np.sin(2.1 * times)) + np.sin(0.9 * times)
    locked = {"locked": {"l": 0.7}}
    (tmp_path / "without.toml").write_text(SIMULATED)
    law = f'\n[[effect]]\nkind = "{truth.kind}"\nsite = "{truth.site}"\n{truth.key} = {truth.size}\n'
    (tmp_path / "with.toml").write_text(SIMULATED + law)
    without, beside = (jbridge.load_model(tmp_path / f"{name}.toml") for name in ("without", "with"))
    still = np.zeros_like(times)
    bare = jbridge.Recording.from_arrays(t=times, u_x=volts, x=still, psi=still, sidecar=locked)
    played = jbridge.simulate(without, bare, initial="first-row").columns
    record = jbridge.Recording.from_arrays(t=times, u_x=volts, x=played["x"], psi=played["psi"], sidecar=locked)
    altered = planted.altered(record, truth, 16.0)
    errors = {}
    for name, model in (("without", without), ("with", beside)):
        told = jbridge.simulate(model, altered).columns
        errors[name] = np.hypot(told["x"] - altered.x, told["psi"] - altered.psi)
    # The initial state is estimated, so that the error is not that of rounding alone.
    assert errors["with"].max() < 2e-3 and errors["without"].max() > 5 * errors["with"].max()
