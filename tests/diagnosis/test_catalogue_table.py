"""The documentation's table of effects is the catalogue's."""

import importlib.util
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_table_of_effects_is_up_to_date():
    spec = importlib.util.spec_from_file_location("catalogue", ROOT / "experiments" / "catalogue.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    # If this fails: python experiments/catalogue.py
    assert script.TABLE.read_text(encoding="utf-8") == script.table()
