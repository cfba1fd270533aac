"""Runs a sweep chunk by chunk into a folder that any interruption leaves whole.

Results are Parquet files, one a chunk, and nothing else is in the folder, so that every reader of Parquet takes it for
one table: a table is what summaries of rollouts are, a chunk is written in one go, and units and specification travel
in its metadata. (Zarr is made for dense arrays, which a random sample of parameters is not.) A chunk is complete or
absent, and the same whenever and wherever it is computed, so that a sweep which was killed goes on where it stopped and
ends with the same bits.
"""

import csv
import dataclasses
import json
import os
import platform
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .._display import Displayed
from .._files import create_text, read_json, replace_text, replacing
from .._progress import Step, silent, with_progress
from ..dask_workers import on_workers
from ..errors import InputError
from ..model.parameters import ParameterTable
from ..simulation.move_summary import UNITS
from .rollouts import Rollouts
from .spec import Sweep

_LISTED = 10_000
"""Most failures that are listed one by one; all are counted, and marked in the results."""
_prepared: dict[str, Rollouts] = {}
"""Of a worker: the compiled rollouts of the sweep that it works for, by its identity."""
_preparing = threading.Lock()


@dataclasses.dataclass(frozen=True, repr=False)
class SweepResult(Displayed):
    """What a sweep left in its folder."""

    folder: Path
    count: int
    """Rollouts."""
    failed: int
    """Rollouts that did not stay finite; they are in the results, marked, and in failures.csv."""
    computed: int
    """Rollouts of this call; the rest were there already."""
    seconds: float


@with_progress
def run_sweep(
    question: Sweep,
    folder: str | os.PathLike[str],
    *,
    workers: int = 0,
    scheduler: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> SweepResult:
    """Runs every rollout of a sweep that its folder does not hold yet.

    Args:
        question: what to ask.
        folder: where results go: `part-*.parquet` and nothing else. What was asked lies beside it in
            `FOLDER.sweep.json`, rollouts that failed in `FOLDER.failures.csv`.
        workers: processes of `dask.distributed` on this machine; one that dies is replaced. With 0, and for a single
            chunk, this process computes.
        scheduler: address of a running scheduler of `dask.distributed`, whose workers see the same folder.
        progress: told how far it is, and how fast; by default a bar on a terminal or in a notebook.

    Raises:
        InputError: the folder holds the results of another question, or cannot be written; `dask.distributed` is not
            installed, or its scheduler not there.
    """
    begun = time.perf_counter()
    target = Path(folder)
    tell = progress or silent
    chunks = _chunks(question)
    _refuse_others(target, question)
    missing = [number for number in range(chunks) if not _part(target, number).exists()]
    computed = 0
    if missing:
        tell("compiling")
        start, total = time.perf_counter(), sum(_size(question, number) for number in missing)
        for done in _computed(question, target.absolute(), missing, workers, scheduler):
            computed += done
            rate = computed / max(time.perf_counter() - start, 1e-9)
            tell(Step(f"{computed:,} rollouts, {rate:,.0f} a second", done=computed / total))
    failed = _conclude(target, question, chunks)
    return SweepResult(target, question.design.count, failed, computed, time.perf_counter() - begun)


def _computed(
    question: Sweep, folder: Path, missing: Sequence[int], workers: int, scheduler: str | None
) -> Iterator[int]:
    """Number of rollouts of each chunk, when it is written."""
    if scheduler is None and (workers == 0 or len(missing) == 1):
        rollouts = Rollouts(question)
        for number in missing:
            yield write_chunk(rollouts, folder, number)
        return
    yield from on_workers(_chunk, [(question, str(folder), number) for number in missing], workers, scheduler)


def _chunk(question: Sweep, folder: str, number: int) -> int:
    """One chunk, on a thread of a worker."""
    with _preparing:
        if question.identity not in _prepared:
            _prepared.clear()
            _prepared[question.identity] = Rollouts(question, threads=1)
        rollouts = _prepared[question.identity]
    return write_chunk(rollouts, Path(folder), number)


def read_sweep(folder: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """The results of a sweep, a column for each parameter and summary, in the order of the points.

    Raises:
        InputError: there are none, or a file is damaged.
    """
    parts = sorted(Path(folder).glob("part-*.parquet"))
    if not parts:
        raise InputError(f"{folder}: holds no results of a sweep; run jbridge sweep SPEC.toml --out {folder}")
    whole = pa.concat_tables([_read(part) for part in parts])
    return {name: whole.column(name).to_numpy() for name in whole.column_names}


def _chunks(question: Sweep) -> int:
    return -(-question.design.count // question.chunk)


def _size(question: Sweep, number: int) -> int:
    return min(question.chunk, question.design.count - number * question.chunk)


def _part(folder: Path, number: int) -> Path:
    return folder / f"part-{number:06d}.parquet"


def _beside(folder: Path, ending: str) -> Path:
    return folder.with_name(f"{folder.name}.{ending}")


def _refuse_others(folder: Path, question: Sweep) -> None:
    """Refuses a folder that holds the results of another question; writes nothing."""
    mark = _beside(folder, "sweep.json")
    try:
        if mark.exists():
            if read_json(mark).get("identity") != question.identity:
                raise InputError(
                    f"{folder}: holds the results of another sweep; choose another --out, or delete it and {mark}"
                )
        elif any(folder.glob("part-*.parquet")):
            raise InputError(f"{folder}: holds results of unknown origin; choose another --out")
    except ValueError:
        raise InputError(f"{mark}: damaged; choose another --out, or delete it and the folder") from None
    except OSError as error:
        raise InputError(f"{mark}: cannot be read ({error.strerror}); choose another --out") from None


def _claim(folder: Path, question: Sweep) -> None:
    """Makes the folder this sweep's; of two sweeps that do so at the same moment one is refused."""
    mark = _beside(folder, "sweep.json")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not mark.exists():
            create_text(mark, json.dumps(_about(question), indent=1) + "\n")
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); choose another --out") from None
    _refuse_others(folder, question)


def _about(question: Sweep) -> dict[str, Any]:
    """What is written beside every result: how to get it again, and what it means."""
    packages = ("jbridge", "jax", "jaxlib", "numpy", "scipy")
    return {
        "identity": question.identity,
        "specification": question.text,
        "seed": question.design.seed,
        "count": question.design.count,
        "chunk": question.chunk,
        "precision": question.precision,
        "units": _units(question),
        "versions": {name: version(name) for name in packages} | {"python": platform.python_version()},
        "device": jax.devices()[0].device_kind,
    }


def _units(question: Sweep) -> dict[str, str]:
    table = ParameterTable(question.model.plant)
    own = {"controller.cart_scale": "m", "controller.hoist_scale": "m", "controller.filter": "s", "reference.x": "m"}
    own |= {"reference.l": "m", "reference.speed_x": "m/s", "reference.speed_l": "m/s", "reference.rest": "s"}
    found = {}
    for axis in question.design.axes:
        known = own.get(axis.name)
        found[axis.name] = table.entry(table.positions(axis.name)[0]).unit if known is None else known
    return found | UNITS


def write_chunk(rollouts: Rollouts, folder: Path, number: int) -> int:
    """Computes one chunk and writes its file; returns the number of its rollouts.

    The folder becomes this sweep's with the first chunk that is there to be written: what fails before leaves no trace.
    """
    question = rollouts.sweep
    start = number * question.chunk
    rows = question.design.points(start, start + question.chunk)
    found = rollouts(rows)
    _claim(folder, question)
    columns: dict[str, Any] = {"index": np.arange(start, start + len(rows))}
    columns |= {axis.name: rows[:, k] for k, axis in enumerate(question.design.axes)}
    table = pa.table(columns | found)
    about = {"jbridge": json.dumps(_about(question))}
    part = _part(folder, number)
    with replacing(part) as partial:
        pq.write_table(table.replace_schema_metadata(about), partial)
    return len(rows)


def _read(part: Path, columns: list[str] | None = None) -> pa.Table:
    try:
        return pq.read_table(part, columns=columns)
    except (OSError, pa.ArrowException):
        raise InputError(f"{part}: damaged; delete it and call the sweep again, which computes it anew") from None


def _conclude(folder: Path, question: Sweep, chunks: int) -> int:
    """Counts and lists the failures."""
    failed = 0
    names = ["index", *(axis.name for axis in question.design.axes)]
    with (
        replacing(_beside(folder, "failures.csv")) as partial,
        open(partial, "w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(names)
        for number in range(chunks):
            table = _read(_part(folder, number), [*names, "sound"])
            bad = np.flatnonzero(~table.column("sound").to_numpy())
            for row in bad[: max(_LISTED - failed, 0)]:
                writer.writerow([table.column(name)[int(row)].as_py() for name in names])
            failed += len(bad)
    replace_text(_beside(folder, "sweep.json"), json.dumps(_about(question) | {"failed": failed}, indent=1) + "\n")
    return failed
