"""A traced function as statements of C: every element of every small array becomes a scalar.

What moves elements about (slices, reshapes, concatenations) needs no statement at all, and what depends on constants
alone is computed here. Loops stay loops, so that the text of a model does not grow with its steps.
"""

import functools
import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal

from ..errors import InputError
from .expressions import ELEMENTWISE, FOLDS, expression
from .symbolic_arrays import Atoms, c_type, elements, literal, numbers_in, taken

_NAME = re.compile(r"\bv\d+\b")
_MOVES = {
    "broadcast_in_dim", "reshape", "squeeze", "expand_dims", "slice", "concatenate", "stack", "transpose", "rev",
    "split", "pad", "gather", "scatter", "dynamic_slice", "dynamic_update_slice",
}  # fmt: skip
"""Primitives that move elements about, as far as their indices are known."""
_INSIDE = {"jit", "pjit", "closed_call", "custom_jvp_call", "custom_vjp_call", "remat2", "checkpoint", "remat"}
"""Primitives that call a function."""


class Translator:
    """Writes the statements of traced functions into `lines`, in an order in which a program may run them."""

    def __init__(self) -> None:
        self._written: list[tuple[str, str | None]] = []
        self._margin = 1
        self._names = 0

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Statements that compute a function.

        Args:
            function: of JAX arrays.
            arguments: pytrees whose leaves are `Atoms` or arrays.

        Returns:
            Its result, with `Atoms` as leaves.

        Raises:
            InputError: the function does what has no form here.
        """
        leaves, tree = jax.tree.flatten(arguments)
        leaves = [np.asarray(leaf) for leaf in leaves]
        like = [jax.ShapeDtypeStruct(a.shape, float if a.dtype == object else a.dtype) for a in leaves]
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(tree, like))
        results = self._closed(closed, leaves)
        return jax.tree.unflatten(jax.tree.structure(shape), results)

    @property
    def lines(self) -> list[str]:
        """The statements, without those whose results nothing uses."""
        uses = [set(_NAME.findall(text)) for text, _ in self._written]
        live = {
            name for (_, target), names in zip(self._written, uses, strict=True) if target is None for name in names
        }
        waiting = [k for k, (_, target) in enumerate(self._written) if target is not None]
        kept = set(range(len(self._written))) - set(waiting)
        while found := [k for k in waiting if self._written[k][1] in live]:
            kept.update(found)
            live.update(*(uses[k] for k in found))
            waiting = [k for k in waiting if k not in kept]
        return [text for k, (text, _) in enumerate(self._written) if k in kept]

    def line(self, text: str, target: str | None = None) -> None:
        """Writes a statement, or a brace.

        Args:
            text: of the statement.
            target: the variable that it sets; it is left out where nothing uses that.
        """
        self._written.append(("    " * self._margin + text, target))

    def name(self) -> str:
        """A name that has not been used."""
        self._names += 1
        return f"v{self._names}"

    def _closed(self, closed: ClosedJaxpr, inputs: Sequence[Atoms]) -> list[Atoms]:
        return self._jaxpr(closed.jaxpr, closed.consts, inputs)

    def _jaxpr(self, jaxpr: Jaxpr, constants: Sequence[Any], inputs: Sequence[Atoms]) -> list[Atoms]:
        known: dict[Any, Atoms] = dict(zip(jaxpr.constvars, map(np.asarray, constants), strict=True))
        known.update(zip(jaxpr.invars, inputs, strict=True))

        def read(variable: Any) -> Atoms:
            return np.asarray(variable.val) if isinstance(variable, Literal) else known[variable]

        for equation in jaxpr.eqns:
            results = self._equation(equation, [read(variable) for variable in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
        return [read(variable) for variable in jaxpr.outvars]

    def _equation(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        name, params = equation.primitive.name, equation.params
        if name in _INSIDE:
            inner: Any = params.get("jaxpr") or params.get("call_jaxpr")
            closed = isinstance(inner, ClosedJaxpr)
            return self._closed(inner, inputs) if closed else self._jaxpr(inner, (), inputs)
        numbers = [numbers_in(a) for a in inputs]
        if all(n is not None for n in numbers):
            typed = [np.asarray(n, _aval(variable).dtype) for n, variable in zip(numbers, equation.invars, strict=True)]
            return [np.asarray(each) for each in _bound(equation, *typed)]
        if name in _MOVES:
            return self._moved(equation, inputs)
        special = {
            "select_n": self._select, "cond": self._cond, "while": self._while, "scan": self._scan,
            "cumsum": self._cumulated, "cummax": self._cumulated, "sort": self._sort,
        }.get(name)  # fmt: skip
        if special is not None:
            return special(equation, inputs)
        if name in FOLDS:
            return [self._folded(FOLDS[name], inputs[0], params["axes"])]
        if name == "convert_element_type":
            return [self._converted(params["new_dtype"], _aval(equation.invars[0]).dtype, inputs[0])]
        dtype = _aval(equation.outvars[0]).dtype
        template = expression(name, dtype, params)
        if template is None:
            raise InputError(f"the model needs the operation {name}, which has no form in C here")
        return [self._each(template, inputs, dtype)]

    def let(self, expression: str, dtype: Any = float) -> str:
        """Writes a constant and returns its name."""
        name = self.name()
        self.line(f"const {c_type(dtype)} {name} = {expression};", name)
        return name

    def _each(self, template: str, inputs: Sequence[Atoms], dtype: Any = float) -> Atoms:
        spread = np.broadcast_arrays(*inputs)
        result = np.empty(spread[0].shape, object)
        for place in np.ndindex(result.shape):
            result[place] = self.let(template.format(*(literal(a[place]) for a in spread)), dtype)
        return result

    def _converted(self, new: Any, old: Any, value: Atoms) -> Atoms:
        if np.issubdtype(new, np.bool_):
            return self._each("{} != 0", [value], new)
        if np.issubdtype(new, np.floating) or not np.issubdtype(old, np.floating):
            return value
        return self._each("(int)({})", [value], new)

    def _select(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        which, *cases = inputs
        result = np.empty(cases[0].shape, object)
        dtype = _aval(equation.outvars[0]).dtype
        for place in np.ndindex(result.shape):
            chooser = which[place] if which.shape else which[()]
            options = [case[place] for case in cases]
            if not isinstance(chooser, str):
                result[place] = options[int(chooser)]
            elif len(options) == 2:
                result[place] = self.let(f"{chooser} ? {literal(options[1])} : {literal(options[0])}", dtype)
            else:
                chain = literal(options[-1])
                for number in reversed(range(len(options) - 1)):
                    chain = f"{chooser} == {number} ? {literal(options[number])} : ({chain})"
                result[place] = self.let(chain, dtype)
        return [result]

    def _folded(self, template: str, value: Atoms, axes: Sequence[int]) -> Atoms:
        moved = np.moveaxis(value, axes, range(len(axes)))
        rows = [np.asarray(row, object) for row in moved.reshape(-1, *moved.shape[len(axes) :])]
        return functools.reduce(lambda a, b: self._each(template, [a, b]), rows)

    def _cumulated(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        template = ELEMENTWISE["max" if equation.primitive.name == "cummax" else "add"]
        dtype = _aval(equation.outvars[0]).dtype
        axis, backwards = equation.params["axis"], equation.params["reverse"]
        rows = list(np.moveaxis(inputs[0], axis, 0))[:: -1 if backwards else 1]
        total = [np.asarray(rows[0], object)]
        for row in rows[1:]:
            total.append(self._each(template, [total[-1], np.asarray(row, object)], dtype))
        return [np.moveaxis(np.stack(total[:: -1 if backwards else 1]), 0, axis)]

    def _sort(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        if len(inputs) > 1:
            raise InputError("the model needs a sort of several arrays, which has no form in C here")
        value = np.moveaxis(inputs[0], equation.params["dimension"], 0).copy()
        for end in range(len(value) - 1, 0, -1):
            for k in range(end):
                pair = [np.asarray(value[k], object), np.asarray(value[k + 1], object)]
                smaller, larger = (self._each(ELEMENTWISE[name], pair) for name in ("min", "max"))
                value[k], value[k + 1] = smaller[()], larger[()]
        return [np.moveaxis(value, 0, equation.params["dimension"])]

    def _moved(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        """Results whose elements are elements of the inputs."""
        name = equation.primitive.name
        moving = {"gather": 1, "scatter": 3, "dynamic_slice": 1, "dynamic_update_slice": 2}.get(name, len(inputs))
        moved = [k for k in range(moving) if not (name == "scatter" and k == 1)]
        indices = [k for k in range(len(inputs)) if k not in moved]
        if any(numbers_in(inputs[k]) is None for k in indices):
            return [self._looked_up(equation, inputs)]
        pool: list[Any] = []
        arguments: list[Any] = [np.asarray(numbers_in(inputs[k]) if k in indices else 0) for k in range(len(inputs))]
        for k in moved:
            arguments[k] = np.arange(inputs[k].size).reshape(inputs[k].shape) + len(pool)
            pool.extend(inputs[k].ravel())
        for k in indices:
            arguments[k] = arguments[k].astype(_aval(equation.invars[k]).dtype)
        found = _bound(equation, *arguments)
        return [taken(pool, np.asarray(each)) for each in found]

    def _looked_up(self, equation: JaxprEqn, inputs: list[Atoms]) -> Atoms:
        """Elements of a table at places that the program computes."""
        name, params = equation.primitive.name, equation.params
        table, shape = inputs[0], _aval(equation.outvars[0]).shape
        if table.ndim != 1 or name not in ("gather", "dynamic_slice"):
            raise InputError(f"the model needs a {name} of {table.ndim} dimensions, which has no form in C here")
        places = inputs[1]
        size = params["slice_sizes"][0]
        array = self._array(table, _aval(equation.outvars[0]).dtype)
        result = np.empty(shape, object)
        starts = places[..., 0] if name == "gather" else places
        # What a slice has follows the places that it begins at.
        apart = np.ndindex(starts.shape)
        rows = result.reshape(*starts.shape, -1)
        for place in apart:
            start = literal(starts[place] if starts.shape else starts[()])
            last = len(table) - size
            at = self.let(f"{start} < 0 ? 0 : ({start} > {last} ? {last} : {start})", int)
            for k in range(rows.shape[-1]):
                rows[(*place, k)] = self.let(f"{array}[{at} + {k}]", _aval(equation.outvars[0]).dtype)
        return rows.reshape(shape)

    def _array(self, atoms: Atoms, dtype: Any) -> str:
        name = self.name()
        fixed = "static " if numbers_in(atoms) is not None else ""
        values = ", ".join(literal(each) for each in atoms.ravel())
        self.line(f"{fixed}const {c_type(dtype)} {name}[{atoms.size}] = {{{values}}};", name)
        return name

    def _variables(self, values: Sequence[Atoms], dtypes: Sequence[Any]) -> list[Atoms]:
        """Variables that begin with some values."""
        result = []
        for value, dtype in zip(values, dtypes, strict=True):
            names = np.empty(value.shape, object)
            for place in np.ndindex(value.shape):
                name = names[place] = self.name()
                self.line(f"{c_type(dtype)} {name} = {literal(value[place])};", name)
            result.append(names)
        return result

    def _assign(self, variables: Sequence[Atoms], values: Sequence[Atoms]) -> None:
        pairs: list[tuple[Any, Any]] = []
        for names, new in zip(variables, values, strict=True):
            pairs.extend(zip(names.flat, new.flat, strict=True))
        changed = {a for a, b in pairs if a != b}
        # A value that another assignment changes first is kept aside.
        kept = {b: self.let(b) for a, b in pairs if a != b and isinstance(b, str) and b in changed}
        for a, b in pairs:
            if a != b:
                self.line(f"{a} = {literal(kept.get(b, b))};", a)

    def _cond(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        branches = equation.params["branches"]
        chooser, operands = inputs[0][()], inputs[1:]
        if not isinstance(chooser, str):
            return self._closed(branches[min(max(int(chooser), 0), len(branches) - 1)], operands)
        types = [_aval(variable).dtype for variable in equation.outvars]
        zeros = [np.zeros(_aval(variable).shape, int).astype(object) for variable in equation.outvars]
        outputs = self._variables(zeros, types)
        for number, branch in enumerate(branches):
            last = number == len(branches) - 1
            test = f"{chooser} <= 0" if number == 0 else f"{chooser} == {number}"
            self.line(("" if number == 0 else "} else ") + ("{" if last else f"if ({test}) {{"))
            self._margin += 1
            self._assign(outputs, self._closed(branch, operands))
            self._margin -= 1
        self.line("}")
        return outputs

    def _while(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        params = equation.params
        of_test, of_body = params["cond_nconsts"], params["body_nconsts"]
        test_constants, body_constants = inputs[:of_test], inputs[of_test : of_test + of_body]
        carry = self._variables(inputs[of_test + of_body :], [_aval(v).dtype for v in equation.outvars])
        self.line("for (;;) {")
        self._margin += 1
        (goes_on,) = self._closed(params["cond_jaxpr"], [*test_constants, *carry])
        self.line(f"if (!{literal(goes_on[()])}) break;")
        self._assign(carry, self._closed(params["body_jaxpr"], [*body_constants, *carry]))
        self._margin -= 1
        self.line("}")
        return carry

    def _scan(self, equation: JaxprEqn, inputs: list[Atoms]) -> list[Atoms]:
        params, variables = equation.params, equation.outvars
        fixed, carried, length = params["num_consts"], params["num_carry"], params["length"]
        constants, rows = inputs[:fixed], inputs[fixed + carried :]
        types = [_aval(variable).dtype for variable in variables]
        carry = self._variables(inputs[fixed : fixed + carried], types[:carried])
        columns = [
            self._array(np.asarray(each, object), _aval(variable).dtype)
            for each, variable in zip(rows, equation.invars[fixed + carried :], strict=True)
        ]
        made = []
        for variable in variables[carried:]:
            made.append(self.name())
            self.line(f"{c_type(_aval(variable).dtype)} {made[-1]}[{math.prod(_aval(variable).shape)}];", made[-1])
        k = self.name()
        if params["reverse"]:
            self.line(f"for (int {k} = {length - 1}; {k} >= 0; --{k}) {{")
        else:
            self.line(f"for (int {k} = 0; {k} < {length}; ++{k}) {{")
        self._margin += 1
        own = [elements(name, k, each.shape[1:]) for name, each in zip(columns, rows, strict=True)]
        results = self._closed(params["jaxpr"], [*constants, *carry, *own])
        for name, value in zip(made, results[carried:], strict=True):
            for target, each in zip(elements(name, k, value.shape).flat, value.flat, strict=True):
                self.line(f"{target} = {literal(each)};", name)
        self._assign(carry, results[:carried])
        self._margin -= 1
        self.line("}")
        stacked = []
        for name, variable in zip(made, variables[carried:], strict=True):
            shape = _aval(variable).shape
            stacked.append(elements(name, "0", (math.prod(shape),)).reshape(shape))
        return [*carry, *stacked]


def _bound(equation: JaxprEqn, *values: Any) -> list[Any]:
    found = equation.primitive.bind(*map(jnp.asarray, values), **equation.primitive.get_bind_params(equation.params))
    return list(found) if equation.primitive.multiple_results else [found]


def _aval(variable: Any) -> Any:
    """Shape and type of a variable."""
    return variable.aval
