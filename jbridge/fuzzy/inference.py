"""Fuzzy inference: from measured values through rules to a command.

`Mamdani` concludes in fuzzy sets, which are clipped (or scaled) by the rules' firing strengths, put together and
defuzzified. `Sugeno` concludes in numbers or linear functions of the inputs, which are averaged.

Both have a hard mode, equal to the textbook's, and a smooth one that tends to it with its `softness`: corners of the
inputs' sets and the choice among degrees and firing strengths are rounded, which gives every rule a gradient where it
is nearly the strongest. Clipping and putting together on the grid stay as they are: over a hundred points their
corners average out, and rounding them would cost more than all the rest. In either mode every gradient is finite.
"""

import abc
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._math import on_processor
from .aggregation import AbstractConclusions, Columned, Gridded, Swept, Weighed, concluded
from .defuzzify import AbstractDefuzzifier, Centroid
from .merged_grid import columns, evaluate, known
from .norms import AbstractNorm, Maximum, Minimum, ProbabilisticSum, Product, Softness, Sum
from .rules import Clause, Labelled, Rule, Variable

POINTS = 101
"""Points of the grid on which sets are put together, MATLAB's default."""


class Inference(NamedTuple):
    """What a system concludes."""

    output: Float[Array, " output"]
    """In the outputs' units."""
    fired: Bool[Array, " output"]
    """Whether any rule speaks about the output; if none does, it is the middle of its range."""
    strength: Float[Array, " rule"]
    """Firing strength of every rule, 0 to 1."""


def clipped_inputs(inputs: Sequence[Variable], values: Float[Array, " input"], matlab: bool) -> Float[Array, " input"]:
    """The values at which sets are evaluated: kept within their universes, unless as in MATLAB."""
    return values if matlab else jnp.stack([variable.clip(values[i]) for i, variable in enumerate(inputs)])


class AbstractSystem(eqx.Module):
    """A fuzzy system: inputs, outputs, rules."""

    inputs: eqx.AbstractVar[tuple[Variable, ...]]
    outputs: eqx.AbstractVar[tuple[Labelled, ...]]
    rules: eqx.AbstractVar[tuple[Rule, ...]]

    @abc.abstractmethod
    def infer(self, values: Float[Array, " input"], *, softness: Softness = None) -> Inference:
        """Concludes from one value per input.

        Args:
            values: in the inputs' units; what lies outside a universe counts as its end, unless `matlab`.
            softness: how close degrees must be for a choice between them to be blurred, at most 1; None for the
                textbook's inference.
        """

    def ready(self) -> "AbstractSystem":
        """The same system for use in a loop, with what does not depend on the inputs computed."""
        return self


def strengths(
    inputs: Sequence[Variable],
    rules: Sequence[Rule],
    values: Float[Array, " input"],
    conjunction: AbstractNorm,
    disjunction: AbstractNorm,
    softness: Softness,
) -> list[Array]:
    """Firing strength of every rule."""
    degrees = [variable.degrees(values[number], softness) for number, variable in enumerate(inputs)]
    return [rule.strength(degrees, conjunction, disjunction, softness) for rule in rules]


def joined(outputs: Sequence[Array]) -> Float[Array, " output"]:
    """Outputs as one array, written one after the other.

    XLA's CPU back end puts the whole program of every part of a concatenation into one kernel, which takes minutes to
    compile from three outputs on.
    """
    if len(outputs) == 1:
        return jnp.stack(outputs)
    found = jnp.zeros(len(outputs), jnp.result_type(*outputs))
    for place, value in enumerate(outputs):
        found = found.at[place].set(value)
    return found


class Mamdani(AbstractSystem):
    """Rules that conclude in fuzzy sets (Mamdani and Assilian 1975)."""

    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    rules: tuple[Rule, ...]
    conjunction: AbstractNorm = Minimum()
    disjunction: AbstractNorm = Maximum()
    implication: AbstractNorm = Minimum()
    aggregation: AbstractNorm = Maximum()
    defuzzifier: AbstractDefuzzifier = Centroid()
    points: int = eqx.field(static=True, default=POINTS)
    """Number of points of the grid, both ends of the universe included."""
    matlab: bool = eqx.field(static=True, default=False)
    """Whether it infers as MATLAB's `evalfis` where that differs: an input beyond its universe has the degrees of its
    own place, rather than those of the nearer end; a bisector is a point of the grid; the smallest and the largest of
    maximum are chosen by size, without regard to sign."""

    def ready(self) -> "Prepared":
        return self._prepared(traced=True)

    def infer(self, values: Float[Array, " input"], *, softness: Softness = None) -> Inference:
        return self._prepared(traced=not known(values)).infer(values, softness=softness)

    def _prepared(self, *, traced: bool) -> "Prepared":
        said = tuple(self.conclusions_about(number) for number in range(len(self.outputs)))
        conclusions = tuple(
            self._conclusions(variable, [clause for clause, _ in found], traced) if found else None
            for variable, found in zip(self.outputs, said, strict=True)
        )
        rules = tuple(tuple(places for _, places in found) for found in said)
        norms = self.conjunction, self.disjunction, self.aggregation
        inputs = tuple(variable.ready() for variable in self.inputs) if traced else self.inputs
        return Prepared(inputs, self.outputs, self.rules, *norms, rules, conclusions, self.matlab)

    def conclusions_about(self, output: int) -> list[tuple[Clause, tuple[int, ...]]]:
        """What is concluded about one output, and by which rules.

        Where sets are put together by their maximum, rules with the same conclusion count as the strongest of them,
        since the clipped sets are nested; where scaled sets are added up, as often as they fire.
        """
        joined = isinstance(self.aggregation, Maximum) or self._is_linear
        found: list[tuple[Clause, tuple[int, ...]]] = []
        for place, rule in enumerate(self.rules):
            for clause in rule.consequent:
                if clause.variable != output:
                    continue
                same = [i for i, (other, _) in enumerate(found) if other == clause]
                if same and joined:
                    found[same[0]] = (clause, (*found[same[0]][1], place))
                else:
                    found.append((clause, (place,)))
        return found

    @property
    def _is_linear(self) -> bool:
        """Whether what is put together is linear in the firing strengths."""
        return isinstance(self.implication, Product) and isinstance(self.aggregation, Sum)

    def _conclusions(self, variable: Variable, clauses: Sequence[Clause], traced: bool) -> AbstractConclusions:
        """The sets of one output; `traced` in a program that is compiled."""
        centroid = isinstance(self.defuzzifier, Centroid)
        # Outside a compiled program many small operations cost more than a few large ones.
        fixed = traced and known(variable)
        shapes, grid = (
            evaluate(_shapes, variable, clauses, self.points) if fixed else _shapes(variable, clauses, self.points)
        )
        if centroid and self._is_linear:
            return Weighed.of(shapes, grid)
        found = None
        if (
            fixed
            and centroid
            and isinstance(self.implication, Minimum | Product)
            and isinstance(self.aggregation, Maximum | Sum | ProbabilisticSum)
        ):
            found = columns(shapes, grid)
        if found is not None:
            middle = float(0.5 * (grid[0] + grid[-1]))
            return Columned(tuple(found), middle, self.points, self.implication, self.aggregation)
        if traced and centroid and on_processor():  # elsewhere many points at a time cost no more
            sets = [(variable.sets[clause.label], clause.negated) for clause in clauses]
            return Swept.of(sets, variable.low, variable.high, self.points, self.implication, self.aggregation)
        shapes, grid = tuple(jnp.asarray(shape) for shape in shapes), jnp.asarray(grid)
        chosen = self.defuzzifier.as_matlab() if self.matlab else self.defuzzifier
        return Gridded(shapes, grid, self.implication, self.aggregation, chosen)


class Prepared(AbstractSystem):
    """A Mamdani system with what its sets alone decide: for loops in which they do not change."""

    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    rules: tuple[Rule, ...]
    conjunction: AbstractNorm
    disjunction: AbstractNorm
    aggregation: AbstractNorm
    concluding: tuple[tuple[tuple[int, ...], ...], ...] = eqx.field(static=True)
    """Of every output and conclusion, the rules that conclude it."""
    conclusions: tuple[AbstractConclusions | None, ...]
    """Of every output; None where no rule speaks about it."""
    matlab: bool = eqx.field(static=True)

    def infer(self, values: Float[Array, " input"], *, softness: Softness = None) -> Inference:
        inside = clipped_inputs(self.inputs, values, self.matlab)
        strength = strengths(self.inputs, self.rules, inside, self.conjunction, self.disjunction, softness)
        outputs, fired = [], []
        for variable, concluding, conclusions in zip(self.outputs, self.concluding, self.conclusions, strict=True):
            if conclusions is None:
                outputs.append(variable.middle)
                fired.append(jnp.zeros((), bool))
                continue
            weights = [self.aggregation.all([strength[i] for i in rules], softness) for rules in concluding]
            outputs.append(conclusions.value(weights, softness))
            fired.append(jnp.stack(weights).max() > 0.0)
        return Inference(joined(outputs), jnp.stack(fired), jnp.stack(strength))


def _shapes(variable: Variable, clauses: Sequence[Clause], points: int) -> tuple[list[Array], Array]:
    """Degrees of some conclusions over the output's grid, and the grid."""
    grid = variable.grid(points)
    return [concluded(variable.sets[clause.label], clause.negated, grid) for clause in clauses], grid
