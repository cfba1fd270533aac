"""Pages in a real browser: they run without a complaint, move, zoom, print, and never run what a file says."""

import dataclasses
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from jbridge import Recording, save_fit, save_report
from jbridge.recordings import Inspection
from jbridge.report.check import save_check
from jbridge.report.control.tracking import _HEAD
from jbridge.report.diagnosis.page import diagnosis_page
from jbridge.report.figures.gallery import Gallery
from jbridge.report.text.html import page
from jbridge.report.text.tables import Table
from tests.report import cases

PAPER = 680
"""Width between the margins of A4 [CSS pixels]."""
# Elements whose edge lies beyond the page's, and tables that would have to be scrolled.
CUT = """() => {
  const edge = document.querySelector("main").getBoundingClientRect().right + 1;
  const every = [...document.querySelectorAll("main *")].filter((node) => node.getClientRects().length);
  const out = every.filter((node) => node.getBoundingClientRect().right > edge && !node.closest(".wide, #interactive"));
  const wide = [...document.querySelectorAll(".wide")].filter((node) => node.scrollWidth > node.clientWidth + 1);
  const said = (nodes) => nodes.map((node) => node.outerHTML.slice(0, 200));
  return { out: said(out), wide: said(wide) };
}"""
# Whether what lies below each heading that folds is to be seen.
FOLDED = "[...document.querySelectorAll('details > :not(summary)')].map((node) => node.checkVisibility())"
# What is drawn on each panel; the cursor, which follows the mouse in all of them, is none of it.
CURVES = "[...document.querySelectorAll('#panels canvas')].map((panel) => panel.toDataURL())"


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install playwright")
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with sync_api.sync_playwright() as started:
        found = started.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def opened(browser, tmp_path):
    """Opens a file; in the end no page may have complained."""
    complaints = []

    def open_page(path, **options):
        shown = browser.new_page(viewport={"width": 1100, "height": 800}, **options)
        shown.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
        shown.on("pageerror", lambda error: complaints.append(str(error)))
        shown.on("request", lambda asked: None if asked.url[:5] in ("file:", "data:") else complaints.append(asked.url))
        shown.goto(path.as_uri())
        return shown

    yield open_page
    assert complaints == []


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(diagnosis_page(dataclasses.replace(cases.missing_physics(), traces=cases.traces()[1:]), Gallery()))
    return path


def checked(folder):
    times = np.arange(400) * 0.01
    made = Recording.from_arrays(t=times, u_x=np.sin(times), x=0.4 + 0.1 * np.sin(times))
    problem = f"{cases.HOSTILE}: write {'x' * 150}"
    return save_check(folder, [Inspection("a.csv", made, {}, {}, (problem,))], f"1 PROBLEM\n- {problem}\n")


def controlled(folder):
    """The widest table of all pages, with its widest entries."""
    moves = Table(_HEAD, [("3", "0.333, 0.333", "not within the time, not within the time", *["123.45, 123.45"] * 7)])
    tracking = SimpleNamespace(moves=[None], times=[12.0])
    (folder / "control.html").write_text(page("control.html", tracking=tracking, moves=moves, remarks=[], pictures=[]))
    return folder / "control.html"


def hostile(folder):
    (folder / "report.html").write_text(diagnosis_page(cases.hostile(), Gallery()))
    return folder / "report.html"


PAGES = {
    "diagnosis": lambda folder: save_report(folder, cases.brief(cases.missing_physics())),
    "hostile diagnosis": hostile,
    "fit": lambda folder: save_fit(folder, cases.brief(cases.fitted())),
    "check": checked,
    "control": controlled,
}


@pytest.mark.parametrize("kind", PAGES)
def test_nothing_is_cut_off(opened, tmp_path, kind):
    path = PAGES[kind](tmp_path)
    assert path.stat().st_size < 3_000_000
    shown = opened(path)
    assert "taken" not in shown.title()
    if "hostile" in kind or kind == "check":
        assert cases.HOSTILE in shown.locator("main").inner_text()
    for width in (1100, 380):
        shown.set_viewport_size({"width": width, "height": 800})
        shown.wait_for_timeout(100)
        assert shown.evaluate("document.documentElement.scrollWidth") <= width
        assert shown.evaluate(CUT)["out"] == []
    shown.set_viewport_size({"width": PAPER, "height": 1000})
    assert not any(shown.evaluate(FOLDED))
    shown.emulate_media(media="print")
    assert all(shown.evaluate(FOLDED))
    assert shown.evaluate(CUT) == {"out": [], "wide": []}
    assert shown.pdf(format="A4").startswith(b"%PDF")


def test_the_replay_advances_and_stops(opened, report):
    shown = opened(report)
    clock = shown.locator("#clock")
    scene = "document.getElementById('rig').toDataURL()"
    at_rest = shown.evaluate(scene)
    shown.keyboard.press("k")
    shown.wait_for_timeout(700)
    shown.keyboard.press("k")
    stopped = clock.inner_text()
    assert float(stopped.removesuffix(" s")) > 0.2
    assert shown.evaluate(scene) != at_rest
    shown.wait_for_timeout(200)
    assert clock.inner_text() == stopped
    # The values of the moment stand below the curves.
    assert abs(float(shown.locator("#panels .u-value").first.inner_text()) - float(stopped.removesuffix(" s"))) < 0.1


def test_zoom_is_linked(opened, report):
    shown = opened(report)
    whole = shown.evaluate(CURVES)
    assert len(whole) == 8  # three channels, what simulation leaves of each, and two inputs
    plot = shown.locator("#panels .u-over").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    shown.mouse.move(box["x"] + 100, box["y"] + 60)
    shown.wait_for_timeout(100)
    assert shown.evaluate(CURVES) == whole
    shown.mouse.down()
    shown.mouse.move(box["x"] + 300, box["y"] + 60, steps=5)
    shown.mouse.up()
    shown.wait_for_timeout(200)
    assert all(before != after for before, after in zip(whole, shown.evaluate(CURVES), strict=True))
    shown.keyboard.press("r")
    shown.wait_for_timeout(200)
    assert shown.evaluate(CURVES) == whole


def test_the_slider_goes_from_before_to_after(opened, report):
    shown = opened(report)
    seen = set()
    for share in ("0", "50", "100"):
        shown.locator("#blend").fill(share)
        shown.wait_for_timeout(100)
        seen.add(shown.evaluate(CURVES)[0])
    assert len(seen) == 3


def test_another_recording_is_chosen(opened, report):
    shown = opened(report)
    first = shown.evaluate(CURVES)
    shown.locator("#recording").select_option("1")
    shown.wait_for_timeout(100)
    assert shown.evaluate(CURVES) != first


def test_it_is_dark_where_that_is_asked_for(opened, report):
    def ground(scheme):
        shown = opened(report, color_scheme=scheme)
        return shown.evaluate("getComputedStyle(document.body).backgroundColor")

    light, dark = ground("light"), ground("dark")
    assert light == "rgb(244, 245, 247)" and dark == "rgb(18, 22, 26)"


def test_the_first_screen_answers(opened, report):
    shown = opened(report)
    for question in ("What is missing", "Where", "How sure", "How much better", "What remains", "What to do next"):
        asked = shown.locator("dt", has_text=question)
        box = asked.bounding_box()
        assert box["y"] + box["height"] < 800 and asked.locator("xpath=following-sibling::dd").inner_text()
