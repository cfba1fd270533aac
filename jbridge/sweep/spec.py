"""What to sweep: a specification in TOML."""

import dataclasses
import hashlib
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from .._toml import Where, nearest, read_toml, shown, word
from ..control.base import AbstractController
from ..control.files import Controller, load_controller
from ..control.paper_rules import paper_controller
from ..control.reference_files import PAPER_POINTS, REST, SPEED
from ..errors import quoted
from ..model.files import Model, check_lengths, load_model, requires
from ..model.parameters import ParameterTable
from ..trajectory import MOST_ENTRIES
from .sample import KINDS, Axis, Design

CHUNK = 4096
"""Rollouts in a chunk where nothing is said."""
LARGEST_CHUNK = 2**20
"""Rollouts whose states fit into the memory of one machine together."""
MOST_TICKS = 10**6
"""Values of one parameter on a grid."""
_KEYS = ("model", "controller", "reference", "sample", "vary", "chunk", "precision")
_REFERENCE = ("x", "l", "speed_x", "speed_l", "rest")
VARIED: dict[str, Callable[[Any], Any]] = {
    "cart_scale": lambda law: law.cart_scale,
    "hoist_scale": lambda law: law.hoist_scale,
    "filter": lambda law: law.differences.time_constant,
}
"""Where the numbers of a controller that may vary stand in its law; a law has those that are there."""
_LARGEST = 1e6
"""Beyond this in SI units nothing on a laboratory rig makes sense, as in recordings."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sweep:
    """A question asked of many plants, controllers and references."""

    model: Model
    controller: Controller
    start: tuple[float, float]
    """Cart position and rope length at the start [m]."""
    goal: tuple[float, float]
    """And at the end [m]."""
    speed: tuple[float, float]
    """Largest speeds of the reference [m/s]."""
    rest: float
    """Time at rest after the move [s]."""
    design: Design
    chunk: int = CHUNK
    precision: str = "float64"
    text: str = ""
    """The specification as it was read."""

    @property
    def seconds(self) -> float:
        """Length of every run [s]: the longest that any of the references needs."""
        low, high = {}, {}
        for axis in self.design.axes:
            values = axis.ticks if self.design.kind == "grid" else np.array([axis.low, axis.high])
            low[axis.name], high[axis.name] = float(values.min()), float(values.max())
        ways, speeds = [], []
        for k, key in enumerate(("x", "l")):
            ends = [low.get(f"reference.{key}", self.goal[k]), high.get(f"reference.{key}", self.goal[k])]
            ways.append(max(abs(end - self.start[k]) for end in ends))
            speeds.append(low.get(f"reference.speed_{key}", self.speed[k]))
        moving = 1.875 * max(way / speed for way, speed in zip(ways, speeds, strict=True))
        return moving + high.get("reference.rest", self.rest)

    @property
    def identity(self) -> str:
        """A hash of everything that decides the results."""
        design = dataclasses.asdict(self.design)
        table = ParameterTable(self.model.plant)
        law = [np.asarray(leaf).tolist() for leaf in jax.tree.leaves(self.controller.law)]
        # Rules and sites are structure, not numbers.
        structure = [str(jax.tree.structure(part)) for part in (self.model.plant, self.controller.law)]
        content = [
            design, structure, np.asarray(table.ravel(self.model.plant)).tolist(), law, self.controller.period,
            self.start, self.goal, self.speed, self.rest, self.chunk, self.precision,
        ]  # fmt: skip
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def load_sweep(path: str | os.PathLike[str]) -> Sweep:
    """Reads a specification; the model and the controller that it names lie beside it.

    Raises:
        InputError: naming the file, the key and what to do.
    """
    document = read_toml(Path(path), "sweep", 'model = "model.toml" and the tables [sample] and [[vary]]')
    file = Where(str(path))
    file.check_keys(document, _KEYS, "key")
    if not isinstance(document.get("model"), str):
        file.refuse('no model; add model = "model.toml"')
    model = load_model(file.beside(Path(path), "model", document["model"]))
    requires(model, ("x", "psi", "l"))
    check_lengths(model)
    given = document.get("controller")
    if given is not None and not isinstance(given, str):
        file.refuse('controller is not the name of a file; write it as controller = "fuzzy.toml"')
    controller = (
        Controller(paper_controller())
        if given is None
        else load_controller(file.beside(Path(path), "controller", given))
    )
    if controller.shaping is not None:
        file.refuse(f"{controller.source} shapes its reference, which sweeps do not; take [shaping] out of it")
    start, goal, speed, rest = _reference(file, document.get("reference", {}))
    axes = _axes(file, document.get("vary"), model, controller)
    sample = document.get("sample", {})
    where = file.within("[sample]")
    if not isinstance(sample, dict):
        where.refuse("sample is not a table; write [sample] on a line of its own")
    where.check_keys(sample, ("kind", "count", "seed"), "key")
    kind = word(where, "kind", sample.get("kind"), KINDS)
    seed = _whole(where, "seed", sample.get("seed", 0), 0, 2**40)
    if kind == "grid":
        if "count" in sample:
            where.refuse("a grid has as many points as its [[vary]] tables say; delete count")
        for number, axis in enumerate(axes, start=1):
            if not axis.values and axis.count < 1:
                file.within(f"[[vary]] {number}").refuse("a grid needs values = [...] or count; add one")
        count = math.prod(axis.size for axis in axes)
        if count > KINDS[kind]:
            where.refuse(f"the grid has {count:.3g} points, more than {KINDS[kind]:.3g}; give fewer values")
    else:
        count = _whole(where, "count", sample.get("count"), 1, KINDS[kind])
        for number, axis in enumerate(axes, start=1):
            if axis.values or axis.count:
                file.within(f"[[vary]] {number}").refuse(f"values and count belong to a grid; delete them for {kind}")
    design = Design(kind, axes, count, seed)
    chunk = _whole(file, "chunk", document.get("chunk", CHUNK), 1, LARGEST_CHUNK)
    precision = word(file, "precision", document.get("precision", "float64"), ("float64", "float32"))
    text = Path(path).read_text(encoding="utf-8-sig")
    sweep = Sweep(
        model=model,
        controller=controller,
        start=start,
        goal=goal,
        speed=speed,
        rest=rest,
        design=design,
        chunk=chunk,
        precision=precision,
        text=text,
    )
    longest = MOST_ENTRIES * controller.period
    if not sweep.seconds <= longest:
        file.refuse(
            f"a run takes up to {sweep.seconds:.3g} s, more than {longest:.3g} s; raise the speeds or shorten the rest"
        )
    return sweep


def _reference(file: Where, table: Any) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float], float]:
    where = file.within("[reference]")
    if not isinstance(table, dict):
        where.refuse("reference is not a table; write [reference] on a line of its own")
    where.check_keys(table, ("start", "goal", "speed", "rest"), "key")
    pairs = []
    for key, default in (("start", PAPER_POINTS[0]), ("goal", PAPER_POINTS[1]), ("speed", SPEED)):
        value = table.get(key, list(default))
        if not isinstance(value, list) or len(value) != 2 or not all(_is_number(entry) for entry in value):
            where.refuse(
                f"{key} = {shown(value)} is not a pair of numbers; write one for the cart and one for the rope"
            )
        pairs.append((float(value[0]), float(value[1])))
    rest = table.get("rest", REST)
    if not _is_number(rest) or rest < 0 or min(pairs[2]) <= 0 or min(pairs[0][1], pairs[1][1]) <= 0:
        where.refuse("speeds and rope lengths must be positive, and the rest not negative; correct them")
    return pairs[0], pairs[1], pairs[2], float(rest)


def _is_number(value: Any) -> bool:
    return not isinstance(value, bool) and isinstance(value, int | float) and abs(value) < 1e9


def _whole(where: Where, key: str, value: Any, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        where.refuse(
            f"{key} = {shown(value)} is not a whole number from {least} to {most};"
            f" write it as {key} = {max(least, 1000)}"
        )
    return value


def variable_names(model: Model, controller: Controller) -> tuple[str, ...]:
    """Everything that a sweep may vary."""
    table = ParameterTable(model.plant)
    return (
        *table.names(),
        *(f"controller.{key}" for key, where in VARIED.items() if _has(controller.law, where)),
        *(f"reference.{key}" for key in _REFERENCE),
    )


def _has(law: AbstractController, where: Callable[[Any], Any]) -> bool:
    try:
        where(law)
    except AttributeError:
        return False
    return True


def _possible(table: ParameterTable, name: str) -> tuple[float, float]:
    """The least and the largest value of what is varied: of a plant's numbers those of their laws."""
    if name == "reference.rest":
        return 0.0, _LARGEST
    if name == "reference.x":
        return -_LARGEST, _LARGEST
    if name.startswith(("reference.", "controller.")):
        return 1 / _LARGEST, _LARGEST  # lengths, speeds, scales and a time constant
    info = table.entry(table.positions(name)[0]).info
    return max(info.low, -_LARGEST), min(info.high, _LARGEST)


def _axes(file: Where, tables: Any, model: Model, controller: Controller) -> tuple[Axis, ...]:
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        file.refuse("nothing is varied; add a [[vary]] table with name, low and high")
    every, parameters = variable_names(model, controller), ParameterTable(model.plant)
    axes: list[Axis] = []
    for number, table in enumerate(tables, start=1):
        where = file.within(f"[[vary]] {number}")
        where.check_keys(table, ("name", "low", "high", "count", "values", "log"), "key")
        name = table.get("name")
        if not isinstance(name, str) or name not in every:
            where.refuse(f"name = {shown(name)} is nothing that can be varied; {nearest(str(name), every)}")
        if any(axis.name == name for axis in axes):
            where.refuse(f"{quoted(name, 80)} is varied twice; delete one")
        values = table.get("values", [])
        if not isinstance(values, list) or not all(_is_number(value) for value in values):
            where.refuse(f"values = {shown(values)} is not a list of numbers")
        low, high = table.get("low", min(values, default=None)), table.get("high", max(values, default=None))
        if not _is_number(low) or not _is_number(high) or low > high:
            where.refuse("low and high are not the ends of a range; write low = 0.1 and high = 0.2")
        least, most = _possible(parameters, name)
        lowest, highest = min([low, *values]), max([high, *values])
        if not least <= lowest <= highest <= most:
            where.refuse(f"{name} cannot go from {lowest:g} to {highest:g}; stay within {least:g} to {most:g}")
        logarithmic = table.get("log", False)
        if not isinstance(logarithmic, bool) or (logarithmic and low <= 0):
            where.refuse("log = true needs a range of positive numbers; correct low, or delete log")
        count = _whole(where, "count", table.get("count", 0), 0, MOST_TICKS)
        axes.append(Axis(name, float(low), float(high), count, tuple(map(float, values)), logarithmic))
    return tuple(axes)
