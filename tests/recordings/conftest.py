"""A bridge's recording that nothing is wrong with, for tests to break in one place each."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from jbridge.errors import InputError
from jbridge.recordings import load_recording

ROWS = 400


def bridge_columns() -> dict[str, np.ndarray]:
    """Returns two seconds of a bridge: an exact cart, swing and hoist, each moving in its own way."""
    t = np.arange(ROWS) * 0.005
    return {
        "t": t,
        "u_x": np.where(t < 1, 2.0, -2.0),
        "u_l": np.where(t < 0.5, 1.0, 0.0),
        "x": 0.2 * np.sin(3 * t),
        "psi": 0.1 * np.sin(4 * t),
        "l": 0.7 + 0.05 * np.sin(2 * t),
    }


def as_text(columns: Mapping[str, np.ndarray]) -> str:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    return bridge_columns()


@pytest.fixture
def lines() -> list[str]:
    """The file's lines; `lines[0]` is the header, so that row 12 of the file is `lines[11]`."""
    return as_text(bridge_columns()).splitlines()


Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a recording from columns, text or bytes, and a sidecar if one is given; returns its path."""

    def to_file(
        content: Mapping[str, np.ndarray] | str | bytes,
        sidecar: str = "",
        *,
        name: str = "run.csv",
        sidecar_name: str = "run.toml",
    ) -> Path:
        path = tmp_path / name
        if isinstance(content, Mapping):
            content = as_text(content)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        if sidecar:
            (tmp_path / sidecar_name).write_text(sidecar, encoding="utf-8")
        return path

    return to_file


@pytest.fixture
def refusal() -> Callable[..., str]:
    """Returns the message with which a recording is refused, which is one line and names the file."""

    def message_of(path: Path, **options: bool) -> str:
        with pytest.raises(InputError) as caught:
            load_recording(path, **options)
        message = str(caught.value)
        assert message.splitlines() == [message]
        assert path.name in message
        return message

    return message_of


@pytest.fixture
def chosen(columns: dict[str, np.ndarray]) -> Callable[[str], dict[str, np.ndarray]]:
    """Returns some of the bridge's columns, by their names."""
    return lambda names: {name: columns[name] for name in names.split()}
