"""`report.html`: the verdict first, then the proof, then what a rig's owner needs in order to believe it."""

from collections.abc import Mapping

from ...diagnosis.result import Diagnosis, NamedEffect
from ...model.names import site_name
from ..figures.gallery import Gallery, diagnosis_signals
from ..interactive import assets, interactive_part
from ..text.html import (
    bullets,
    element,
    fold,
    page,
    paragraph,
    parameter_tables,
    section,
    show,
    show_all,
    table,
    tag,
)
from ..text.quantities import UNKNOWN, digits, percent, shown
from ..text.rows import error_rows, error_text, is_changed
from ..text.words import CHANNELS, EQUATIONS, capital, effect_meaning, effect_name, heading
from .next_steps import continued_section, next_section, not_seen_section
from .places import when_sentences, where_sentences
from .trials import trial_table


def diagnosis_page(diagnosis: Diagnosis, gallery: Gallery) -> str:
    """The page as HTML, with everything that it needs inside."""
    style, scripts = assets() if diagnosis.traces else ("", ())
    return page(
        f"{heading(diagnosis.verdict, (e.kind for e in diagnosis.effects))} - jbridge",
        [
            _header(diagnosis),
            continued_section(diagnosis),
            _fit(diagnosis, gallery),
            _effects(diagnosis, gallery),
            _place(diagnosis, gallery),
            section("Recorded and simulated", interactive_part(diagnosis), show_all(gallery.signals)),
            section("What simulation leaves", show_all(gallery.residuals)),
            _parameters(diagnosis, gallery),
            not_seen_section(diagnosis),
            next_section(diagnosis),
            _trials(diagnosis),
            section("What the recordings hardly tell", bullets(diagnosis.warnings, "warnings")),
            section("Notes on the recordings", bullets(diagnosis.notes)),
            _footer(diagnosis),
        ],
        style,
        scripts,
    )


def diagnosis_summary(diagnosis: Diagnosis) -> str:
    """Verdict, facts, what was named and the proof as a piece of HTML, for notebooks."""
    before = diagnosis.holdout_before.free_run if is_changed(diagnosis) else None
    pieces = [_header(diagnosis), *(_effect(effect, diagnosis, Gallery()) for effect in diagnosis.effects)]
    if diagnosis.holdout_after.free_run:
        pieces += [tag("h3", "Hold-out, whole recordings")]
        pieces += [errors_table(before, diagnosis.holdout_after.free_run, diagnosis.noise)]
    pieces += [bullets(diagnosis.warnings, "warnings")]
    return element("div", "\n".join([*pieces, show(diagnosis_signals(diagnosis))]))


def _header(diagnosis: Diagnosis) -> str:
    location = diagnosis.location
    place = site_name(location.site)
    if location.equation in EQUATIONS:
        place += f" ({EQUATIONS[location.equation]})"
    named = "; ".join(effect_name(effect.kind, effect.site) for effect in diagnosis.effects)
    facts = [
        ("Place", capital(place) if diagnosis.adequacy.alarm or location.equation in EQUATIONS else "none"),
        ("Named physics", capital(named) if named else "none"),
        ("Hold-out error, before and after" if is_changed(diagnosis) else "Hold-out error", _worst(diagnosis)),
        ("How sure", _sure(diagnosis)),
        ("What remains", "noise or measured scatter" if diagnosis.complete else "more than noise"),
        ("What to do next", _next(diagnosis)),
    ]
    shown_facts = "".join(element("div", tag("dt", name) + tag("dd", value)) for name, value in facts)
    return element(
        "header",
        tag("p", heading(diagnosis.verdict, (e.kind for e in diagnosis.effects)), "verdict")
        + tag("h1", diagnosis.statement)
        + element("dl", shown_facts),
        diagnosis.verdict or "unknown",
    )


def _sure(diagnosis: Diagnosis) -> str:
    """Status and probability of each named effect."""
    return "; ".join(f"{e.status}, {percent(e.probability)}" for e in diagnosis.effects) or UNKNOWN


def _next(diagnosis: Diagnosis) -> str:
    if diagnosis.next_experiment is not None:
        return "record next_experiment.csv, see below"
    if diagnosis.stopped == "budget":
        return "repeat it with a larger --budget"
    return "use model.toml" if diagnosis.complete else "record more motion where the mismatch sits"


def _worst(diagnosis: Diagnosis) -> str:
    """The hold-out error of the channel that was worst, in units and as a multiple of the noise."""
    before, after = diagnosis.holdout_before.free_run, diagnosis.holdout_after.free_run
    noise = diagnosis.noise
    ratios = {channel: before[channel] / noise[channel] for channel in before if noise.get(channel)}
    if not ratios:
        return UNKNOWN
    channel = max(ratios, key=lambda name: ratios[name])
    row = error_rows({channel: before[channel]}, {channel: after[channel]}, noise)[0]
    if is_changed(diagnosis):
        return f"{CHANNELS[channel]}: {row.before} to {row.after} ({row.after_ratio})"
    return f"{CHANNELS[channel]}: {row.after} ({row.after_ratio})"


def _fit(diagnosis: Diagnosis, gallery: Gallery) -> str:
    names = ", ".join(diagnosis.holdout)
    changed = is_changed(diagnosis)
    explained = (
        " 'Before' is the model as given with its unknown numbers fitted anew, 'after' the final model."
        if changed
        else ""
    )
    return section(
        "How well it fits, before and after" if changed else "How well it fits",
        paragraph(
            f"The proof is on recordings that no number was learned from: {names}."
            if names
            else "No recording was held out."
        ),
        show_all(gallery.improvement),
        tag("h3", "Hold-out, whole recordings"),
        errors_table(
            diagnosis.holdout_before.free_run if changed else None, diagnosis.holdout_after.free_run, diagnosis.noise
        ),
        tag("h3", f"Hold-out, windows of {diagnosis.window:g} s"),
        errors_table(
            diagnosis.holdout_before.window if changed else None, diagnosis.holdout_after.window, diagnosis.noise
        ),
        tag("h3", "Training recordings, whole"),
        errors_table(
            diagnosis.train_before.free_run if changed else None, diagnosis.train_after.free_run, diagnosis.noise
        ),
        paragraph(f"{_alarm(diagnosis)} {_repeatable(diagnosis)}"),
        paragraph(
            "Errors are root mean squares of simulations that are given the inputs and the start alone."
            f"{explained} An error of 1 × noise is as good as the sensors can show. In windows a simulation starts anew"
            " each time, so slow drift counts less.",
            "soft",
        ),
    )


def _alarm(diagnosis: Diagnosis) -> str:
    if diagnosis.adequacy.alarm:
        return "The model as given does not explain the recordings."
    return "The model as given, refitted, explains what can be explained."


def _repeatable(diagnosis: Diagnosis) -> str:
    before, after = diagnosis.adequacy.repeatable_before, diagnosis.adequacy.repeatable_after
    if before is None:
        return ""
    said = f"Of the force that it leaves unexplained, {percent(before)} repeats from recording to recording"
    return f"{said}; with the final model {percent(after)}." if after is not None else f"{said}."


def errors_table(before: Mapping[str, float] | None, after: Mapping[str, float], noise: Mapping[str, float]) -> str:
    """A table of errors per channel; without the columns of before and of the gap where there is no before."""
    rows = error_rows(before, after, noise)
    if before is None:
        return table(
            ("channel", "rms error", "", "noise"),
            [(CHANNELS[row.channel], row.after, row.after_ratio, row.noise) for row in rows],
            numbers=(1, 2, 3),
        )
    return table(
        ("channel", "before", "", "after", "", "noise", "gap closed"),
        [
            (
                CHANNELS[row.channel],
                row.before,
                row.before_ratio,
                row.after,
                row.after_ratio,
                row.noise,
                row.closed,
            )
            for row in rows
        ],
        numbers=(1, 2, 3, 4, 5, 6),
    )


def _effects(diagnosis: Diagnosis, gallery: Gallery) -> str:
    if not diagnosis.effects:
        none = {
            "adequate": "Nothing needs to be added to the model.",
            "unknown": "No physics of the catalogue explains what is missing, so none is named.",
        }
        return section("What is missing", paragraph(none.get(diagnosis.verdict or "", "")))
    heading = "What is missing" if diagnosis.verdict != "unknown" else "What was found, though more is missing"
    return section(heading, *(_effect(effect, diagnosis, gallery) for effect in diagnosis.effects))


def _effect(effect: NamedEffect, diagnosis: Diagnosis, gallery: Gallery) -> str:
    chance = "" if effect.probability is None else f" - {effect.status}, probability {percent(effect.probability)}"
    meaning = effect_meaning(effect.kind, effect.site)
    return "\n".join(
        piece
        for piece in (
            tag("h3", capital(effect_name(effect.kind, effect.site)) + chance),
            paragraph(effect.statement or capital(meaning)),
            paragraph(_status(effect), "soft") if effect.probability is not None else "",
            parameter_tables(effect.parameters, effect.kind, effect.site, diagnosis.model.known),
            show((gallery.maps or {}).get((effect.kind, effect.site))),
            _rivals(effect, diagnosis),
        )
        if piece
    )


def _status(effect: NamedEffect) -> str:
    """What the hold-out says of an effect."""
    share = (
        "" if effect.explained is None else f" Without it {percent(effect.explained)} of the error at 1 s comes back."
    )
    if effect.status == "confirmed":
        return f"Confirmed: the hold-out is met worse without it, by more than two standard errors.{share}"
    if effect.status == "event":
        return "An event: it happened once, in these recordings alone, and the model file leaves it out."
    if not effect.in_model:
        return "Suggested: the recordings ask for it, but the hold-out is met better without it, as the model file is."
    return f"Suggested: the recordings ask for it, and the hold-out does not decide.{share}"


def _rivals(effect: NamedEffect, diagnosis: Diagnosis) -> str:
    if not effect.equivalents:
        return paragraph("No other explanation that was tried does as well.", "soft")
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
    return paragraph("These recordings cannot tell it from the following; errors are those on the hold-out.") + table(
        ("explanation", "probability", "with", *(f"error in {channel}" for channel in channels)),
        [own, *rows],
        numbers=(1, *range(3, 3 + len(channels))),
    )


def _unbroken(text: str) -> str:
    """A text that stays on one line."""
    return text.replace(" ", "\u00a0")


def _place(diagnosis: Diagnosis, gallery: Gallery) -> str:
    location = diagnosis.location
    sentences = [*where_sentences(diagnosis), *when_sentences(diagnosis)]
    if location.site is None and not sentences:
        return section("What the model leaves unexplained", show_all(gallery.evidence), show_all(gallery.forces))
    return section(
        "Where and when",
        paragraph(f"The evidence points to the {site_name(location.site)}." if location.site else ""),
        bullets(sentences),
        show_all(gallery.evidence),
        paragraph(location.likeness.statement if location.likeness else ""),
        show_all(gallery.missing),
        show_all(gallery.forces),
    )


def _parameters(diagnosis: Diagnosis, gallery: Gallery) -> str:
    known = diagnosis.model.known
    pieces = [parameter_tables(diagnosis.bridge, known=known)]
    for effect in diagnosis.model_effects:
        pieces += [
            tag("h3", capital(effect_name(effect.kind, effect.site))),
            parameter_tables(effect.parameters, effect.kind, effect.site, known),
            show((gallery.maps or {}).get((effect.kind, effect.site))),
        ]
    return section("The model's own numbers, refitted", *pieces)


def _trials(diagnosis: Diagnosis) -> str:
    count = len(diagnosis.trials)
    many = f"{count} explanation{'s' if count != 1 else ''} refitted; show them"
    return section("What was tried", fold(many, trial_table(diagnosis.trials)))


def _footer(diagnosis: Diagnosis) -> str:
    settings = table(("setting", "value"), [(name, str(value)) for name, value in diagnosis.settings.items()])
    return element(
        "footer",
        fold("settings", settings)
        + paragraph(f"The diagnosis took {digits(diagnosis.seconds)} s. The same numbers, in SI units: report.json."),
    )
