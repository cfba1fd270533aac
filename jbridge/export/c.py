"""Controllers as C99: one header without allocation, for `double` or `float`, with a test of its own.

The header holds two functions, `NAME_start` and `NAME_step`, which do what `AbstractController.start` and `.command`
do, and `NAME_self_test`, which lets the controller run over samples whose commands were computed here. A program
defines `NAME_REAL` as `float` before it includes the header to compute in single precision.
"""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import Axes
from ..control.base import AbstractController, Reference
from ..control.files import Controller
from ..control.shaping import Shaping
from ..trajectory import Path
from .c_laws import law_in_c
from .header import SelfTest, constant, header

SAMPLES = 32
"""Samples of the self-test."""
TOLERANCES = {"double": 1e-12, "float": 1e-3}
"""Largest difference of a command from Python's [V]: in single precision, differences of positions are rounded, too."""


def controller_header(controller: Controller, name: str) -> str:
    """The header of a controller.

    Args:
        controller: fuzzy, PID, or state feedback with or without an observer.
        name: prefix of all that it defines, such as `crane`.

    Raises:
        InputError: the name is no identifier of C, or the law has no form in C.
    """
    law = law_in_c(controller.law, controller.period)
    taps = [] if controller.shaping is None else _taps(controller.shaping, controller.period)
    begin, step = law.start, law.step
    if taps:
        begin += "    state->newest = state->begun = 0;\n"
        step = "    P_real reference[4];\n    P_shape(state, wanted, reference);\n" + step
    text = law.functions + (_with(_SHAPE, taps) if taps else "")
    text += _FUNCTIONS.replace("BEGIN", begin).replace("GIVEN", "wanted" if taps else "reference").replace("STEP", step)
    return header(
        name,
        about=_ABOUT,
        period=controller.period,
        members=law.members + (_with(_PAST, taps) if taps else ""),
        functions=text,
        test=_self_test(controller),
    )


_ABOUT = """\
A controller of cart and hoist, written by jbridge. All numbers are in SI units, angles in rad.

    P_state state;
    P_start(&state, measured);                        once, with what the encoders read at rest
    P_step(&state, measured, reference, command);     every SECONDS s

measured: x [m], psi [rad], l [m]. reference: x [m], l [m] and their speeds [m/s].
command: u_x, u_l, in the unit of the model's inputs (volts where nothing else is said).
"""
_PAST = """
    /* References of the cart, position and speed, from the newest at `newest` on backwards in time. */
    P_real past[ROWS][2];
    int newest, begun;"""
_SHAPE = """
/* Splits changes of the cart's reference into impulses whose swings cancel. */
static inline void P_shape(P_state *state, const P_real wanted[4], P_real reference[4]) {
    static const int late[TAPS] = {LATE};
    static const P_real weight[TAPS] = {WEIGHT};
    int k;
    /* What was wanted before the first sample is what is wanted then. */
    for (k = state->begun ? ROWS - 1 : 0; k < ROWS; ++k) {
        state->newest = (state->newest + ROWS - 1) % ROWS;
        state->past[state->newest][0] = wanted[0];
        state->past[state->newest][1] = wanted[2];
    }
    state->begun = 1;
    reference[0] = reference[2] = 0;
    reference[1] = wanted[1];
    reference[3] = wanted[3];
    for (k = 0; k < TAPS; ++k) {
        const P_real *then = state->past[(state->newest + late[k]) % ROWS];
        reference[0] += weight[k] * then[0];
        reference[2] += weight[k] * then[1];
    }
}
"""
_FUNCTIONS = """
static inline void P_start(P_state *state, const P_real measured[3]) {
    int k;
BEGIN}

static inline void P_step(P_state *state, const P_real measured[3], const P_real GIVEN[4], P_real command[2]) {
    int k;
STEP}
"""


def _taps(shaping: Shaping, period: float) -> list[tuple[int, float]]:
    """Samples by which parts of the reference are late, in ascending order, and the parts' weights.

    An impulse between two samples is split between them, as linear interpolation does.
    """
    found: dict[int, float] = {}
    for weight, delay in zip(*shaping.impulses(), strict=True):
        whole = math.floor(delay / period)
        share = delay / period - whole
        for late, part in ((whole, weight * (1.0 - share)), (whole + 1, weight * share)):
            if part:
                found[late] = found.get(late, 0.0) + float(part)
    return sorted(found.items())


def _with(template: str, taps: list[tuple[int, float]]) -> str:
    """A text about the past of the reference, filled in."""
    texts = {
        "TAPS": str(len(taps)),
        "LATE": ", ".join(str(late) for late, _ in taps),
        "WEIGHT": ", ".join(constant(weight) for _, weight in taps),
        "ROWS": str(taps[-1][0] + 1),
    }
    return functools.reduce(lambda text, item: text.replace(*item), texts.items(), template)


def _self_test(controller: Controller) -> SelfTest:
    # Long enough for a shaped reference to have come through.
    late = 0 if controller.shaping is None else _taps(controller.shaping, controller.period)[-1][0]
    measured, reference, command = samples(controller, SAMPLES + late, seed=0)
    return SelfTest(
        what="commands",
        begin="P_start(&state, samples[0]);",
        each="P_step(&state, samples[i], samples[i] + 3, found);",
        given=np.concatenate([measured, reference], axis=1),
        wanted=command,
        tolerances=TOLERANCES,
    )


def samples(
    controller: Controller, count: int, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A walk of the measurements about random references, and what the controller commands.

    Args:
        controller: what commands.
        count: of samples, the first one that of the start.
        seed: of the walk.

    Returns:
        `(sample, 3)` measured [m, rad, m], `(sample, 4)` references [m, m, m/s, m/s], `(sample, 2)` commands [V].
    """
    rng = np.random.default_rng(seed)
    largest = np.array([0.3, 0.2, 0.2]) * controller.period
    walk = np.cumsum(rng.uniform(-largest, largest, (count, 3)), axis=0)
    measured = np.array([0.6, 0.0, 0.5]) + walk - walk.mean(axis=0)
    away = rng.choice([1e-3, 1e-2, 0.1, 1.0], (count, 1)) * rng.standard_normal((count, 2))
    reference = np.concatenate([measured[:, [0, 2]] + away, rng.uniform(-0.2, 0.2, (count, 2))], axis=1)
    wanted = Path(controller.period * np.arange(count, dtype=np.float64), *reference.T)
    followed = np.stack(controller.follows(wanted)[1:], axis=1)[:count]
    return measured, reference, _commands(controller.law, measured, followed, controller.period)


def _commands(
    law: AbstractController, measured: NDArray[np.float64], reference: NDArray[np.float64], period: float
) -> NDArray[np.float64]:
    ready = law.ready()

    def step(state: Any, sample: Any) -> tuple[Any, jax.Array]:
        command, state = ready.command(state, Axes(*sample[0]), Reference(*sample[1]), period)
        return state, command

    @jax.jit
    def run(measured: jax.Array, reference: jax.Array) -> jax.Array:
        return jax.lax.scan(step, ready.start(Axes(*measured[0])), (measured, reference))[1]

    return np.asarray(run(jnp.asarray(measured), jnp.asarray(reference)))
