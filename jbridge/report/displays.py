"""Results as a text that fits on a screen, a piece of a page, a figure, a table and files: see `_display`."""

from collections.abc import Iterable, Mapping
from functools import singledispatch
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .._files import make_folder
from ..diagnosis.result import Diagnosis, NamedEffect
from ..identification.identifiability import Identifiability
from ..identification.result import Estimate, Fit
from ..prediction import Simulation
from ..recordings import Inspection, save_csv
from ..simulation.tracking import Tracking
from ..sweep.run import SweepResult, read_sweep
from ..tuning.tune import Tuning
from .check import describe_check, describe_identifiability, save_check
from .control.tracking import describe_tracking
from .control.tuning import describe_tuning, save_tuning
from .diagnosis.page import diagnosis_summary
from .figures.gallery import diagnosis_signals, fit_signals, simulation_signals
from .files import PathLike
from .fit_page import fit_summary
from .save import save_fit, save_report
from .terminal import diagnosis_in_short, fit_in_short
from .text.html import piece
from .text.quantities import digits
from .text.rows import error_rows, parts
from .text.words import CHANNELS

_LINES = 24
"""Of a text that fits on a screen."""
COLUMNS = ("parameter", "kind", "site", "value", "std", "low", "high", "unit", "status", "probability")
"""Columns of a table of estimates; `kind` and `site` are None for numbers of the bridge."""


@singledispatch
def text(result: Any) -> str:
    """A result in at most 24 lines of 80 letters."""
    raise TypeError(f"no display of {type(result).__name__}")


@singledispatch
def html(result: Any) -> str:
    """A result as a piece of a page, for notebooks; by default its text."""
    return f"<pre>{escape(text(result))}</pre>"


@singledispatch
def figure(result: Any, recording: str | None = None) -> Figure:
    """A recording of a result beside its simulations."""
    raise TypeError(f"a {type(result).__name__} has no figure")


@singledispatch
def columns(result: Any) -> Mapping[str, Any]:
    """The numbers of a result as columns of equal length."""
    raise TypeError(f"a {type(result).__name__} has no table")


@singledispatch
def save(result: Any, folder: PathLike) -> Path:
    """Writes what the result's command writes."""
    raise TypeError(f"a {type(result).__name__} has no file")


def _in_short(told: str) -> str:
    """A text, cut where it is longer than a screen."""
    lines = told.rstrip().splitlines()
    return "\n".join(lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "..."])


@text.register
def _(result: Tracking) -> str:
    moved = f"{len(result.moves)} move{'s' if len(result.moves) != 1 else ''}"
    return _in_short(f"Tracking: {len(result.times)} samples, {moved}\n{describe_tracking(result)}")


@text.register
def _(result: Tuning) -> str:
    return _in_short(f"Tuning\n{describe_tuning(result)}")


@text.register
def _(result: SweepResult) -> str:
    return (
        f"Sweep in {result.folder}: {result.count:,} rollouts, {result.failed:,} failed\n"
        f"{result.computed:,} of them computed now, in {result.seconds:.1f} s"
    )


@text.register
def _(result: Inspection) -> str:
    return _in_short(f"Inspection of {result.path}\n{describe_check([result], None)}")


@text.register
def _(result: Identifiability) -> str:
    return _in_short(describe_identifiability(result))


text.register(Fit, fit_in_short)
text.register(Diagnosis, diagnosis_in_short)
html.register(Fit, fit_summary)
html.register(Diagnosis, diagnosis_summary)


@text.register
def _(result: Simulation) -> str:
    name, rows = result.recording.name, len(result["t"])
    lines = [f"Simulation of {name}: {rows} rows over {digits(result.recording.duration)} s of {', '.join(result)}"]
    for row in error_rows(None, result.errors, {}):
        lines.append(f"  {CHANNELS[row.channel]}: rms error {row.after}")
    return "\n".join(lines)


@html.register
def _(result: Simulation) -> str:
    sentence, picture = text(result).partition("\n")[0], simulation_signals(result)
    return piece("simulation_summary.html", sentence=sentence, errors=result.errors, picture=picture)


@figure.register
def _(result: Fit, recording: str | None = None) -> Figure:
    return fit_signals(result, recording).figure


@figure.register
def _(result: Diagnosis, recording: str | None = None) -> Figure:
    return diagnosis_signals(result, recording).figure


@figure.register
def _(result: Simulation, recording: str | None = None) -> Figure:
    return simulation_signals(result).figure


@columns.register
def _(result: Simulation) -> Mapping[str, Any]:
    return dict(result)


@columns.register
def _(result: Tracking) -> Mapping[str, Any]:
    return result.columns


@columns.register
def _(result: SweepResult) -> Mapping[str, Any]:
    return read_sweep(result.folder)


@columns.register
def _(result: Identifiability) -> Mapping[str, Any]:
    return _as_columns(_rows(None, None, result.parameters))


@columns.register
def _(result: Fit) -> Mapping[str, Any]:
    return _as_columns(row for part in parts(result) for row in _rows(part.kind, part.site, part.parameters))


@columns.register
def _(result: Diagnosis) -> Mapping[str, Any]:
    def of(effect: NamedEffect, status: str | None) -> list[tuple[Any, ...]]:
        return _rows(effect.kind, effect.site, effect.parameters, status, effect.probability)

    named = [row for effect in result.effects for row in of(effect, effect.status)]
    own = [row for effect in result.model_effects for row in of(effect, None)]
    return _as_columns([*named, *own, *_rows(None, None, result.bridge)])


@save.register
def _(result: Fit, folder: PathLike) -> Path:
    return save_fit(folder, result)


@save.register
def _(result: Diagnosis, folder: PathLike) -> Path:
    return save_report(folder, result)


@save.register
def _(result: Tuning, folder: PathLike) -> Path:
    return save_tuning(folder, result)


@save.register
def _(result: Inspection, folder: PathLike) -> Path:
    return save_check(folder, [result], describe_check([result], None))


@save.register
def _(result: Simulation, folder: PathLike) -> Path:
    """Into a file of that name if it ends in `.csv`, else as `simulated.csv` into a folder."""
    target = Path(folder)
    target = target if target.suffix.lower() == ".csv" else target / "simulated.csv"
    make_folder(target.parent)
    save_csv(target, result)
    return target


def _rows(
    kind: str | None,
    site: str | None,
    parameters: Mapping[str, Estimate],
    status: str | None = None,
    probability: float | None = None,
) -> list[tuple[Any, ...]]:
    """A row for each number, in the order of `COLUMNS`; entries of lists are called `name[0]` and so on."""
    rows: list[tuple[Any, ...]] = []
    for name, estimate in parameters.items():
        numbers = (estimate.value, estimate.std, estimate.low, estimate.high)
        if isinstance(estimate.value, list):
            for k in range(len(estimate.value)):
                own = (each[k] if isinstance(each, list) else each for each in numbers)
                rows.append((f"{name}[{k}]", kind, site, *map(_number, own), estimate.unit, status, probability))
        else:
            rows.append((name, kind, site, *map(_number, numbers), estimate.unit, status, probability))
    return rows


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


def _as_columns(rows: Iterable[tuple[Any, ...]]) -> Mapping[str, Any]:
    listed = list(rows)
    return {name: [row[k] for row in listed] for k, name in enumerate(COLUMNS)}
