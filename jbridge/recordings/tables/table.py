"""Named columns of numbers as a file holds them, before anything is known about their meaning."""

from dataclasses import dataclass, field

import numpy as np

from jbridge.errors import InputError, cut


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
    faulty: dict[str, InputError] = field(default_factory=dict)
    """Columns in which a cell cannot be read, in the order of their first such rows, each with its refusal."""
    clocks: dict[str, InputError] = field(default_factory=dict)
    """Columns with times of day, which are seconds here, each with its refusal where it is not the time."""
    told: dict[str, str] = field(default_factory=dict)
    """Units that lines of comment give, by the name of the column."""
    notes: tuple[str, ...] = ()
    """What was assumed about how the file writes numbers, each one sentence."""

    def error(self, sample: int, column: str, problem: str) -> InputError:
        """Returns the refusal of one number: file, row and column, what is wrong and what to do."""
        return InputError(f"{self.path}, row {self.row_numbers[sample]}, column {cut(column)}: {problem}")
