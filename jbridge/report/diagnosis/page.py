"""`report.html`: the verdict first, then the proof, then what a rig's owner needs in order to believe it.

What stands where is the matter of `assets/diagnosis.html`; here are the words and tables that it shows.
"""

from collections.abc import Sequence
from typing import Any

from ...diagnosis.criteria import CRITERIA
from ...diagnosis.result import Diagnosis, NamedEffect
from ...model.names import site_name
from ..figures.gallery import Gallery, diagnosis_signals
from ..interactive import report_data
from ..text.html import page, piece
from ..text.quantities import UNKNOWN, percent, shown
from ..text.rows import error_rows, error_text, is_changed, was_sought
from ..text.tables import Table, errors_table, parameter_tables
from ..text.words import CHANNELS, EQUATIONS, capital, effect_meaning, effect_name, heading
from .next_steps import decided_table, limits_table, unlimited
from .places import when_sentences, where_sentences
from .trials import trial_table

LEAST_FALL = 0.1
"""Fall of the share of a force that repeats which is worth a sentence."""
LEAST_RISE = 1.1
"""Error over that of the model as given from which on a channel that is not met is said to be met worse."""


def diagnosis_page(diagnosis: Diagnosis, gallery: Gallery) -> str:
    """The page as HTML, with everything that it needs inside."""
    moves = bool(diagnosis.traces)
    return page(
        "diagnosis.html",
        styles=("uplot.min.css",) if moves else (),
        scripts=("uplot.min.js", "report.js") if moves else (),
        data=report_data(diagnosis) if moves else None,
        gallery=gallery,
        maps=gallery.maps or {},
        changed=is_changed(diagnosis),
        repeatable=_repeatable(diagnosis),
        where=[*where_sentences(diagnosis), *when_sentences(diagnosis)],
        decided=decided_table(diagnosis.continued),
        invisible=unlimited(diagnosis.not_seen),
        notable=limits_table(row for row in diagnosis.not_seen if row.notable and row.limit is not None),
        negligible=limits_table(row for row in diagnosis.not_seen if not row.notable and row.limit is not None),
        notes=_gathered(diagnosis.notes),
        trials=trial_table(diagnosis.trials),
        settings=Table(("setting", "value"), [(name, str(value)) for name, value in diagnosis.settings.items()]),
        **_shared(diagnosis),
    )


def diagnosis_summary(diagnosis: Diagnosis) -> str:
    """Verdict, facts, what was named and the proof as a piece of HTML, for notebooks."""
    return piece("diagnosis_summary.html", picture=diagnosis_signals(diagnosis), **_shared(diagnosis))


def _shared(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the page and the summary both show."""
    return {
        "diagnosis": diagnosis,
        "heading": heading(diagnosis.verdict, (e.kind for e in diagnosis.effects)),
        "facts": _facts(diagnosis),
        "named": [_named(effect, diagnosis) for effect in diagnosis.effects],
        "proof": _proof(diagnosis),
    }


def _facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """What the first screen answers."""
    location = diagnosis.location
    place = site_name(location.site) if was_sought(diagnosis) else "not looked for"
    if location.equation in EQUATIONS:
        place += f" ({EQUATIONS[location.equation]})"
    lasting = [effect_name(e.kind, e.site) for e in diagnosis.effects if e.recording is None]
    once = [f"{effect_name(e.kind, e.site)}, once, in {e.recording}" for e in diagnosis.effects if e.recording]
    missing = lasting or ["nothing" if diagnosis.verdict == "adequate" else "not known"]
    return [
        ("What is missing", capital("; ".join([*missing, *once]))),
        ("Where", capital(place) if diagnosis.adequacy.alarm or location.equation in EQUATIONS else "none"),
        ("How much better, on the hold-out" if is_changed(diagnosis) else "Error on the hold-out", _worst(diagnosis)),
        ("How sure", _sure(diagnosis)),
        ("What remains", "noise, or scatter between repeats" if diagnosis.complete else "more than noise"),
        ("What to do next", _next(diagnosis)),
    ]


def _sure(diagnosis: Diagnosis) -> str:
    """Status and probability of each named effect, with its name where there are several."""
    said = {"confirmed": "confirmed by the hold-out", "suggested": "suggested", "event": "a single event"}
    each = []
    for effect in diagnosis.effects:
        how = said[effect.status]
        if _by_most_alone(effect):
            how = "confirmed by most windows of the hold-out, though not by those with the largest errors"
        name = f"{effect_name(effect.kind, effect.site)}: " if len(diagnosis.effects) > 1 else ""
        chance = "" if effect.probability is None else f", probability {percent(effect.probability)}"
        each.append(name + how + chance)
    return "; ".join(each) or UNKNOWN


def _by_most_alone(effect: NamedEffect) -> bool:
    """Whether most windows of the hold-out confirm an effect, but the sum of squared errors shows none of it."""
    return effect.status == "confirmed" and effect.explained is not None and effect.explained <= 0.0


def _next(diagnosis: Diagnosis) -> str:
    if diagnosis.next_experiment is not None:
        return "play next_experiment.csv on the rig and record it, see below"
    if diagnosis.stopped == "budget":
        return "run it again with a larger --budget"
    if not diagnosis.complete:
        return "record more motion where the error arises"
    has = any(effect.in_model for effect in diagnosis.effects)
    return "simulate with model.toml, which has it" if has else "simulate with model.toml"


def _worst(diagnosis: Diagnosis) -> str:
    """The hold-out error of the channel that was worst, in units and as a multiple of the noise, and what got worse."""
    before, after = diagnosis.holdout_before.free_run, diagnosis.holdout_after.free_run
    noise = diagnosis.noise
    ratios = {channel: before[channel] / noise[channel] for channel in before if noise.get(channel)}
    if not ratios:
        return UNKNOWN
    worst = max(ratios, key=lambda name: ratios[name])
    rows = {row.channel: row for row in error_rows(before, after, noise)}
    if not is_changed(diagnosis):
        return f"{CHANNELS[worst]}: {rows[worst].after} ({rows[worst].after_ratio})"
    least = {channel: max(LEAST_RISE * before[channel], CRITERIA.met * noise[channel]) for channel in ratios}
    risen = [channel for channel in ratios if after[channel] > least[channel]]
    said = {
        channel: f"{CHANNELS[channel]}: {rows[channel].before} to {rows[channel].after} ({rows[channel].after_ratio})"
        for channel in dict.fromkeys((worst, *risen))
    }
    return "; ".join(f"worse in {text}" if channel in risen else text for channel, text in said.items())


def _proof(diagnosis: Diagnosis) -> list[tuple[str, Table]]:
    """Tables of errors with their titles."""
    before, after = diagnosis.holdout_before, diagnosis.holdout_after
    rows = (
        ("Hold-out, whole recordings", before.free_run, after.free_run),
        (f"Hold-out, windows of {diagnosis.window:g} s", before.window, after.window),
        ("Training recordings, whole", diagnosis.train_before.free_run, diagnosis.train_after.free_run),
    )
    changed = is_changed(diagnosis)
    return [(title, errors_table(old if changed else None, new, diagnosis.noise)) for title, old, new in rows]


def _gathered(notes: Sequence[str]) -> list[str]:
    """Notes on recordings, `NAME: sentence`, with the names of all to which one sentence applies."""
    names: dict[str, list[str]] = {}
    for note in notes:
        name, colon, sentence = note.partition(": ")
        names.setdefault(sentence if colon else note, []).extend([name] if colon else [])
    return [f"{', '.join(of)}: {sentence}" if of else sentence for sentence, of in names.items()]


def _repeatable(diagnosis: Diagnosis) -> str:
    before, after = diagnosis.adequacy.repeatable_before, diagnosis.adequacy.repeatable_after
    if before is None or (after is not None and before - after < LEAST_FALL):
        return ""
    said = f"Of the force that it leaves unexplained, {percent(before)} repeats from recording to recording"
    return f"{said}; with the final model {percent(after)}." if after is not None else f"{said}."


def _named(effect: NamedEffect, diagnosis: Diagnosis) -> dict[str, Any]:
    """What the page says of an effect that was named."""
    name = capital(effect_name(effect.kind, effect.site))
    chance = "" if effect.probability is None else f", probability {percent(effect.probability)}"
    return {
        "key": (effect.kind, effect.site),
        "title": f"{name} - {effect.status}{chance}",
        "statement": effect.statement or capital(effect_meaning(effect.kind, effect.site)),
        "status": _status(effect),
        "parameters": parameter_tables(effect.parameters, effect.kind, effect.site, diagnosis.model.known),
        "rivals": _rivals(effect, diagnosis),
        "compared": effect.probability is not None,
    }


def _status(effect: NamedEffect) -> str:
    """What the hold-out says of an effect."""
    share = (
        "" if effect.explained is None else f" Without it {percent(effect.explained)} of the error at 1 s comes back."
    )
    if _by_most_alone(effect):
        return (
            "Confirmed: without it most windows of the hold-out are met worse, by more than two standard errors. The"
            " sum of squared errors at 1 s shows nothing of it: the windows with the largest errors, which make up most"
            " of it, are met no better."
        )
    if effect.status == "confirmed":
        return f"Confirmed: without it the hold-out is worse by more than two standard errors.{share}"
    if effect.status == "event":
        where = "in these recordings alone" if effect.recording is None else f"in {effect.recording} alone"
        return f"An event: it happened once, {where}, and the model file leaves it out."
    if not effect.in_model:
        return "Suggested: the recordings ask for it, but the hold-out speaks against it: not in the model file."
    return f"Suggested: the training recordings ask for it, and the hold-out does not decide.{share}"


def _rivals(effect: NamedEffect, diagnosis: Diagnosis) -> Table:
    """The effect beside those that the recordings cannot tell it from; no rows where there are none."""
    channels = [channel for channel in CHANNELS if any(channel in rival.holdout for rival in effect.equivalents)]
    rows = [
        (
            f"{capital(effect_name(rival.kind, rival.site))}: {effect_meaning(rival.kind, rival.site)}".removesuffix(
                ": "
            ),
            percent(rival.probability),
            "\n".join(_unbroken(f"{key} {shown(estimate).text}") for key, estimate in rival.parameters.items()),
            *(error_text(channel, rival.holdout.get(channel)) for channel in channels),
        )
        for rival in effect.equivalents
    ]
    own = (
        capital(effect_name(effect.kind, effect.site)),
        percent(effect.probability),
        "as above",
        *(error_text(channel, diagnosis.holdout_after.free_run.get(channel)) for channel in channels),
    )
    return Table(
        ("explanation", "probability", "with", *(f"error in {channel}" for channel in channels)),
        [own, *rows] if rows else [],
        (1, *range(3, 3 + len(channels))),
    )


def _unbroken(text: str) -> str:
    """A text that stays on one line."""
    return text.replace(" ", "\u00a0")
