"""What the documentation's site has beyond the pages of this folder, for MkDocs: `make docs`.

Its first page is the README, figures come from `figures`, the commands' page from the commands themselves, and the page
of the Python interface from the public names.
"""

import ast
import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
SHOWN = (".png", ".svg", ".md")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the README, the figures, and what is made of the sources."""
    made = {
        "index.md": (ROOT / "README.md").read_text(encoding="utf-8"),
        "commands.md": commands(),
        "api.md": interface(),
    }
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    for path in sorted((ROOT / "figures").iterdir()):
        if path.name.endswith(SHOWN):
            files.append(File.generated(config, f"figures/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Links as they are from the site: what the site does not have is named without one."""
    text = markdown.replace("](docs/tutorials)", "](tutorials/own_recordings.py)").replace("](docs/", "](")
    text = text.replace("](../figures/", "](figures/")
    return re.sub(r"\[([^\]]*)\]\((?:\.\./)*(?:experiments/|CONTRIBUTING|CHANGELOG|SECURITY)[^)]*\)", r"\1", text)


def commands() -> str:
    """The help of every command."""
    from jbridge.cli import COMMANDS, parser

    every = parser()
    pages = [("jbridge", every.format_help())]
    [chosen] = [a for a in every._actions if isinstance(a.choices, dict)]
    pages += [(f"jbridge {name}", chosen.choices[name].format_help()) for name in COMMANDS]
    return "# Commands\n\n" + "\n\n".join(f"## {name}\n\n```text\n{text.rstrip()}\n```" for name, text in pages) + "\n"


def interface() -> str:
    """Every public name with its docstring."""
    face = ast.parse((ROOT / "jbridge" / "__init__.pyi").read_text(encoding="utf-8"))
    homes = {a.name: node.module for node in face.body if isinstance(node, ast.ImportFrom) for a in node.names}
    names = sorted(name for name in homes if not name.startswith("_"))
    parts = [f"## {name}\n\n::: jbridge.{homes[name]}.{name}\n    options: {{heading_level: 3}}" for name in names]
    return "# Python interface\n\nAll names are those of `jbridge` itself.\n\n" + "\n\n".join(parts) + "\n"
