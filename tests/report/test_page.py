"""The interactive part of a report: its numbers, and what draws them."""

import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from jbridge.report.diagnosis.page import diagnosis_page
from jbridge.report.figures.gallery import Gallery
from jbridge.report.interactive import MOST_POINTS, report_data
from tests.report import cases

ASSETS = Path(cases.__file__).parents[2] / "jbridge/report/assets"


def numbers(page):
    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    (text,) = re.findall(r'<script type="application/json" id="report-data">(.*?)</script>', page, flags=re.S)
    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("case", ["missing_physics", "adequate", "unknown", "cart_alone"])
def test_every_curve_is_finite_and_short(case):
    data = report_data(getattr(cases, case)())
    assert data["recordings"]
    for run in data["recordings"]:
        assert 0 < len(run["t"]) <= MOST_POINTS
        for panel in run["panels"]:
            assert all(len(curve["values"]) == len(run["t"]) for curve in panel["curves"])


def test_a_run_that_goes_astray_leaves_a_gap():
    trace = cases.traces()[2]
    astray = dataclasses.replace(trace, before={**trace.before, "x": np.full(trace.times.size, np.inf)})
    data = report_data(dataclasses.replace(cases.missing_physics(), traces=(astray,)))
    (panel,) = (panel for panel in data["recordings"][0]["panels"] if panel.get("channel") == "x")
    assert set(panel["curves"][1]["values"]) == {None}
    (whole,) = report_data(cases.brief(cases.missing_physics()))["recordings"]
    # It leaves the scene of the replay, which stays as large as the rig's own motion asks for.
    scene, usual = data["recordings"][0]["scene"], whole["scene"]
    assert scene["right"] - scene["left"] < 2.01 * (usual["right"] - usual["left"])


def test_a_name_cannot_end_the_numbers():
    trace = dataclasses.replace(cases.traces()[2], recording=cases.HOSTILE)
    data = numbers(diagnosis_page(dataclasses.replace(cases.missing_physics(), traces=(trace,)), Gallery()))
    assert data["recordings"][0]["name"].startswith(cases.HOSTILE)


def test_the_plot_library_is_the_one_of_the_notice():
    """uPlot 1.6.32 as npm publishes it."""
    digest = hashlib.sha256((ASSETS / "uplot.min.js").read_bytes()).hexdigest()
    assert digest == "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f"
    assert "uPlot 1.6.32" in (ASSETS / "NOTICE").read_text(encoding="utf-8")
