"""gcc at its strictest."""

import subprocess
from pathlib import Path


def compiled(folder: Path, source: str, *options: str) -> Path:
    """A program from the text of its source."""
    (folder / "source.c").write_text(source)
    strict = ["-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-O2"]
    subprocess.run(["gcc", *strict, *options, "source.c", "-o", "program", "-lm"], cwd=folder, check=True)
    return folder / "program"
