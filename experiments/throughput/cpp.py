"""The reference in C++: compiled here, and run as a program of its own."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from problem import MODES, Given

SOURCE = Path(__file__).with_name("reference.cpp")
FLAGS = ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-fopenmp", "-std=c++17")


def build(folder: Path) -> Path:
    program = folder / "reference"
    subprocess.run(["g++", *FLAGS, str(SOURCE), "-o", str(program)], check=True)
    return program


def reference(
    program: Path, mode: str, precision: str, given: Given, *, short: int = 0, repeats: int = 5
) -> dict[str, Any]:
    """Rates, and the final positions of every lane.

    Args:
        program: see `build`; what it reads and writes lies beside it.
        mode, precision: which loop, in float64 or float32.
        given: the batch.
        short: periods to leave out at the end.
        repeats: the best of these is told.
    """
    data, out = program.with_name("in"), program.with_name("out")
    data.write_bytes(np.concatenate([given.rows, given.starts], axis=1).tobytes() + given.table.tobytes())
    words = [mode, precision, len(given.rows), len(given.table) - short, MODES[mode][1], repeats, data, out]
    found = subprocess.run([program, *map(str, words)], check=True, capture_output=True, text=True)
    return json.loads(found.stdout) | {"final": np.fromfile(out).reshape(-1, 3)}
