"""Where results go: folders are checked before the long computation, and files appear whole or not at all."""

import contextlib
import functools
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

from .._files import make_folder, replacing
from ..errors import InputError

PathLike = str | os.PathLike[str]
Save = TypeVar("Save", bound=Callable[..., Any])


def check_output(path: PathLike, *, folder: bool, inputs: Iterable[PathLike] = ()) -> None:
    """Checks, without writing anything, that results can be written.

    Args:
        path: the folder or the file to write; it need not exist, nor the folders above it.
        folder: whether `path` is to be a folder.
        inputs: files that are read and must not be replaced by results.

    Raises:
        InputError: saying what is in the way, and to choose another place.
    """
    target = Path(path)
    try:
        _check_kind(target, folder)
        _check_permission(target, folder)
        _check_inputs(target, folder, inputs)
    except (OSError, ValueError) as error:  # a name may be too long, or hold a null byte
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{target}: cannot be written ({reason}); choose another place") from None


def write_bytes(path: Path, content: bytes) -> None:
    """Writes a file, and its folder if need be; an existing file is replaced at once, so that no reader sees half.

    Raises:
        InputError: if it cannot be written.
    """
    make_folder(path.parent)
    with replacing(path) as part:
        part.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Writes a text file in UTF-8, as `write_bytes` does."""
    write_bytes(path, content.encode("utf-8", errors="replace"))


def alone_in_folder(save: Save) -> Save:
    """For a function that writes the files of one result into a folder, its first argument, which is made if need be.

    Two processes that write into one folder do so one after the other: what lies there in the end is of one result.
    """

    @functools.wraps(save)
    def alone(folder: PathLike, *args: Any, **kwargs: Any) -> Any:
        make_folder(Path(folder))
        with _locked(Path(folder)):
            return save(folder, *args, **kwargs)

    return cast(Save, alone)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holds a lock on a folder, which ends with this process; neither Windows nor every network share has one."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            descriptor = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


def _check_kind(target: Path, folder: bool) -> None:
    if folder and target.exists() and not target.is_dir():
        raise InputError(f"{target}: a file, where the folder for the results belongs; choose another --out")
    if not folder and target.is_dir():
        raise InputError(f"{target}: a folder, where a file belongs; add a name, such as {target / 'simulated.csv'}")


def _check_permission(target: Path, folder: bool) -> None:
    """Whether the folder, or the nearest one above it that exists, takes files."""
    nearest = target if folder else target.parent
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"{target}: {nearest} is a file, not a folder; choose another --out")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"{target}: {nearest} cannot be written to; choose another --out, or change its permissions")


def _check_inputs(target: Path, folder: bool, inputs: Iterable[PathLike]) -> None:
    written = {target.resolve()} if not folder else {(target / name).resolve() for name in RESULTS}
    for source in map(Path, inputs):
        if source.resolve() in written:
            raise InputError(f"{source}: the results would replace this file, which is read; choose another --out")


RESULTS = (
    "report.json", "report.html", "model.toml", "next_experiment.csv", "fit.json", "fit.html", "check.html",
    "check.png", "control.json", "control.html", "tune.json", "tune.html", "controller.toml", "controller-cart.fis",
    "controller-hoist.fis", "controller.h", "run.csv",
)  # fmt: skip
"""Names of the files that land in the results' folder, besides the figures."""
