"""Several processes for one sweep: JAX's own distributed runtime."""

import jax

from ..errors import InputError

_PATIENCE = 300
"""Time that processes wait for each other to start [s]."""


def join(coordinator: str | None, processes: int | None, process: int | None) -> None:
    """Makes this process one of several; to be called before anything is computed. Without a coordinator, nothing.

    Args:
        coordinator: `HOST:PORT` at which process 0 listens, or `auto` where a cluster (Slurm, Open MPI) tells
            everything by itself.
        processes: how many there are.
        process: which of them this is, from 0.

    Raises:
        InputError: something is missing, or the others do not come.
    """
    if coordinator is None:
        if processes is not None or process is not None:
            raise InputError("--processes and --process need --coordinator HOST:PORT; add it")
        return
    if coordinator != "auto" and (processes is None or process is None):
        raise InputError("--coordinator HOST:PORT needs --processes N and --process I; add them")
    if process is not None and processes is not None and not 0 <= process < processes:
        raise InputError(f"--process {process} is not one of {processes} processes, which count from 0")
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    address = None if coordinator == "auto" else coordinator
    try:
        jax.distributed.initialize(address, processes, process, initialization_timeout=_PATIENCE)
    except (RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"the processes of this sweep have not found each other at {coordinator} ({reason}); start all of them "
            "with the same --coordinator and --processes"
        ) from None
