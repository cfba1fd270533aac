"""What a person can correct: the one error that commands turn into a line and exit status 2."""

from collections.abc import Iterable

_LONGEST = 1000
"""Characters of a message; a screen shows twice as many."""


class InputError(Exception):
    """A file or an option that cannot be used; `str` is exactly one line: where, what, and what to do."""

    def __init__(self, message: str) -> None:
        # Cells and names come from files: a line break or an escape sequence in them must not reach a
        # terminal. A long one must not hide the place, which comes first, and what to do, which comes last.
        line = " ".join(message.split())
        if len(line) > _LONGEST:
            line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
        super().__init__("".join(letter if letter.isprintable() else "?" for letter in line))


def quoted(text: str, limit: int = 40) -> str:
    """Returns `text` in quotes, shortened to `limit` characters, control characters as escape sequences.

    >>> quoted("abc")
    "'abc'"
    """
    return repr(cut(text, limit))


def cut(text: str, limit: int = 40) -> str:
    """Returns `text`, shortened to `limit` characters."""
    return text if len(text) <= limit else text[: limit - 3] + "..."


def listed(names: Iterable[object], limit: int = 8) -> str:
    """Returns names separated by commas, with the number of those left out.

    >>> listed(["t", "u_x", "x"], limit=2)
    't, u_x and 1 more'
    """
    every = [str(name) for name in names]
    more = f" and {len(every) - limit} more" if len(every) > limit else ""
    return ", ".join(every[:limit]) + more
