"""Puts measured tables into the pages that show them, between their markers.

    python docs/tables.py

Each `<!-- NAME -->` ... `<!-- end of NAME -->` in a page receives the content of figures/NAME.md where that exists.
"""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ("docs/results.md", "docs/real-rigs.md", "docs/export.md")
FIRST_ONLY = {"tuning-from-recordings"}
"""Tables of several sections of which a page shows the first."""


def main() -> None:
    for page in PAGES:
        path = ROOT / page
        path.write_text(with_tables(path.read_text(encoding="utf-8"), page), encoding="utf-8")


def with_tables(text: str, page: str) -> str:
    """A page's text with its tables as they are in figures/.

    Args:
        text: what the page says now.
        page: where it lies below the project's root; links are relative to that.
    """
    figures = "../" * page.count("/") + "figures"
    for name in re.findall(r"<!-- end of ([\w-]+) -->", text):
        source = ROOT / "figures" / f"{name}.md"
        if not source.exists():
            print(f"{page}: no figures/{name}.md yet")
            continue
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        before, rest = text.split(begin)
        content = source.read_text(encoding="utf-8").strip()
        if name in FIRST_ONLY:
            content = content.split("\n## ")[0].strip()
        content = re.sub(r"^#[^#].*\n+", "", content)  # the page has a heading of its own
        content = re.sub(r"^(#+ )", r"#\1", content, flags=re.MULTILINE)
        content = re.sub(r"\]\(([\w-]+\.(?:md|png))\)", rf"]({figures}/\1)", content)
        text = f"{before}{begin}\n\n{content}\n\n{end}{rest.split(end)[1]}"
    return text


if __name__ == "__main__":
    main()
