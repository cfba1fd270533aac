"""The page's parts on what the recordings leave open: what may hide, what to record next, what that has changed."""

from collections.abc import Mapping, Sequence

from ...diagnosis.result import Diagnosis, NotSeen
from ..text.html import bullets, fold, paragraph, section, table
from ..text.quantities import UNKNOWN, digits, join_unit, percent, scale_for
from ..text.words import capital, effect_name


def not_seen_section(diagnosis: Diagnosis) -> str:
    """What these recordings could not have shown: the notable open, the rest folded."""
    notable = [row for row in diagnosis.not_seen if row.notable]
    rest = [row for row in diagnosis.not_seen if not row.notable]
    return section(
        "What these recordings could not have shown",
        paragraph(
            "Effects that were not named may be there all the same, up to these limits (95 %). The last column is what "
            "that would mean for a simulation of the hold-out."
        )
        if diagnosis.not_seen
        else "",
        _limits(notable),
        fold(f"what is practically nothing: {len(rest)} more; show", _limits(rest)) if rest else "",
    )


def limit_text(row: NotSeen) -> str:
    """A limit with its unit; a dash where there is none.

    >>> limit_text(NotSeen("sensor_delay", "x_sensor", "delay", 0.0012, "s", 0.3, False, ""))
    '1.2 ms'
    """
    if row.limit is None:
        return UNKNOWN
    scale = scale_for(row.unit, [row.limit])
    return join_unit(digits(scale.factor * row.limit, 2), scale.unit)


def _limits(rows: Sequence[NotSeen]) -> str:
    return table(
        ("effect", "parameter", "limit", "what that means"),
        [(capital(effect_name(row.kind, row.site)), row.parameter, limit_text(row), row.statement) for row in rows],
        numbers=(2,),
    )


def next_section(diagnosis: Diagnosis) -> str:
    """The input that separates best what cannot be told apart; nothing where there is nothing to separate."""
    experiment = diagnosis.next_experiment
    if experiment is None:
        return ""
    return section(
        "What to record next",
        paragraph(experiment.purpose),
        paragraph("It would separate:") + bullets(experiment.separates) if experiment.separates else "",
        paragraph(
            f"Expected chance of a wrong decision with it: {percent(experiment.expected_wrong)}. The input is in "
            "next_experiment.csv beside this page, ready to play; then call the same command again with --with and the "
            "new recording."
        ),
    )


def continued_section(diagnosis: Diagnosis) -> str:
    """What a diagnosis that goes on from an earlier one has decided."""
    continued = diagnosis.continued
    if continued is None:
        return ""
    after = {(row["kind"], row["site"]): row for row in continued.after}
    named = dict.fromkeys((row["kind"], row["site"]) for row in (*continued.before, *continued.after))
    before = {(row["kind"], row["site"]): row for row in continued.before}
    rows = [
        (
            capital(effect_name(str(kind), str(site))),
            _chance(before.get((kind, site))),
            _chance(after.get((kind, site))),
        )
        for kind, site in named
    ]
    return section(
        "What the new recordings have decided",
        paragraph(continued.statement),
        table(("explanation", "probability before", "probability now"), rows, numbers=(1, 2)),
    )


def _chance(row: Mapping[str, object] | None) -> str:
    """The probability of an explanation; a dash where it is none any more, or was none yet."""
    value = None if row is None else row["probability"]
    return percent(value) if isinstance(value, float) else UNKNOWN
