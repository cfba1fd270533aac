"""`save_export`: a controller or a model in another program's language, as a file."""

import os
import re
from pathlib import Path

from .._files import make_folder, replacing
from .._toml import Where, read_toml
from ..control.files import load_controller
from ..errors import InputError
from ..model.files import check_lengths, load_model, requires
from .c import controller_header
from .c_model import model_header
from .fmu import model_unit
from .models import matlab_function, mujoco_xml, state_space_module

TARGETS = ("c", "fmu", "mujoco", "statespace", "matlab")
"""Languages: C99 for controllers and models, the others for models."""
PERIOD = 0.01
"""Time between samples of a model in C or in a unit where nothing else is said [s]."""
_RESERVED = frozenset(
    "break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd "
    "switch try while".split()
)
"""Words that no function of MATLAB is called by."""
ROPE = 0.5
"""Length of the rope at a model's working point where nothing else is said [m]."""


def save_export(
    folder: str | os.PathLike[str],
    source: str | os.PathLike[str],
    target: str,
    *,
    rope: float = ROPE,
    period: float | None = None,
) -> Path:
    """Writes a controller or a model in another program's language.

    Args:
        folder: which is made if need be; the file in it is called like the source.
        source: a model's TOML, or a controller's for `c`.
        target: one of `TARGETS`.
        rope: length of the rope at the working point of a model [m].
        period: time between samples of a model in C or in a unit [s], 0.01 if not given; a controller has its own.

    Returns:
        The file: `NAME.h`, `NAME.fmu`, `NAME.xml`, `NAME_statespace.py` or `NAME.m`.

    Raises:
        ValueError: there is no such target.
        InputError: the source cannot be read, is of the other kind, or has what the language cannot say.
    """
    if target not in TARGETS:
        raise ValueError(f"unknown target {target!r}; choose among {', '.join(TARGETS)}")
    path = Path(source)
    name = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    name = name if re.match("[A-Za-z]", name) else f"bridge_{name}"
    document = read_toml(path, "model or controller", "a [bridge] table, or the kind of a controller")
    if "bridge" in document or ("kind" not in document and target != "c"):
        if target == "matlab" and name in _RESERVED:
            name = f"bridge_{name}"
        content, end = _model(path, name, target, rope, PERIOD if period is None else period)
    elif period is not None:
        Where(str(path)).refuse(f"a controller has its own period; leave out --period {period:g}, or change it there")
    elif target == "c":
        content, end = controller_header(load_controller(path), name), ".h"
    else:
        Where(str(path)).refuse(f"a controller, but only models are exported to {target}; choose --to c")
    file = Path(folder) / f"{name}{end}"
    make_folder(file.parent)
    with replacing(file) as part:
        part.write_bytes(content if isinstance(content, bytes) else content.encode(errors="replace"))
    return file


def _model(path: Path, name: str, target: str, rope: float, period: float) -> tuple[str | bytes, str]:
    """A model in the language, and how its file ends."""
    if not 0.0 < rope < 1e3:
        raise InputError(f"--rope {rope:g}: give the length of the rope at the working point in metres, above 0")
    if not 1e-5 <= period <= 1.0:
        raise InputError(f"--period {period:g}: give the time between samples in seconds, from 1e-5 to 1")
    model = load_model(path)
    check_lengths(model)
    if target == "c":
        return model_header(model, name, period=period, rope=rope), ".h"
    if target == "fmu":
        return model_unit(model, name, period=period, rope=rope), ".fmu"
    requires(model, model.axes)
    if target == "mujoco":
        return mujoco_xml(model, rope), ".xml"
    if target == "statespace":
        return state_space_module(model, rope), "_statespace.py"
    return matlab_function(model, name, rope), ".m"
