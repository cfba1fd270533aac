"""What controllers cost in C: bytes of code and tables, bytes of the state, and cycles of a step.

    python experiments/export_cost.py              compiles and measures (needs gcc on x86-64); a minute
    python experiments/export_cost.py --figures    only writes the table from the kept numbers

Bytes are those of an object file by `gcc -Os`, of a step and a start; cycles those of the processor's time stamp
counter, the least of 200 means over 2000 steps, by `gcc -O2`. Numbers are kept in figures/data/export.json.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from version import commit

import jbridge

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "figures" / "data" / "export.json"
MODEL = ROOT / "experiments" / "paper" / "guess.toml"
CALLS = """
#define C_REAL {real}
#include "c.h"
void begin(c_state *s, const c_real *m) {{ c_start(s, m); }}
void step(c_state *s, const c_real *m, const c_real *r, c_real *u) {{ c_step(s, m, r, u); }}
"""
CLOCK = """
#define C_REAL {real}
#include "c.h"
#include <stdio.h>
#include <x86intrin.h>
int main(void) {{
    c_real measured[3] = {{0.5, 0.01, 0.4}}, reference[4] = {{0.6, 0.5, 0.1, 0.0}}, command[2];
    double least = 1e300, sum = 0;
    c_state state;
    c_start(&state, measured);
    for (int j = 0; j < 200; ++j) {{
        unsigned long long begun = __rdtsc();
        for (int i = 0; i < 2000; ++i) {{
            measured[0] = 0.5 + 1e-5 * i;
            measured[1] = 1e-5 * (i % 7);
            c_step(&state, measured, reference, command);
            sum += command[0];
        }}
        double mean = (__rdtsc() - begun) / 2000.0;
        least = mean < least ? mean : least;
    }}
    fprintf(stderr, "%g", sum);
    printf("%g %d", least, (int)sizeof state);
}}
"""


def controllers() -> dict[str, jbridge.Controller]:
    model = jbridge.load_model(MODEL)
    given = jbridge.compensation_for(model.plant)
    return {
        "the paper's rules": jbridge.Controller(jbridge.paper_controller()),
        "the extended rules with compensation": jbridge.Controller(jbridge.extended_controller(given)),
        "PID with compensation": jbridge.Controller(jbridge.Pid(compensation=given)),
        "the same, ZV": jbridge.Controller(jbridge.Pid(compensation=given), shaping=jbridge.Shaping("zv", 4.7)),
        "state feedback (LQR) with compensation": jbridge.lqr_controller(model, given),
        "state feedback on an observer (LQG) with compensation": jbridge.lqg_controller(model, given),
    }


def measure(controller: jbridge.Controller, real: str) -> dict[str, float]:
    """Bytes and cycles of a controller in one precision."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "c.h").write_text(jbridge.controller_header(controller, "c"))
        (folder / "calls.c").write_text(CALLS.format(real=real))
        (folder / "clock.c").write_text(CLOCK.format(real=real))

        def run(*words: str) -> str:
            return subprocess.run(words, cwd=folder, check=True, capture_output=True, text=True).stdout

        run("gcc", "-std=c99", "-Os", "-c", "calls.c", "-o", "calls.o")
        run("gcc", "-std=gnu99", "-O2", "clock.c", "-o", "clock", "-lm")
        code, data, *_ = run("size", "calls.o").splitlines()[1].split()
        cycles, state = run("./clock").split()
    return {"code": int(code) + int(data), "state": int(state), "cycles": float(cycles)}


def table(kept: dict[str, Any]) -> str:
    """The page in markdown, from `commit` and the numbers of all `controllers`."""
    lines = [
        f"Version {kept['commit']}.",
        "",
        "| controller | code and tables, double (float) [bytes] | state, double (float) [bytes] |"
        " a step, double [cycles] |",
        "|---|---|---|---|",
    ]
    for name, found in kept["controllers"].items():
        double, single = found["double"], found["float"]
        sizes = " | ".join(f"{double[key]:,} ({single[key]:,})" for key in ("code", "state"))
        lines.append(f"| {name} | {sizes} | {10 * round(double['cycles'] / 10)} |")
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", action="store_true", help="only write the table")
    if not parser.parse_args().figures:
        jbridge.set_up()
        found = {
            name: {real: measure(own, real) for real in ("double", "float")} for name, own in controllers().items()
        }
        DATA.write_text(json.dumps({"commit": commit(), "controllers": found}, separators=(",", ":")) + "\n")
    (ROOT / "figures" / "export-table.md").write_text(table(json.loads(DATA.read_text())))


if __name__ == "__main__":
    main()
