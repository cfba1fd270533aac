"""Puts measured tables into README.md, between their markers.

    python docs/tables.py

Each `<!-- NAME -->` ... `<!-- end of NAME -->` in the README receives the content of figures/NAME.md where that exists.
"""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIRST_ONLY = {"concealed-table"}
"""Pages of several sections of which the README has the first."""


def main() -> None:
    readme = ROOT / "README.md"
    readme.write_text(with_tables(readme.read_text(encoding="utf-8")), encoding="utf-8")


def with_tables(text: str) -> str:
    """The README's text with its tables as they are in figures/."""
    for name in re.findall(r"<!-- end of ([\w-]+) -->", text):
        source = ROOT / "figures" / f"{name}.md"
        if not source.exists():
            print(f"{name}: no {source.relative_to(ROOT)} yet")
            continue
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        before, rest = text.split(begin)
        # In the README a table's headings stand below the section's.
        content = source.read_text(encoding="utf-8").strip()
        if name in FIRST_ONLY:
            content = content.split("\n## ")[0].strip()
        content = re.sub(r"^(#+ )", r"##\1", content, flags=re.MULTILINE)
        content = re.sub(r"\]\(([\w-]+\.md)\)", r"](figures/\1)", content)
        text = f"{before}{begin}\n\n{content}\n\n{end}{rest.split(end)[1]}"
    return text


if __name__ == "__main__":
    main()
