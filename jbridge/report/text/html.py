"""Pieces of a self-contained page: everything from files is escaped here, and pictures are part of the page."""

import base64
import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from itertools import zip_longest

from ...identification.result import Estimate
from ..figures.style import Picture
from .quantities import UNKNOWN, shown_entries
from .rows import parameter_rows
from .words import capital


def page(title: str, body: Iterable[str], style: str = "", scripts: Sequence[str] = ()) -> str:
    """A whole page; `title` is text, `body` are pieces of HTML, `style` and `scripts` are the package's own."""
    style = "\n" + style + files("jbridge.report").joinpath("assets", "page.css").read_text(encoding="utf-8")
    # Whatever slipped through the escaping would neither run nor load anything.
    policy = f"default-src 'none'; img-src data:; style-src {_digest(style)}; base-uri 'none'; form-action 'none'"
    if scripts:
        policy += f"; script-src {' '.join(map(_digest, scripts))}"
    run = "".join(f"<script>{script}</script>\n" for script in scripts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{style}</style>\n</head>\n<body>\n<main>\n" + "\n".join(body) + f"\n</main>\n{run}</body>\n</html>\n"
    )


def _digest(text: str) -> str:
    """The source expression by which a policy allows this text alone."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode('ascii')}'"


def tag(name: str, text: str, kind: str = "") -> str:
    """An element around text, which is escaped."""
    return element(name, escape(text), kind)


def element(name: str, content: str, kind: str = "") -> str:
    """An element around HTML."""
    of_class = f' class="{kind}"' if kind else ""
    return f"<{name}{of_class}>{content}</{name}>"


def section(heading: str, *content: str) -> str:
    """A part of the page with its heading; nothing at all where there is no content."""
    inside = "\n".join(piece for piece in content if piece)
    return f"<section>\n{tag('h2', heading)}\n{inside}\n</section>" if inside else ""


def paragraph(text: str, kind: str = "") -> str:
    return tag("p", text, kind) if text else ""


def bullets(texts: Iterable[str], kind: str = "") -> str:
    items = "".join(tag("li", text) for text in texts)
    return element("ul", items, kind) if items else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of text.

    Args:
        head: names of the columns.
        rows: cells as text.
        numbers: columns that hold numbers, set flush right.
    """

    def cells(name: str, texts: Sequence[str]) -> str:
        return "".join(tag(name, text, "number" if i in numbers else "") for i, text in enumerate(texts))

    body = "".join(element("tr", cells("td", row)) for row in rows)
    if not body:
        return ""
    inside = element("thead", element("tr", cells("th", head))) + element("tbody", body)
    return element("div", element("table", inside), "wide")


def parameter_tables(
    parameters: Mapping[str, Estimate], kind: str | None = None, site: str | None = None, known: Collection[str] = ()
) -> str:
    """The parameters of an effect, or of the bridge; those that are lists make a table with a row per place.

    Args:
        parameters: by key.
        kind, site: of the effect.
        known: names of the model's parameters that were not estimated.
    """
    lists = {key: estimate for key, estimate in parameters.items() if isinstance(estimate.value, list)}
    numbers = {key: estimate for key, estimate in parameters.items() if key not in lists}
    rows = parameter_rows(numbers, kind, site, known)
    return table(
        ("parameter", "value", "95 % interval", "unit", "what it is"),
        [(row.name, row.value, row.interval, row.unit, row.meaning) for row in rows],
        numbers=(1, 2),
    ) + _list_table(lists)


def _list_table(lists: Mapping[str, Estimate]) -> str:
    """Lists side by side, with intervals where there are any."""
    head, columns = [], []
    for key, estimate in lists.items():
        entries = shown_entries(estimate)
        head.append(f"{key} [{entries[0].unit}]" if entries and entries[0].unit else key)
        columns.append([entry.value for entry in entries])
        if any(entry.interval != UNKNOWN for entry in entries):
            head.append("95 % interval")
            columns.append([entry.interval for entry in entries])
    return table(head, list(zip_longest(*columns, fillvalue="")), numbers=range(len(head)))


def show(picture: Picture | None) -> str:
    """A picture, which carries its title; on a narrow screen it scrolls sideways rather than becoming illegible."""
    if picture is None:
        return ""
    source = base64.b64encode(picture.png).decode("ascii")
    image = f'<img alt="{escape(picture.title)}" src="data:image/png;base64,{source}">'
    return element("figure", image, "wide")


def show_all(pictures: Iterable[Picture]) -> str:
    return "\n".join(show(picture) for picture in pictures)


def fold(heading: str, *content: str) -> str:
    """What few readers need, closed until it is clicked."""
    inside = "\n".join(piece for piece in content if piece)
    return f"<details>\n{tag('summary', capital(heading))}\n{inside}\n</details>" if inside else ""
