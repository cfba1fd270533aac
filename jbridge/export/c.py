"""Controllers as C99: one header without allocation, for `double` or `float`, with a test of its own.

The header holds two functions, `NAME_start` and `NAME_step`, which do what `AbstractController.start` and `.command`
do, and `NAME_self_test`, which lets the controller run over samples whose commands were computed here. A program
defines `NAME_REAL` as `float` before it includes the header to compute in single precision.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .._types import Axes
from ..control.base import AbstractController, Reference
from ..control.compensation import LIMITS, Compensation
from ..control.files import Controller
from ..control.fuzzy import FuzzyController
from ..control.linear import Pid, StateFeedback
from ..control.shaping import Shaping
from ..errors import InputError
from ..fuzzy.inference import AbstractSystem
from ..fuzzy.rules import Variable
from ..trajectory import Path
from .c_fuzzy import HELPERS, system_source
from .header import SelfTest, constant, header

SAMPLES = 32
"""Samples of the self-test."""
TOLERANCES = {"double": 1e-12, "float": 1e-3}
"""Largest difference of a command from Python's [V]: in single precision, differences of positions are rounded, too."""


def controller_header(controller: Controller, name: str) -> str:
    """The header of a controller.

    Args:
        controller: fuzzy, PID or state feedback.
        name: prefix of all that it defines, such as `crane`.

    Raises:
        InputError: the name is no identifier of C, or the law has no form in C.
    """
    write = _LAWS.get(type(controller.law))
    if write is None:
        raise InputError(f"a {type(controller.law).__name__} has no form in C; export a fuzzy, PID or LQR controller")
    functions, step, sums = write(controller.law, controller.period)
    law: Any = controller.law
    share = controller.period / (controller.period + float(law.differences.time_constant))
    taps = [] if controller.shaping is None else _taps(controller.shaping, controller.period)
    past = _PAST.replace("ROWS", str(taps[-1][0] + 1)) if taps else ""
    text = HELPERS + functions + _START.replace("SUMS", (_SUMS_START if sums else "") + (_PAST_START if taps else ""))
    if taps:
        text += _shape(taps)
    text += (
        _STEP.replace("GIVEN", "wanted" if taps else "reference")
        .replace("SHAPED", "    P_real reference[4];\n" if taps else "")
        .replace("PREPARE", "    P_shape(state, wanted, reference);\n" if taps else "")
        .replace("SHARE", constant(share))
        .replace("PERIOD", constant(controller.period))
        .replace("LAW", step)
    )
    return header(
        name,
        about=_ABOUT,
        period=controller.period,
        members=_MEMBERS + (_SUMS if sums else "") + past,
        functions=text,
        test=_self_test(controller),
    )


_ABOUT = """\
A controller of cart and hoist, written by jbridge. All numbers are in SI units, angles in rad.

    P_state state;
    P_start(&state, measured);                        once, with what the encoders read at rest
    P_step(&state, measured, reference, command);     every SECONDS s

measured: x [m], psi [rad], l [m]. reference: x [m], l [m] and their speeds [m/s]. command: u_x, u_l [V].
"""
_MEMBERS = """\
    P_real last[3];
    P_real speed[3];"""
_SUMS = "\n    P_real sums[2];"
_PAST = """
    /* References of the cart, position and speed, from the newest at `newest` on backwards in time. */
    P_real past[ROWS][2];
    int newest, begun;"""
_START = """
static inline void P_start(P_state *state, const P_real measured[3]) {
    int k;
    for (k = 0; k < 3; ++k) {
        state->last[k] = measured[k];
        state->speed[k] = 0;
    }
SUMS}
"""
_SUMS_START = "    state->sums[0] = state->sums[1] = 0;\n"
_PAST_START = "    state->newest = state->begun = 0;\n"
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
_STEP = """
static inline void P_step(P_state *state, const P_real measured[3], const P_real GIVEN[4], P_real command[2]) {
    P_real *speed = state->speed;
SHAPED    int k;
    for (k = 0; k < 3; ++k) {
        speed[k] += SHARE * ((measured[k] - state->last[k]) / PERIOD - speed[k]);
        state->last[k] = measured[k];
    }
PREPARELAW}
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


def _shape(taps: list[tuple[int, float]]) -> str:
    texts = {
        "TAPS": str(len(taps)),
        "LATE": ", ".join(str(late) for late, _ in taps),
        "WEIGHT": ", ".join(constant(weight) for _, weight in taps),
        "ROWS": str(taps[-1][0] + 1),
    }
    return functools.reduce(lambda text, item: text.replace(*item), texts.items(), _SHAPE)


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
    wanted = Path(controller.period * np.arange(count), *reference.T)
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


def _compensated(compensation: Compensation | None, signals: tuple[str, str]) -> str:
    if compensation is None:
        return "".join(f"    command[{k}] = {signal};\n" for k, signal in enumerate(signals))
    lost = compensation.cart, compensation.hoist
    bias = 0.0, compensation.hoist_bias
    limits = compensation.cart_limit, compensation.hoist_limit
    text = ""
    for k, signal in enumerate(signals):
        low, high = constant(-float(limits[k])), constant(limits[k])
        text += f"    command[{k}] = {signal};\n"
        blurred = f"tanh(command[{k}] / {constant(compensation.blur)})"
        given = f"command[{k}] + {constant(lost[k])} * {blurred} + {constant(bias[k])}"
        text += f"    command[{k}] = P_between({given}, {low}, {high});\n"
    return text


def _fuzzy(law: FuzzyController, period: float) -> tuple[str, str, bool]:
    """Functions, the statements of a step, and whether there are integrals."""
    speeds = [f" - reference[{2 + k}]" if law.relative_speed else "" for k in range(2)]
    cart = {
        "error": f"(reference[0] - measured[0]) / {constant(law.cart_scale)}",
        "velocity": f"speed[0]{speeds[0]}",
        "angle": f"measured[1] * {constant(180.0 / np.pi)}",
    }
    hoist = {
        "error": f"(reference[1] - measured[2]) / {constant(law.hoist_scale)}",
        "velocity": f"speed[2]{speeds[1]}",
    }

    def inputs(name: str, found: dict[str, str], variables: tuple[Variable, ...]) -> str:
        values = ",\n        ".join(found[variable.name] for variable in variables)
        return f"    const P_real {name}[{len(variables)}] = {{\n        {values}}};\n"

    systems: dict[str, AbstractSystem] = {"cart": law.cart, "hoist": law.hoist}
    functions = "".join("\n" + system_source(name, system) for name, system in systems.items())
    step = inputs("cart", cart, law.cart.inputs) + inputs("hoist", hoist, law.hoist.inputs)
    return functions, step + _compensated(law.compensation, ("P_cart(cart)", "P_hoist(hoist)")), False


def _pid(law: Pid, period: float) -> tuple[str, str, bool]:
    text, signals = "", []
    for k, (axis, place) in enumerate((("cart", 0), ("hoist", 2))):
        p, i, d = (constant(getattr(law, f"{axis}_{term}")) for term in "pid")
        room = float(law.most) * float(LIMITS[k])
        error, slope = f"(reference[{k}] - measured[{place}])", f"(reference[{2 + k}] - speed[{place}])"
        grown = f"state->sums[{k}] + {i} * {error} * {constant(period)}"
        text += f"    state->sums[{k}] = P_between({grown}, {constant(-room)}, {constant(room)});\n"
        signals.append(f"{p} * {error} + state->sums[{k}] + {d} * {slope}")
    return "", text + _compensated(law.compensation, (signals[0], signals[1])), True


def _state_feedback(law: StateFeedback, period: float) -> tuple[str, str, bool]:
    away = (
        "measured[0] - reference[0]",
        "measured[1]",
        "measured[2] - reference[1]",
        "speed[0] - reference[2]",
        "speed[1]",
        "speed[2] - reference[3]",
    )
    text = "    const P_real away[6] = {\n        " + ",\n        ".join(away) + "};\n"
    gains = np.asarray(law.gains)
    signals = [" + ".join(f"{constant(-gain)} * away[{k}]" for k, gain in enumerate(row)) for row in gains]
    return "", text + _compensated(law.compensation, (signals[0], signals[1])), False


_LAWS: dict[type[AbstractController], Callable[[Any, float], tuple[str, str, bool]]] = {
    FuzzyController: _fuzzy,
    Pid: _pid,
    StateFeedback: _state_feedback,
}
