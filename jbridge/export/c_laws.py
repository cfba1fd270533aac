"""Laws of controllers as statements of C: what a state holds, how it begins, and what a step does.

Texts say `P_` for the header's name, as in `header`.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..control.base import AbstractController, Differences
from ..control.compensation import Compensation, limits_of
from ..control.fuzzy import FuzzyController
from ..control.linear import ObserverFeedback, Pid, StateFeedback
from ..errors import InputError
from ..fuzzy.inference import AbstractSystem
from ..fuzzy.rules import Variable
from .c_fuzzy import HELPERS, system_source
from .header import constant


@dataclass(frozen=True)
class LawInC:
    """A law's parts of a header; both lists of statements may use an `int k`."""

    members: str
    """Of the structure that holds the state."""
    functions: str
    """Definitions that a step needs."""
    start: str
    """Statements that set `state` from `measured`."""
    step: str
    """Statements that fill `command` from `measured` and `reference`."""


def law_in_c(law: AbstractController, period: float) -> LawInC:
    """The statements of a law.

    Args:
        law: fuzzy, PID, or state feedback with or without an observer.
        period: of sampling [s].

    Raises:
        InputError: the law has no form in C.
    """
    write = _LAWS.get(type(law))
    if write is None:
        raise InputError(f"a {type(law).__name__} has no form in C; export a fuzzy, PID, LQR or LQG controller")
    return write(law, period)


_MEMBERS = """\
    P_real last[3];
    P_real speed[3];"""
_START = """\
    for (k = 0; k < 3; ++k) {
        state->last[k] = measured[k];
        state->speed[k] = 0;
    }
"""
_STEP = """\
    P_real *speed = state->speed;
    for (k = 0; k < 3; ++k) {
        speed[k] += SHARE * ((measured[k] - state->last[k]) / PERIOD - speed[k]);
        state->last[k] = measured[k];
    }
"""


def _velocities(differences: Differences, period: float) -> str:
    """Statements that find `speed`."""
    share = period / (period + float(differences.time_constant))
    return _STEP.replace("SHARE", constant(share)).replace("PERIOD", constant(period))


def _compensated(law: FuzzyController | Pid | StateFeedback | ObserverFeedback, signals: tuple[str, str]) -> str:
    compensation, text = law.compensation, ""
    for k, (signal, limit) in enumerate(zip(signals, limits_of(law).tolist(), strict=True)):
        text += f"    command[{k}] = {signal};\n"
        given = f"command[{k}]"
        if compensation is not None:
            given += f" + ({_lost(compensation, k, f'command[{k}]')})"
        text += f"    command[{k}] = P_between({given}, {constant(-limit)}, {constant(limit)});\n"
    return text


def _lost(compensation: Compensation, axis: int, signal: str) -> str:
    """What friction, dead zone and the load's weight take from a signal of the cart (0) or hoist (1) [V]."""
    lost, bias = ((compensation.cart, 0.0), (compensation.hoist, compensation.hoist_bias))[axis]
    return f"{constant(lost)} * tanh({signal} / {constant(compensation.blur)}) + {constant(bias)}"


def _fuzzy(law: FuzzyController, period: float) -> LawInC:
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
    step += _compensated(law, ("P_cart(cart)", "P_hoist(hoist)"))
    return LawInC(_MEMBERS, HELPERS + functions, _START, _velocities(law.differences, period) + step)


def _pid(law: Pid, period: float) -> LawInC:
    text, signals = "", []
    for k, (axis, place) in enumerate((("cart", 0), ("hoist", 2))):
        p, i, d = (constant(getattr(law, f"{axis}_{term}")) for term in "pid")
        room = float(law.most * limits_of(law)[k])
        error, slope = f"(reference[{k}] - measured[{place}])", f"(reference[{2 + k}] - speed[{place}])"
        grown = f"state->sums[{k}] + {i} * {error} * {constant(period)}"
        text += f"    state->sums[{k}] = P_between({grown}, {constant(-room)}, {constant(room)});\n"
        signals.append(f"{p} * {error} + state->sums[{k}] + {d} * {slope}")
    return LawInC(
        _MEMBERS + "\n    P_real sums[2];",
        HELPERS,
        _START + "    state->sums[0] = state->sums[1] = 0;\n",
        _velocities(law.differences, period) + text + _compensated(law, (signals[0], signals[1])),
    )


def _state_feedback(law: StateFeedback, period: float) -> LawInC:
    away = (
        "measured[0] - reference[0]",
        "measured[1]",
        "measured[2] - reference[1]",
        "speed[0] - reference[2]",
        "speed[1]",
        "speed[2] - reference[3]",
    )
    text = _away(away) + _compensated(law, _fed_back(law.gains))
    return LawInC(_MEMBERS, HELPERS, _START, _velocities(law.differences, period) + text)


def _observer_feedback(law: ObserverFeedback, period: float) -> LawInC:
    transition, drive, correction = (np.asarray(m) for m in (law.transition, law.drive, law.correction))
    estimate, given = ([f"state->{name}[{k}]" for k in range(size)] for name, size in (("estimate", 6), ("given", 2)))
    foreseen = [_weighed([*row, *by], [*estimate, *given]) for row, by in zip(transition, drive, strict=True)]
    text = "    P_real foreseen[6], missed[3];\n"
    text += "".join(f"    foreseen[{k}] = {value};\n" for k, value in enumerate(foreseen))
    text += "    for (k = 0; k < 3; ++k) missed[k] = measured[k] - foreseen[k];\n"
    for k, row in enumerate(correction):
        text += f"    {estimate[k]} = foreseen[{k}] + {_weighed(row, [f'missed[{j}]' for j in range(3)])};\n"
    wanted = {0: 0, 2: 1, 3: 2, 5: 3}
    text += _away([each + (f" - reference[{wanted[k]}]" if k in wanted else "") for k, each in enumerate(estimate)])
    asked = "".join(f"    const P_real asked_{k} = {signal};\n" for k, signal in enumerate(_fed_back(law.gains)))
    text += asked + _compensated(law, ("asked_0", "asked_1"))
    for k in range(2):
        text += f"    state->given[{k}] = command[{k}] - ({_lost(law.compensation, k, f'asked_{k}')});\n"
    start = "    for (k = 0; k < 3; ++k) state->estimate[k] = measured[k], state->estimate[3 + k] = 0;\n"
    start += "    state->given[0] = state->given[1] = 0;\n"
    return LawInC("    P_real estimate[6];\n    P_real given[2];", HELPERS, start, text)


def _away(expressions: Sequence[str]) -> str:
    """The statement that says how far each state is from where it is wanted."""
    return "    const P_real away[6] = {\n        " + ",\n        ".join(expressions) + "};\n"


def _fed_back(gains: Any) -> tuple[str, str]:
    cart, hoist = (_weighed(-row, [f"away[{k}]" for k in range(6)]) for row in np.asarray(gains))
    return cart, hoist


def _weighed(weights: Iterable[float], values: Iterable[str]) -> str:
    """A sum, without what weighs nothing."""
    terms = [f"{constant(weight)} * {value}" for weight, value in zip(weights, values, strict=True) if weight]
    return " + ".join(terms) or constant(0.0)


_LAWS: dict[type[AbstractController], Callable[[Any, float], LawInC]] = {
    FuzzyController: _fuzzy,
    Pid: _pid,
    StateFeedback: _state_feedback,
    ObserverFeedback: _observer_feedback,
}
