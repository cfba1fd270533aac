"""Comparison of a diagnosis with the preceding one, after new experiments."""

from collections.abc import Mapping, Sequence

from ..model.names import explanation_name
from .result import Continued, Former, NamedEffect


def explanations(effects: Sequence[NamedEffect]) -> tuple[Mapping[str, object], ...]:
    """Everything that was named or could not be told from it."""
    rows = []
    for effect in effects:
        rows.append({"kind": effect.kind, "site": effect.site, "probability": effect.probability})
        rows += [{"kind": r.kind, "site": r.site, "probability": r.probability} for r in effect.equivalents]
    return tuple(rows)


def continued(former: Former, effects: Sequence[NamedEffect], new: Sequence[str]) -> Continued:
    """What further recordings have made of an earlier diagnosis.

    Args:
        former: the earlier diagnosis.
        effects: what is named now.
        new: names of the new recordings.
    """
    after = explanations(effects)
    before = [(str(row["kind"]), str(row["site"])) for row in former.explanations]
    now = [(str(row["kind"]), str(row["site"])) for row in after]
    left = [name for name in before if name in now]
    extra = [name for name in now if name not in before]
    lead = f"With {', '.join(new)}, "
    if not before:
        text = f"{lead}as before, nothing is named." if not now else f"{lead}what had no name has one: {_listed(now)}."
    elif not left:
        text = f"{lead}none of the {len(before)} former explanations is left"
        text += f"; now it is {_listed(extra)}." if extra else "."
    else:
        be = "is" if len(left) == 1 else "are"
        text = f"{lead}{len(left)} of {len(before)} explanations {be} left: {_listed(left)}."
        if extra:
            text += f" New among them: {_listed(extra)}."
    return Continued(tuple(new), former.explanations, after, text)


def _listed(names: Sequence[tuple[str, str]]) -> str:
    return ", ".join(explanation_name(*name) for name in names)
