"""Examples of the documentation run: commands are accepted as they stand, Python runs on the demo's recordings."""

import contextlib
import importlib.resources
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import jbridge
from jbridge.cli import COMMANDS, main, parser

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
QUICK = {
    "plants=64, steps=200": "plants=2, steps=2",
    "jbridge.diagnose(model, train, proof)": "jbridge.diagnose(model, train, proof, budget=5.0)",
}
"""What would take minutes, and stands for it here."""


def command_lines(path):
    text = path.read_text(encoding="utf-8")
    shown = [body for kind, body in FENCED.findall(text) if not kind]
    lines = [line for body in shown for line in body.splitlines()]
    lines += [line[4:] for line in text.splitlines() if line.startswith("    jbridge ")]
    return [line.removeprefix("$ ") for line in lines if re.match(r"(\$ )?jbridge ", line)]


LINES = [line for page in PAGES for line in command_lines(page)]


@pytest.mark.parametrize("line", sorted(set(LINES)))
def test_commands_are_accepted(line):
    _, *words = shlex.split(line, comments=True)
    assert parser().parse_args(words).command in COMMANDS


def test_every_command_is_shown():
    assert {shlex.split(line)[1] for line in LINES} >= COMMANDS.keys()


def test_the_site_builds_without_a_warning(tmp_path):
    """Links, anchors and docstrings; `make docs` runs the tutorials as well."""
    for plugin in ("mkdocs", "material", "mkdocs_jupyter", "mkdocstrings"):
        pytest.importorskip(plugin, reason="needs MkDocs: make docs installs it")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)],
        cwd=ROOT, env=os.environ | {"JBRIDGE_RUN_TUTORIALS": "false", "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    for name in ("index.html", "api/index.html", "commands/index.html", "tutorials/course/index.html"):
        assert (tmp_path / name).is_file(), name


def python_blocks(name):
    blocks = FENCED.findall((ROOT / "docs" / name).read_text(encoding="utf-8"))
    return [body for kind, body in blocks if kind == "python"]


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """A folder with the files that the pages speak of, and the names that their examples take for given."""
    with importlib.resources.as_file(importlib.resources.files("jbridge") / "demo_data") as demo:
        shutil.copytree(demo, tmp_path, dirs_exist_ok=True)
    for number in (1, 2, 3):
        (tmp_path / f"train-{number}.csv").rename(tmp_path / f"monday-{number}.csv")
    (tmp_path / "holdout-1.csv").rename(tmp_path / "tuesday-1.csv")
    # The demo's rope is locked; controllers move a hoist.
    text = (tmp_path / "model.toml").read_text(encoding="utf-8")
    hoist = "[bridge]\nwinch_mass = 0.1\nhoist_damping = 25.0\nhoist_gain = 3.0\n"
    (tmp_path / "model.toml").write_text(text.replace("[bridge]\n", hoist), encoding="utf-8")
    (tmp_path / "fitted").mkdir()
    shutil.copy(tmp_path / "model.toml", tmp_path / "fitted")
    monkeypatch.chdir(tmp_path)
    run = jbridge.load_recording("monday-1.csv")
    frame = pytest.importorskip("pandas").DataFrame(
        {"t": run.times, "u_x": run.u_x, "cart_mm": 1e3 * run.x, "theta": run.psi, "l": np.full(run.x.size, 0.7)}
    )
    return {"t": run.times, "volts": run.u_x, "x": run.x, "psi": run.psi, "frame": frame}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["python.md", "engine.md", "tuning.md"])
def test_python_examples_run(rig, name):
    names, said = dict(rig), io.StringIO()
    assert python_blocks(name)
    for block in python_blocks(name):
        for long, short in QUICK.items():
            block = block.replace(long, short)
        # Types are promoted as JAX does by itself: optax counts its steps in integers.
        with contextlib.redirect_stdout(said), jax.numpy_dtype_promotion("standard"):
            exec(compile(block, name, "exec"), names)
    if name == "python.md":
        assert "can never change the output" in said.getvalue()
        assert Path("report/report.html").exists() and Path("fitted/model.toml").exists()
    if name == "engine.md":
        assert names["batch"].shape[0] == 256 and np.isfinite(names["swing_slope"](names["volts"])).all()


@pytest.mark.slow
def test_the_example_of_a_sweep_runs(rig, tmp_path):
    (spec,) = [body for kind, body in FENCED.findall((ROOT / "docs/sweeps.md").read_text("utf-8")) if kind == "toml"]
    assert "count = 100000" in spec
    (tmp_path / "friction.toml").write_text(spec.replace("count = 100000", "count = 8"), encoding="utf-8")
    bridge = "cart_mass = 5.5\nload_mass = 0.143\nwinch_mass = 0.1\ncart_damping = 45.0\nhoist_damping = 25.0\n"
    bridge += "swing_damping = 0.0015\ncart_gain = 16.0\nhoist_gain = 3.0\n"
    friction = '[[effect]]\nkind = "coulomb_friction"\nsite = "cart"\nlevel = 4.0\n'
    (tmp_path / "model.toml").write_text(f"[bridge]\n{bridge}{friction}", encoding="utf-8")
    jbridge.save_controller(tmp_path / "fuzzy.toml", jbridge.Controller(jbridge.paper_controller()))
    jbridge.run_sweep(jbridge.load_sweep(tmp_path / "friction.toml"), tmp_path / "friction")
    names = {}
    for block in python_blocks("sweeps.md"):
        exec(compile(block, "sweeps.md", "exec"), names)
    assert len(names["table"]["index"]) == 8


NUMBER = re.compile(r"\d+(?:\.\d+)?")


def alike(shown, printed):
    """The lines that are shown and not printed: words are compared exactly, numbers to 5 %, as on another machine."""

    def same(one, other):
        numbers = [[float(number) for number in NUMBER.findall(line)] for line in (one, other)]
        words = [" ".join(NUMBER.sub("#", line).split()) for line in (one, other)]
        return words[0] == words[1] and numbers[0] == pytest.approx(numbers[1], rel=0.05)

    return [line for line in shown if line.strip() and not any(same(line, other) for other in printed)]


def test_check_prints_what_the_page_shows(tmp_path, monkeypatch, capsys):
    """A position in millimetres; with the line that is offered in the sidecar, nothing is wrong any more."""
    blocks = FENCED.findall((ROOT / "docs/own-rig.md").read_text(encoding="utf-8"))
    (shown,) = [body for kind, body in blocks if body.startswith("$ jbridge check monday-1.csv")]
    header, *rows = (ROOT / "tests/recordings/whole_bridge.csv").read_text(encoding="utf-8").splitlines()
    place = header.split(",").index("x")
    cells = [row.split(",") for row in rows]
    in_mm = [",".join([*row[:place], repr(1e3 * float(row[place])), *row[place + 1 :]]) for row in cells]
    (tmp_path / "monday-1.csv").write_text("\n".join([header, *in_mm]) + "\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert main(["check", "monday-1.csv"]) == 2
    printed = capsys.readouterr().out.splitlines()
    assert [line for line in shown.splitlines()[1:] if line != "..." and line not in printed] == []
    (line,) = re.findall(r"declare (x = \{.*?\})", shown)
    (tmp_path / "monday-1.toml").write_text(f"[columns]\n{line}\n", encoding="utf-8")
    assert main(["check", "monday-1.csv"]) == 0
    assert "NO PROBLEM FOUND" in capsys.readouterr().out


def test_the_model_and_the_sidecar_of_the_page_are_read(tmp_path):
    """The demo's recording, with the names and the sign of angle that the page speaks of."""
    blocks = FENCED.findall((ROOT / "docs/own-rig.md").read_text(encoding="utf-8"))
    model, sidecar = (body for kind, body in blocks if kind == "toml")
    (tmp_path / "model.toml").write_text(model, encoding="utf-8")
    (tmp_path / "recordings.toml").write_text(sidecar, encoding="utf-8")
    assert jbridge.load_model(tmp_path / "model.toml").known >= {"cart_mass", "load_mass", "gravity"}
    rows = np.loadtxt(ROOT / "jbridge/demo_data/train-1.csv", delimiter=",", skiprows=1)
    shown = {"t": rows[:, 0], "voltage": rows[:, 1], "position": rows[:, 2], "angle": -rows[:, 3]}
    jbridge.save_csv(tmp_path / "monday-1.csv", shown)
    recording = jbridge.load_recording(tmp_path / "monday-1.csv")
    np.testing.assert_array_equal(recording.psi, rows[:, 3])
    assert recording.locked_length == 0.2485


@pytest.mark.slow
def test_the_demo_prints_what_the_readme_shows(tmp_path, monkeypatch, capsys):
    blocks = FENCED.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    (shown,) = [body for kind, body in blocks if body.startswith("MISSING PHYSICS IS IDENTIFIED")]
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--out", "out/demo"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert alike([line for line in shown.splitlines() if line != "..."], printed) == []
    assert alike(["cart position x 1.2 mm"], ["cart position x 1.3 mm"]) != []
