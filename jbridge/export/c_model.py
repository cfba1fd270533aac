"""Models as C99: one header without allocation that plays a rig in real time, with a test of its own.

The header holds `NAME_start`, `NAME_read` and `NAME_step`, the statements that JAX traces of `loop.SampledPlant`, with
all effects of the model. A program defines `NAME_REAL` as `float` before it includes the header to compute in single
precision.
"""

import re
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import Axes
from ..errors import InputError
from ..loop import Sampled, SampledPlant, periods_remembered
from ..model.files import Model, present
from ..model.plant import Plant
from ..model.steps import substeps
from .c import check_name
from .translate import Atoms, Translator, literal

SAMPLES = 32
"""Samples of the self-test."""
TOLERANCES = {"double": 1e-9, "float": 2e-3}
"""Largest difference of a reading from Python's [m, rad, m]: friction that sticks decides a little earlier or later in
another arithmetic."""


@dataclass(frozen=True)
class Played:
    """What the self-test, and others, may compare with."""

    start: NDArray[np.float64]
    """`x, psi, l` [m, rad, m]; the rates are 0."""
    inputs: NDArray[np.float64]
    """`(sample, 2)`, each held for one period, in the input's unit."""
    readings: NDArray[np.float64]
    """`(sample, 3)` of the encoders after each period [m, rad, m]."""


def model_header(model: Model, name: str, *, period: float, rope: float) -> str:
    """The header of a model.

    Args:
        model: as read.
        name: prefix of all that it defines, such as `crane`.
        period: time between samples [s].
        rope: length of the rope in the self-test [m].

    Raises:
        InputError: the name is no identifier of C, or the model does what has no form in C.
    """
    check_name(name)
    sampled = sampled_plant(model, period)
    leaves, _ = jax.tree.flatten(jax.eval_shape(sampled.begin, jnp.zeros(_size(model.plant))))
    shapes = [leaf.shape for leaf in leaves]
    count = sum(int(np.prod(shape)) for shape in shapes)
    text = _HEAD + _start(sampled, _size(model.plant)) + _read(sampled, shapes) + _step(sampled, shapes)
    text += _self_test(played(sampled, model, rope, SAMPLES, seed=0))
    text = text.replace("COUNT_OF_STATES", str(count)).replace("SECONDS", repr(period))
    text = text.replace("P_NAME", name.upper())
    return re.sub(r"\bR\(", f"{name}_C(", re.sub(r"\bP_", f"{name}_", text))


def sampled_plant(model: Model, period: float) -> SampledPlant:
    """A model as the header plays it: axes of which the file has no mass or no gain are locked or absent."""
    moving = Axes(*(jnp.asarray(float(axis in present(model))) for axis in Axes._fields))
    steps, memory = substeps(model.plant, period), periods_remembered(model.plant, period)
    return SampledPlant(model.plant, jnp.asarray(period), steps, memory, moving, looped=True)


def played(sampled: SampledPlant, model: Model, rope: float, count: int, seed: int) -> Played:
    """Random inputs about those that hold the load, strong enough to move cart and winch, and what encoders read."""
    rng = np.random.default_rng(seed)
    bridge = model.plant.bridge
    moved = np.array([bridge.cart_mass + bridge.load_mass, bridge.winch_mass + bridge.load_mass], float)
    gains = np.array([bridge.cart_gain, bridge.hoist_gain], float)
    active = np.array([sampled.active.x, sampled.active.l])
    weight = np.array([0.0, -float(bridge.load_mass * bridge.gravity)])
    force = weight + np.array([3.0, 1.5]) * moved * rng.uniform(-1.0, 1.0, (count, 2))
    inputs = np.divide(force, gains, out=np.zeros_like(force), where=(active > 0) & (gains != 0) & np.isfinite(gains))
    start = np.array([0.5, 0.1, rope]) * np.array(sampled.active)
    start[2] = rope

    def step(now: Sampled, sample: Any) -> tuple[Sampled, jax.Array]:
        number, command = sample
        begin, end = (k.astype(command.dtype) * sampled.period for k in (number, number + 1))
        later = sampled.after(now, number, begin, command)
        return later, jnp.stack(sampled.measured(later, end))

    @jax.jit
    def run(initial: jax.Array, inputs: jax.Array) -> jax.Array:
        return jax.lax.scan(step, sampled.begin(initial), (jnp.arange(count), inputs))[1]

    initial = jnp.zeros(_size(model.plant)).at[:3].set(start)
    return Played(start, inputs, np.asarray(run(initial, jnp.asarray(inputs))))


_HEAD = """\
/* A model of a loading bridge, written by jbridge. All numbers are in SI units, angles in rad.
 *
 *     P_state state;
 *     P_start(&state, position);        once: x, psi, l [m, rad, m] of the rig at rest
 *     P_step(&state, input);            every SECONDS s: u_x, u_l, held for that long, in the unit of the recordings
 *     P_read(&state, measured);         at any time: what the encoders read, x, psi, l [m, rad, m]
 *
 * Define P_NAME_REAL as float before this file is included to compute in single precision. P_self_test() returns how
 * many readings differ from those that jbridge computed; with P_NAME_MAIN defined this file is a program that says so.
 */
#ifndef P_NAME_H
#define P_NAME_H
#include <stdlib.h>
#include <tgmath.h>

#ifndef P_NAME_REAL
#define P_NAME_REAL double
#endif
typedef P_NAME_REAL P_real;
#define P_C(value) ((P_real)(value))
#define P_NAME_PERIOD SECONDS

typedef struct {
    P_real s[COUNT_OF_STATES];
    long samples;
} P_state;
"""
_TEST = """
static inline int P_self_test(void) {
    /* Of every sample inputs, and readings after it. */
    static const P_real samples[COUNT][5] = {
ROWS
    };
    static const P_real begin[3] = {START};
    const P_real tolerance = sizeof(P_real) < sizeof(double) ? FLOAT : DOUBLE;
    P_state state;
    P_real measured[3];
    int i, k, failed = 0;
    P_start(&state, begin);
    for (i = 0; i < COUNT; ++i) {
        P_step(&state, samples[i]);
        P_read(&state, measured);
        for (k = 0; k < 3; ++k)
            if (!(fabs(measured[k] - samples[i][2 + k]) <= tolerance)) ++failed;
    }
    return failed;
}

#ifdef P_NAME_MAIN
#include <stdio.h>
int main(void) {
    const int failed = P_self_test();
    printf("%d of %d readings differ from jbridge's\\n", failed, 3 * COUNT);
    return failed ? 1 : 0;
}
#endif
#endif
"""


def _size(plant: Plant) -> int:
    """Length of an initial-state vector; hidden parts begin at rest."""
    return 6 + 2 * len(plant.mechanisms) + (plant.hysteresis is not None)


def _start(sampled: SampledPlant, size: int) -> str:
    translator = Translator()
    initial = np.zeros(size).astype(object)
    initial[:3] = [f"position[{k}]" for k in range(3)]
    state = translator.call(sampled.begin, initial)
    _store(translator, jax.tree.leaves(state))
    translator.line("state->samples = 0;")
    return _function("P_start(P_state *state, const P_real position[3])", translator)


def _read(sampled: SampledPlant, shapes: list[tuple[int, ...]]) -> str:
    translator = Translator()
    translator.line("const P_real *s = state->s;")
    found = translator.call(sampled.measured, _stored(sampled, shapes), np.asarray(_TIME, object))
    for k, value in enumerate(found):
        translator.line(f"measured[{k}] = {literal(value[()])};")
    return _function("P_read(const P_state *state, P_real measured[3])", translator)


def _step(sampled: SampledPlant, shapes: list[tuple[int, ...]]) -> str:
    translator = Translator()
    translator.line("P_real *s = state->s;")
    command = np.array(["input[0]", "input[1]"], object)
    zero = np.asarray(0)
    state = translator.call(sampled.after, _stored(sampled, shapes), zero, np.asarray(_TIME, object), command)
    _store(translator, jax.tree.leaves(state))
    translator.line("++state->samples;")
    return _function("P_step(P_state *state, const P_real input[2])", translator)


_TIME = "((P_real)state->samples * R(SECONDS))"


def _stored(sampled: SampledPlant, shapes: list[tuple[int, ...]]) -> Sampled:
    """The state as a program reads it."""
    tree = jax.tree.structure(jax.eval_shape(sampled.begin, jnp.zeros(_size(sampled.plant))))
    leaves, count = [], 0
    for shape in shapes:
        size = int(np.prod(shape))
        leaves.append(np.array([f"s[{count + k}]" for k in range(size)], object).reshape(shape))
        count += size
    return jax.tree.unflatten(tree, leaves)


def _store(translator: Translator, leaves: list[Atoms]) -> None:
    values = [value for leaf in leaves for value in np.asarray(leaf).ravel()]
    # A state that moves on to another place is read before that place is written.
    names = [translator.let(v) if isinstance(v, str) and v.startswith("s[") else literal(v) for v in values]
    for place, name in enumerate(names):
        translator.line(f"state->s[{place}] = {name};")


def _function(head: str, translator: Translator) -> str:
    return "\n".join(["", f"static inline void {head} {{", *translator.lines, "}", ""])


def _self_test(run: Played) -> str:
    rows = np.concatenate([run.inputs, run.readings], axis=1)
    if not np.all(np.isfinite(rows)):
        raise InputError("the model runs away within the self-test; --period may be too long for it")
    lines = ",\n".join("        {" + ", ".join(map(literal, row)) + "}" for row in rows)
    text = _TEST.replace("ROWS", lines).replace("COUNT", str(len(rows)))
    text = text.replace("START", ", ".join(map(literal, run.start)))
    return text.replace("FLOAT", literal(TOLERANCES["float"])).replace("DOUBLE", literal(TOLERANCES["double"]))
