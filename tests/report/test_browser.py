"""Pages in a real browser: they run without a complaint, move, zoom, print, and never run what a file says."""

import base64
import dataclasses
import io
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from jbridge import Recording, save_fit, save_report
from jbridge.recordings import Inspection
from jbridge.report.check import save_check
from jbridge.report.control.tracking import _HEAD
from jbridge.report.diagnosis.page import diagnosis_page
from jbridge.report.figures.gallery import Gallery, diagnosis_signals
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
# What stands below each panel: a list of texts.
VALUES = """[...document.querySelectorAll('#panels .u-legend')].map(
  (legend) => [...legend.querySelectorAll('.u-value')].map((value) => value.textContent))"""
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
    shown.keyboard.press("K")  # as with caps lock
    stopped = clock.inner_text()
    assert float(stopped.removesuffix(" s")) > 0.2
    assert shown.evaluate(scene) != at_rest
    shown.locator("#speed").press("k")  # a letter that looks for an entry of the list
    shown.wait_for_timeout(200)
    assert clock.inner_text() == stopped


def test_the_values_of_the_moment_stand_below_all_curves(opened, report):
    shown = opened(report)
    shown.locator("#time").fill("5")
    moment = shown.evaluate(VALUES)
    assert {values[0] for values in moment} == {"5"}
    assert "–" not in sum(moment, [])  # the angle's sensor is slower
    (_, recorded, before, _), (_, residual, _) = ([float(value) for value in values] for values in moment[:2])
    assert abs(residual - 1e3 * (recorded - before)) < 0.2  # [mm]; values have four digits
    plot = shown.locator("#panels .u-over").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()

    def pointed(x):
        shown.mouse.move(box["x"] + x, box["y"] + 60)
        shown.wait_for_timeout(100)
        return shown.evaluate(VALUES)

    assert pointed(500) != moment
    assert pointed(-50) == moment
    pointed(100)
    shown.mouse.down()
    pointed(200)
    shown.mouse.up()
    shown.wait_for_timeout(100)
    assert pointed(-50) == moment  # which is out of view now
    shown.keyboard.press("r")
    shown.wait_for_timeout(100)
    assert shown.evaluate(VALUES) == moment


def run_of(**measured):
    """A recording of some channels, met by its simulation at once."""
    times = np.linspace(0.0, 2.0, 101)
    channels = {name: values(times) for name, values in measured.items()}
    coordinates = {"x": 0.0 * times, "psi": 0.0 * times, "l": 0.38 + 0.0 * times, **channels}
    shown = {"measured": channels, "before": channels, "after": channels, "coordinates": coordinates}
    return dataclasses.replace(cases.traces()[2], times=times, inputs={}, **shown)


MOTIONS = {
    "hoist alone": run_of(l=lambda t: 0.6 + 0.2 * np.sin(3 * t)),
    "pendulum that swings over the top": run_of(psi=lambda t: np.pi * t),
    "crane": run_of(x=lambda t: 0.4 * t, psi=lambda t: np.sin(4 * t), l=lambda t: 0.8 - 0.3 * np.sin(t)),
}


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_whole_motion_is_seen_in_either_half(opened, tmp_path, motion):
    (tmp_path / "report.html").write_text(
        diagnosis_page(dataclasses.replace(cases.missing_physics(), traces=(MOTIONS[motion],)), Gallery())
    )
    shown, seen = opened(tmp_path / "report.html"), set()
    for moment in np.linspace(0.0, 2.0, 9):
        shown.locator("#time").fill(str(moment))
        scene = shown.evaluate("document.getElementById('rig').toDataURL()")
        seen.add(scene)
        whole = Image.open(io.BytesIO(base64.b64decode(scene.partition(",")[2]))).getchannel("A")
        for ink in np.split(np.array(whole)[22:] > 0, 2, axis=1):  # below the titles
            # Nothing touches an edge of its half, and rail, cart (280 pixels) and load (150) are all there.
            assert not ink[0].any() and not ink[-4:].any() and not ink[:, :4].any() and not ink[:, -4:].any()
            assert ink.sum() > 2 * (ink.shape[1] - 20) + 280 + 120
    assert len(seen) > 4


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


@pytest.mark.parametrize("how", ["finger", "keys"])
def test_zoom_needs_no_mouse(opened, report, how):
    shown = opened(report, has_touch=True)
    whole = shown.evaluate(CURVES)
    plot = shown.locator("#panels .u-over").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    if how == "finger":
        device = shown.context.new_cdp_session(shown)
        for kind, x in (("touchStart", 100), ("touchMove", 150), ("touchMove", 300), ("touchEnd", None)):
            points = [] if x is None else [{"x": box["x"] + x, "y": box["y"] + 60}]
            device.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    else:
        shown.keyboard.press("+")
    shown.wait_for_timeout(200)
    assert all(before != after for before, after in zip(whole, shown.evaluate(CURVES), strict=True))
    shown.keyboard.press("r" if how == "finger" else "-")
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


def test_it_is_dark_where_that_is_asked_for(opened, tmp_path):
    drawn = Gallery(improvement=(diagnosis_signals(cases.brief(cases.cart_alone())),))
    (tmp_path / "report.html").write_text(diagnosis_page(cases.cart_alone(), drawn))

    def colours(scheme):
        shown = opened(tmp_path / "report.html", color_scheme=scheme)
        picture = Image.open(io.BytesIO(shown.locator("figure img").screenshot())).convert("L")
        return shown.evaluate("getComputedStyle(document.body).backgroundColor"), np.median(picture)

    (light, white), (dark, black) = colours("light"), colours("dark")
    assert light == "rgb(244, 245, 247)" and dark == "rgb(18, 22, 26)"
    assert white > 250 and black < 40


def test_the_first_screen_answers(opened, report):
    shown = opened(report)
    for question in ("What is missing", "Where", "How sure", "How much better", "What remains", "What to do next"):
        asked = shown.locator("dt", has_text=question)
        box = asked.bounding_box()
        assert box["y"] + box["height"] < 800 and asked.locator("xpath=following-sibling::dd").inner_text()
