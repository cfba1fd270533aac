"""Sweeps: each rollout as one alone, interruptions that leave no trace, failures that are told, several processes."""

import dataclasses
import json

import jax
import numpy as np
import pyarrow.parquet as pq
import pytest

import jbridge
from jbridge import InputError
from jbridge.model.parameters import ParameterTable
from jbridge.model.plant import Plant
from jbridge.model.step_size import substeps
from jbridge.simulation.move_summary import UNITS
from jbridge.sweep.rollouts import Rollouts, _substeps
from jbridge.sweep.run import read_sweep, run_sweep
from jbridge.sweep.spec import load_sweep
from tests.problems import model_text

MODEL = model_text(
    ("coulomb_friction", "cart", {"level": 4.0}),
    ("coulomb_friction", "hoist", {"level": 3.0}),
    ("input_delay", "cart_drive", {"delay": 0.01}),
)
SPEC = """
model = "model.toml"
chunk = 8

[reference]
start = [0.0, 0.4]
goal = [0.3, 0.5]
rest = 2.0

[sample]
kind = "latin"
count = 20
seed = 5

[[vary]]
name = "coulomb_friction@cart.level"
low = 1.0
high = 5.0

[[vary]]
name = "input_delay@cart_drive.delay"
low = 0.0
high = 0.05

[[vary]]
name = "controller.cart_scale"
low = 2.0
high = 4.0
"""


PID = """\
kind = "pid"
cart = {p = 20.0, i = 0.0, d = 5.0}
hoist = {p = 40.0, i = 0.0, d = 2.0}
"""


@pytest.fixture
def spec(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "spec.toml").write_text(SPEC)
    (tmp_path / "pid.toml").write_text(PID)
    return tmp_path / "spec.toml"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """One finished sweep that several tests look at."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "model.toml").write_text(MODEL)
    (folder / "spec.toml").write_text(SPEC)
    said = []
    result = run_sweep(load_sweep(folder / "spec.toml"), folder / "out", progress=said.append)
    return folder, result, said


def test_every_rollout_is_as_it_would_be_alone(done):
    """The same plant, controller and reference through `track`, measured by code of its own."""
    folder, result, _ = done
    assert (result.count, result.failed, result.computed) == (20, 0, 20)
    table = read_sweep(folder / "out")
    np.testing.assert_array_equal(table["index"], np.arange(20))
    model = jbridge.load_model(folder / "model.toml")
    for i in (0, 9, 19):
        values = {name: table[name][i] for name in table}
        plant = model.plant
        level, delay = values["coulomb_friction@cart.level"], values["input_delay@cart_drive.delay"]
        effects = (
            dataclasses.replace(plant.effects[0], level=level),
            plant.effects[1],
            dataclasses.replace(plant.effects[2], delay=delay),
        )
        law = dataclasses.replace(jbridge.paper_controller(), cart_scale=values["controller.cart_scale"])
        path = jbridge.smooth_path([(0.0, 0.4), (0.3, 0.5)], speed=(0.3, 0.2), rest=2.0, period=0.02)
        other = dataclasses.replace(model, plant=jbridge.Plant(plant.bridge, effects))
        tracking = jbridge.track(other, jbridge.Controller(law), path, noise=(0.0, 0.0, 0.0))
        (move,) = tracking.moves
        error = tracking.position["x"] - 0.3
        assert values["final_error_x"] == pytest.approx(error[-1], abs=1e-9)
        assert values["largest_swing"] == pytest.approx(np.abs(tracking.position["psi"]).max(), rel=1e-9)
        follow = np.abs(tracking.position["x"] - tracking.reference["x"])
        assert values["itae_x"] == pytest.approx(0.02 * np.sum(path.times * follow), rel=1e-9)
        assert values["overshoot_x"] == pytest.approx(max(error.max(), 0.0), abs=1e-9)
        # There the clock begins when the reference first moves, one sample later.
        assert values["settling_x"] == pytest.approx(move.settling_time["x"], abs=0.021)


def test_results_say_what_they_are(done):
    folder, _, said = done
    about = json.loads(pq.read_schema(folder / "out" / "part-000000.parquet").metadata[b"jbridge"])
    assert about["specification"] == SPEC and about["seed"] == 5 and about["versions"]["jax"] == jax.__version__
    assert about["units"]["coulomb_friction@cart.level"] == "N" and about["units"]["settling_x"] == "s"
    assert set(UNITS) <= set(read_sweep(folder / "out"))
    assert "rollouts" in said[-1] and said[-1].done == 1.0


def test_an_interrupted_sweep_ends_with_the_same_bits(done, spec, tmp_path):
    folder, _, _ = done
    question, out = load_sweep(spec), tmp_path / "again"
    calls = []

    def interrupt(text):
        calls.append(text)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(question, out, progress=interrupt)
    finished = {path.name for path in out.glob("part-*.parquet")}
    assert 0 < len(finished) < 3 and "failed" not in json.loads((tmp_path / "again.sweep.json").read_text())
    (out / ".part-000002.parquet.123.part").write_bytes(b"half")
    result = run_sweep(question, out)
    assert result.computed == 20 - sum(8 if name != "part-000002.parquet" else 4 for name in finished)
    one, two = read_sweep(folder / "out"), read_sweep(out)
    for name, values in one.items():
        np.testing.assert_array_equal(two[name], values)  # a place that never settles is NaN in both
    assert run_sweep(question, out).computed == 0


def test_another_question_does_not_mix_with_the_answers(done, spec):
    folder, _, _ = done
    spec.write_text(SPEC.replace("seed = 5", "seed = 6"))
    with pytest.raises(InputError, match="results of another sweep; choose another --out"):
        run_sweep(load_sweep(spec), folder / "out")


def test_other_rules_are_another_question(spec, tmp_path):
    """Rules are no numbers, and yet they decide the results."""
    controller = jbridge.Controller(jbridge.paper_controller())
    jbridge.save_controller(spec.parent / "fuzzy.toml", controller)
    spec.write_text('controller = "fuzzy.toml"\n' + SPEC)
    before = load_sweep(spec).identity
    text = (spec.parent / "fuzzy.toml").read_text()
    (spec.parent / "fuzzy.toml").write_text(
        text.replace("if angle is P then voltage is ZE", "if angle is P then voltage is NS")
    )
    assert load_sweep(spec).identity != before


def test_failures_are_counted_and_listed(spec, tmp_path):
    """A winch that is wired the wrong way round winds the load through its drum."""
    spec.write_text(
        SPEC.replace("coulomb_friction@cart.level", "hoist_gain").replace(
            "low = 1.0\nhigh = 5.0", "low = -60.0\nhigh = 40.0"
        )
    )
    result = run_sweep(load_sweep(spec), tmp_path / "out")
    table = read_sweep(tmp_path / "out")
    assert 0 < result.failed < 20 and result.failed == np.sum(~table["sound"])
    lines = (tmp_path / "out.failures.csv").read_text().splitlines()
    assert lines[0].startswith("index,hoist_gain") and len(lines) == 1 + result.failed
    assert json.loads((tmp_path / "out.sweep.json").read_text())["failed"] == result.failed


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("model.toml", "other.toml"), "other.toml: no such file"),
        (('kind = "latin"', 'kind = "magic"'), "unknown kind 'magic'"),
        (("count = 20", "count = 0.5"), "count = 0.5 is not a whole number"),
        (("cart.level", "cart.height"), "nothing that can be varied; did you mean 'coulomb_friction@cart.level'"),
        (("low = 1.0", "low = 9.0"), "low and high are not the ends of a range"),
        (("low = 0.0", "log = true\nlow = 0.0"), "log = true needs a range of positive numbers"),
        (("chunk = 8", "lump = 8"), "unknown key 'lump'; choose among"),
        (("[0.3, 0.5]", "[0.3]"), r"goal = \[0.3\] is not a pair"),
        (('kind = "latin"\ncount = 20', 'kind = "grid"'), "a grid needs values"),
        (('"model.toml"', '"../model.toml"'), "'../model.toml' does not lie beside this file"),
        (('"model.toml"', '"/etc/model.toml"'), "'/etc/model.toml' does not lie beside this file"),
        (('"model.toml"', '"model.toml"\ncontroller = "a/../../c.toml"'), "'a/../../c.toml' does not lie beside"),
        (("chunk = 8", "chunk = 1048577"), "chunk = 1048577 is not a whole number from 1 to 1048576"),
        (("count = 20", "count = 10000001"), "count = 10000001 is not a whole number from 1 to 10000000"),
        (("seed = 5", "seed = 18446744073709551616"), "'sample.seed': an integer of more than 64 bits"),
        (("rest = 2.0", "rest = 1e8"), r"a run takes up to 1e\+08 s, more than 2e\+04 s; raise the speeds or shorten"),
        (("rest = 2.0", "speed = [1e-6, 0.2]"), "a run takes up to 5.*e.05 s"),
        (("low = 1.0", "low = -1.0"), r"coulomb_friction@cart.level cannot go from -1 to 5; stay within 0 to 1e\+06"),
        (('"model.toml"', '"model.toml"\ncontroller = "pid.toml"'), "'controller.cart_scale'"),
        (("low = 2.0", "low = 0.0"), "controller.cart_scale cannot go from 0 to 4; stay within 1e-06 to"),
    ],
)
def test_what_is_wrong_with_a_specification_is_said(spec, change, complaint):
    spec.write_text(SPEC.replace(*change))
    with pytest.raises(InputError, match=complaint):
        load_sweep(spec)


def test_the_filter_of_a_pid_varies(spec):
    asked = SPEC.replace('"model.toml"', '"model.toml"\ncontroller = "pid.toml"')
    spec.write_text(asked.replace("cart_scale", "filter").replace("low = 2.0\nhigh = 4.0", "low = 0.005\nhigh = 0.5"))
    found = Rollouts(load_sweep(spec))(np.array([[2.0, 0.01, 0.005], [2.0, 0.01, 0.5]]))
    assert found["itae_x"][1] > 1.01 * found["itae_x"][0]


def test_a_grid_of_more_points_than_can_be_counted_is_refused(spec):
    text = SPEC.replace('kind = "latin"\ncount = 20', 'kind = "grid"').replace("high", "count = 1000000\nhigh")
    spec.write_text(text)
    with pytest.raises(InputError, match=r"the grid has 1e\+18 points, more than 1.1e\+12; give fewer values"):
        load_sweep(spec)


def test_of_two_sweeps_that_claim_a_folder_at_once_one_is_refused(spec, tmp_path):
    """The other one's mark appears while this one compiles."""

    def other(text):
        (tmp_path / "out.sweep.json").write_text('{"identity": "another"}')

    with pytest.raises(InputError, match="results of another sweep; choose another --out"):
        run_sweep(load_sweep(spec), tmp_path / "out", progress=other)
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"[" * 100_000, b"\xff"], ids=["empty", "cut", "list", "deep", "bytes"]
)
def test_a_damaged_mark_is_refused(spec, tmp_path, content):
    (tmp_path / "out.sweep.json").write_bytes(content)
    with pytest.raises(InputError, match="out.sweep.json: damaged; choose another --out, or delete it and the folder"):
        run_sweep(load_sweep(spec), tmp_path / "out")


def test_a_damaged_part_is_refused(done, tmp_path):
    folder, _, _ = done
    for part in (folder / "out").glob("part-*.parquet"):
        (tmp_path / part.name).write_bytes(part.read_bytes()[:-100])
    with pytest.raises(InputError, match="part-000000.parquet: damaged; delete it"):
        read_sweep(tmp_path)


READERS = {
    "pandas": lambda pandas, folder: pandas.read_parquet(folder)["index"].to_numpy(),
    "pyarrow.dataset": lambda dataset, folder: dataset.dataset(folder).to_table()["index"].to_numpy(),
    "polars": lambda polars, folder: polars.read_parquet(folder)["index"].to_numpy(),
    "duckdb": lambda duckdb, folder: duckdb.sql(f"select index from '{folder}/*.parquet'").fetchnumpy()["index"],
}


@pytest.mark.parametrize("reader", READERS)
def test_a_folder_of_results_is_one_table(done, reader):
    library = pytest.importorskip(reader)
    assert sorted(READERS[reader](library, str(done[0] / "out"))) == list(range(20))


def test_a_failed_start_claims_nothing(spec, tmp_path, monkeypatch):
    def fails(question):
        raise RuntimeError("no memory for the program")

    monkeypatch.setattr("jbridge.sweep.run.Rollouts", fails)
    with pytest.raises(RuntimeError):
        run_sweep(load_sweep(spec), tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.toml", "pid.toml", "spec.toml"]


def test_a_scheduler_that_is_not_there_is_told(spec, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("jbridge.dask_workers._PATIENCE", 0.5)
    with pytest.raises(InputError, match="no scheduler at tcp://127.0.0.1:1 .*; start `dask scheduler`, and workers"):
        run_sweep(load_sweep(spec), tmp_path / "out", scheduler="tcp://127.0.0.1:1")


@pytest.mark.slow
def test_workers_give_what_one_process_gives_though_they_are_killed(done, spec, tmp_path):
    """Whichever of them dies, and however often, the table has the same bits."""
    psutil = pytest.importorskip("psutil")
    pytest.importorskip("distributed")
    folder, _, _ = done
    spec.write_text(SPEC.replace("chunk = 8", "chunk = 1"))
    whole = run_sweep(load_sweep(spec), tmp_path / "alone")
    rng, killed = np.random.default_rng(0), []

    def kill(text):
        """A worker, after every fourth chunk."""
        if "rollouts" in text and len(killed) < 5 and int(text.split()[0]) % 4 == 0:
            every = psutil.Process().children(recursive=True)
            workers = [p for p in every if any("spawn_main" in word for word in p.cmdline())]
            killed.append(rng.choice(workers))
            killed[-1].kill()

    result = run_sweep(load_sweep(spec), tmp_path / "out", workers=2, progress=kill)
    assert len(killed) == 5 and result.computed == whole.computed == 20
    one, two = read_sweep(tmp_path / "alone"), read_sweep(tmp_path / "out")
    for name, values in one.items():
        np.testing.assert_array_equal(two[name], values)


@pytest.mark.parametrize("names", [("cart_damping", "cart_mass"), ("cart_mass", "cart_damping")])
def test_steps_are_short_enough_for_the_fastest_bridge_of_a_sweep(tmp_path, names):
    """A light cart with much damping, in whichever order the two are varied."""
    ranges = {"cart_damping": "low = 20.0\nhigh = 500.0", "cart_mass": "low = 0.3\nhigh = 6.0"}
    axes = "\n".join(f'[[vary]]\nname = "{name}"\n{ranges[name]}\n' for name in names)
    (tmp_path / "model.toml").write_text(model_text())
    (tmp_path / "sweep.toml").write_text(SPEC.partition("[[vary]]")[0] + axes)
    sweep = load_sweep(tmp_path / "sweep.toml")
    table = ParameterTable(sweep.model.plant)
    places = {name: list(table.positions(name)) for name in names}
    found = _substeps(sweep, table, np.asarray(table.ravel(sweep.model.plant)), places)
    bridge = dataclasses.replace(sweep.model.plant.bridge, cart_damping=500.0, cart_mass=0.3)
    assert found == substeps(Plant(bridge), sweep.controller.period) > substeps(sweep.model.plant, 0.02)
