"""Files that are there whole or not at all, and those of an earlier run, which may have been damaged since."""

import contextlib
import json
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .errors import InputError


@contextlib.contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Yields the path of a new file, which takes the place of `target` at once when the block ends without an error.

    Whoever reads `target` meanwhile sees all of the old file or all of the new one, whatever else happens.

    Raises:
        InputError: if it cannot be written, such as on a full disk.
    """
    with _beside(target) as part:
        yield part
        os.replace(part, target)


@contextlib.contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """Yields a path in the folder of `target` that nobody else uses, in whatever process or container; what is there at
    the end is removed."""
    part = target.with_name(f".{target.name}.{secrets.token_hex(8)}.part")
    try:
        yield part
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{target}: cannot be written ({reason}); make room there, or choose another place") from None
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it; one that exists will do.

    Raises:
        InputError: if that is not possible.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder ({error.strerror}); choose another place") from None


def replace_text(target: Path, text: str) -> None:
    """Writes a text file in UTF-8; it appears whole or not at all, and an existing file is replaced.

    Raises:
        InputError: if the file cannot be written.
    """
    with replacing(target) as part:
        part.write_text(text, encoding="utf-8", errors="replace", newline="")


def create_text(target: Path, text: str) -> None:
    """Writes a text file unless there is one: of several processes that do so at once, the first one's stays.

    Raises:
        InputError: if the file cannot be written.
    """
    with _beside(target) as part:
        part.write_text(text, encoding="utf-8", newline="")
        try:
            os.link(part, target)
        except FileExistsError:
            pass
        except OSError:  # a file system without links, where the last one's stays
            os.replace(part, target)


def read_json(path: Path) -> dict[str, Any]:
    """Returns the object in a JSON file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not JSON, is nested too deep to be read, or holds something else than an object.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("nested too deep") from None
    if not isinstance(found, dict):
        raise ValueError("not an object")
    return found
