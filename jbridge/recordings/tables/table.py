"""Named columns of numbers as a file holds them, before anything is known about their meaning."""

from dataclasses import dataclass, field

import numpy as np

from jbridge.errors import InputError


@dataclass(frozen=True)
class Table:
    """Columns of one file, with what it takes to say where in the file a number stands."""

    path: str
    """The file, as the caller named it."""
    header: str
    """Where the names of the columns stand, for messages."""
    columns: dict[str, np.ndarray]
    """Columns by name; in a .mat they may differ in length."""
    row_numbers: np.ndarray
    """Each sample's line in the file, the header being 1, or its number in the vectors of a .mat."""
    unusable: dict[str, str] = field(default_factory=dict)
    """Names in the file that are not columns of numbers, and what they are instead."""
    notes: tuple[str, ...] = ()
    """What was assumed about how the file writes numbers, each one sentence."""

    def error(self, sample: int, column: str, problem: str) -> InputError:
        """Returns the refusal of one number: file, row and column, what is wrong and what to do."""
        return InputError(f"{self.path}, row {self.row_numbers[sample]}, column {column}: {problem}")
