"""Self-contained pages from the templates in `assets`, which escape whatever comes from files."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from ...model.names import site_name
from .quantities import digits, percent, unbroken
from .rows import is_met
from .tables import errors_table, parameter_tables
from .words import capital, effect_name

_PACKAGE, _ASSETS = "jbridge.report", "assets"


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
    made.filters |= {"base64": _base64, "capital": capital, "digits": digits, "percent": percent, "unbroken": unbroken}
    made.globals |= {
        "effect_name": effect_name,
        "errors_table": errors_table,
        "is_met": is_met,
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
