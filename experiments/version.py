"""Which version of the code a measurement was made with."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parent.parent


def commit() -> str:
    """The code's version, with a mark where files differ from it."""
    git = ["git", "-C", str(ROOT)]
    head = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True).stdout.strip()
    changed = subprocess.run([*git, "status", "--porcelain", "jbridge"], capture_output=True, text=True).stdout
    return head + ("+changes" if changed.strip() else "")
