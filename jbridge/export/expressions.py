"""JAX's primitives that work element by element, as expressions of C."""

from collections.abc import Mapping
from typing import Any

import numpy as np

ELEMENTWISE = {
    "add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}", "abs": "fabs({})",
    "max": "{0} > {1} ? {0} : {1}", "min": "{0} < {1} ? {0} : {1}", "square": "{0} * {0}",
    "sin": "sin({})", "cos": "cos({})", "tan": "tan({})", "atan2": "atan2({}, {})", "tanh": "tanh({})",
    "exp": "exp({})", "expm1": "expm1({})", "log": "log({})", "log1p": "log1p({})", "sqrt": "sqrt({})",
    "rsqrt": "1 / sqrt({})", "pow": "pow({}, {})", "logistic": "1 / (1 + exp(-{}))", "floor": "floor({})",
    "ceil": "ceil({})", "round": "rint({})", "sign": "({0} > 0) - ({0} < 0)", "rem": "fmod({}, {})",
    "is_finite": "isfinite({})",
    "lt": "{} < {}", "le": "{} <= {}", "gt": "{} > {}", "ge": "{} >= {}", "eq": "{} == {}", "ne": "{} != {}",
    "lt_to": "{} < {}", "le_to": "{} <= {}", "and": "{} & {}", "or": "{} | {}", "xor": "{} ^ {}",
    "clamp": "{1} < {0} ? {0} : ({1} > {2} ? {2} : {1})", "copy": "{}", "stop_gradient": "{}",
}  # fmt: skip
"""Of primitives that work element by element."""
_WHOLE = {"rem": "{} % {}", "div": "{} / {}", "abs": "{0} < 0 ? -{0} : {0}"}
"""The same where they are another operation for whole numbers."""
FOLDS = {
    f"reduce_{name}": ELEMENTWISE[of]
    for name, of in {"sum": "add", "prod": "mul", "max": "max", "min": "min", "or": "or", "and": "and"}.items()
}
"""Of primitives that combine the elements along axes, two at a time."""


def expression(primitive: str, dtype: Any, params: Mapping[str, Any]) -> str | None:
    """The expression of C for a primitive, with a place for each operand, or None where there is none here.

    Args:
        primitive: its name.
        dtype: of the result.
        params: of the primitive.
    """
    if primitive == "integer_pow":
        product = " * ".join(["{0}"] * abs(params["y"]))
        return product if params["y"] > 0 else f"1 / ({product})"
    if primitive == "not":
        return "!{}" if np.issubdtype(dtype, np.bool_) else "~{}"
    whole = _WHOLE.get(primitive) if np.issubdtype(dtype, np.integer) else None
    return whole or ELEMENTWISE.get(primitive)
