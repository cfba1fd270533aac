"""The pages' tables are those that were measured, and their links lead somewhere."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

import jbridge

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "tables.py")
tables = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tables)
PROSE = sorted(
    str(p.relative_to(ROOT)) for p in [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("experiments/**/*.md")]
)


@pytest.mark.parametrize("page", tables.PAGES)
def test_tables_are_those_in_figures(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    # If this fails: python docs/tables.py
    assert tables.with_tables(text, page) == text
    assert "<!-- end of" in text


@pytest.mark.parametrize("page", PROSE)
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if not link.startswith("http")]
    assert not [link for link in links if not ((ROOT / page).parent / link).exists()]
    if page == "README.md":
        assert links


def blocks(page: str, heading: str) -> list[str]:
    """The TOML examples below a heading."""
    section = (ROOT / page).read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]
    return re.findall(r"```toml\n(.*?)```", section, re.DOTALL)


def test_examples_of_files_are_read(tmp_path):
    (sidecar,) = blocks("docs/files.md", "Sidecars")
    (model,) = blocks("docs/files.md", "Models")
    (reference,) = blocks("docs/files.md", "Controllers and references")
    for name, text in (("run.toml", sidecar), ("model.toml", model), ("path.toml", reference)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    rows = ["millis,enc,theta,rope,pwm,u_l"]
    rows += [f"{5 * k},{1000 + 20 * (k % 50)},{180 + k % 5},0.7,{k % 7 * 10},0.0" for k in range(4100)]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    recording = jbridge.load_recording(tmp_path / "run.csv")
    assert np.ptp(recording.times) == pytest.approx(18.5)
    assert recording.x.min() == pytest.approx(1000 * 5.5e-5) and recording.psi.min() == pytest.approx(-np.radians(4))
    assert jbridge.load_model(tmp_path / "model.toml").known == {"cart_mass", "load_mass", "winch_mass", "gravity"}
    assert jbridge.load_reference(tmp_path / "path.toml", 0.02).x.max() == pytest.approx(1.2)
