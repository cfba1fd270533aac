"""Base class of results: text, page, figure, table and files, which `report.displays` makes.

Pages, figures and files are the matter of `report`, which knows the results and is unknown to them. The public face
connects the two: it says where the displays are, and they are loaded when a result is first looked at.
"""

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_connected: list[Callable[[], ModuleType]] = []


def connect(displays: Callable[[], ModuleType]) -> None:
    """Says where the functions `text`, `html`, `figure`, `columns` and `save` of every kind of result are found."""
    _connected[:] = [displays]


class Displayed:
    """A result that is shown as text, page, figure or table, and saved as its command saves it."""

    def __repr__(self) -> str:
        return _displays().text(self)

    def _repr_html_(self) -> str:
        return _displays().html(self)

    def plot(self, recording: str | None = None) -> "Figure":
        """Draws a recording beside its simulations, over time.

        Args:
            recording: Its name; by default the first hold-out, or else the training recording that is met worst.
        """
        return _displays().figure(self, recording)

    def to_dataframe(self) -> Any:
        """Returns the numbers as a pandas data frame, in SI units and those of the inputs.

        Raises:
            ImportError: if pandas is not installed.
        """
        try:
            pandas = importlib.import_module("pandas")
        except ImportError:
            raise ImportError("to_dataframe needs pandas, which jbridge does without: pip install pandas") from None
        return pandas.DataFrame(_displays().columns(self))

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Writes into a folder what the command writes there, and returns the path of what to look at first.

        Raises:
            InputError: if a file cannot be written.
        """
        return _displays().save(self, folder)


def _displays() -> Any:
    [displays] = _connected
    return displays()
