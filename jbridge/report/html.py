"""Pieces of a self-contained page: everything from files is escaped here, and pictures are part of the page."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files

from .figures.style import Picture
from .rows import ParameterRow
from .words import capital


def page(title: str, body: Iterable[str]) -> str:
    """A whole page; `title` is text, `body` are pieces of HTML."""
    style = files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>\n{style}</style>\n</head>\n<body>\n<main>\n" + "\n".join(body) + "\n</main>\n</body>\n</html>\n"
    )


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


def parameter_table(rows: Sequence[ParameterRow]) -> str:
    return table(
        ("parameter", "value", "95 % interval", "unit", "what it is"),
        [(row.name, row.value, row.interval, row.unit, row.meaning) for row in rows],
        numbers=(1, 2),
    )


def map_table(parameters: Mapping[str, Estimate]) -> str:
    """Parameters that are lists, one row per place; the first of them names the places."""
    columns = list(parameters.items())
    head = [f"{key} [{shown(estimate).unit}]" for key, estimate in columns]
    cells = [shown_each(estimate) for _, estimate in columns]
    for i in reversed(range(1, len(columns))):
        head.insert(i + 1, "95 % interval")
        cells.insert(i + 1, [row.interval for row in cells[i]])
    rows = zip(*([row if isinstance(row, str) else row.value for row in column] for column in cells), strict=True)
    return table(head, rows, numbers=range(len(head)))


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
