"""The bar of long computations: on a terminal one line with the time that is left, elsewhere nothing."""

import os
import re
import subprocess
import sys

import pytest

import jbridge
from jbridge._progress import Step, with_progress

pty = pytest.importorskip("pty", reason="needs a pseudo-terminal, which Windows has not")

SCRIPT = """
import time, jbridge
from jbridge._progress import Step
bar = jbridge.ProgressBar()
bar("reading [red]a.csv[/red]\\nand more")
for done in (0.2, 0.4, 0.6):
    time.sleep(0.1)
    bar(Step(f"a long message on step {done} that no narrow terminal has room for", done=done))
print("result")
bar(Step("searching", most=200.0))
bar.clear()
"""


def on_terminal(columns):
    """What the script writes to stdout, and to a terminal as its stderr."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"COLUMNS": str(columns), "TERM": "xterm"}
    with subprocess.Popen(
        [sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, stderr=theirs, env=environment
    ) as run:
        os.close(theirs)
        told = b""
        try:
            while found := os.read(ours, 65536):
                told += found
        except OSError:  # the other side is closed
            pass
        said = run.stdout.read()
    os.close(ours)
    return said.decode(), told.decode()


@pytest.mark.parametrize("columns", [60, 100])
def test_a_terminal_shows_one_line_with_the_time_left(columns):
    said, told = on_terminal(columns)
    assert said == "result\n"
    lines = [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line).strip() for line in re.split("[\r\n]+", told)]
    assert max(map(len, lines)) <= columns
    assert any(re.search(r"a long.*0:00:0[01] [01] s left", line) for line in lines)
    assert any(re.search(r"searching.*at most 3 min (20|19) s left", line) for line in lines)
    assert any("[red]" in line for line in lines)  # a file's name is no markup
    # In the end the cursor is shown, and the line is taken back.
    assert told.endswith("\x1b[2K") and "\x1b[?25h" in told


def test_elsewhere_there_is_nothing():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "result\n", "")


def test_who_gives_no_callback_gets_a_bar():
    told, bars = [], []

    @with_progress
    def compute(number, progress=None):
        progress(Step("half way", done=0.5))
        bars.append(progress)
        return 2 * number

    assert compute(2) == 4 and compute(3, progress=told.append) == 6
    assert isinstance(bars[0], jbridge.ProgressBar)
    assert told == ["half way"] and told[0].done == 0.5
