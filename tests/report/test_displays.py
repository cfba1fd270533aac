"""Results show themselves as text, in notebooks, as figures and tables, and save what their commands write."""

import dataclasses
import importlib.resources
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

import jbridge
from jbridge.control.move_metrics import Move
from jbridge.identification.identifiability import Identifiability
from jbridge.identification.result import Estimate
from jbridge.prediction import Simulation
from jbridge.simulation.tracking import Tracking
from jbridge.sweep.run import SweepResult
from tests.identification.cases import make_recording
from tests.report import cases
from tests.report.test_warnings import tuning

TIMES = np.arange(200) * 0.01


def simulation():
    recording = make_recording("run.csv", TIMES, u_x=np.sin(TIMES), x=0.4 + 0.1 * TIMES)
    return Simulation({"t": TIMES, "u_x": recording.u_x, "x": recording.x + 0.002}, recording)


RESULTS = {
    "missing physics": cases.missing_physics,
    "adequate": cases.adequate,
    "unknown": cases.unknown,
    "cart alone": cases.cart_alone,
    "fit": cases.fitted,
    "fit without hold-out": lambda: cases.fitted(holdout=False),
    "simulation": simulation,
}


@pytest.fixture(params=RESULTS)
def result(request):
    return RESULTS[request.param]()


@pytest.fixture
def frames(monkeypatch):
    """In place of pandas: a frame is its columns."""
    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=dict))


def test_repr_fits_on_a_screen(result):
    lines = repr(result).splitlines()
    assert 1 < len(lines) <= 24 and max(map(len, lines)) <= 100
    assert str(result) == repr(result)


def tracking():
    """A long one, whose arrays would fill pages."""
    axes = {name: 0.5 + 0.0 * np.arange(5000) for name in ("x", "psi", "l")}
    each = dict.fromkeys(("x", "l", "load"), 0.5)
    move = Move(
        start=0.0,
        arrival=1.0,
        settling_time=each,
        overshoot=each,
        steady_error=each,
        residual_swing=0.0,
        itae=each,
        effort=each,
        travel=each,
        sign_changes=dict.fromkeys(each, 3),
        saturation=each,
    )
    return Tracking(
        times=0.01 * np.arange(5000),
        reference=axes,
        reference_speed=axes,
        position=axes,
        measured=axes,
        command={"u_x": axes["x"], "u_l": axes["x"]},
        moves=(move,),
    )


def inspection():
    return jbridge.inspect_recordings([importlib.resources.files("jbridge") / "demo_data" / "train-1.csv"])[0]


SHORT = {
    "tracking": (tracking, "Tracking: 5000 samples, 1 move"),
    "tuning": (lambda: dataclasses.replace(tuning(), costs={"train": (2.0, 1.0), "held_out": (2.0, 1.0)}), "Tuning"),
    "sweep": (lambda: SweepResult(Path("out"), 12_000, 3, 500, 2.0), "Sweep in out: 12,000 rollouts, 3 failed"),
    "inspection": (inspection, "Inspection of "),
    "identifiability": (
        lambda: Identifiability({"cart_gain": Estimate(16.0, 0.1, 15.8, 16.2, "N/V")}, ("cart_gain",), (), (), {}),
        "Parameters that a fit would estimate",
    ),
}


@pytest.mark.parametrize(("make", "begins"), SHORT.values(), ids=SHORT)
def test_what_has_no_page_is_shown_as_a_short_text(make, begins):
    made = make()
    said = repr(made)
    assert said.startswith(begins) and len(said.splitlines()) <= 24 and max(map(len, said.splitlines())) <= 100
    assert made._repr_html_().startswith("<pre>")
    with pytest.raises(TypeError, match=f"a {type(made).__name__} has no figure"):
        made.plot()


def test_repr_says_what_matters():
    said = repr(cases.missing_physics())
    assert (
        said.startswith("Diagnosis: Missing physics is identified")
        and "dead zone, cart drive (confirmed): positive 0.301" in said
    )
    assert "Hold-out, whole recordings" in said
    assert "cart_gain 16.04 N/V (95 %: 15.82 to 16.26)" in repr(cases.fitted())
    assert repr(simulation()) == (
        "Simulation of run.csv: 200 rows over 1.99 s of t, u_x, x\n  cart position x: rms error 2.00 mm"
    )


def test_notebooks_get_a_page(result):
    page = result._repr_html_()
    assert "data:image/png;base64," in page and "<table>" in page
    assert page.count("<div") == page.count("</div>")


def test_plots_are_figures(result):
    figure = result.plot()
    assert isinstance(figure, Figure) and any("cart position" in axes.get_ylabel() for axes in figure.axes)


def test_the_recording_to_plot_is_chosen():
    def title(figure):
        return figure.subfigs[0].texts[0].get_text()

    result = cases.fitted()
    assert title(result.plot()) == "holdout-1.csv" and title(result.plot("train-2.csv")) == "train-2.csv"
    with pytest.raises(ValueError, match=r"no recording 'none'; there are train-1\.csv"):
        result.plot("none")


def test_inputs_alone_can_be_plotted():
    recording = make_recording("inputs.csv", TIMES, u_x=np.sin(TIMES))
    result = Simulation({"t": TIMES, "u_x": recording.u_x, "x": 0.1 * TIMES}, recording)
    assert result.errors == {} and isinstance(result.plot(), Figure)
    assert repr(result).startswith("Simulation of inputs.csv: 200 rows")


def test_numbers_are_a_table(result, frames):
    table = result.to_dataframe()
    assert len({len(column) for column in table.values()}) == 1 and len(next(iter(table.values()))) > 1


def test_a_row_for_each_number(frames):
    table = cases.fitted().to_dataframe()
    row = table["parameter"].index("cart_gain")
    assert [table[name][row] for name in ("kind", "value", "low", "high", "unit")] == [None, 16.04, 15.82, 16.26, "N/V"]
    table = cases.missing_physics().to_dataframe()
    row = table["parameter"].index("positive")
    assert [table[name][row] for name in ("kind", "site", "value", "status", "probability")] == [
        "dead_zone", "cart_drive", 0.3012, "confirmed", 0.97,
    ]  # fmt: skip
    assert list(simulation().to_dataframe()) == ["t", "u_x", "x"]


def test_without_pandas_one_line_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="to_dataframe needs pandas, which jbridge does without: pip install pandas"):
        simulation().to_dataframe()


def test_saving_writes_what_commands_write(tmp_path):
    cases.brief(cases.fitted()).save(tmp_path / "fit")
    assert {path.name for path in (tmp_path / "fit").iterdir()} == {"fit.json", "fit.html", "model.toml", "figures"}
    shown = cases.brief(cases.missing_physics()).save(tmp_path / "report")
    assert shown == tmp_path / "report" / "report.html"
    assert {"report.json", "report.html", "model.toml", "figures"} <= {path.name for path in shown.parent.iterdir()}
    assert simulation().save(tmp_path / "out") == tmp_path / "out" / "simulated.csv"
    path = simulation().save(tmp_path / "out" / "run.csv")
    again = jbridge.load_recording(path)
    np.testing.assert_array_equal(again.x, simulation()["x"])
    assert simulation().errors == {"x": pytest.approx(0.002)}
