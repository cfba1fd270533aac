"""Calls of a function on the workers of `dask.distributed`, on this machine or on a cluster.

What is called gives the same wherever and however often it runs, so a worker may die at any moment: its call is given
to another one, and on this machine a new worker takes its place.
"""

import contextlib
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from .compilation.settings import set_up
from .errors import InputError

_PATIENCE = 60.0
"""Time to find a scheduler [s]."""
_DEATHS = 1000
"""Workers that may die over one call before all are given up."""
_WAITING = 4
"""Calls that wait at the scheduler for each worker."""


def on_workers(
    function: Callable[..., Any],
    calls: Sequence[tuple[Any, ...]],
    workers: int,
    scheduler: str | None,
    *,
    threads: int | None = None,
) -> Iterator[Any]:
    """What a function returns for each tuple of arguments, in the order in which workers finish.

    Args:
        function: of a module that workers can import.
        calls: arguments that can be sent to another process.
        workers: processes to start on this machine, where there is no scheduler.
        scheduler: address of one that runs.
        threads: calls at a time of a process on this machine; by default its share of the cores.

    Raises:
        InputError: `dask.distributed` is not installed, or its scheduler is not there or goes.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise InputError(
            "several processes need dask.distributed, which is not installed; install jbridge with its extra 'cluster'"
        ) from None
    left = iter(calls)
    settings = {"distributed.scheduler.allowed-failures": _DEATHS, "distributed.comm.timeouts.connect": _PATIENCE}
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        try:
            client = stack.enter_context(_client(distributed, stack, min(workers, len(calls)), threads, scheduler))
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"no scheduler at {scheduler} ({reason}); start `dask scheduler`, and workers") from None

        # Before they receive arrays, which would be single precision otherwise; those that replace others as well.
        client.register_worker_callbacks(setup=set_up)

        def submit(call: tuple[Any, ...]) -> Any:
            return client.submit(function, *call, pure=False)

        ahead = _WAITING * max(len(client.nthreads()), 1)
        waiting = distributed.as_completed([submit(call) for _, call in zip(range(ahead), left, strict=False)])
        try:
            for future in waiting:
                yield future.result()
                for call in left:
                    waiting.add(submit(call))
                    break
        except distributed.CancelledError:
            raise InputError(
                "the connection to the scheduler was lost; run the command again to compute the rest"
            ) from None


def _client(
    distributed: Any, stack: contextlib.ExitStack, workers: int, threads: int | None, scheduler: str | None
) -> Any:
    if scheduler is not None:
        return distributed.Client(scheduler, timeout=_PATIENCE)
    cluster = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=threads or max(1, (os.cpu_count() or 1) // workers),
        memory_limit=None,
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    )
    return distributed.Client(stack.enter_context(cluster))
