"""Self-contained pages from the templates in `assets`, which escape whatever comes from files."""

import base64
import hashlib
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from importlib.resources import files
from itertools import zip_longest
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from ...identification.result import Estimate
from ...model.names import site_name
from .quantities import UNKNOWN, digits, percent, shown_entries
from .rows import error_rows, parameter_rows
from .words import CHANNELS, capital, effect_name

_PACKAGE, _ASSETS = "jbridge.report", "assets"


class Table(NamedTuple):
    """A table of text."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Collection[int] = ()
    """Columns that hold numbers, set flush right."""


def page(template: str, *, styles: Sequence[str] = (), scripts: Sequence[str] = (), **values: Any) -> str:
    """A whole page.

    Args:
        template: its file in `assets`.
        styles, scripts: files there that the page needs beside its own style sheet.
        values: what the template shows.
    """
    style = "\n" + "".join(map(_asset, (*styles, "page.css")))
    run = list(map(_asset, scripts))
    # Whatever slipped through the escaping would neither run nor load anything.
    policy = f"default-src 'none'; img-src data:; style-src {_digest(style)}; base-uri 'none'; form-action 'none'"
    if run:
        policy += f"; script-src {' '.join(map(_digest, run))}"
    return piece(template, style=style, scripts=run, policy=policy, **values)


def piece(template: str, **values: Any) -> str:
    """A template with its values, such as a part of a page for notebooks."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    made = Environment(
        autoescape=True,
        keep_trailing_newline=True,
        loader=PackageLoader(_PACKAGE, _ASSETS),
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    made.filters |= {"base64": _base64, "capital": capital, "digits": digits, "percent": percent}
    made.globals |= {
        "effect_name": effect_name,
        "errors_table": errors_table,
        "parameter_tables": parameter_tables,
        "site_name": site_name,
    }
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return made


def _asset(name: str) -> str:
    return files(_PACKAGE).joinpath(_ASSETS, name).read_text(encoding="utf-8")


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def _digest(text: str) -> str:
    """The source expression by which a policy allows this text alone."""
    return f"'sha256-{_base64(hashlib.sha256(text.encode('utf-8')).digest())}'"


def errors_table(before: Mapping[str, float] | None, after: Mapping[str, float], noise: Mapping[str, float]) -> Table:
    """Errors per channel; without the columns of before and of the gap where there is no before."""
    rows = error_rows(before, after, noise)
    if before is None:
        shown = [(CHANNELS[row.channel], row.after, row.after_ratio, row.noise) for row in rows]
        return Table(("channel", "rms error", "", "noise"), shown, range(1, 4))
    return Table(
        ("channel", "before", "", "after", "", "noise", "gap closed"),
        [(CHANNELS[r.channel], r.before, r.before_ratio, r.after, r.after_ratio, r.noise, r.closed) for r in rows],
        range(1, 7),
    )


def parameter_tables(
    parameters: Mapping[str, Estimate], kind: str | None = None, site: str | None = None, known: Collection[str] = ()
) -> list[Table]:
    """The parameters of an effect, or of the bridge; those that are lists make a table with a row per place.

    Args:
        parameters: by key.
        kind, site: of the effect.
        known: names of the model's parameters that were not estimated.
    """
    lists = {key: estimate for key, estimate in parameters.items() if isinstance(estimate.value, list)}
    numbers = {key: estimate for key, estimate in parameters.items() if key not in lists}
    rows = [
        (row.name, row.value, row.interval, row.unit, row.meaning) for row in parameter_rows(numbers, kind, site, known)
    ]
    return [Table(("parameter", "value", "95 % interval", "unit", "what it is"), rows, (1, 2)), _list_table(lists)]


def _list_table(lists: Mapping[str, Estimate]) -> Table:
    """Lists side by side, with intervals where there are any."""
    head, columns = [], []
    for key, estimate in lists.items():
        entries = shown_entries(estimate)
        head.append(f"{key} [{entries[0].unit}]" if entries and entries[0].unit else key)
        columns.append([entry.value for entry in entries])
        if any(entry.interval != UNKNOWN for entry in entries):
            head.append("95 % interval")
            columns.append([entry.interval for entry in entries])
    return Table(head, list(zip_longest(*columns, fillvalue="")), range(len(head)))
