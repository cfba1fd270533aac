"""The command: what it accepts, what it prints where, and how it ends."""

import functools
import json
import re
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

import jbridge
from jbridge import InputError
from jbridge.cli import COMMANDS, main
from jbridge.fuzzy.membership import Trapezoidal, as_number
from jbridge.fuzzy.rules import Variable, rule
from jbridge.fuzzy.sugeno import Conclusions, Linear, Sugeno
from jbridge.report import save as saving
from jbridge.report.figures.gallery import Gallery
from tests.problems import model_text
from tests.report import cases

FRICTION = ("coulomb_friction", "cart", {"level": 4.0})
MODEL = """\
[bridge]
cart_mass = 5.5
cart_gain = 16.0
cart_damping = 45.0
load_mass = 0.143
known = ["cart_mass", "load_mass", "gravity"]
"""


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """A folder with a model and recordings, in which the command runs, with the computations replaced."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.toml").write_text(MODEL)
    times = np.arange(200) * 0.01
    for i, name in enumerate(("a.csv", "b.csv", "c.csv", "d.csv")):
        columns = {"t": times, "u_x": np.sin(times + i), "x": 0.5 - 0.1 * np.cos(times + i)}
        jbridge.save_csv(name, columns)
    monkeypatch.setattr(saving, "diagnosis_gallery", lambda diagnosis: Gallery())
    monkeypatch.setattr(saving, "fit_gallery", lambda fit: Gallery())
    monkeypatch.setitem(vars(jbridge), "set_up", lambda cache=True: None)  # the tests' settings stay
    return tmp_path


@pytest.fixture
def calls(monkeypatch):
    """Replaces the computations, and keeps what they were called with."""
    seen = {}

    def compute(name, result):
        def computed(model, recordings, holdout=(), *, progress=None, **options):
            seen[name] = (model, [each.name for each in recordings], [each.name for each in holdout])
            seen["options"] = options
            progress("half way")
            return result

        return computed

    def simulate(model, recording, initial):
        seen["simulate"] = (model, recording.name, initial)
        return {"t": recording.times, "u_x": recording.u_x, "x": np.zeros(recording.times.size)}

    monkeypatch.setitem(vars(jbridge), "fit", compute("fit", cases.fitted()))
    monkeypatch.setitem(vars(jbridge), "diagnose", compute("diagnose", cases.missing_physics()))
    monkeypatch.setitem(vars(jbridge), "simulate", simulate)
    return seen


def test_diagnose_saves_and_says(rig, calls, capsys):
    status = main(["diagnose", "model.toml", "a.csv", "b.csv", "--holdout", "c.csv", "d.csv", "--out", "deep/out"])
    assert status == 0
    assert calls["diagnose"][1:] == (["a.csv", "b.csv"], ["c.csv", "d.csv"])
    assert json.loads((rig / "deep" / "out" / "report.json").read_text())["verdict"] == "missing_physics"
    out, err = capsys.readouterr()
    assert out.startswith("MISSING PHYSICS IS IDENTIFIED")
    assert "deep/out/report.html" in out
    assert err == ""  # no terminal, no progress


def test_a_diagnosis_goes_on_with_further_recordings(rig, calls, capsys):
    assert main(["diagnose", "model.toml", "a.csv", "b.csv", "--holdout", "c.csv", "--out", "out"]) == 0
    assert calls["options"] == {"new": (), "former": None, "budget": 300.0}
    assert main("diagnose model.toml a.csv b.csv --with d.csv --holdout c.csv --out out".split()) == 0
    assert calls["diagnose"][1:] == (["a.csv", "b.csv"], ["c.csv"])
    assert [recording.name for recording in calls["options"]["new"]] == ["d.csv"]
    names = calls["options"]["former"].names
    assert {("dead_zone", "cart_drive"), ("stribeck_friction", "cart"), ("wrong_value", "load_mass")} <= names
    assert "Continued" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"schema": 2, "effects": []}', '{"schema": 1, "effects": [{}]}'])
def test_a_report_that_is_none_cannot_go_on(rig, calls, capsys, text):
    (rig / "out").mkdir()
    (rig / "out" / "report.json").write_text(text)
    assert main("diagnose model.toml a.csv --with d.csv --out out".split()) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "report.json" in err and "without --with first" in err
    assert (rig / "out" / "report.json").read_text() == text


def test_fit_saves_and_says(rig, calls, capsys):
    assert main(["fit", "model.toml", "a.csv", "--out", "out"]) == 0
    assert calls["fit"][1:] == (["a.csv"], [])
    assert calls["options"] == {"window": None}
    assert main(["fit", "model.toml", "a.csv", "--window", "0.5", "--out", "out"]) == 0
    assert calls["options"] == {"window": 0.5}
    assert {path.name for path in (rig / "out").iterdir()} == {"fit.json", "fit.html", "model.toml"}
    assert "cart_gain" in capsys.readouterr().out


def test_quiet_leaves_files_and_errors(rig, calls, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert main(["fit", "model.toml", "a.csv", "--out", "new", "--quiet"]) == 0
    assert Path("new/fit.json").is_file()
    assert main(["fit", "model.toml", "absent.csv", "--out", "new", "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("jbridge: absent.csv") and err.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "keys"),
    [
        ("fit model.toml a.csv --out new", {"out", "schema", "seconds"}),
        ("diagnose model.toml a.csv b.csv --out new", {"out", "verdict", "effects"}),
        ("simulate model.toml --input a.csv --out new.csv", {"out", "rows", "columns"}),
        ("check a.csv", {"recordings", "mismatch"}),
    ],
)
def test_json_is_one_object_and_nothing_else(rig, calls, capsys, line, keys):
    assert main([*line.split(), "--json"]) == 0
    assert keys <= json.loads(capsys.readouterr().out).keys()


def test_simulate_writes_the_channels(rig, calls, capsys):
    assert main(["simulate", "model.toml", "--input", "a.csv", "--out", "new/sim.csv"]) == 0
    assert (rig / "new" / "sim.csv").read_text().startswith("t,u_x,x\n")
    assert capsys.readouterr().out == "new/sim.csv: 200 rows of t, u_x, x\n"
    assert calls["simulate"][1:] == ("a.csv", "estimated")
    assert main(["simulate", "model.toml", "--input", "a.csv", "--initial", "first-row", "--out", "sim.csv"]) == 0
    assert calls["simulate"][1:] == ("a.csv", "first-row")


def turned(name: str) -> None:
    """A cart of some friction, recorded for 20 s with the input's wires crossed."""
    times = np.arange(1000) * 0.02
    u = np.repeat(np.random.default_rng(0).uniform(-2.0, 2.0, 25), 40)
    v = np.zeros(1000)
    for k in range(999):
        v[k + 1] = v[k] + 0.02 * (3.0 * u[k] - 8.0 * v[k])
    jbridge.save_csv(name, {"t": times, "u_x": -u, "x": np.cumsum(v) * 0.02})


@pytest.mark.parametrize("command", ["simulate model.toml --input", "fit model.toml", "diagnose model.toml"])
def test_a_wrong_sign_is_refused_before_anything_runs(rig, calls, capsys, command):
    turned("t.csv")
    assert main([*command.split(), "t.csv", "--out", "out"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "t.csv, column u_x" in err and 'u_x = {column = "u_x", unit = "V", sign = -1}' in err
    assert not calls and not (rig / "out").exists()
    assert main([*command.split(), "t.csv", "--out", "out", "--force"]) == 0
    (rig / "t.toml").write_text('[columns]\nu_x = {column = "u_x", unit = "V", sign = -1}\n')
    assert main([*command.split(), "t.csv", "--out", "mended"]) == 0


@pytest.mark.parametrize("command", ["fit model.toml", "diagnose model.toml", "check model.toml"])
def test_an_input_that_the_models_gain_contradicts_is_refused(rig, calls, capsys, command):
    """Volts of which a hundredth is logged; every number of the recording is one that a rig may have."""
    (rig / "model.toml").write_text(MODEL.replace("known = [", 'known = ["cart_gain", '))
    turned("t.csv")
    columns = np.loadtxt("t.csv", delimiter=",", skiprows=1).T * [[1.0], [-0.01], [1.0]]
    jbridge.save_csv("t.csv", dict(zip(("t", "u_x", "x"), columns, strict=True)))
    assert main([*command.split(), "t.csv", "--out", "out"]) == 2
    err = capsys.readouterr().err
    assert "t.csv, column u_x" in err and "the model's cart_gain" in err and err.count("\n") == 1
    assert main([*command.split(), "t.csv", "--out", "out", "--force"]) == 0


def test_check_says_what_was_read(rig, capsys):
    turned("t.csv")
    (rig / "t.toml").write_text("[columns]\nu_x = {sign = -1, late = -1}\n")
    assert main(["check", "t.csv", "a.csv"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("NO PROBLEM FOUND") and err == ""
    for needle in (
        "1000 rows",
        "every 20 ms",
        "u_x from u_x [V, sign -1, late -1]",
        "noise",
        "no gap",
        "u_x: fits the laws",
    ):
        assert needle in " ".join(out.split()), needle
    assert {path.name for path in rig.iterdir()} >= {"t.csv"} and not (rig / "out").exists()


def test_check_lists_all_problems(rig, capsys):
    turned("t.csv")
    (rig / "b.csv").write_text((rig / "b.csv").read_text().replace("u_x", "voltage"))
    assert main(["check", "model.toml", "t.csv", "b.csv", "gone.csv", "--out", "out"]) == 2
    out, err = capsys.readouterr()
    assert out.startswith("3 PROBLEMS") and err.count("\n") == 1 and "t.csv, column u_x" in err
    assert 'u_x = {column = "voltage", unit = "V"}' in out and "gone.csv: no such file" in out
    assert {path.name for path in (rig / "out").iterdir()} == {"check.html", "check.png"}
    assert main(["check", "t.csv", "--force"]) == 0


def test_a_problem_that_files_share_is_said_once(rig, capsys):
    """With what mends it for all of them; the numbers of each may differ."""
    for k, name in enumerate(("a.csv", "b.csv", "c.csv")):
        columns = np.loadtxt(name, delimiter=",", skiprows=1).T * [[1.0], [1.0], [1e3 + k]]
        jbridge.save_csv(name, dict(zip(("t", "volts", "x"), columns, strict=True)))
    assert main(["check", "a.csv", "b.csv", "c.csv"]) == 2
    out, err = capsys.readouterr()
    assert out.startswith("1 PROBLEM\n") and "(likewise b.csv, c.csv)" in out
    assert out.splitlines()[1].removeprefix("- ") in err and err.count("\n") == 1
    written = []
    for channel in ("u_x", "x"):
        [line] = re.findall(rf'declare ({channel} = {{.*?}}) under \["\*.csv".columns\] in recordings.toml', out)
        written.append(line)
        (rig / "recordings.toml").write_text('["*.csv".columns]\n' + "\n".join(written) + "\n")
        status = main(["check", "a.csv", "b.csv", "c.csv"])
        out = capsys.readouterr().out
    assert status == 0 and "NO PROBLEM FOUND" in out


def test_what_force_cannot_take_is_said(rig, capsys):
    (rig / "a.csv").write_text((rig / "a.csv").read_text().replace("u_x", "voltage").replace("x", "pos", 1))
    assert main(["check", "a.csv"]) == 2
    out, err = capsys.readouterr()
    assert out.startswith("2 PROBLEMS") and "nothing measured" not in out and "voltage: not used" in err
    assert main(["check", "a.csv", "--force"]) == 2
    assert "nothing measured" in capsys.readouterr().err


def test_check_says_which_numbers_can_be_told(rig, capsys):
    assert main(["check", "model.toml", "a.csv", "b.csv"]) == 0
    out = capsys.readouterr().out
    assert "Parameters that a fit would estimate" in out and "cart_gain" in out and "cart_mass" not in out
    (rig / "still.csv").write_text("t,u_x,x\n" + "".join(f"{k / 100},0.0,{k % 3 / 1e4}\n" for k in range(100)))
    assert main(["check", "model.toml", "still.csv"]) == 2
    out, err = capsys.readouterr()
    assert "u_x never changes, so cart_gain cannot be estimated" in out and "u_x never changes" in err


def test_holdout_may_come_first_or_twice(rig, calls):
    assert main(["diagnose", "--holdout", "c.csv", "--holdout", "d.csv", "--out", "out", "model.toml", "a.csv"]) == 0
    assert calls["diagnose"][1:] == (["a.csv"], ["c.csv", "d.csv"])


def test_an_existing_folder_is_used(rig, calls):
    (rig / "out").mkdir()
    (rig / "out" / "notes.txt").write_text("mine")
    for _ in range(2):
        assert main(["diagnose", "model.toml", "a.csv", "--out", "out"]) == 0
    assert (rig / "out" / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("case", ["adequate", "unknown"])
def test_status_is_zero_whatever_the_verdict(rig, calls, monkeypatch, case):
    monkeypatch.setitem(vars(jbridge), "diagnose", lambda *_, **__: getattr(cases, case)())
    assert main(["diagnose", "model.toml", "a.csv", "--out", "out"]) == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("", "COMMAND; see jbridge --help"),
        ("diagnos model.toml a.csv --out out", "'diagnos'"),
        ("diagnose", "required: MODEL.toml, REC.csv, --out; see jbridge diagnose --help"),
        ("diagnose model.toml --out out", "name recordings to learn from, or folders of them behind --each"),
        ("fit model.toml a.csv --out out --hold b.csv", "unrecognized arguments: --hold"),
        ("fit model.toml a.csv --out out --holdout", "--holdout: expected at least one argument"),
        ("diagnose none.toml a.csv --out out", "none.toml: no such file"),
        ("diagnose a.csv a.csv --out out", "a.csv: a recording; name the model"),
        ("diagnose model.toml none.csv --out out", "none.csv: no such file"),
        ("diagnose model.toml a.csv --holdout none.csv --out out", "none.csv: no such file"),
        ("diagnose model.toml a.csv --holdout a.csv --out out", "a.csv: the recording is named twice"),
        ("diagnose model.toml a.csv --with b.csv --out out", "out/report.json: no report to go on from"),
        ("diagnose model.toml a.csv --with --out out", "--with: expected at least one argument"),
        ("diagnose model.toml a.csv --budget soon --out out", "--budget: soon: give seconds, at least 1"),
        ("diagnose model.toml a.csv --out b.csv", "b.csv: a file, where the folder"),
        ("diagnose model.toml a.csv --out .", "model.toml: the results would replace this file"),
        ("simulate model.toml --input none.csv --out sim.csv", "none.csv: no such file"),
        ("simulate model.toml --input a.csv --out a.csv", "a.csv: the results would replace this file"),
        ("simulate model.toml --input a.csv --out .", "a folder, where a file belongs"),
        ("simulate model.toml --input a.csv --out a.csv/sim.csv", "a.csv is a file, not a folder"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(rig, calls, capsys, arguments, told):
    before = {path: path.read_bytes() for path in rig.rglob("*") if path.is_file()}
    assert main(arguments.split()) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1 and err.startswith("jbridge: ") and told in err
    assert {path: path.read_bytes() for path in rig.rglob("*") if path.is_file()} == before
    assert not (rig / "out").exists()


def test_an_error_found_late_writes_nothing_either(rig, monkeypatch, capsys):
    def refuse(*_, **__):
        raise jbridge.InputError("u_x never changes\nin any recording; move the cart")

    monkeypatch.setitem(vars(jbridge), "diagnose", refuse)
    assert main(["diagnose", "model.toml", "a.csv", "--out", "out"]) == 2
    assert capsys.readouterr().err == "jbridge: u_x never changes in any recording; move the cart\n"
    assert not (rig / "out").exists()


def test_interruption_is_status_130_and_one_line(rig, monkeypatch, capsys):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setitem(vars(jbridge), "fit", interrupt)
    assert main(["fit", "model.toml", "a.csv", "--out", "out"]) == 130
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "interrupted" in err


def test_a_bug_shows_its_traceback(rig, monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setitem(vars(jbridge), "fit", fail)
    with pytest.raises(ZeroDivisionError):
        main(["fit", "model.toml", "a.csv", "--out", "out"])


def test_progress_is_of_a_terminal_and_not_of_the_quiet(rig, calls, monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert main(["fit", "model.toml", "a.csv", "--out", "out"]) == 0
    assert "half way" in capsys.readouterr().err
    assert main(["fit", "model.toml", "a.csv", "--out", "out", "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_the_cache_can_be_left_out(rig, calls, monkeypatch):
    asked = []
    monkeypatch.setitem(vars(jbridge), "set_up", asked.append)
    main(["fit", "model.toml", "a.csv", "--out", "out"])
    main(["fit", "model.toml", "a.csv", "--out", "out", "--no-cache"])
    assert asked == [True, False]


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_help_has_an_example_and_loads_no_jax(command):
    code = (
        "import sys; from jbridge.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit as end: assert end.code == 0\n"
        "heavy = {'jax', 'numpy', 'matplotlib', 'scipy'} & sys.modules.keys()\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code, *command, "--help"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "example" in done.stdout and "jbridge " + (command[0] if command else "diagnose") in done.stdout


def test_module_runs_as_a_command():
    done = subprocess.run([sys.executable, "-m", "jbridge", "--version"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"jbridge {jbridge.__version__}\n")
    done = subprocess.run([sys.executable, "-m", "jbridge", "fit"], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


def test_public_names_are_sorted_and_lazy():
    assert jbridge.__all__ == sorted(jbridge.__all__)
    assert set(jbridge.__all__) <= set(dir(jbridge))
    assert all(hasattr(jbridge, name) for name in jbridge.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = jbridge.nothing


def test_set_up_survives_a_cache_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    code = (
        "import jbridge; jbridge.set_up(); import jax, jax.numpy as jnp\n"
        "assert jnp.zeros(1).dtype == 'float64' and jax.jit(lambda x: x + 1)(1.0) == 2.0\n"
        "assert jax.config.jax_compilation_cache_dir is None"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env={"XDG_CACHE_HOME": str(tmp_path / "file"), "PATH": ""},
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_control_moves_the_load(tmp_path, capsys):
    """The paper's controllers and moves by default; what is written can be used again."""
    model = tmp_path / "model.toml"
    model.write_text(model_text(FRICTION))
    reference = tmp_path / "reference.toml"
    reference.write_text("points = [[0.0, 0.3], [0.3, 0.4]]\nrest = 2.0\n")
    out = tmp_path / "out"
    assert main(["control", str(model), "--reference", str(reference), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "0.3, 0.4" in said and str(out / "control.html") in said and "sign changes" in said
    (move,) = json.loads((out / "control.json").read_text())["moves"]
    assert (move["settling_time"]["load"] is None) == said.startswith("Warning: the load does not settle in move 1.")
    assert {p.name for p in out.iterdir()} == {"control.html", "control.json", "controller.toml", "run.csv", "figures"}
    again = tmp_path / "again"
    command = ["control", str(model), "--controller", str(out / "controller.toml"), "--reference", str(reference)]
    assert main([*command, "--out", str(again)]) == 0
    assert (again / "run.csv").read_text() == (out / "run.csv").read_text()
    # The run is a recording that the other commands read.
    assert main(["simulate", str(model), "--input", str(out / "run.csv"), "--out", str(tmp_path / "open.csv")]) == 0


SMALL_CONTROLLER = """
kind = "fuzzy"
angle_unit = "deg"

[cart]
points = 11
rules = ["if error is N then voltage is N", "if error is P then voltage is P"]
input.error = {range = [-1.0, 1.0], sets = {N = {trimf = [-1.0, -1.0, 1.0]}, P = {trimf = [-1.0, 1.0, 1.0]}}}
input.velocity = {range = [-1.0, 1.0], sets = {ANY = {trimf = [-9.0, 0.0, 9.0]}}}
input.angle = {range = [-9.0, 9.0], sets = {ANY = {trimf = [-90.0, 0.0, 90.0]}}}
output.voltage = {range = [-3.0, 3.0], sets = {N = {trimf = [-3.0, -2.0, 0.0]}, P = {trimf = [0.0, 2.0, 3.0]}}}

[hoist]
points = 11
rules = ["if error is N then voltage is N", "if error is P then voltage is P"]
input.error = {range = [-1.0, 1.0], sets = {N = {trimf = [-1.0, -1.0, 1.0]}, P = {trimf = [-1.0, 1.0, 1.0]}}}
input.velocity = {range = [-1.0, 1.0], sets = {ANY = {trimf = [-9.0, 0.0, 9.0]}}}
output.voltage = {range = [-9.0, 9.0], sets = {N = {trimf = [-9.0, -6.0, 0.0]}, P = {trimf = [0.0, 6.0, 9.0]}}}
"""


SLOW_RULES = [pytest.param(rules, marks=pytest.mark.slow) for rules in ("given", "paper", "extended", "lqg")]


@pytest.mark.parametrize("rules", ["pid", *SLOW_RULES])
def test_tune_makes_a_controller_for_control(tmp_path, monkeypatch, capsys, rules):
    """Two steps on two bridges: what is written is there, can be used, and is told."""
    monkeypatch.setitem(vars(jbridge), "tune", functools.partial(jbridge.tune, held_out=2))  # in the place of 64
    model, out = tmp_path / "model.toml", tmp_path / "out"
    model.write_text(model_text(FRICTION))
    (tmp_path / "given.toml").write_text(SMALL_CONTROLLER)
    begin = ["--controller", str(tmp_path / "given.toml")] if rules == "given" else ["--rules", rules]
    begin += ["--shaping", "zvd"] if rules == "pid" else []
    small = ["--plants", "2", "--steps", "2", "--starts", "1", "--rail", "0", "0.8", "--delay", "10"]
    with jax.numpy_dtype_promotion("standard"):  # optax counts its steps in integers
        assert main(["tune", str(model), *begin, *small, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "cost" in said and str(out / "tune.html") in said and str(out / "controller.toml") in said
    assert {p.name for p in out.iterdir()} == {"controller.toml", "controller.h", "tune.json", "tune.html", "figures"}
    told = json.loads((out / "tune.json").read_text())
    assert len(told["history"]) == 2 and set(told["measures"]) == {"train", "held_out"}
    of_rules = {"sets-cart.png", "surface-hoist.png"} if rules not in ("pid", "lqg") else set()
    wanted = {"response.png", "ensemble.png"} | of_rules
    assert wanted <= {p.name for p in (out / "figures").iterdir()}
    tuned = jbridge.load_controller(out / "controller.toml")
    assert (tuned.law.compensation is not None) == (rules in ("pid", "extended", "lqg"))
    # The swing on a rope in the middle of 0.185 and 0.7 m.
    given = None if tuned.shaping is None else (tuned.shaping.kind, tuned.shaping.frequency)
    assert given == (("zvd", pytest.approx(np.sqrt(9.81 / 0.4425))) if rules == "pid" else None)


@pytest.mark.parametrize(("words", "complaint"), [
    (["--seed", "-1"], "seed -1: give 0 or more"),
    (["--rail", "1.2", "0"], "--rail 1.2 0: give the lower end and the higher one in metres"),
    (["--rope", "-0.1", "0.5"], "--rope -0.1 0.5: give"),
    (["--delay", "-5"], "--delay -5: give milliseconds"),
    (["--controller", "sugeno.toml"], "cart's fuzzy system is a Sugeno's; only Mamdani's are tuned"),
    (["--controller", "folder.toml"], "cart = '.' does not lie beside this file"),
])  # fmt: skip
def test_what_tune_cannot_do_is_said_in_one_line(tmp_path, capsys, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    Path("model.toml").write_text(model_text(FRICTION))
    Path("sugeno.toml").write_text('kind = "fuzzy"\nangle_unit = "deg"\ncart = "cart.fis"\nhoist = "hoist.fis"\n')
    Path("folder.toml").write_text('kind = "fuzzy"\ncart = "."\nhoist = "."\n')
    for name, inputs in (("cart", ("error", "velocity", "angle")), ("hoist", ("error", "velocity"))):
        jbridge.save_fis(f"{name}.fis", sugeno(inputs))
    assert main(["tune", "model.toml", *words, "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert complaint in said and said.count("\n") == 1 and not Path("out").exists()


def test_a_sugeno_controller_moves_the_load_and_comes_back(tmp_path, capsys):
    model, given, out = tmp_path / "model.toml", tmp_path / "given.toml", tmp_path / "out"
    model.write_text(model_text(FRICTION))
    given.write_text('kind = "fuzzy"\nangle_unit = "deg"\ncart = "cart.fis"\nhoist = "hoist.fis"\n')
    for name, inputs in (("cart", ("error", "velocity", "angle")), ("hoist", ("error", "velocity"))):
        jbridge.save_fis(tmp_path / f"{name}.fis", sugeno(inputs))
    reference = tmp_path / "reference.toml"
    reference.write_text("points = [[0.0, 0.3], [0.3, 0.4]]\nrest = 2.0\n")
    command = ["control", str(model), "--controller", str(given), "--reference", str(reference)]
    assert main([*command, "--out", str(out)]) == 0
    found, wanted = (jbridge.load_controller(path).law for path in (out / "controller.toml", given))
    assert eqx.tree_equal(found, wanted)


def test_controllers_beside_one_that_runs_away_are_compared(tmp_path, capsys, monkeypatch):
    model, out, track = tmp_path / "model.toml", tmp_path / "out", jbridge.track
    model.write_text(model_text(FRICTION))
    reference = tmp_path / "reference.toml"
    reference.write_text("points = [[0.0, 0.3], [0.3, 0.4]]\nrest = 2.0\n")
    for name, p in (("calm", 5.0), ("calmer", 4.0), ("wild", 1e4)):
        axis = f"{{p = {p}, i = 0.0, d = 1.0}}"
        (tmp_path / f"{name}.toml").write_text(f'kind = "pid"\ncart = {axis}\nhoist = {axis}\n')

    def tracked(model, controller, path):
        if float(controller.law.cart_p) > 1e3:
            raise InputError("wild.toml: the loop runs away")
        return track(model, controller, path)

    monkeypatch.setattr(jbridge, "track", tracked)
    rivals = [str(tmp_path / f"{name}.toml") for name in ("wild", "calm", "calmer")]
    command = ["control", str(model), "--reference", str(reference), "--out", str(out), "--controller"]
    assert main([*command, *rivals]) == 2
    told = capsys.readouterr()
    assert "wild.toml: the loop runs away" in told.err and "calmer" in told.out
    assert sorted(folder.name for folder in out.iterdir()) == ["calm", "calmer"]
    assert main([*command, rivals[0]]) == 2


def test_controllers_called_alike_go_by_their_folders_and_none_is_replaced(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.toml").write_text(model_text(FRICTION))
    for name in ("slow", "quick"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "controller.toml").write_text(
            'kind = "fuzzy"\ncart = "controller-cart.fis"\nhoist = "b.fis"\n'
        )
        for file, inputs in (("controller-cart", ("error", "velocity")), ("b", ("error", "velocity"))):
            jbridge.save_fis(tmp_path / name / f"{file}.fis", sugeno(inputs))
    (tmp_path / "slow" / "controller.toml").rename(tmp_path / "slow" / "mine.toml")
    before = (tmp_path / "slow" / "controller-cart.fis").read_bytes()
    # The file that a controller names, and, since each has a folder called like its own, a controller itself.
    assert main(["control", "rig.toml", "--controller", "slow/mine.toml", "--out", "slow"]) == 2
    assert "controller-cart.fis: the results would replace this file" in capsys.readouterr().err
    assert (tmp_path / "slow" / "controller-cart.fis").read_bytes() == before
    (tmp_path / "slow" / "mine.toml").rename(tmp_path / "slow" / "controller.toml")
    rivals = ["slow/controller.toml", "quick/controller.toml"]
    assert main(["control", "rig.toml", "--controller", *rivals, "--out", "."]) == 2
    assert "slow/controller.toml: the results would replace this file" in capsys.readouterr().err


def sugeno(inputs):
    """Ten volts per metre of error, whatever else is asked."""
    variables = tuple(
        Variable(name, as_number(-1.0), as_number(1.0), ("any",), (Trapezoidal(*map(as_number, (-1, -1, 1, 1))),))
        for name in inputs
    )
    slopes = [10.0] + [0.0] * (len(inputs) - 1)
    out = Conclusions(
        "voltage", as_number(-10.0), as_number(10.0), ("law",), (Linear(as_number(slopes), as_number(0.0)),)
    )
    return Sugeno(variables, (out,), (rule("if error is any then voltage is law", variables, (out,)),))


def test_a_cart_alone_cannot_be_controlled(tmp_path, capsys):
    model = tmp_path / "model.toml"
    model.write_text("[bridge]\ncart_mass = 5.5\ncart_gain = 16.0\n")
    assert main(["control", str(model), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "no load_mass" in said and said.count("\n") == 1 and not (tmp_path / "out").exists()
