"""Reports: complete for programs, honest about what is not known, safe to open, whole on disk."""

import base64
import dataclasses
import hashlib
import html
import json
import math
import os
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from jbridge import InputError, describe_diagnosis, describe_fit, load_model, save_fit, save_report
from jbridge.identification.result import Estimate
from jbridge.model.files import Model
from jbridge.report import save as saving
from jbridge.report.as_json import fit_json, report_json
from jbridge.report.diagnosis.page import diagnosis_page
from jbridge.report.figures.gallery import Gallery, diagnosis_gallery
from jbridge.report.files import check_output, write_text
from jbridge.report.text.quantities import shown, shown_entries
from jbridge.report.text.rows import error_rows, parts
from jbridge.report.text.tables import Table
from tests.report import cases

VERDICTS = ["missing_physics", "adequate", "unknown"]
KEYS = {
    "schema", "verdict", "statement", "adequacy", "location", "effects", "model_effects", "fit", "next_experiment",
    "bridge", "settings", "seconds", "trials", "warnings", "notes", "not_seen", "continued", "missing_force",
    "holdout", "complete", "explained", "stopped",
}  # fmt: skip


@pytest.fixture
def no_figures(monkeypatch):
    """Reports without their pictures, which take most of the time."""
    monkeypatch.setattr(saving, "diagnosis_gallery", lambda diagnosis: Gallery())
    monkeypatch.setattr(saving, "fit_gallery", lambda fit: Gallery())


def no_constant(name):
    raise AssertionError(f"{name} is not JSON")


def parsed(text):
    return json.loads(text, parse_constant=no_constant)


@pytest.mark.parametrize("case", VERDICTS)
def test_report_has_every_key(case):
    report = parsed(report_json(getattr(cases, case)()))
    assert report.keys() >= KEYS
    assert report["schema"] == 1
    assert report["verdict"] == case
    assert report["adequacy"].keys() == {"alarm", "repeatable", "channels"}
    assert report["adequacy"]["repeatable"].keys() == {"before", "after"}
    for channel in report["adequacy"]["channels"].values():
        assert channel.keys() == {"rmse", "noise", "ratio"}
    assert report["location"].keys() == {"site", "equation", "sites", "where", "when"}
    for effect in report["effects"] + report["model_effects"]:
        assert effect.keys() == {
            "kind", "site", "probability", "status", "explained", "in_model", "recording", "parameters", "equivalents",
            "statement",
        }  # fmt: skip
        for estimate in effect["parameters"].values():
            assert estimate.keys() == {"value", "std", "low", "high", "unit"}
        for rival in effect["equivalents"]:
            assert rival.keys() == {"kind", "site", "probability", "parameters", "holdout"}
    for estimate in report["bridge"].values():
        assert estimate.keys() == {"value", "std", "low", "high", "unit"}
    for row in report["not_seen"]:
        assert row.keys() == {"kind", "site", "parameter", "limit", "unit", "change", "notable", "statement"}
    fit = report["fit"]
    assert fit["train"].keys() == fit["holdout"].keys() == fit["window"]["holdout"].keys() == {"before", "after"}
    assert fit["window"]["seconds"] == 2.0
    assert fit["noise"] == cases.NOISE
    assert [row["seconds"] for row in fit["horizons"]] == [0.1, 0.3, 1.0, 2.0, 3.0]
    for row in fit["horizons"]:
        assert row["holdout"].keys() == row["typical"].keys() == {"before", "after"}
        assert row["scatter"].keys() == cases.NOISE.keys()


def test_report_tells_what_the_missing_force_is_like():
    assert parsed(report_json(cases.adequate()))["missing_force"] is None
    likeness = parsed(report_json(cases.unknown()))["missing_force"]["likeness"]
    assert likeness["by"]["v_psi"] == 0.62 and likeness["odd"] == 0.94 and likeness["period"] is None


def test_page_tells_what_the_missing_force_is_like():
    page = diagnosis_page(cases.unknown(), diagnosis_gallery(cases.unknown()))
    assert cases.LIKENESS.statement in page and "Missing force on the cart" in page
    assert "Missing force" not in diagnosis_page(cases.adequate(), Gallery())


def test_report_keeps_numbers_in_si():
    report = parsed(report_json(cases.missing_physics()))
    assert report["fit"]["holdout"]["before"] == {"x": 0.0257, "psi": 0.034, "l": 6.2e-5}
    assert report["location"]["where"][1] == {"variable": "v_x", "low": -0.05, "high": 0.05, "share": 0.48}
    assert report["effects"][1]["parameters"]["knots"]["value"] == cases.KNOTS
    experiment = report["next_experiment"]
    assert experiment["input"] == "next_experiment.csv" and experiment["expected_wrong"] == 0.013
    assert experiment["start"] == {"x": 0.75, "psi": 0.0, "l": 0.6}
    assert report["not_seen"][1]["limit"] == 0.02 and report["not_seen"][0]["limit"] is None
    assert [row["kind"] for row in report["continued"]["before"]] == ["dead_zone", "stribeck_friction"]


def test_unknown_numbers_are_null():
    report = parsed(report_json(cases.adequate()))
    assert report["explained"] == {"all": None}
    assert report["location"]["site"] is None
    assert report["adequacy"]["repeatable"] == {"before": None, "after": None}
    assert report["adequacy"]["channels"]["psi"]["ratio"] is None  # its noise is zero
    assert report["bridge"]["hoist_gain"]["std"] is None
    assert report["next_experiment"] is None
    unknown = parsed(report_json(cases.unknown()))
    assert unknown["fit"]["holdout"]["after"]["psi"] is None
    assert unknown["fit"]["window"]["holdout"]["after"]["x"] is None
    assert unknown["trials"][2]["gain"] is None


def test_a_vector_keeps_its_length_around_an_unknown_entry():
    report = parsed(report_json(cases.missing_physics()))
    negative = report["effects"][1]["parameters"]["negative"]
    assert negative["std"] == [0.1] * 7 + [None]


def test_the_same_diagnosis_gives_the_same_files(tmp_path):
    for folder in ("a", "b"):
        save_report(tmp_path / folder, cases.brief(cases.cart_alone()))
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert {str(path) for path in files} >= {"report.json", "report.html", "model.toml", "next_experiment.csv"}
    for path in files:
        assert (tmp_path / "a" / path).read_bytes() == (tmp_path / "b" / path).read_bytes(), path


def test_fit_json_sorts_parameters_by_owner():
    document = parsed(fit_json(cases.fitted()))
    assert document["bridge"].keys() == cases.BRIDGE.keys()
    assert [(effect["kind"], effect["site"]) for effect in document["model_effects"]] == [
        ("coulomb_friction", "cart"),
        ("dead_zone", "cart_drive"),
        ("position_direction_friction", "cart"),
    ]
    assert document["model_effects"][1]["parameters"].keys() == {"positive", "negative"}
    assert parsed(fit_json(cases.fitted(holdout=False)))["fit"]["holdout"] is None


def test_a_second_effect_of_a_kind_keeps_its_own_parameters():
    level = Estimate(1.0, 0.1, 0.8, 1.2, "N")
    fit = dataclasses.replace(
        cases.fitted(),
        estimates={"coulomb_friction@cart.level": level, "coulomb_friction@cart#2.level": level},
    )
    assert [(part.kind, part.site) for part in parts(fit)][1:] == [("coulomb_friction", "cart")] * 2


class Elements(HTMLParser):
    """Tags of a page, with their attributes."""

    def __init__(self, text):
        super().__init__()
        self.found, self.open = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in ("img", "input", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_text_from_files_is_escaped(tmp_path):
    page = save_report(tmp_path, cases.hostile()).read_text(encoding="utf-8")
    # Of scripts there are the page's own three: its numbers, the plots and what joins them.
    assert len(re.findall(r"<script\b", page)) == page.count("</script>") == 3
    assert cases.HOSTILE not in page
    assert page.count("&lt;script&gt;") > 10


@pytest.mark.parametrize("case", [*VERDICTS, "cart_alone"])
def test_page_is_whole_and_needs_nothing_from_outside(case):
    diagnosis = getattr(cases, case)()
    text = diagnosis_page(diagnosis, Gallery())
    elements = Elements(text)
    assert elements.open == []
    tags = [tag for tag, _ in elements.found]
    assert not {"link", "iframe"} & set(tags)
    assert [attrs for tag, attrs in elements.found if tag == "script" and "src" in attrs] == []
    assert not re.search(r"(src|href)=\"(?!data:)|url\(|@import", text)
    assert tags.index("h1") < tags.index("h2")  # the verdict comes first
    assert diagnosis.statement in html.unescape(text).replace("\u00a0", " ")
    assert "nan" not in re.sub(r"<(style|script)\b.*?</\1>", "", text, flags=re.S).lower().split()


def test_a_page_obeys_its_own_policy(tmp_path):
    """Nothing but its own style sheet and pictures within it is let in (Content Security Policy Level 3)."""
    text = save_report(tmp_path, cases.brief(cases.hostile())).read_text(encoding="utf-8")
    found = Elements(text).found
    policy = next(attrs["content"] for tag, attrs in found if attrs.get("http-equiv") == "Content-Security-Policy")
    allowed = dict(directive.strip().split(" ", 1) for directive in policy.split(";"))
    assert allowed.keys() == {"default-src", "img-src", "style-src", "script-src", "base-uri", "form-action"}
    assert allowed["default-src"] == allowed["base-uri"] == allowed["form-action"] == "'none'"
    (style,) = re.findall(r"<style>(.*?)</style>", text, flags=re.S)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    scripts = re.findall(r"<script>(.*?)</script>", text, flags=re.S)
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert len(digests) == 2
    assert allowed["script-src"] == " ".join(f"'sha256-{digest}'" for digest in digests)
    assert allowed["style-src"] == f"'sha256-{digest}'" and allowed["img-src"] == "data:"
    assert [tag for tag, _ in found].index("meta") < [tag for tag, _ in found].index("style")
    assert all(attrs["src"].startswith("data:") for tag, attrs in found if tag == "img")
    assert [attrs for _, attrs in found if "style" in attrs or any(name.startswith("on") for name in attrs)] == []


def test_pictures_are_part_of_the_page(tmp_path):
    page = save_report(tmp_path, cases.brief(cases.missing_physics()))
    images = [attributes for tag, attributes in Elements(page.read_text(encoding="utf-8")).found if tag == "img"]
    assert len(images) == len(list((tmp_path / "figures").glob("*.png")))
    assert all(image["src"].startswith("data:image/png;base64,") and image["alt"] for image in images)


@pytest.mark.slow
def test_a_page_of_many_long_recordings_can_be_mailed(tmp_path):
    """Noise, which no compression makes small, on every channel of three times as many rows as a screen shows."""
    rng, (given, *_) = np.random.default_rng(0), cases.traces()
    times, fields = (
        np.arange(6_000) * 5e-3,
        [f.name for f in dataclasses.fields(given) if f.name not in "recording role"],
    )

    def noisy(values):
        return np.resize(values[np.isfinite(values)], times.size) + 0.1 * rng.standard_normal(times.size)

    long = [
        dataclasses.replace(
            given,
            recording=f"run-{number}.csv",
            role="train" if number < 3 else "holdout",
            times=times,
            **{f: {key: noisy(values) for key, values in getattr(given, f).items()} for f in fields if f != "times"},
        )
        for number in range(8)
    ]
    page = save_report(tmp_path, dataclasses.replace(cases.unknown(), traces=tuple(long)))
    assert page.stat().st_size < 3_000_000


def test_saved_model_is_read_back(tmp_path, no_figures):
    save_report(tmp_path, cases.missing_physics())
    model = load_model(tmp_path / "model.toml")
    assert isinstance(model, Model)
    assert [effect.kind for effect in model.plant.effects] == ["coulomb_friction", "dead_zone"]
    assert model.uncertainty["cart_gain"]["std"] == 0.11


def test_next_experiment_can_be_played(tmp_path, no_figures):
    save_report(tmp_path, cases.missing_physics())
    header, *rows = (tmp_path / "next_experiment.csv").read_text().splitlines()
    assert header == "t,u_x,u_l"
    assert len(rows) == 200


def test_what_is_left_open_is_shown_and_said():
    """Limits, the next experiment and what a new recording decided, on the page and in the terminal."""
    full = cases.missing_physics()
    page = diagnosis_page(full, Gallery())
    for heading in ("What these recordings could not have shown", "What to record next", "What the new recordings"):
        assert heading in page
    assert "Could not have been seen: no place is known." in page and "1 limits that" not in page
    assert "wrong decision with it: 1 %" in page and "1 of 2 explanations is left" in page
    text = " ".join(describe_diagnosis(full).split())
    # What is practically nothing is left to the page.
    assert "sensor offset, cart position sensor; load drag, swing (up to 0.020 N s²/m²)" in text
    assert "backlash" not in text.split("Unseen")[1].split("Record next")[0]
    assert "Continued With next-1.csv" in text and "Expected chance of a wrong decision: 1 %" in text
    plain = dataclasses.replace(full, not_seen=(), next_experiment=None, continued=None)
    page, text = diagnosis_page(plain, Gallery()), describe_diagnosis(plain)
    assert "could not have shown" not in page and "new recordings have decided" not in page
    assert "Unseen" not in text and "Continued" not in text and "Record next" not in text


def test_the_first_screen_hides_no_contradiction():
    """An effect that most windows confirm, though the sum of squares shows none of it; a channel that is met worse."""
    full = cases.missing_physics()
    (dead, friction), (before, after) = full.effects, (full.holdout_before, full.holdout_after)
    worse = dataclasses.replace(after, free_run={**after.free_run, "psi": 2.0 * before.free_run["psi"]})
    page = diagnosis_page(dataclasses.replace(full, holdout_after=worse), Gallery())
    assert "worse in swing angle psi: 1.95° to 3.90°" in page and "worse in" not in diagnosis_page(full, Gallery())
    for share, said in (
        (0.4, "dead zone, cart drive: confirmed by the hold-out, probability 97 %"),
        (
            -0.4,
            "cart drive: confirmed by most windows of the hold-out, though not by those with the largest errors, prob",
        ),
    ):
        effects = (dataclasses.replace(dead, explained=share), friction)
        page = diagnosis_page(dataclasses.replace(full, effects=effects), Gallery()).replace("\u00a0", " ")
        assert said in page and "-40 %" not in page


def test_what_an_earlier_report_left_is_removed_and_nothing_else(tmp_path):
    save_report(tmp_path, cases.brief(cases.cart_alone()))
    mine = tmp_path / "figures" / "fit-of-mine.png"
    mine.write_bytes(b"mine")
    save_report(tmp_path, cases.brief(cases.adequate()))
    assert not (tmp_path / "next_experiment.csv").exists()
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert "places.png" not in names
    assert "force-psi.png" in names
    assert mine.read_bytes() == b"mine"


def test_a_file_is_replaced_at_once_or_not_at_all(tmp_path, monkeypatch):
    target = tmp_path / "report.json"
    write_text(target, "old")

    def fails(source, destination):
        assert (tmp_path / os.path.basename(source)).read_text() == "new"  # written beside it, in full
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(InputError, match="report.json: cannot be written .No space left"):
        write_text(target, "new")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_an_interrupted_report_leaves_whole_files(tmp_path, monkeypatch):
    def interrupt(diagnosis):
        raise KeyboardInterrupt

    monkeypatch.setattr(saving, "diagnosis_gallery", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_report(tmp_path, cases.missing_physics())
    assert parsed((tmp_path / "report.json").read_text())["verdict"] == "missing_physics"
    load_model(tmp_path / "model.toml")


def test_output_is_checked_without_writing(tmp_path):
    check_output(tmp_path / "new" / "deeper", folder=True)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: a file, where the folder"):
        check_output(tmp_path / "file", folder=True)
    with pytest.raises(InputError, match="file is a file, not a folder"):
        check_output(tmp_path / "file" / "out", folder=True)
    with pytest.raises(InputError, match="a folder, where a file belongs"):
        check_output(tmp_path, folder=False)
    with pytest.raises(InputError, match="cannot be written"):
        check_output("bad\0name", folder=True)


def test_a_read_only_folder_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may write anywhere
    with pytest.raises(InputError, match="cannot be written to; choose another --out"):
        check_output(tmp_path / "out", folder=True)


def test_what_is_read_is_not_replaced(tmp_path):
    with pytest.raises(InputError, match="model.toml: the results would replace this file"):
        check_output(tmp_path, folder=True, inputs=[tmp_path / "train-1.csv", tmp_path / "model.toml"])
    with pytest.raises(InputError, match="would replace"):
        check_output(tmp_path / "a.csv", folder=False, inputs=[tmp_path / "sub" / ".." / "a.csv"])


def test_terminal_tells_the_same_as_the_page(tmp_path):
    text = describe_diagnosis(cases.missing_physics(), tmp_path)
    for part in (
        "MISSING PHYSICS IS IDENTIFIED",
        "cart drive (cart equation), 93 % of the criterion's gain",
        "dead zone, cart drive, confirmed, probability 97 %",
        "0.301 V   (95 %: 0.280 to 0.322)",
        "cannot be told from: Stribeck friction, cart, probability 2 %",
        "25.7 mm (514 ×)",
        "0.028° (1.1 ×)",
        "-50 and 50 mm/s",
        str(tmp_path / "report.html"),
    ):
        assert " ".join(part.split()) in " ".join(text.split())
    assert max(len(line) for line in text.splitlines() if str(tmp_path) not in line) <= 80
    assert max(len(line) for line in text.splitlines() if str(tmp_path) not in line) <= 92


@pytest.mark.parametrize("case", [*VERDICTS, "cart_alone"])
def test_terminal_copes_with_what_is_not_known(case):
    text = describe_diagnosis(getattr(cases, case)())
    assert not re.search(r"\bnan\b|\binf\b|None", text)


def test_terminal_shows_the_fitted_numbers(tmp_path):
    text = describe_fit(cases.fitted(), tmp_path)
    assert "cart_gain      16.04 N/V   (95 %: 15.82 to 16.26)" in text
    assert "gravity        9.81 m/s²   (known)" in text
    assert "Hold-out" not in describe_fit(cases.fitted(holdout=False))
    unmet = describe_fit(dataclasses.replace(cases.fitted(), over_foreseen=2.0))
    assert "jbridge diagnose" in unmet and "jbridge diagnose" not in text


def test_fit_is_saved(tmp_path):
    page = save_fit(tmp_path, cases.brief(cases.fitted()))
    assert Elements(page.read_text(encoding="utf-8")).open == []
    assert parsed((tmp_path / "fit.json").read_text())["seconds"] == 7.9
    assert load_model(tmp_path / "model.toml").known == cases.model().known
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert {"signals-holdout-holdout-1.png", "friction-map-position-direction-friction-cart.png"} <= names


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(0.0123, 0.0004, 0.0115, 0.0131, "m"), "12.30 mm (95 %: 11.50 to 13.10)"),
        (Estimate(0.8, 0.0123, 0.776, 0.824, "m"), "0.800 m (95 %: 0.776 to 0.824)"),
        (Estimate(math.pi / 2, 0.01, 1.55, 1.59, "rad"), "90.00° (95 %: 88.81 to 91.10)"),
        (Estimate(0.06, 0.001, 0.058, 0.062, "s"), "60.0 ms (95 %: 58.0 to 62.0)"),
        (Estimate(12345.6, 210.0, 11934.0, 12757.0, "N/m"), "12346 N/m (95 %: 11934 to 12757)"),
        (Estimate(1.02, math.nan, None, None, "1"), "1.02"),
        (Estimate(math.nan, None, None, None, "N"), "– N"),
        (Estimate(0.3, 0.02, -math.inf, 0.34, "N s^2/m^2"), "0.300 N s²/m²"),
        (Estimate(0.3, math.inf, 0.0, math.inf, "N"), "0.3 N"),
    ],
)
def test_estimates_have_the_digits_that_they_deserve(estimate, text):
    assert shown(estimate).text == text


def test_entries_of_a_vector_share_unit_and_digits():
    entries = shown_entries(Estimate([0.001, 0.05], [1e-4, 1e-3], [0.0008, math.nan], [0.0012, 0.052], "m"))
    assert [(entry.value, entry.interval, entry.unit) for entry in entries] == [
        ("1.00", "0.80 to 1.20", "mm"),
        ("50.00", "–", "mm"),
    ]


def test_closed_gap_counts_only_where_there_is_one():
    rows = error_rows({"x": 1e-3, "psi": 1e-3}, {"x": 2e-4, "psi": 1e-3}, {"x": 1e-4, "psi": 9e-4})
    assert [row.closed for row in rows] == ["89 %", "–"]


def test_numbers_of_any_kind_become_json():
    trials = ({"kind": "x", "array": np.arange(2), "set": {"b", "a"}, "flag": np.bool_(True), "inf": np.inf},)
    report = parsed(report_json(dataclasses.replace(cases.adequate(), trials=trials)))
    assert report["trials"] == [{"kind": "x", "array": [0, 1], "set": ["a", "b"], "flag": True, "inf": None}]


def test_tables_fit_the_terminal_and_lose_nothing():
    words = ["a name of a controller that goes on", "[bold]0.123456 mm[/bold]", "never (12 of 34)", "1, 2, 3", "y" * 90]
    shown = Table(["controller", *(f"measure {k} [mm]" for k in range(4))], [words, words], (1, 2))
    for lines in (shown.lines(), shown.turned()):
        assert max(map(len, lines)) <= 80
        letters = "".join("".join(lines).split())
        assert letters.count("y") >= 180  # what is wider than its column goes on below
    assert Table(("a", "b"), [("[red]", "1.5 mm"), ("z", "12 mm")], (1,)).lines() == [
        "a           b",
        "[red]  1.5 mm",
        "z       12 mm",
    ]
