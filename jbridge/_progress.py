"""How far a long computation is: messages for whoever asks, and by default a bar on a terminal or in a notebook."""

import functools
import importlib.util
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress

_Asked = ParamSpec("_Asked")
_Result = TypeVar("_Result")
_ANY_PACE = 1e6
"""Time over which the pace is averaged [s]: all of it, since steps may be minutes apart."""


class Step(str):
    """A message that also says how much is done.

    >>> said = Step("2 of 8 folders", done=0.25)
    >>> said, said.done
    ('2 of 8 folders', 0.25)
    """

    done: float | None
    """Share of the work that is done; None where that is not known."""
    most: float | None
    """Time after which all will be done, counted from the first message [s]; None where that is not known."""

    def __new__(cls, text: str, *, done: float | None = None, most: float | None = None) -> "Step":
        made = super().__new__(cls, text)
        made.done, made.most = done, most
        return made


class ProgressBar:
    """One line that says what is going on, for how long, and how long it still takes; gone when it is cleared.

    It is shown on a terminal (stderr) and in notebooks that have `ipywidgets`; elsewhere there is nothing of it.
    """

    def __init__(self, *, shown: bool = True) -> None:
        self._shown = shown and (sys.stderr.isatty() or _in_notebook())
        self._drawn: Progress | None = None

    def __call__(self, message: str) -> None:
        """Shows what is going on; a `Step` also tells how long it still takes."""
        if not self._shown:
            return
        step = message if isinstance(message, Step) else Step(message)
        if self._drawn is None:
            self._drawn = _line()
            self._drawn.add_task("", total=None)
        known = step.done is not None
        # `update` takes None for what stays as it is.
        self._drawn.tasks[0].total = 1.0 if known else None
        self._drawn.update(
            self._drawn.task_ids[0],
            description=" ".join(message.split()),
            completed=step.done,
            known=known,
            most=step.most,
        )
        self._drawn.start()
        self._drawn.refresh()

    def clear(self) -> None:
        """Takes the line back."""
        if self._drawn is not None:
            self._drawn.stop()
            self._drawn = None


def with_progress(compute: Callable[_Asked, _Result]) -> Callable[_Asked, _Result]:
    """Gives a function whose caller passes no `progress` a bar of its own."""

    @functools.wraps(compute)
    def computed(*args: _Asked.args, **options: _Asked.kwargs) -> _Result:
        if options.get("progress") is not None:
            return compute(*args, **options)
        bar = ProgressBar()
        options["progress"] = bar
        try:
            return compute(*args, **options)
        finally:
            bar.clear()

    return computed


def silent(message: str) -> None:
    """Shows nothing."""


def _in_notebook() -> bool:
    return "ipykernel" in sys.modules and importlib.util.find_spec("ipywidgets") is not None


def _line() -> "Progress":
    # Loaded only where a bar is shown.
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
    from rich.table import Column
    from rich.text import Text

    class Left(ProgressColumn):
        """Time that is left, or that is left at most."""

        def render(self, task: Task) -> Text:
            if task.fields["most"] is not None:
                return Text(f"at most {_duration(max(task.fields['most'] - (task.elapsed or 0.0), 0.0))} left")
            known = task.fields["known"] and task.time_remaining is not None
            return Text(f"{_duration(task.time_remaining or 0.0)} left" if known else "")

    columns: list[Any] = [
        TextColumn("{task.description}", markup=False, table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
        BarColumn(bar_width=8),
        TimeElapsedColumn(),
        Left(table_column=Column(no_wrap=True)),
    ]
    # What is printed on stdout meanwhile may be read by a program, and stays there.
    return Progress(
        *columns,
        console=Console(stderr=True),
        transient=True,
        expand=True,
        redirect_stdout=False,
        speed_estimate_period=_ANY_PACE,
    )


def _duration(seconds: float) -> str:
    minutes, rest = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"
