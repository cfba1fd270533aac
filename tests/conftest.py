"""Settings of the run: double precision, no silent promotion, cached compilation, plots without a display."""

import importlib.util
import os
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"  # for the commands that tests start, too
# Most of the suite's time is the compiler's, which takes half as long where it optimises little, and two thirds of that
# where fused operations go straight to machine code.
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + (
    " --xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
)
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("NPROC", "1")  # threads of JAX: processes side by side would contend for the processors

import jax
import pytest

import jbridge

jbridge.set_up()
# Also what takes milliseconds to compile: tests compile thousands of such operations, again in each process and after
# `few_memory_maps`, and reading one takes half as long.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
if any(importlib.util.find_spec(f"jax_cuda{number}_plugin") for number in (12, 13)):
    jax.config.update("jax_platforms", "cpu,cuda")  # the second for the tests that ask for it
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

MAPS = Path("/proc/self/maps")
MOST_MAPS = 20_000
"""Every compiled program takes some memory maps, of which Linux gives a process 65,530: then loading one aborts."""


LONGEST = (
    "test_cli.py", "test_diagnose.py", "test_rollout.py", "test_tune.py", "test_sensitivity.py", "test_estimation.py",
    "test_inference.py", "test_design.py", "test_flexible.py", "test_sweep.py", "test_gradients.py", "test_friction.py",
    "test_fit.py", "test_slips.py", "test_report.py", "test_fis.py", "test_closed_loop.py",
)  # fmt: skip
"""Files that take longest come first, the longest first of all, lest one process is left with them at the end."""


def pytest_collection_modifyitems(items):
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(LONGEST)))


@pytest.fixture(autouse=True, scope="module")
def few_memory_maps():
    """Drops the programs of finished modules when there are many; whoever needs one again reads it from the cache."""
    yield
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()
