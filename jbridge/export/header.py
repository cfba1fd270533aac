"""What every header in C99 has: a type of numbers, a state, functions, and a test of its own.

Texts say `P_` for the header's name, and `R(...)` for a constant in the precision that a program chooses.
"""

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError


@dataclass(frozen=True)
class SelfTest:
    """A run that was computed here, which the header repeats."""

    what: str
    """What is compared, such as `commands`."""
    begin: str
    """Statement before the first row."""
    each: str
    """Statements of row `i`, which fill `found`."""
    given: NDArray[np.float64]
    """`(row, number)`, what the statements need: `samples[i]` in C."""
    wanted: NDArray[np.float64]
    """`(row, number)`, what they should find."""
    tolerances: dict[str, float]
    """Largest difference in `double` and in `float`."""


def header(name: str, *, about: str, period: float, members: str, functions: str, test: SelfTest) -> str:
    """The text of a header.

    Args:
        name: prefix of all that it defines, such as `crane`.
        about: lines of its first comment.
        period: between two steps [s].
        members: of the structure `NAME_state`.
        functions: their definitions.
        test: what `NAME_self_test` repeats.

    Raises:
        InputError: the name is no identifier of C.
    """
    if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name):
        raise InputError(f"{name!r} is no name in C; use letters, digits and underscores, a letter first")
    functions = re.sub(rf"\b({'|'.join(_MATH)})\(", r"P_\1(", functions)
    rows = np.concatenate([test.given, test.wanted], axis=1)
    texts = {
        "ABOUT": "\n".join(f" * {line}".rstrip() for line in about.splitlines()),
        "MEMBERS": members,
        "BEGIN": test.begin,
        "EACH": "\n        ".join(test.each.splitlines()),
        "ROWS": ",\n".join("        {" + ", ".join(map(constant, row)) + "}" for row in rows),
        "COUNT": str(len(rows)),
        "WIDTH": str(rows.shape[1]),
        "GIVEN": str(test.given.shape[1]),
        "FOUND": str(test.wanted.shape[1]),
        "WHAT": test.what,
        "DOUBLE": constant(test.tolerances["double"]),
        "FLOAT": constant(test.tolerances["float"]),
        "MATH": "\n".join(_wrapped(each) for each in _MATH if f"P_{each}(" in functions + _TEXT),
        "FUNCTIONS": functions.strip("\n") + "\n",
        "SECONDS": repr(period),
        "P_NAME": name.upper(),
    }
    text = _TEXT
    for key, value in texts.items():
        text = text.replace(key, value)
    return re.sub(r"\bR\(", f"{name}_C(", re.sub(r"\bP_", f"{name}_", text))


def _wrapped(function: str) -> str:
    """The definition of a function of <math.h> that computes in `P_real`."""
    names = "ab" if function in _OF_TWO else "a"
    given, single, full = (", ".join(f"{kind}{name}" for name in names) for kind in ("P_real ", "(float)", "(double)"))
    choice = f"(P_real){function}f({single}) : (P_real){function}({full})"
    return f"static inline P_real P_{function}({given}) {{\n    return sizeof(P_real) < sizeof(double) ? {choice};\n}}"


def constant(value: Any) -> str:
    """A number with as many digits as give it back."""
    if isinstance(value, bool | np.bool_ | int | np.integer):
        return f"({int(value)})" if value < 0 else str(int(value))
    number = float(value)
    if math.isfinite(number):
        return f"R({number!r})"
    return "NAN" if math.isnan(number) else "INFINITY" if number > 0 else "(-INFINITY)"


_OF_TWO = ("atan2", "fmod", "pow")
_MATH = (
    "ceil", "cos", "exp", "expm1", "fabs", "floor", "log", "log1p", "rint", "sin", "sqrt", "tan", "tanh", *_OF_TWO,
)  # fmt: skip
"""Functions of <math.h> that texts may call. Not by <tgmath.h>, which small machines' libraries lack."""
_TEXT = """\
/*
ABOUT
 *
 * Define P_NAME_REAL as float before this file is included to compute in single precision. P_self_test() returns how
 * many WHAT differ from those that jbridge computed; with P_NAME_MAIN defined this file is a program that says so.
 */
#ifndef P_NAME_H
#define P_NAME_H
#include <math.h>

#ifndef P_NAME_REAL
#define P_NAME_REAL double
#endif
typedef P_NAME_REAL P_real;
#define P_C(value) ((P_real)(value))
#define P_NAME_PERIOD SECONDS

typedef struct {
MEMBERS
} P_state;

MATH

FUNCTIONS
static inline int P_self_test(void) {
    /* Of every sample what is given, and what jbridge found. */
    static const P_real samples[COUNT][WIDTH] = {
ROWS
    };
    const P_real tolerance = sizeof(P_real) < sizeof(double) ? FLOAT : DOUBLE;
    P_state state;
    P_real found[FOUND];
    int i, k, failed = 0;
    BEGIN
    for (i = 0; i < COUNT; ++i) {
        EACH
        for (k = 0; k < FOUND; ++k)
            if (!(P_fabs(found[k] - samples[i][GIVEN + k]) <= tolerance)) ++failed;
    }
    return failed;
}

#ifdef P_NAME_MAIN
#include <stdio.h>
int main(void) {
    const int failed = P_self_test();
    printf("%d of %d WHAT differ from jbridge's\\n", failed, FOUND * COUNT);
    return failed ? 1 : 0;
}
#endif
#endif
"""
