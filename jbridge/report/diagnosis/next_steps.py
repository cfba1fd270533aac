"""Tables of what the recordings leave open: what may hide, and what new recordings have decided."""

from collections.abc import Iterable, Mapping

from ...diagnosis.result import Continued, NotSeen
from ..text.quantities import UNKNOWN, digits, join_unit, percent, scale_for
from ..text.tables import Table
from ..text.words import capital, effect_name


def limit_text(row: NotSeen) -> str:
    """A limit with its unit; a dash where there is none.

    >>> limit_text(NotSeen("sensor_delay", "x_sensor", "delay", 0.0012, "s", 0.3, False, ""))
    '1.2 ms'
    """
    if row.limit is None:
        return UNKNOWN
    scale = scale_for(row.unit, [row.limit])
    return join_unit(digits(scale.factor * row.limit, 2), scale.unit)


def limits_table(rows: Iterable[NotSeen]) -> Table:
    """How large effects may be that these recordings could not have shown."""
    return Table(
        ("effect", "parameter", "limit", "what that means"),
        [(capital(effect_name(row.kind, row.site)), row.parameter, limit_text(row), row.statement) for row in rows],
        (2,),
    )


def unlimited(rows: Iterable[NotSeen]) -> list[str]:
    """Each reason for which effects have no limit, with the effects."""
    names: dict[str, list[str]] = {}
    for row in rows:
        if row.limit is None:
            names.setdefault(row.statement, []).append(effect_name(row.kind, row.site))
    return [f"{capital('; '.join(of))}. {statement}" for statement, of in names.items()]


def decided_table(continued: Continued | None) -> Table:
    """What a diagnosis that goes on from an earlier one has decided; no rows where it does not."""
    former, latter = ({}, {}) if continued is None else map(_by_name, (continued.before, continued.after))
    rows = [
        (capital(effect_name(*name)), _chance(former.get(name)), _chance(latter.get(name)))
        for name in dict.fromkeys((*former, *latter))
    ]
    return Table(("explanation", "probability before", "probability now"), rows, (1, 2))


def _by_name(rows: Iterable[Mapping[str, object]]) -> dict[tuple[str, str], Mapping[str, object]]:
    return {(str(row["kind"]), str(row["site"])): row for row in rows}


def _chance(row: Mapping[str, object] | None) -> str:
    """The probability of an explanation; a dash where it is none any more, or was none yet."""
    value = None if row is None else row["probability"]
    return percent(value) if isinstance(value, float) else UNKNOWN
