"""Diagnoses of many rigs or days, a folder of recordings each, on this machine or on a cluster."""

import csv
import dataclasses
import hashlib
import io
import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from .._files import make_folder, read_json, replace_text
from .._progress import Step, silent, with_progress
from ..dask_workers import on_workers
from ..diagnosis.diagnose import diagnose
from ..errors import InputError
from ..identification.gains import check_model_gains
from ..model.files import load_model
from ..recordings import load_recordings
from .files import PathLike, check_output
from .save import save_report

_RECORDINGS = (".csv", ".mat")
_OWN_MODEL = "model.toml"
_HOLDOUT = "holdout"


@dataclasses.dataclass(frozen=True)
class Finding:
    """What one folder's diagnosis came to."""

    folder: str
    verdict: str = ""
    """Empty where its recordings could not be read."""
    explained: float | None = None
    """Share of the hold-out's excess squared error that the confirmed effects close."""
    effects: str = ""
    """Kind and site of what was found, the largest first, each with its status."""
    statement: str = ""
    """One or two sentences; of recordings that could not be read, why."""
    seconds: float = 0.0


@with_progress
def diagnose_each(  # noqa: PLR0913
    model: PathLike,
    folders: Sequence[PathLike],
    out: PathLike,
    *,
    budget: float = 300.0,
    force: bool = False,
    workers: int = 0,
    scheduler: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> list[Finding]:
    """Diagnoses the recordings of every folder on their own; a report each, and a table of all.

    Of a folder, `*.csv` and `*.mat` are recordings, those whose names begin with `holdout` its hold-out, and a
    `model.toml` takes the place of `model`. What is there already, of the same files, is not diagnosed again.

    Args:
        model: file with the model of all rigs that have none of their own.
        folders: of recordings; their names are those of the reports.
        out: folder that receives the reports, one folder each, and `each.csv`.
        budget: time for every diagnosis [s].
        force: whether to take columns that are plainly in another unit as they are.
        workers: processes of `dask.distributed` on this machine; with 0 this process computes.
        scheduler: address of a running scheduler, whose workers see the same folders.
        progress: told how far it is; by default a bar on a terminal or in a notebook.

    Returns:
        What was found, in the order of the folders.

    Raises:
        InputError: a folder holds no recordings, two have one name, or `out` cannot be written.
    """
    tell = progress or silent
    target, places = Path(out), [Path(folder).absolute() for folder in folders]
    _check(places)
    check_output(target, folder=True)
    calls = {
        place.name: (str(_model_of(place, model)), str(place), str(target.absolute() / place.name), budget, force)
        for place in places
    }
    identities = {name: _identity(*call) for name, call in calls.items()}
    found = {name: kept for name, call in calls.items() if (kept := _kept(Path(call[2]), identities[name]))}
    missing = [call for name, call in calls.items() if name not in found]
    make_folder(target)
    tell(f"{len(missing)} folders to diagnose")
    for done, finding in enumerate(_computed(missing, workers, scheduler), 1):
        found[finding.folder] = finding
        mark = {"identity": identities[finding.folder], "finding": dataclasses.asdict(finding)}
        replace_text(_mark(target / finding.folder), json.dumps(mark, indent=1) + "\n")
        tell(Step(f"{done} of {len(missing)} folders", done=done / len(missing)))
    rows = [found[place.name] for place in places]
    replace_text(target / "each.csv", _table(rows))
    return rows


def _computed(calls: Sequence[tuple[Any, ...]], workers: int, scheduler: str | None) -> Iterator[Finding]:
    if scheduler is None and (workers == 0 or len(calls) <= 1):
        for call in calls:
            yield _one(*call)
        return
    yield from on_workers(_one, calls, workers, scheduler, threads=1)


def _one(model: str, folder: str, out: str, budget: float, force: bool) -> Finding:
    """One folder's diagnosis, saved; on a worker."""
    begun, name = time.perf_counter(), Path(folder).name
    try:
        every, proof = _recordings(Path(folder))
        recordings = load_recordings([*every, *proof], force=force)
        given = load_model(model)
        if not force:
            check_model_gains(given, recordings)
        result = diagnose(given, recordings[: len(every)], recordings[len(every) :], budget=budget, progress=silent)
        save_report(out, result)
        if result.stopped == "interrupted":
            raise KeyboardInterrupt
    except InputError as error:
        return Finding(name, statement=str(error), seconds=time.perf_counter() - begun)
    effects = ", ".join(f"{e.kind} at {e.site} ({e.status})" for e in result.effects)
    share = result.explained.get("all")
    return Finding(name, result.verdict or "", share, effects, result.statement, time.perf_counter() - begun)


def _recordings(folder: Path) -> tuple[list[Path], list[Path]]:
    """Recordings to learn from, and the hold-out."""
    every = sorted(path for path in folder.iterdir() if path.suffix.lower() in _RECORDINGS)
    proof = [path for path in every if path.name.lower().startswith(_HOLDOUT)]
    return [path for path in every if path not in proof], proof


def _check(places: Sequence[Path]) -> None:
    for place in places:
        if not place.is_dir():
            raise InputError(f"{place}: no such folder; --each takes folders of recordings")
        if not _recordings(place)[0]:
            raise InputError(f"{place}: holds no recordings (*.csv or *.mat); leave it out")
    names = [place.name for place in places]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{twice}: two folders are called so, and their reports would be one; rename one")


def _model_of(place: Path, model: PathLike) -> Path:
    own = place / _OWN_MODEL
    return own if own.exists() else Path(model).absolute()


def _identity(model: str, folder: str, out: str, budget: float, force: bool) -> str:
    """A name for all that a diagnosis depends on but the version of jbridge."""
    digest = hashlib.sha256(f"{budget} {force}\0".encode())
    for path in (Path(model), *sorted(path for path in Path(folder).iterdir() if path.is_file())):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _mark(out: Path) -> Path:
    return out.with_name(f"{out.name}.json")


def _kept(out: Path, identity: str) -> Finding | None:
    """What an earlier call found of the same files, if its report is still there."""
    try:
        mark = read_json(_mark(out))
        if mark.get("identity") == identity and (out / "report.html").exists():
            return Finding(**mark["finding"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        pass
    return None


def _table(rows: Sequence[Finding]) -> str:
    names = [field.name for field in dataclasses.fields(Finding)]
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(dataclasses.asdict(row) for row in rows)
    return text.getvalue()
