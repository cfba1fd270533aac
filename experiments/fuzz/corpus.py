"""Small whole files of every kind that jbridge reads, for mutations to begin with."""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.io import savemat

import jbridge

MODEL = """\
[bridge]
cart_mass = 5.5
load_mass = 0.143
winch_mass = 0.1
gravity = 9.81
cart_damping = 45.0
swing_damping = 0.0015
hoist_damping = 25.0
cart_gain = 16.0
hoist_gain = 3.0
known = ["cart_mass", "load_mass", "winch_mass", "gravity"]

[[effect]]
kind = "coulomb_friction"
site = "cart"
level = 4.0

[[effect]]
kind = "dead_zone"
site = "cart_drive"
positive = 0.3
negative = 0.2

[uncertainty.cart_gain]
std = 0.1
"""
SIDECAR = """\
[columns]
x = {column = "cart_mm", unit = "mm"}
psi = {column = "theta", unit = "deg", sign = -1, offset = 180}
[hold]
psi = true
[resolution]
x = 1e-4
[override]
load_mass = 0.25
[initial]
x = 0.0
psi = 0.0
l = 0.7
[trim]
start = 0.1
stop = 1.15
"""
FOLDER_SIDECAR = """\
["rec*.csv".columns]
x = {column = "cart_mm", unit = "mm", offset = 0.5}
psi = {column = "theta", unit = "deg"}
["rec.csv".override]
load_mass = 0.25
["rec.csv".trim]
start = 0.1
"""
REFERENCE = "points = [[0.0, 0.185], [1.2, 0.6], [0.5, 0.3]]\nspeed = [0.3, 0.2]\nrest = 4.0\n"
SWEEPS = (
    """\
model = "model.toml"
controller = "c.toml"
chunk = 256
precision = "float32"
[reference]
start = [0.0, 0.3]
goal = [1.0, 0.6]
speed = [0.3, 0.2]
rest = 2.0
[sample]
kind = "sobol"
count = 1000
seed = 3
[[vary]]
name = "cart_gain"
low = 10.0
high = 20.0
log = true
[[vary]]
name = "reference.rest"
low = 1.0
high = 3.0
""",
    """\
model = "model.toml"
[sample]
kind = "grid"
[[vary]]
name = "load_mass"
values = [0.1, 0.2, 0.3]
[[vary]]
name = "reference.speed_x"
low = 0.1
high = 0.4
count = 5
""",
)
REPORT = {
    "schema": 1,
    "verdict": "missing_physics",
    "effects": [
        {
            "kind": "dead_zone",
            "site": "cart_drive",
            "probability": 0.97,
            "parameters": {"positive": {"value": 0.3, "std": 0.01, "unit": "V"}},
            "equivalents": [{"kind": "coulomb_friction", "site": "cart", "probability": None}],
        }
    ],
    "seconds": 1.0,
}


@dataclass(frozen=True)
class Case:
    """Files that are read together, by name; one of them is to be changed."""

    reader: str
    """Of `READERS`."""
    read: str
    """Name of the file that the reader is given."""
    changed: str
    """Name of the file that mutations change."""
    files: dict[str, bytes]


READERS: dict[str, Callable[[Path], object]] = {
    "recording": jbridge.load_recording,
    "model": jbridge.load_model,
    "controller": jbridge.load_controller,
    "reference": lambda path: jbridge.load_reference(path, 0.02),
    "sweep": lambda path: jbridge.load_sweep(path).seconds,
    "report": lambda path: jbridge.load_former(path.parent),
}
"""What commands read their files with."""


def columns() -> dict[str, np.ndarray]:
    """A second of a whole bridge whose parts move in their own ways."""
    t = np.arange(60) / 50
    return {
        "t": t,
        "u_x": np.where(t < 0.6, 1.0, -1.0),
        "u_l": np.where(t < 0.3, 0.5, 0.0),
        "x": 0.1 * t**2,
        "psi": np.round(0.05 * np.sin(5 * t), 3),
        "l": 0.6 + 0.05 * np.sin(2 * t),
    }


def as_csv(table: dict[str, np.ndarray], separator: str = ",", comma: bool = False) -> bytes:
    rows = [separator.join(table)]
    for row in zip(*table.values(), strict=True):
        texts = [f"{value:.5g}" for value in row]
        rows.append(separator.join(text.replace(".", ",") if comma else text for text in texts))
    return ("\n".join(rows) + "\n").encode()


def as_mat(variables: dict[str, object], form: str = "5", compressed: bool = False) -> bytes:
    file = BytesIO()
    savemat(file, variables, format=form, do_compression=compressed)
    return file.getvalue()


def with_time(table: dict[str, np.ndarray]) -> dict[str, object]:
    """What Simulink saves as "Structure With Time"."""
    signals = np.zeros((1, len(table) - 1), dtype=[("values", object), ("dimensions", object), ("label", object)])
    for place, name in enumerate(name for name in table if name != "t"):
        signals[0, place] = (table[name].reshape(-1, 1), 1.0, name)
    return {"time": table["t"].reshape(-1, 1), "signals": signals, "blockName": "rig/To Workspace"}


def controllers() -> dict[str, bytes]:
    """The paper's controller with its rules inside and in `.fis` files, and the extended one, as they are written."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        law = jbridge.paper_controller()
        jbridge.save_controller(root / "c.toml", jbridge.Controller(law))
        jbridge.save_controller(root / "extended.toml", jbridge.Controller(jbridge.extended_controller()))
        for axis in ("cart", "hoist"):
            jbridge.save_fis(root / f"{axis}.fis", getattr(law, axis))
        (root / "f.toml").write_text('kind = "fuzzy"\ncart = "cart.fis"\nhoist = "hoist.fis"\nangle_unit = "deg"\n')
        return {path.name: path.read_bytes() for path in root.iterdir()}


def corpus() -> list[Case]:
    """Every kind of file, each in several forms; none of them is refused."""
    table = columns()
    named = {"cart_mm": table["x"] * 1e3, "theta": np.rad2deg(table["psi"])}
    renamed = {name: table[name] for name in ("t", "u_x", "u_l", "l")} | named
    found = [
        Case("recording", "rec.csv", "rec.csv", {"rec.csv": content})
        for content in (
            as_csv(table),
            as_csv(table, ";", comma=True),
            as_csv(table, "\t"),
            b"\xef\xbb\xbf" + as_csv({name: table[name] for name in ("t", "u_x", "x")}),
        )
    ]
    clutter = {"cells": np.array([1, "a"], dtype=object), "Ts": 0.02, "note": "rig", "z": table["x"] * 1j}
    for content in (
        as_mat(table),
        as_mat(table, compressed=True),
        as_mat(table, "4"),
        as_mat({"rec": table} | clutter, compressed=True),
        as_mat({"rec": table} | clutter),
        as_mat({"simout": with_time(table)}),
    ):
        found.append(Case("recording", "rec.mat", "rec.mat", {"rec.mat": content}))
    own, folder = SIDECAR.encode(), FOLDER_SIDECAR.encode()
    found += [
        Case("recording", "rec.csv", "rec.toml", {"rec.csv": as_csv(renamed), "rec.toml": own}),
        Case("recording", "rec.csv", "recordings.toml", {"rec.csv": as_csv(renamed), "recordings.toml": folder}),
    ]
    written, model = controllers(), MODEL.encode()
    inside = {name: written[name] for name in ("f.toml", "cart.fis", "hoist.fis")}
    found += [
        Case("model", "model.toml", "model.toml", {"model.toml": model}),
        Case("controller", "c.toml", "c.toml", {"c.toml": written["c.toml"]}),
        Case("controller", "c.toml", "c.toml", {"c.toml": written["extended.toml"]}),
        *(Case("controller", "f.toml", name, inside) for name in inside),
        Case("reference", "r.toml", "r.toml", {"r.toml": REFERENCE.encode()}),
        Case("report", "report.json", "report.json", {"report.json": json.dumps(REPORT, indent=1).encode()}),
    ]
    for text in SWEEPS:
        files = {"sweep.toml": text.encode(), "model.toml": model, "c.toml": written["c.toml"]}
        found.append(Case("sweep", "sweep.toml", "sweep.toml", files))
    return found
