"""Models as C99: one header without allocation that plays a rig in real time, with a test of its own.

The header holds `NAME_start`, `NAME_read` and `NAME_step`, the statements that JAX traces of `SampledPlant`, with all
effects of the model. A program defines `NAME_REAL` as `float` before it includes the header to compute in single
precision.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._types import Axes
from ..errors import InputError
from ..model.files import Model, present
from ..model.step_size import substeps
from ..simulation.closed_loop import Sampled, SampledPlant, periods_remembered
from .header import SelfTest, header
from .symbolic_arrays import Atoms, literal
from .translate import Translator

SAMPLES = 32
"""Samples of the self-test."""
TOLERANCES = {"double": 1e-9, "float": 2e-3}
"""Largest difference of a reading from Python's [m, rad, m]: friction that sticks decides a little earlier or later in
another arithmetic."""


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
    sampled = sampled_plant(model, period)
    leaves, _ = jax.tree.flatten(jax.eval_shape(sampled.begin, jnp.zeros(model.plant.states)))
    shapes = [leaf.shape for leaf in leaves]
    count = sum(math.prod(shape) for shape in shapes)
    return header(
        name,
        about=_ABOUT,
        period=period,
        members=f"    P_real s[{count}];\n    long samples;",
        functions=_start(sampled) + _read(sampled, shapes) + _step(sampled, shapes),
        test=_self_test(sampled, rope),
    )


def sampled_plant(model: Model, period: float) -> SampledPlant:
    """A model as the header plays it: axes of which the file has no mass or no gain are locked or absent."""
    moving = Axes(*(jnp.asarray(float(axis in present(model))) for axis in Axes._fields))
    steps, memory = substeps(model.plant, period), periods_remembered(model.plant, period)
    return SampledPlant(model.plant, jnp.asarray(period), steps, memory, moving, looped=True)


def samples(
    sampled: SampledPlant, rope: float, count: int, seed: int
) -> tuple[list[float], NDArray[np.float64], NDArray[np.float64]]:
    """Random inputs about those that hold the load, strong enough to move cart and winch, and what encoders read.

    Args:
        sampled: the plant.
        rope: length of the rope at the start [m].
        count: of samples.
        seed: of the inputs.

    Returns:
        `x, psi, l` [m, rad, m] of the rig at rest, `(sample, 2)` inputs, each held for one period, and `(sample, 3)`
        readings [m, rad, m] after each.
    """
    rng = np.random.default_rng(seed)
    bridge, moving = sampled.plant.bridge, sampled.active
    masses = np.array([bridge.cart_mass, bridge.winch_mass]) + float(bridge.load_mass)
    inputs = inputs_that_hold(sampled, np.array([3.0, 1.5]) * masses * rng.uniform(-1.0, 1.0, (count, 2)))
    begin = [0.5 * float(moving.x), 0.1 * float(moving.psi), rope]

    def step(now: Sampled, sample: Any) -> tuple[Sampled, jax.Array]:
        number, command = sample
        begin, end = (k.astype(command.dtype) * sampled.period for k in (number, number + 1))
        later = sampled.after(now, number, begin, command)
        return later, jnp.stack(sampled.measured(later, end))

    @jax.jit
    def run(initial: jax.Array, inputs: jax.Array) -> jax.Array:
        return jax.lax.scan(step, sampled.begin(initial), (jnp.arange(count), inputs))[1]

    initial = jnp.zeros(sampled.plant.states).at[:3].set(jnp.asarray(begin))
    return begin, inputs, np.asarray(run(initial, jnp.asarray(inputs)))


def inputs_that_hold(sampled: SampledPlant, force: ArrayLike = 0.0) -> NDArray[np.float64]:
    """Inputs `(..., 2)` that hold the load and leave a force `(..., 2)` [N] over; 0 where there is no drive."""
    bridge, moving = sampled.plant.bridge, sampled.active
    total = np.array([0.0, -float(bridge.load_mass * bridge.gravity)]) + np.asarray(force)
    driven = np.array([moving.x, moving.l]) > 0
    return np.divide(total, [bridge.cart_gain, bridge.hoist_gain], out=np.zeros_like(total), where=driven)


_ABOUT = """\
A model of a loading bridge, written by jbridge. All numbers are in SI units, angles in rad.

    P_state state;
    P_start(&state, position);        once: x, psi, l [m, rad, m] of the rig at rest
    P_step(&state, input);            every SECONDS s: u_x, u_l, held for that long, in the unit of the recordings
    P_read(&state, measured);         at any time: what the encoders read, x, psi, l [m, rad, m]
"""


def _start(sampled: SampledPlant) -> str:
    translator = Translator()
    initial = np.zeros(sampled.plant.states).astype(object)
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
    tree = jax.tree.structure(jax.eval_shape(sampled.begin, jnp.zeros(sampled.plant.states)))
    leaves, count = [], 0
    for shape in shapes:
        size = math.prod(shape)
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


def _self_test(sampled: SampledPlant, rope: float) -> SelfTest:
    begin, inputs, readings = samples(sampled, rope, SAMPLES, seed=0)
    if not np.all(np.isfinite(readings)):
        raise InputError("the model runs away within the self-test; --period may be too long for it")
    return SelfTest(
        what="readings",
        begin=f"static const P_real begin[3] = {{{', '.join(map(literal, begin))}}};\n    P_start(&state, begin);",
        each="P_step(&state, samples[i]);\nP_read(&state, found);",
        given=inputs,
        wanted=readings,
        tolerances=TOLERANCES,
    )
