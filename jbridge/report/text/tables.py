"""Tables of text, for pages and for the terminal."""

import io
import textwrap
from collections.abc import Collection, Mapping, Sequence
from itertools import zip_longest
from typing import Literal, NamedTuple

from rich.console import Console
from rich.table import Table as Drawn

from ...identification.result import Estimate
from .quantities import UNKNOWN, shown_entries
from .rows import error_rows, parameter_rows
from .words import CHANNELS

WIDTH = 80
"""Letters of a line in the terminal, at most."""
_ABREAST = 3
"""Columns beside each other in a table that is turned."""
_NAMES = 30
"""Letters of a name on one line, at most."""


class Table(NamedTuple):
    """A table of text."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Collection[int] = ()
    """Columns that hold numbers, set flush right."""

    def lines(self, first: int = 0) -> list[str]:
        """For the terminal; what is too wide for a line is wrapped within its cell.

        Args:
            first: letters of the first column, at least.
        """
        drawn = Drawn(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
        for k, name in enumerate(self.head):
            # Names stay on one line, so long as the other columns leave room.
            justify: Literal["left", "right"] = "right" if k in self.numbers else "left"
            drawn.add_column(name if k else name.ljust(first), justify=justify, no_wrap=k == 0, overflow="fold")
        for name, *cells in self.rows:
            drawn.add_row(textwrap.fill(name, _NAMES, drop_whitespace=False), *cells)
        text = io.StringIO()
        # Cells are text as it stands, whatever it looks like.
        Console(file=text, width=WIDTH, color_system=None, emoji=False, highlight=False, markup=False).print(drawn)
        return [line.rstrip() for line in text.getvalue().splitlines()]

    def turned(self) -> list[str]:
        """For the terminal with a column for each row, where there are more columns than fit into a line."""
        lines = []
        for start in range(0, len(self.rows), _ABREAST):
            head, *rows = zip(self.head, *self.rows[start : start + _ABREAST], strict=True)
            lines += [*Table(head, rows).lines(), ""]
        return lines


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
    """The parameters of an effect, or of the bridge, see `parameter_rows`; lists make a table with a row per place."""
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
