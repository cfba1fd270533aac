"""Figures: every axis has quantity and unit, and no recording is so odd that drawing fails."""

import dataclasses
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from jbridge.diagnosis.result import Interval, Location, Region
from jbridge.identification.result import Estimate
from jbridge.report.figures.friction_map import draw_friction_map
from jbridge.report.figures.gallery import OWN_NAME, choose, diagnosis_gallery, fit_gallery, misfit
from jbridge.report.figures.residual_force import running_median
from tests.report import cases


@pytest.fixture
def figures(monkeypatch):
    """Collects the figures that are saved."""
    saved = []
    original = Figure.savefig

    def keep(self, *args, **kwargs):
        saved.append(self)
        original(self, *args, **kwargs)

    monkeypatch.setattr(Figure, "savefig", keep)
    return saved


@pytest.mark.parametrize("case", ["missing_physics", pytest.param("adequate", marks=pytest.mark.slow), "cart_alone"])
def test_every_axis_has_quantity_and_unit(case, figures):
    gallery = diagnosis_gallery(getattr(cases, case)())
    assert len(figures) == len(gallery.all())
    for picture, figure in zip(gallery.all(), figures, strict=False):
        assert picture.title and picture.png.startswith(b"\x89PNG")
    unit = re.compile(r"\w.*\[.+\]", re.S)
    for figure in figures:
        for axes in figure.axes:
            across = [axes, *axes.get_shared_x_axes().get_siblings(axes)]
            assert any(unit.search(other.get_xlabel()) for other in across)
            row = axes.get_subplotspec().rowspan
            beside = [other for other in figure.axes if other.get_subplotspec().rowspan == row]
            named = any(re.search("[a-z]", label.get_text()) for label in axes.get_yticklabels())
            assert named or any(unit.search(other.get_ylabel()) for other in beside)


def test_gallery_answers_every_question():
    gallery = diagnosis_gallery(cases.brief(cases.missing_physics()))
    assert [picture.name for picture in gallery.evidence] == ["places"]
    assert [picture.name for picture in gallery.forces] == ["force-x"]
    assert list(gallery.maps) == [("position_direction_friction", "cart")]
    assert [picture.name for picture in gallery.signals][0] == "signals-holdout-holdout-1"
    names = [picture.name for picture in gallery.all()]
    assert len(set(names)) == len(names)
    assert all(OWN_NAME.fullmatch(f"{name}.png") for name in names)
    assert all(OWN_NAME.fullmatch(f"{picture.name}.png") for picture in fit_gallery(cases.brief(cases.fitted())).all())


def test_an_interval_without_an_end_does_not_flatten_a_map(figures):
    levels = Estimate([1.0, 2.0, 2.0], [0.1, 1e4, np.inf], [0.8, 0.0, 0.0], [1.2, 2e4, np.inf], "N")
    knots = Estimate([0.2, 0.7, 1.2], None, None, None, "m")
    draw_friction_map("m", "position_dependent_friction", "cart", {"knots": knots, "levels": levels})
    assert figures[0].axes[0].get_ylim() == (0.0, 8.0)


def test_worst_training_recording_is_chosen():
    train_1, train_2, holdout = cases.traces()
    good = dataclasses.replace(train_1, before=train_1.after, recording="good.csv")
    assert misfit(good, cases.NOISE) < misfit(train_2, cases.NOISE)
    assert choose([good, train_2, holdout], cases.NOISE, ()) == [holdout, train_2]
    when = [Interval("good.csv", 1.0, 2.0)]
    assert choose([good, train_2, holdout], cases.NOISE, when) == [holdout, train_2, good]


def test_running_median_finds_a_jump_at_zero_and_ignores_outliers():
    rng = np.random.default_rng(0)
    velocity = rng.uniform(-0.3, 0.5, 4000)
    force = -2.0 * np.sign(velocity)
    force[::25] = 1e4
    force[1::50] = np.nan
    centres, medians = running_median(velocity, force, jumps=True)
    seen = np.isfinite(medians)
    np.testing.assert_array_equal(medians[seen], -2.0 * np.sign(centres[seen]))
    assert np.isnan(medians[centres == 0.0]).all()


def odd_traces():
    """Recordings that a rig can give and that a careless drawing would choke on."""
    trace = cases.traces()[0]
    nothing = np.full_like(trace.times, np.nan)
    zero = np.zeros_like(trace.times)
    return {
        "never measured": dataclasses.replace(trace, measured={**trace.measured, "psi": nothing}),
        "ran away": dataclasses.replace(trace, before={**trace.before, "x": np.geomspace(1, 1e300, zero.size)}),
        "became infinite": dataclasses.replace(
            trace, before={**trace.before, "x": np.where(trace.times > 3, np.inf, 0)}
        ),
        "failed": dataclasses.replace(trace, before={"x": nothing}, after={"x": nothing}),
        "at rest": dataclasses.replace(
            trace, inputs={"u_x": zero, "u_l": zero}, measured={**trace.measured, "x": zero}, after=trace.before
        ),
        "no force": dataclasses.replace(trace, force_before={"x": nothing}, force_after={"x": nothing}),
        "no force at all": dataclasses.replace(trace, force_before={}, force_after={}),
        "a name as a formula": dataclasses.replace(trace, recording="$\\frac{" + 100 * "x" + "_^.csv"),
        "short": dataclasses.replace(
            trace,
            times=trace.times[:50],
            **{
                field: {key: values[:50] for key, values in getattr(trace, field).items()}
                for field in (
                    "inputs", "measured", "before", "after", "coordinates", "velocities", "force_before", "force_after"
                )
            },
        ),
    }  # fmt: skip


@pytest.mark.parametrize("case", odd_traces())
def test_odd_recordings_are_drawn(case):
    trace = odd_traces()[case]
    location = Location(
        "cart",
        "cart",
        {"cart": 1.0},
        (Region("time_since_reversal", 0.0, 0.1, 0.5), Region("psi", -0.1, 0.1, 0.4), Region("t", 0.0, 1.0, 0.2)),
        (Interval(trace.recording, 1.0, 2.0),),
        (cases.missing_force(trace),),
        cases.LIKENESS,
    )
    diagnosis = dataclasses.replace(cases.missing_physics(), traces=(trace,), location=location, noise={"x": 0.0})
    for picture in diagnosis_gallery(diagnosis).all():
        assert picture.png.startswith(b"\x89PNG")


def test_nothing_to_draw_is_no_picture():
    empty = dataclasses.replace(
        cases.adequate(),
        traces=(),
        horizons=(),
        holdout_before=dataclasses.replace(cases.adequate().holdout_before, free_run={}, window={}),
    )
    assert diagnosis_gallery(empty).all() == ()
