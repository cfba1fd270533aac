"""How JAX computes: double precision, loops as single kernels, and programs that are kept."""

import contextlib
import ctypes
import hashlib
import os
import platform
import sys
import warnings
from pathlib import Path

_WHOLE_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold"
"""What a pass of a loop may touch [byte] for the compiler to make one kernel of the loop; its default is 1 KiB."""
_PASS = 4_000_000
"""So much is the loop over the steps of a call's simulations, and not the loop over blocks of time around it, which
gains little as one kernel and takes twice as long to compile."""
_VECTOR_WIDTH = "--xla_cpu_prefer_vector_width"
_GRAPHS = "--xla_gpu_enable_command_buffer=FUSION,WHILE,CONDITIONAL --xla_gpu_graph_min_graph_size=1"
"""A time loop is launched as a whole, and not kernel by kernel: 1.4 times the rate of 16,000 rollouts."""


def set_up(cache: bool = True, *, gpu: bool = False) -> None:
    """Turns on double precision, which every result needs, makes loops over time one kernel on a processor, which takes
    a third of the time, and keeps programs from one run to the next.

    To be called once, before anything is computed, by whoever starts the computation: commands, experiments, notebooks.

    Args:
        cache: whether to keep programs, traced and compiled, in the user's cache folder (`$XDG_CACHE_HOME` or
            `~/.cache`). A folder that cannot be written costs time and changes nothing.
        gpu: whether JAX computes on a graphics processor, if it has one. That pays from some 2,000 rollouts at a
            time; fits and diagnoses, which simulate a few recordings, take longer there.
    """
    import jax

    from .programs import keep_in

    jax.config.update("jax_enable_x64", True)
    if not gpu:
        jax.config.update("jax_platforms", "cpu")
    flags = os.environ.get("XLA_FLAGS", "")
    if gpu and "command_buffer" not in flags:
        flags = f"{flags} {_GRAPHS}"
    if _WHOLE_LOOPS not in flags:
        # Whole vectors of a processor that has wide ones; the compiler's own choice is half of them.
        width = "" if _VECTOR_WIDTH in flags else f"{_VECTOR_WIDTH}=512"
        os.environ["XLA_FLAGS"] = f"{flags} {_WHOLE_LOOPS}={_PASS} {width}".strip()
    _keep_freed_memory()
    keep_in(None)
    if not cache:
        return
    try:
        own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jbridge"
        folder = own / "jax" / _processor()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # no home, or one that is read-only
        return
    with contextlib.suppress(OSError):
        keep_in(own / "programs")
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    warnings.filterwarnings("ignore", message="Error (reading|writing) persistent compilation cache entry")


_INSTRUCTIONS = Path("/proc/cpuinfo")
"""Where Linux lists the instructions that its processor has."""


def _processor() -> str:
    """A name for the instructions that this processor has: machines that share a home folder keep compiled programs
    apart, since one that was compiled for another processor may end the process."""
    text = platform.machine()
    with contextlib.suppress(OSError):
        lines = _INSTRUCTIONS.read_text(encoding="utf-8", errors="replace").splitlines()
        text += next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return hashlib.sha256(text.encode()).hexdigest()[:12]


_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
"""Names of settings of glibc's `mallopt`."""


def _keep_freed_memory() -> None:
    """Lets this process keep the large arrays that it frees, for the next ones: fresh pages from the system, which
    clears each of them, take a quarter of a diagnosis otherwise."""
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):  # another library than glibc has no such settings
        mallopt = ctypes.CDLL("libc.so.6").mallopt
        mallopt(_MMAP_MAX, 0)
        mallopt(_TRIM_THRESHOLD, 2**31 - 1)
        mallopt(_ARENA_MAX, 1)
