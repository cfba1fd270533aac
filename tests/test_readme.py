"""The pages' tables are those that were measured, and their links lead somewhere."""

import importlib.util
import re
from pathlib import Path

import pytest

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
