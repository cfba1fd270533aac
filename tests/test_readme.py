"""The README's tables are those that were measured."""

import importlib.util
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_tables_are_those_in_figures():
    spec = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "tables.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    # If this fails: python docs/tables.py
    assert script.with_tables(text) == text


def test_links_lead_somewhere():
    links = re.findall(r"\]\(([^)#]+)\)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert links and not [link for link in links if not (ROOT / link).exists()]
