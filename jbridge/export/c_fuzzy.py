"""Fuzzy systems as C99: the degrees of sets, the rules, and how they conclude.

Every constant that depends on the sets alone is computed here, and the degrees of conclusions over the grid are tables,
so that a step of the controller is comparisons, a few multiplications and one pass over the grid.
"""

import re
from collections.abc import Iterable, Iterator, Sequence

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..fuzzy.aggregation import concluded
from ..fuzzy.defuzzify import (
    AbstractDefuzzifier,
    Bisector,
    BisectorOnGrid,
    Centroid,
    FarthestOfMaximum,
    LargestOfMaximum,
    MeanOfMaximum,
    NearestOfMaximum,
    SmallestOfMaximum,
)
from ..fuzzy.flanks import flank_slope
from ..fuzzy.inference import AbstractSystem, Mamdani
from ..fuzzy.membership import AbstractMembership, Trapezoidal
from ..fuzzy.norms import AbstractNorm, Product, Sum
from ..fuzzy.rules import Clause, Rule, Variable
from ..fuzzy.sugeno import Conclusions, Sugeno
from .header import constant

HELPERS = """\
static inline P_real P_lesser(P_real a, P_real b) { return a < b ? a : b; }
static inline P_real P_greater(P_real a, P_real b) { return a > b ? a : b; }
static inline P_real P_between(P_real v, P_real low, P_real high) {
    return v < low ? low : (v > high ? high : v);
}
static inline P_real P_either(P_real a, P_real b) { return a + b - a * b; }

/* Rises from left to top_left and falls from top_right to right; a slope of 0 makes a vertical or an open flank. */
static inline P_real P_flanks(P_real v, P_real left, P_real rise, P_real top_left, P_real top_right, P_real fall,
                              P_real right) {
    P_real up = rise > 0 ? (v - left) * rise : (v >= top_left ? 1 : 0);
    P_real down = fall > 0 ? (right - v) * fall : (v <= top_right ? 1 : 0);
    return P_between(P_lesser(up, down), 0, 1);
}

static inline P_real P_spline(P_real v, P_real begin, P_real slope, P_real middle) {
    P_real s = P_between((v - begin) * slope, 0, 1);
    if (slope <= 0) return v >= middle ? 1 : 0;
    return s < R(0.5) ? 2 * s * s : 1 - 2 * (1 - s) * (1 - s);
}

static inline P_real P_gauss(P_real v, P_real width, P_real centre) {
    P_real away = P_between((v - centre) / width, -40, 40);
    return exp(R(-0.5) * away * away);
}

static inline P_real P_bell(P_real v, P_real width, P_real slope, P_real centre) {
    P_real away = P_between(fabs(v - centre) / width, R(1e-9), R(1e9));
    return 1 / (1 + exp(P_between(2 * slope * log(away), -60, 60)));
}

static inline P_real P_sigmoid(P_real v, P_real slope, P_real centre) {
    return 1 / (1 + exp(-P_between(slope * (v - centre), -60, 60)));
}
"""
"""Functions that every header has; `P` is its prefix, and `R(...)` makes a constant of the header's kind of number."""
_COMBINE = {"min": "P_lesser", "max": "P_greater", "probor": "P_either"}
_LEAST = 1e-100
"""Least width that is divided by, as in `fuzzy.membership`."""


def combined(norm: AbstractNorm, first: str, second: str) -> str:
    """Two degrees under a norm."""
    if norm.name in ("prod", "sum"):
        return f"({first} {'*' if norm.name == 'prod' else '+'} {second})"
    return f"{_COMBINE[norm.name]}({first}, {second})"


def degree_of(member: AbstractMembership, value: str) -> str:
    """The degree of a value in a set, as an expression."""
    general = member.general()
    if isinstance(general, Trapezoidal):
        rise, fall = (
            float(flank_slope(*ends)) for ends in ((general.left, general.top_left), (general.top_right, general.right))
        )
        # An open flank is one that every value has passed.
        top_left = -np.inf if float(general.left) == -np.inf else general.top_left
        top_right = np.inf if float(general.right) == np.inf else general.top_right
        left, right = (general.left if rise else 0.0), (general.right if fall else 0.0)
        return f"P_flanks({value}, {', '.join(map(constant, (left, rise, top_left, top_right, fall, right)))})"
    numbers = [float(number) for number in member.parameters()]
    return _CURVED[member.kind](value, numbers)


def _spline(value: str, begin: float, end: float) -> str:
    slope = float(flank_slope(jnp.asarray(begin), jnp.asarray(end)))
    return f"P_spline({value}, {constant(begin)}, {constant(slope)}, {constant(0.5 * (begin + end))})"


def _gauss(value: str, width: float, centre: float) -> str:
    return f"P_gauss({value}, {constant(max(abs(width), _LEAST))}, {constant(centre)})"


def _sigmoid(value: str, slope: float, centre: float) -> str:
    return f"P_sigmoid({value}, {constant(slope)}, {constant(centre)})"


def _two_sided(value: str, n: Sequence[float]) -> str:
    left = _gauss(f"P_lesser({value}, {constant(n[1])})", n[0], n[1])
    return f"{left} * {_gauss(f'P_greater({value}, {constant(n[3])})', n[2], n[3])}"


_CURVED = {
    "smf": lambda v, n: _spline(v, n[0], n[1]),
    "zmf": lambda v, n: _spline(f"-({v})", -n[1], -n[0]),
    "pimf": lambda v, n: f"{_spline(v, n[0], n[1])} * {_spline(f'-({v})', -n[3], -n[2])}",
    "gaussmf": lambda v, n: _gauss(v, n[0], n[1]),
    "gauss2mf": _two_sided,
    "gbellmf": lambda v, n: f"P_bell({v}, {constant(max(abs(n[0]), _LEAST))}, {constant(n[1])}, {constant(n[2])})",
    "sigmf": lambda v, n: _sigmoid(v, n[0], n[1]),
    "dsigmf": lambda v, n: f"fabs({_sigmoid(v, n[0], n[1])} - {_sigmoid(v, n[2], n[3])})",
    "psigmf": lambda v, n: f"{_sigmoid(v, n[0], n[1])} * {_sigmoid(v, n[2], n[3])}",
}


def system_source(name: str, system: AbstractSystem) -> str:
    """A function `P_NAME` that takes the inputs of a system and returns its first output.

    Args:
        name: of the function, without the prefix.
        system: Mamdani's or Sugeno's.

    Raises:
        InputError: the system is of another type.
    """
    lines = [f"/* Inputs: {', '.join(_in_comment(variable.name) for variable in system.inputs)}. */"]
    if isinstance(system, Mamdani):
        tables, body = _mamdani(name, system)
    elif isinstance(system, Sugeno):
        tables, body = [], _sugeno(system)
    else:
        raise InputError(f"a {type(system).__name__} has no form in C; export a Mamdani or a Sugeno system")
    lines = [*tables, *lines, f"static P_real P_{name}(const P_real input[{len(system.inputs)}]) {{"]
    statements = _mentioned((*_inputs(system.inputs, system.matlab), *_strengths(system), *body))
    lines += [f"    {line}" for line in statements]
    return "\n".join([*lines, "}", ""])


def _mentioned(statements: Iterable[str]) -> list[str]:
    """Statements without declarations that no later one mentions: an input may have no sets, and C no empty array."""
    kept: list[str] = []
    for statement in reversed(list(statements)):
        declared = re.match(r"const P_real (\w+)", statement)
        if declared is None or any(re.search(rf"\b{declared[1]}\b", later) for later in kept):
            kept.insert(0, statement)
    return kept


def _in_comment(text: str) -> str:
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ").replace("\\", "/")


def _inputs(inputs: Sequence[Variable], matlab: bool) -> Iterator[str]:
    for place, variable in enumerate(inputs):
        value = f"input[{place}]"
        if not matlab:
            value = f"P_between({value}, {constant(variable.low)}, {constant(variable.high)})"
        yield f"const P_real in{place} = {value};"
        degrees = ",\n        ".join(degree_of(member, f"in{place}") for member in variable.sets)
        yield f"const P_real is{place}[{len(variable.sets)}] = {{\n        {degrees}}};"


def _strengths(system: Mamdani | Sugeno) -> Iterator[str]:
    def clause(found: Clause) -> str:
        degree = f"is{found.variable}[{found.label}]"
        return f"(1 - {degree})" if found.negated else degree

    def strength(rule: Rule) -> str:
        norm = system.disjunction if rule.any_of else system.conjunction
        total, *rest = (clause(found) for found in rule.antecedent)
        for each in rest:
            total = combined(norm, total, each)
        return total if float(rule.weight) == 1.0 else f"{constant(rule.weight)} * {total}"

    rules = ",\n        ".join(strength(rule) for rule in system.rules)
    yield f"const P_real rule[{len(system.rules)}] = {{\n        {rules}}};"


def _mamdani(name: str, system: Mamdani) -> tuple[list[str], list[str]]:
    """Tables of the conclusions' degrees, and the statements that conclude."""
    output = system.outputs[0]
    groups = system.conclusions_about(0)
    if not groups:
        return [], [f"return {constant(output.middle)};"]
    weights = []
    for _, rules in groups:
        total = f"rule[{rules[0]}]"
        for rule in rules[1:]:
            total = combined(system.aggregation, total, f"rule[{rule}]")
        weights.append(total)
    body = [f"const P_real weight[{len(groups)}] = {{{', '.join(weights)}}};"]
    grid = np.asarray(output.grid(system.points))
    shapes = [np.asarray(concluded(output.sets[c.label], c.negated, jnp.asarray(grid))) for c, _ in groups]
    middle = 0.5 * (grid[0] + grid[-1])
    defuzzifier = system.defuzzifier.as_matlab() if system.matlab else system.defuzzifier
    linear = isinstance(system.implication, Product) and isinstance(system.aggregation, Sum)
    if linear and isinstance(defuzzifier, Centroid):
        area, moment = (
            " + ".join(f"weight[{k}] * {constant(np.sum(shape * lever))}" for k, shape in enumerate(shapes))
            for lever in (1.0, grid - middle)
        )
        return [], [
            *body,
            f"const P_real area = {area};",
            f"const P_real moment = {moment};",
            f"return {constant(middle)} + (area > 0 ? moment / area : 0);",
        ]
    table = f"P_{name}_shape"
    rows = ",\n".join("    {" + ", ".join(map(constant, shape)) + "}" for shape in shapes)
    tables = [
        f"/* Degrees of the conclusions at the points of the output's grid. */\n"
        f"static const P_real {table}[{len(shapes)}][{len(grid)}] = {{\n{rows}}};"
    ]
    parts = [combined(system.implication, f"{table}[{k}][i]", f"weight[{k}]") for k in range(len(shapes))]
    total = parts[0]
    for part in parts[1:]:
        total = combined(system.aggregation, total, part)
    return tables, [*body, *_defuzzified(defuzzifier, grid, float(middle), total)]


def _defuzzified(defuzzifier: AbstractDefuzzifier, grid: NDArray[np.float64], middle: float, degree: str) -> list[str]:
    """Statements that put the conclusions together, `degree` at point `i`, and choose a value."""
    count, span = len(grid), float(grid[-1] - grid[0])
    point = f"({constant(grid[0])} + {constant(span)} * ((P_real)i / {count - 1}))"
    every = f"for (i = 0; i < {count}; ++i)"
    if isinstance(defuzzifier, Centroid):
        # Without an array of the degrees: a small machine's stack holds no hundred numbers.
        return [
            "P_real area = 0, moment = 0;",
            "int i;",
            f"{every} {{\n        const P_real degree = {degree};\n        area += degree;\n"
            f"        moment += degree * ({point} - {constant(middle)});\n    }}",
            f"return {constant(middle)} + (area > 0 ? moment / area : 0);",
        ]
    head = [f"P_real degree[{count}];", "int i;", f"{every} degree[i] = {degree};"]
    return [*head, *_chosen(defuzzifier, grid, middle, point, every)]


def _chosen(
    defuzzifier: AbstractDefuzzifier, grid: NDArray[np.float64], middle: float, point: str, every: str
) -> list[str]:
    """Statements that choose a value from the array of the degrees."""
    count, span = len(grid), float(grid[-1] - grid[0])
    top = [f"{every} top = P_greater(top, degree[i]);", f"if (!(top > 0)) return {constant(middle)};"]
    if isinstance(defuzzifier, MeanOfMaximum):
        return [
            "P_real top = 0, number = 0, moment = 0;",
            *top,
            f"{every} if (degree[i] >= top - R(1e-12)) {{\n        number += 1;\n"
            f"        moment += {point} - {constant(middle)};\n    }}",
            f"return {constant(middle)} + moment / number;",
        ]
    if isinstance(defuzzifier, BisectorOnGrid):
        return [
            "P_real sum = 0, reached = 0;",
            f"{every} sum += degree[i];",
            f"if (!(sum > 0)) return {constant(middle)};",
            f"for (i = 0; i < {count - 1}; ++i) {{\n        reached += degree[i];\n"
            f"        if (reached >= R(0.5) * sum) break;\n    }}",
            f"return {point};",
        ]
    if isinstance(defuzzifier, Bisector):
        return _bisector(count, span, point, middle)
    keys = {
        SmallestOfMaximum: "i",
        LargestOfMaximum: "-i",
        NearestOfMaximum: f"fabs({point})",
        FarthestOfMaximum: f"-fabs({point})",
    }
    key = keys[type(defuzzifier)]
    return [
        "P_real top = 0, least = INFINITY;",
        "int best = 0;",
        *top,
        f"{every} if (degree[i] >= top - R(1e-12) && {key} < least) {{\n        least = {key};\n"
        "        best = i;\n    }",
        "i = best;",
        f"return {point};",
    ]


def _bisector(count: int, span: float, point: str, middle: float) -> list[str]:
    step = constant(span / (count - 1))
    return [
        f"const P_real step = {step};",
        "P_real half = 0, area = 0, left, slope, under, below;",
        f"for (i = 0; i < {count - 1}; ++i) half += R(0.5) * (degree[i + 1] + degree[i]) * step;",
        "half = R(0.5) * half;",
        f"if (!(half > 0)) return {constant(middle)};",
        f"for (i = 0; i < {count - 2}; ++i) {{",
        "    const P_real piece = R(0.5) * (degree[i + 1] + degree[i]) * step;",
        "    if (area + piece > half) break;",
        "    area += piece;",
        "}",
        "left = half - area;",
        "slope = (degree[i + 1] - degree[i]) / step;",
        "under = P_greater(degree[i] * degree[i] + 2 * slope * left, 0);",
        "below = degree[i] + (under > 0 ? sqrt(under) : 0);",
        f"return {point} + P_between(below > 0 ? 2 * left / below : 0, 0, step);",
    ]


def _sugeno(system: Sugeno) -> list[str]:
    output: Conclusions = system.outputs[0]
    totals, weights = [], []
    for number, rule in enumerate(system.rules):
        for clause in rule.consequent:
            if clause.variable == 0:
                function = output.functions[clause.label]
                terms = [constant(function.offset)]
                terms += [
                    f"{constant(s)} * in{k}" for k, s in enumerate(np.asarray(function.slopes)) if float(s) != 0.0
                ]
                totals.append(f"rule[{number}] * ({' + '.join(terms)})")
                weights.append(f"rule[{number}]")
    if not totals:
        return [f"return {constant(output.middle)};"]
    mean = "total" if system.summed else "total / weight"
    return [
        f"const P_real total = {' + '.join(totals)};",
        f"const P_real weight = {' + '.join(weights)};",
        f"return weight > 0 ? {mean} : {constant(output.middle)};",
    ]
