"""The summary that a command prints: the same answers as the page, in the terminal's width."""

import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path

from ..diagnosis.result import Diagnosis, NamedEffect
from ..identification.result import Estimate, Fit, Trace
from ..model.names import site_name
from .as_json import INPUT_FILE
from .diagnosis.next_steps import limit_text
from .diagnosis.places import when_sentences, where_sentences
from .files import PathLike
from .text.quantities import UNKNOWN, join_unit, percent, shown
from .text.rows import error_rows, is_changed, is_met, parameter_rows, parts, was_sought
from .text.tables import WIDTH, Table
from .text.words import CHANNELS, EQUATIONS, capital, effect_name, heading

_INDENT, _ERRORS = 12, 28
"""Letters of the margin, and of the first column in tables of errors."""
_MOST_LINES, _MOST_EFFECTS = 24, 4
"""Lines of a result in short, and effects that it names."""
_MOST_UNSEEN = 6
"""Effects that may hide and are listed here; the page has all."""


def describe_diagnosis(diagnosis: Diagnosis, folder: PathLike | None = None) -> str:
    """Verdict, place, named physics, rivals, and the fit before and after.

    Args:
        diagnosis: what to tell.
        folder: where its files were saved, which are then named.
    """
    lines = [
        heading(diagnosis.verdict, (e.kind for e in diagnosis.effects)).upper(),
        *_wrapped("", diagnosis.statement),
        "",
    ]
    if diagnosis.continued is not None:
        lines += [*_wrapped("Continued", diagnosis.continued.statement), ""]
    lines += _wrapped("Place", _place(diagnosis))
    for sentence in [*where_sentences(diagnosis), *when_sentences(diagnosis)]:
        lines += _wrapped("", sentence)
    if not diagnosis.effects:
        lines += _wrapped("Named", "nothing")
    for effect in diagnosis.effects:
        lines += _effect(effect, diagnosis)
    lines += ["", *_fit(diagnosis)]
    lines += _remarks(diagnosis.warnings, diagnosis.notes, diagnosis.traces)
    lines += _unseen(diagnosis)
    if diagnosis.next_experiment is not None:
        experiment = diagnosis.next_experiment
        chance = f" Expected chance of a wrong decision: {percent(experiment.expected_wrong)}."
        where = f" The input is in {Path(folder) / INPUT_FILE}." if folder is not None else ""
        lines += ["", *_wrapped("Record next", experiment.purpose + chance + where)]
    if folder is not None:
        lines += ["", f"{'Report':{_INDENT}}{Path(folder) / 'report.html'}"]
        lines += [f"{'':{_INDENT}}{Path(folder) / 'report.json'}, {Path(folder) / 'model.toml'}"]
    return "\n".join(lines) + "\n"


def describe_fit(fit: Fit, folder: PathLike | None = None) -> str:
    """The fitted numbers with their intervals, and how well they do.

    Args:
        fit: what to tell.
        folder: where its files were saved, which are then named.
    """
    lines = []
    known = fit.model.known
    for part in parts(fit):
        if part.kind is not None and part.site is not None:
            lines += ["", capital(effect_name(part.kind, part.site))]
        lines += _parameters(part.parameters, part.kind, part.site, known, "")
    for errors, which in ((fit.holdout, "Hold-out"), (fit.train, "Training")):
        if errors is not None:
            lines += ["", *_errors(f"{which}, whole recordings", None, errors.free_run, fit.noise)]
            lines += _errors(f"{which}, windows of {fit.window:g} s", None, errors.window, fit.noise)
    if not is_met(fit):
        lines += ["", *_wrapped("Next", "What remains is more than noise: jbridge diagnose looks for what is missing.")]
    lines += _remarks(fit.warnings, fit.notes, fit.traces)
    if folder is not None:
        lines += ["", f"{'Report':{_INDENT}}{Path(folder) / 'fit.html'}"]
        lines += [f"{'':{_INDENT}}{Path(folder) / 'fit.json'}, {Path(folder) / 'model.toml'}"]
    return "\n".join(lines) + "\n"


def diagnosis_in_short(diagnosis: Diagnosis) -> str:
    """The verdict, what was named and the error on the hold-out, on one screen."""
    said = heading(diagnosis.verdict, (e.kind for e in diagnosis.effects))
    lines = [f"Diagnosis: {said}", *_wrapped("", diagnosis.statement), *_wrapped("Place", _place(diagnosis))]
    for effect in diagnosis.effects[:_MOST_EFFECTS]:
        numbers = ", ".join(f"{key} {shown(estimate).text}" for key, estimate in effect.parameters.items())
        lines += _wrapped("Named", f"{effect_name(effect.kind, effect.site)} ({effect.status}): {numbers}", 2)
    more = len(diagnosis.effects) - _MOST_EFFECTS
    lines += _wrapped("", f"and {more} more") if more > 0 else []
    return _in_short(lines, _fit(diagnosis), "describe_diagnosis")


def fit_in_short(fit: Fit) -> str:
    """The fitted numbers with their intervals and the error, on one screen."""
    free = {name: estimate for name, estimate in fit.estimates.items() if estimate.std is not None}
    lines = [f"Fit: {len(free)} of {len(fit.estimates)} parameters estimated"]
    room = _MOST_LINES - 12
    for name, estimate in list(free.items())[:room]:
        lines.append("  " + textwrap.shorten(f"{name} {shown(estimate).text}", WIDTH - 2, placeholder=" ..."))
    lines += [f"  and {len(free) - room} more"] if len(free) > room else []
    errors, which = (fit.holdout, "Hold-out") if fit.holdout else (fit.train, "Training")
    return _in_short(lines, _errors(f"{which}, whole recordings", None, errors.free_run, fit.noise), "describe_fit")


def _in_short(lines: list[str], errors: list[str], describe: str) -> str:
    """So many lines that the errors, and where to find more, have room below."""
    more = f"More: .plot(), .to_dataframe(), .save(folder), print(jbridge.{describe}(...))"
    return "\n".join([*lines[: _MOST_LINES - len(errors) - 1], *errors, more])


def _place(diagnosis: Diagnosis) -> str:
    location = diagnosis.location
    if diagnosis.adequacy.alarm and not was_sought(diagnosis):
        return "not looked for"
    if location.site is None:
        equation = EQUATIONS.get(location.equation)
        return f"no single place in the {equation}" if equation else "none"
    share = location.sites.get(location.site)
    evidence = f", {percent(share)} of the criterion's gain" if share is not None else ""
    return f"{site_name(location.site)} ({EQUATIONS.get(location.equation, 'no equation')}){evidence}"


def _effect(effect: NamedEffect, diagnosis: Diagnosis) -> list[str]:
    chance = f", {effect.status}" + ("" if effect.recording is None else f" in {effect.recording}")
    chance += "" if effect.probability is None else f", probability {percent(effect.probability)}"
    chance += "" if effect.in_model else "; model.toml leaves it out"
    lines = _wrapped("Named", effect_name(effect.kind, effect.site) + chance)
    lines += _parameters(effect.parameters, effect.kind, effect.site, diagnosis.model.known, " " * (_INDENT + 2))
    for rival in effect.equivalents:
        said = f"cannot be told from: {effect_name(rival.kind, rival.site)}, probability {percent(rival.probability)}"
        lines += _wrapped("", said)
    return lines


def _parameters(
    parameters: Mapping[str, Estimate], kind: str | None, site: str | None, known: Iterable[str], indent: str
) -> list[str]:
    rows = parameter_rows(parameters, kind, site, set(known))
    width = max((len(row.name) for row in rows), default=0)
    lines = []
    for row in rows:
        behind = "" if row.interval == UNKNOWN else row.interval
        if " to " in behind:
            behind = f"95 %: {behind}"
        text = join_unit(row.value, row.unit) + (f"   ({behind})" if behind else "")
        lines += textwrap.wrap(
            text,
            WIDTH,
            initial_indent=f"{indent}{row.name:{width}}  ",
            subsequent_indent=" " * (len(indent) + width + 2),
        )
    return lines


def _fit(diagnosis: Diagnosis) -> list[str]:
    before, after = diagnosis.holdout_before, diagnosis.holdout_after
    changed = is_changed(diagnosis)
    lines = _errors("Hold-out, whole recordings", before.free_run if changed else None, after.free_run, diagnosis.noise)
    title = f"Hold-out, windows of {diagnosis.window:g} s"
    return lines + _errors(title, before.window if changed else None, after.window, diagnosis.noise)


def _errors(
    title: str, before: Mapping[str, float] | None, after: Mapping[str, float], noise: Mapping[str, float]
) -> list[str]:
    """A table of errors, by channel."""
    rows = error_rows(before, after, noise)
    head = ["rms error (× noise)"] if before is None else ["before (× noise)", "after (× noise)"]
    head.append("noise")
    cells = []
    for row in rows:
        first = [_with_ratio(row.before, row.before_ratio)] if before is not None else []
        cells.append([f"  {CHANNELS[row.channel]}", *first, _with_ratio(row.after, row.after_ratio), row.noise])
    return Table([title, *head], cells, range(1, 4)).lines(_ERRORS)


def _remarks(warnings: Iterable[str], notes: Iterable[str], traces: Iterable[Trace]) -> list[str]:
    """Warnings, and notes on the run as a whole; how each recording was read is told by the page."""
    files = tuple(f"{trace.recording}: " for trace in traces)
    named = [("Warning", text) for text in warnings]
    named += [("Note", text) for text in notes if not text.startswith(files)]
    lines = [line for name, text in named for line in _wrapped(name, text)]
    return ["", *lines] if lines else []


def _unseen(diagnosis: Diagnosis) -> list[str]:
    """What may hide in the recordings and is more than noise; each effect once."""
    limits: dict[str, str] = {}
    for row in diagnosis.not_seen:
        if row.notable:
            how = "beyond" if row.parameter in ("stiffness", "limit", "position") else "up to"
            size = f" ({how} {limit_text(row)})" if row.limit is not None else ""
            limits.setdefault(effect_name(row.kind, row.site), size)
    if not limits:
        return []
    named = [name + size for name, size in limits.items()]
    more = f"; and {len(named) - _MOST_UNSEEN} more, see the report" if len(named) > _MOST_UNSEEN else ""
    return ["", *_wrapped("Unseen", f"not excluded by these recordings: {'; '.join(named[:_MOST_UNSEEN])}{more}.")]


def _with_ratio(error: str, ratio: str) -> str:
    return error if ratio == UNKNOWN else f"{error} ({ratio.removesuffix(' noise')})"


def _wrapped(name: str, text: str, most: int | None = None) -> list[str]:
    """A paragraph behind a name in the margin, of so many lines at most."""
    first, later = f"{name:{_INDENT}}", " " * _INDENT
    lines = textwrap.wrap(
        text, WIDTH, initial_indent=first, subsequent_indent=later, max_lines=most, placeholder=" ..."
    )
    return lines or [name]
