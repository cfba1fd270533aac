"""What only a fresh process can tell: compile times without kept programs, peak memory, and gradients.

    python experiments/throughput/fresh.py compile            one line of JSON
    python experiments/throughput/fresh.py gradient LANES SECONDS
    python experiments/throughput/fresh.py few SECONDS          and plain SECONDS, without whole loops
    python experiments/throughput/fresh.py memory SECONDS

Everything runs with whole loops (`jbridge.set_up`), as the commands do. Another engine does not have them unless it is
told to, so it is measured both ways.
"""

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax

import jbridge
from problem import bare, batch, load_model

LANES = 4096
SOFTNESS = 0.05
TURNS = 10
"""How often each program of a gradient runs; the fastest counts."""


_GIVEN = dict(os.environ)
"""Without the compiler's options that `set_up` hands to children."""


def ask(*words: str) -> dict[str, float]:
    """The answer of a process of its own."""
    found = subprocess.run([sys.executable, __file__, *words], check=True, capture_output=True, text=True, env=_GIVEN)
    return json.loads(found.stdout.splitlines()[-1])


def best_of(run: Callable[[], Any], repeats: int = 3) -> float:
    """Seconds of the fastest call; the first is not counted."""
    run()
    spans = []
    for _ in range(repeats):
        begun = time.perf_counter()
        run()
        spans.append(time.perf_counter() - begun)
    return min(spans)


def compiled(function: Any, *arguments: Any) -> tuple[float, Any]:
    """Seconds to trace and compile, and the program."""
    begun = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    return time.perf_counter() - begun, program


def compile_times() -> dict[str, float]:
    """Of an open loop and of a closed one."""
    import ours

    model, seconds = a_model(), {}
    for mode in ("open", "closed"):
        given = batch(mode, ours.ABREAST, 2.0)
        run = ours.forward(mode, given, model, "float64")
        seconds[mode], _ = compiled(run, *ours.lanes_of(given, "float64"))
    return seconds


def gradients(lanes: str, seconds: str) -> dict[str, float]:
    """Seconds of a closed-loop cost, and of its value with the gradient by every number of both controllers.

    In blocks that fit a core's cache, one on each core.
    """
    import numpy as np

    import ours

    model, given = a_model(), batch("closed", int(lanes), float(seconds))
    law, *numbers = ours.law("float64", SOFTNESS), *ours.lanes_of(given, "float64")
    pieces = -(-int(lanes) // ours.ABREAST)
    blocks = list(zip(*(np.split(np.asarray(a), pieces) for a in numbers), strict=True))
    found, programs = {"lanes": float(lanes), "seconds": float(seconds)}, {}
    for name, function in (
        ("forward", ours.cost(given, model)),
        ("rematerialised", jax.value_and_grad(ours.cost(given, model, reverse=True))),
        ("kept", jax.value_and_grad(ours.cost(given, model))),
    ):
        found[f"compile {name}"], programs[name] = compiled(function, law, *blocks[0])
        found[name] = math.inf
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for _ in range(TURNS):  # in turns, since the machine may be shared
            for name, program in programs.items():
                begun = time.perf_counter()
                list(pool.map(lambda block, run=program: jax.block_until_ready(run(law, *block)), blocks))
                found[name] = min(found[name], time.perf_counter() - begun)
    return found


def few(seconds: str) -> dict[str, float]:
    """Four bare bridges in jbridge and in plain diffrax: seconds of both, and how far they differ."""
    import numpy as np

    import engines
    import ours

    given = bare(4, float(seconds))
    run, theirs = ours.bare_forward(given), engines.diffrax_batch(given)
    difference = float(np.abs(np.asarray(run(given.starts)) - theirs()).max())
    found = {"seconds": float(seconds), "difference": difference, "diffrax": best_of(theirs)}
    return found | {"jbridge": best_of(lambda: np.asarray(run(given.starts)))}


def memory(seconds: str) -> dict[str, float]:
    """Peak memory of summaries of closed loops [byte]."""
    import ours

    model, given = a_model(), batch("closed", LANES, float(seconds))
    ours.timed(ours.forward("closed", given, model, "float64"), ours.lanes_of(given, "float64"), "float64")
    return {"peak": peak_memory()}


def peak_memory() -> float:
    """Of this process [byte]."""
    status = Path("/proc/self/status")
    if status.exists():  # what the other one tells begins with the parent's memory on Linux
        return 1024.0 * next(float(line.split()[1]) for line in status.read_text().splitlines() if "VmHWM" in line)
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def a_model() -> Any:
    with tempfile.TemporaryDirectory() as name:
        return load_model(Path(name))


if __name__ == "__main__":
    kinds: dict[str, Callable[..., dict[str, float]]] = {
        "compile": compile_times, "gradient": gradients, "few": few, "plain": few, "memory": memory
    }  # fmt: skip
    kind, *words = sys.argv[1:]
    if kind == "plain":
        jax.config.update("jax_enable_x64", True)
    else:
        jbridge.set_up(cache=False)
    print(json.dumps(kinds[kind](*words)))
