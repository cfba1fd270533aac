"""Reads files in a process of its own, with limits, so that whatever a file does to its reader is an outcome.

The processes are forked from a server that has started nothing: a process whose JAX has threads must not be forked.
"""

import multiprocessing
import resource
import tempfile
import traceback
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import jbridge
from corpus import READERS, Case, corpus

SECONDS = 10.0
"""Most time that a file may take."""
MEMORY = 2**30
"""Most memory that a file may take [byte]."""
_START = 120.0
"""Most time that a worker may take to start [s]."""


@dataclass(frozen=True)
class Outcome:
    """What came of one input."""

    kind: str
    """`read` or `refused`, as it should be; otherwise `traceback`, `signal`, `memory` or `time`."""
    text: str = ""
    """The refusal, or what else was said."""

    @property
    def sound(self) -> bool:
        return self.kind in ("read", "refused")


def outcomes(cases: Iterable[Case]) -> Iterator[Outcome]:
    """What comes of each input, in order, read by one worker, which is replaced when an input ends it."""
    context = multiprocessing.get_context("forkserver")
    worker, pipe = None, None
    try:
        for case in cases:
            if worker is None or pipe is None:
                worker, pipe = _start(context)
            pipe.send(case)
            if not pipe.poll(SECONDS):
                outcome = Outcome("time", f"more than {SECONDS:g} s")
            else:
                try:
                    outcome = pipe.recv()
                except EOFError:
                    worker.join()
                    outcome = Outcome("signal", f"the process ended with {worker.exitcode}")
            if outcome.kind in ("time", "signal", "memory"):
                _end(worker, pipe)
                worker, pipe = None, None
            yield outcome
    finally:
        if worker is not None and pipe is not None:
            _end(worker, pipe)


def _start(
    context: multiprocessing.context.ForkServerContext,
) -> tuple[multiprocessing.process.BaseProcess, Connection]:
    ours, theirs = context.Pipe()
    worker = context.Process(target=_work, args=(theirs,), daemon=True)
    worker.start()
    theirs.close()
    if not ours.poll(_START) or ours.recv() != "ready":
        raise RuntimeError("a worker does not start")
    return worker, ours


def _end(worker: multiprocessing.process.BaseProcess, pipe: Connection) -> None:
    pipe.close()
    worker.kill()
    worker.join()


def _work(pipe: Connection) -> None:
    """Reads one input after the other until nobody sends any."""
    jbridge.set_up(False)
    with tempfile.TemporaryDirectory() as folder:
        for case in corpus():  # what is compiled and kept once does not count as the first input's
            outcome = read(case, Path(folder))
            if outcome.kind != "read":
                raise RuntimeError(f"{case.reader} of {case.changed}: {outcome.text}")
        used = _used()
        resource.setrlimit(resource.RLIMIT_DATA, (used + MEMORY, resource.RLIM_INFINITY))
        pipe.send("ready")
        while True:
            try:
                case = pipe.recv()
            except EOFError:
                return
            pipe.send(read(case, Path(folder)))


def _used() -> int:
    """Memory of this process that RLIMIT_DATA counts [byte]."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(next(line for line in status.splitlines() if line.startswith("VmData")).split()[1])


def read(case: Case, folder: Path) -> Outcome:
    """Writes the files of an input and reads them as the commands do."""
    for old in folder.iterdir():
        old.unlink()
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a warning would be a second line, and no one could act on it
            READERS[case.reader](folder / case.read)
    except jbridge.InputError as error:
        text = str(error)
        if text.splitlines() != [text] or not text.isprintable() or len(text) > 2000:
            return Outcome("traceback", f"not one short line: {text[:500]!r}")
        return Outcome("refused", text)
    except MemoryError:
        return Outcome("memory", traceback.format_exc(limit=-3))
    except Exception:
        return Outcome("traceback", traceback.format_exc(limit=-6))
    return Outcome("read")
