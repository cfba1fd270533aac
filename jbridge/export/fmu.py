"""Models as functional mock-up units (FMI 3.0, co-simulation), which Simulink, OpenModelica and others simulate.

A unit is an archive of a description, the sources of the model in C, and a library for this computer where it has a
compiler; elsewhere the importing program compiles the sources. Source: Modelica Association, Functional Mock-up
Interface Specification 3.0.1.
"""

import hashlib
import io
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from importlib.resources import files
from pathlib import Path
from string import Template

from ..errors import InputError
from ..model.files import Model
from .c_model import inputs_that_hold, model_header, sampled_plant

_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
"""How `sys.platform` is called in a unit, and how its libraries end."""
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
"""How machines are called in a unit where Python calls them otherwise."""
_TEXTS = ("modelDescription.xml", "sources/buildDescription.xml", "sources/fmi3.c")
"""Of every unit, with `$NAME` for what differs."""


def model_unit(model: Model, name: str, *, period: float, rope: float) -> bytes:
    """The unit of a model, an archive: the same bytes for the same model, compiler and version of jbridge.

    Inputs are `u_x`, `u_l` in the unit of the recordings, held over each step; outputs are what encoders read, `x`,
    `psi`, `l` [m, rad, m]; parameters are `x_start`, `psi_start`, `l_start`, the rig at rest at the start. Steps are
    multiples of the period. States can be kept and set.

    Args:
        model: as read, with all its effects.
        name: of the model, an identifier of C.
        period: time between samples [s].
        rope: length of the rope at the start where nothing else is set [m].

    Raises:
        InputError: the name is no identifier of C, or the model does what has no form in C.
    """
    header = model_header(model, "model", period=period, rope=rope)
    texts = {path: (files(__package__) / "unit" / path).read_text(encoding="utf-8") for path in _TEXTS}
    token = hashlib.sha256("".join([name, header, *texts.values()]).encode()).hexdigest()
    u_x, u_l = (float(value) for value in inputs_that_hold(sampled_plant(model, period)))
    numbers = {"u_x": repr(u_x), "u_l": repr(u_l), "rope": repr(rope), "period": repr(period)}
    texts = {path: Template(text).substitute(numbers, name=name, token=token) for path, text in texts.items()}
    texts["sources/model.h"] = header
    parts = {path: text.encode() for path, text in texts.items()} | _library(name, texts)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as unit:
        for path in sorted(parts):
            unit.writestr(zipfile.ZipInfo(path), parts[path], zipfile.ZIP_DEFLATED)
    return archive.getvalue()


def _library(name: str, texts: dict[str, str]) -> dict[str, bytes]:
    """The library for this computer under its place in the archive; nothing where there is no compiler."""
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    machine = platform.machine().lower()
    if compiler is None or sys.platform not in _SYSTEMS:
        return {}
    system, end = _SYSTEMS[sys.platform]
    with tempfile.TemporaryDirectory() as folder:
        for path in ("sources/model.h", "sources/fmi3.c"):
            (Path(folder) / Path(path).name).write_text(texts[path], encoding="utf-8")
        options = ["-std=c99", "-O2", "-shared", "-fPIC", "fmi3.c", "-o", f"unit{end}", "-lm"]
        done = subprocess.run([compiler, *options], cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            lines = done.stderr.strip().splitlines() or ["no reason given"]
            reason = next((line for line in lines if "error" in line), lines[0])
            raise InputError(f"{compiler} cannot compile the model ({reason}); set CC to another compiler")
        library = (Path(folder) / f"unit{end}").read_bytes()
    return {f"binaries/{_MACHINES.get(machine, machine)}-{system}/{name}{end}": library}
