"""The interactive part of a report: its numbers, its size, and how it behaves in a browser."""

import dataclasses
import hashlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from jbridge.report.diagnosis.page import diagnosis_page
from jbridge.report.figures.gallery import Gallery
from jbridge.report.interactive import MOST_POINTS, report_data
from tests import report_cases as cases

ASSETS = Path(cases.__file__).parents[1] / "jbridge/report/assets"
HOSTILE = '</script><script>document.title = "taken"</script>.csv'


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
    assert set(data["recordings"][0]["motion"]["before"]["x"]) == {None}


def test_a_name_cannot_end_the_numbers():
    trace = dataclasses.replace(cases.traces()[2], recording=HOSTILE)
    data = numbers(diagnosis_page(dataclasses.replace(cases.missing_physics(), traces=(trace,)), Gallery()))
    assert data["recordings"][0]["name"].startswith(HOSTILE)


def test_the_plot_library_is_the_one_of_the_notice():
    """uPlot 1.6.32 as npm publishes it."""
    digest = hashlib.sha256((ASSETS / "uplot.min.js").read_bytes()).hexdigest()
    assert digest == "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f"
    assert "uPlot 1.6.32" in (ASSETS / "NOTICE").read_text(encoding="utf-8")


@pytest.mark.slow
def test_in_a_browser(tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install playwright")
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    trace = dataclasses.replace(cases.traces()[2], recording=HOSTILE)
    page_file = tmp_path / "report.html"
    shown = dataclasses.replace(cases.missing_physics(), traces=(*cases.traces()[:2], trace))
    page_file.write_text(diagnosis_page(shown, Gallery()), encoding="utf-8")
    assert page_file.stat().st_size < 3_000_000
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1100, "height": 800})
        complaints = []
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(page_file.as_uri())
        assert page.locator("#panels .uplot").count() == 5
        assert "taken" not in page.title()
        assert HOSTILE in page.locator("#recording").inner_text()

        page.keyboard.press("k")
        page.wait_for_timeout(600)
        page.keyboard.press("k")
        assert float(page.locator("#clock").inner_text().removesuffix(" s")) > 0.1

        before = page.locator("#panels .uplot canvas").last.screenshot()
        plot = page.locator("#panels .u-over").first
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        page.mouse.move(box["x"] + 100, box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + 300, box["y"] + 60, steps=5)
        page.mouse.up()
        page.wait_for_timeout(200)
        assert page.locator("#panels .uplot canvas").last.screenshot() != before

        page.set_viewport_size({"width": 380, "height": 800})
        page.wait_for_timeout(200)
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 720, "height": 1000})
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert page.pdf(format="A4").startswith(b"%PDF")
        browser.close()
    assert complaints == []
