"""Chunks of a sweep on the workers of `dask.distributed`, on this machine or on a cluster.

A chunk is a file that is complete or absent and the same wherever it is computed, so a worker may die at any moment:
its chunk is given to another one, and on this machine a new worker takes its place.
"""

import contextlib
import logging
import os
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..compilation import set_up
from ..errors import InputError
from .rollouts import Rollouts
from .run import write_chunk
from .spec import Sweep

_PATIENCE = 60.0
"""Time to find a scheduler [s]."""
_DEATHS = 1000
"""Workers that may die over one chunk before the sweep gives up."""
_WAITING = 4
"""Chunks that wait at the scheduler for each worker."""
_prepared: dict[str, Rollouts] = {}
"""Of a worker: the compiled rollouts of the sweep that it works for, by its identity."""
_preparing = threading.Lock()


def computed(
    question: Sweep, folder: Path, missing: Sequence[int], workers: int, scheduler: str | None
) -> Iterator[int]:
    """Number of rollouts of each chunk, when a worker has written it.

    Args:
        question: what to ask.
        folder: for the results, which all workers see.
        missing: numbers of the chunks.
        workers: processes to start on this machine, where there is no scheduler.
        scheduler: address of one that runs.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise InputError(
            "sweeps by several processes need dask.distributed, which is not installed; install jbridge with its extra "
            "'cluster'"
        ) from None
    left = iter(missing)
    settings = {"distributed.scheduler.allowed-failures": _DEATHS, "distributed.comm.timeouts.connect": _PATIENCE}
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        try:
            client = stack.enter_context(_client(distributed, stack, min(workers, len(missing)), scheduler))
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"no scheduler at {scheduler} ({reason}); start `dask scheduler`, and workers") from None

        # Before they receive arrays, which would be single precision otherwise; those that replace others as well.
        client.register_worker_callbacks(setup=set_up)

        def submit(number: int) -> Any:
            return client.submit(_chunk, question, str(folder), number, pure=False)

        ahead = _WAITING * max(len(client.nthreads()), 1)
        waiting = distributed.as_completed([submit(n) for _, n in zip(range(ahead), left, strict=False)])
        try:
            for future in waiting:
                yield future.result()
                for number in left:
                    waiting.add(submit(number))
                    break
        except distributed.CancelledError:
            raise InputError("the scheduler is gone; call the sweep again, which computes what is missing") from None


def _client(distributed: Any, stack: contextlib.ExitStack, workers: int, scheduler: str | None) -> Any:
    if scheduler is not None:
        return distributed.Client(scheduler, timeout=_PATIENCE)
    cluster = distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=max(1, (os.cpu_count() or 1) // workers),
        memory_limit=None,
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    )
    return distributed.Client(stack.enter_context(cluster))


def _chunk(question: Sweep, folder: str, number: int) -> int:
    """One chunk, on a thread of a worker."""
    with _preparing:
        if question.identity not in _prepared:
            _prepared.clear()
            _prepared[question.identity] = Rollouts(question, threads=1)
        rollouts = _prepared[question.identity]
    return write_chunk(rollouts, Path(folder), number)
