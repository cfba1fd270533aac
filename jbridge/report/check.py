"""How recordings were read, what is wrong with them, and which parameters they determine, before anything is fitted."""

import re
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..errors import listed
from ..identification.data.noise import noise_floor
from ..identification.identifiability import Identifiability
from ..recordings import Inspection, Recording
from .figures.recordings import draw_recordings
from .files import PathLike, alone_in_folder, write_bytes, write_text
from .text.html import page
from .text.quantities import digits, join_unit, percent, scale_for
from .text.rows import error_text
from .text.words import CHANNELS

_WIDTH = 80
_NUMBER = re.compile(r"\d[\d.e+-]*")
_TABLE = re.compile(r"\[(columns|locked|trim)\]")
_INPUTS = {"u_x": "input of the cart", "u_l": "input of the hoist"}
_SIGNS = {
    True: "fits the laws of motion",
    False: "contradicts the laws of motion",
    None: "cannot be told from this recording",
}
_LOOSE = 0.5
"""Relative standard deviation above which a fit says that recordings hardly determine a number."""


def describe_check(inspections: Sequence[Inspection], found: Identifiability | None, model_problem: str = "") -> str:
    """Every problem first, then how each file was read, then which parameters the recordings determine.

    Args:
        inspections: of the files.
        found: what a fit could tell, if there was a model.
        model_problem: why model and recordings do not go together, if so.
    """
    problems = shared_problems(inspections) + ([model_problem] if model_problem else [])
    if problems:
        # A line that mends something is to be copied, so that it is not broken.
        lines = [f"{len(problems)} PROBLEM{'S' if len(problems) > 1 else ''}", *(f"- {text}" for text in problems)]
    else:
        lines = ["NO PROBLEM FOUND IN THE RECORDINGS"]
    for each in inspections:
        if each.recording is not None:
            lines += ["", *_recording(each, each.recording)]
    if found is not None:
        lines += ["", describe_identifiability(found)]
    return "\n".join(lines) + "\n"


def shared_problems(inspections: Sequence[Inspection], *, forced: bool = False) -> list[str]:
    """Returns the problems, one that several files of a folder share only once: with what mends it for all of them.

    Args:
        inspections: of the files.
        forced: whether to return only those with which nothing can be read, whatever is forced.
    """
    found: dict[tuple[str, ...], list[tuple[Path, str]]] = {}
    for each in inspections:
        path = Path(each.path)
        for problem in filter(None, [each.refusal]) if forced else each.problems:
            said = problem.replace(each.path, "").replace(path.with_suffix(".toml").name, "")
            found.setdefault((str(path.parent), path.suffix, _NUMBER.sub("", said)), []).append((path, problem))
    problems = []
    for (_, suffix, _), shared in found.items():
        (path, problem), *others = shared
        if others:
            problem = problem.replace(path.with_suffix(".toml").name, "recordings.toml")
            problem = _TABLE.sub(rf'["*{suffix}".\1]', problem)
            problem += f" (likewise {listed((other.name for other, _ in others), limit=3)})"
        problems.append(problem)
    return problems


@alone_in_folder
def save_check(folder: PathLike, inspections: Sequence[Inspection], text: str) -> Path:
    """Writes check.png (and check-2.png, ... for many recordings) and check.html; each file is replaced at once.

    Args:
        folder: where to.
        inspections: of the files.
        text: what `describe_check` said.

    Returns:
        The path of check.html.

    Raises:
        InputError: if a file cannot be written.
    """
    target = Path(folder)
    pictures = draw_recordings("check", [each.recording for each in inspections if each.recording is not None])
    for picture in pictures:
        write_bytes(target / f"{picture.name}.png", picture.png)
    write_text(target / "check.html", page("check.html", text=text, pictures=pictures))
    return target / "check.html"


def _recording(inspection: Inspection, recording: Recording) -> Iterator[str]:
    steps = np.diff(recording.times)
    rate = f"a row every {1e3 * recording.period:.4g} ms"
    if steps.max() > 1.01 * steps.min():
        rate += f" (from {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms)"
    gaps = int(np.count_nonzero(steps > 3 * recording.period))
    yield f"{recording.name}: {len(recording.times)} rows, {recording.duration:.4g} s, {rate}, {_count(gaps, 'gap')}"
    noise = noise_floor([recording])
    for channel, column in inspection.columns.items():
        values = getattr(recording, channel, None)
        if values is None:
            continue
        sign = ", sign -1" if column.sign < 0 else ""
        late = f", late {column.late}" if column.late else ""
        read = f"{channel:4} from {column.name} [{column.unit}{sign}{late}]"
        unit = recording.units.get(channel) or ("rad" if channel == "psi" else "m")
        scale = scale_for(unit, []) if channel == "psi" else None
        factor, shown = (scale.factor, scale.unit) if scale else (1.0, unit)
        low, high = (digits(float(factor * edge), 4) for edge in (np.min(values), np.max(values)))
        parts = [f"{low} to {join_unit(high, shown)}"]
        if channel in noise:
            parts.append(f"noise {error_text(channel, noise[channel])}")
            size = recording.resolution.get(channel, 0.0)
            parts.append(f"count {error_text(channel, size)}" if size > 0 else "no count to be seen")
            fresh = np.count_nonzero(recording.fresh[channel]) / len(recording.times)
            if fresh < 0.99:
                parts.append(f"new in {percent(float(fresh))} of the rows")
        if np.ptp(values) == 0:
            parts.append("never changes" + ("; is the sensor connected?" if channel in ("x", "psi") else ""))
        yield from textwrap.wrap(f"  {read}: {'; '.join(parts)}", _WIDTH, subsequent_indent="       ")
    if recording.locked_length is not None:
        yield f"  rope locked at {recording.locked_length:.4g} m"
    for name, right in inspection.signs.items():
        yield f"  sign of {(CHANNELS | _INPUTS)[name].removesuffix(' ' + name)} {name}: {_SIGNS[right]}"
    for note in recording.notes:
        yield from textwrap.wrap(note, _WIDTH, initial_indent="  - ", subsequent_indent="    ")


def describe_identifiability(found: Identifiability) -> str:
    """Which parameters recordings determine, and how well."""
    return "\n".join(_numbers(found))


def _numbers(found: Identifiability) -> Iterator[str]:
    yield "Parameters that a fit would estimate, as accurately as a complete model allows"
    width = max(map(len, found.estimated), default=0)
    for name in found.estimated:
        estimate = found.parameters[name]
        value, std = estimate.value, estimate.std
        if isinstance(value, list) or isinstance(std, list):
            yield f"  {name:{width}} a table of {len(value) if isinstance(value, list) else 1}"
            continue
        start = join_unit(digits(value), estimate.unit)
        if std is None:
            verdict = "not at all"
        elif not value:
            verdict = f"to {join_unit(digits(std, 2), estimate.unit)}"
        else:
            share = abs(std / value)
            verdict = f"to {digits(100 * share, 2)} %" if share < _LOOSE else f"hardly, to {100 * share:.0f} %"
        yield f"  {name:{width}} {start:>16}  {verdict}"
    for text in (*found.warnings, *found.notes):
        yield from textwrap.wrap(text, _WIDTH, initial_indent="  - ", subsequent_indent="    ")


def _count(number: int, what: str) -> str:
    return f"no {what}" if number == 0 else f"{number} {what}{'s' if number > 1 else ''}"
