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

from .columns import area_and_moment, columns, evaluate, known
from .defuzzify import AbstractDefuzzifier, Centroid
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


class AbstractSystem(eqx.Module):
    """A fuzzy system: inputs, outputs, rules."""

    inputs: eqx.AbstractVar[tuple[Variable, ...]]
    outputs: eqx.AbstractVar[tuple[Labelled, ...]]
    rules: eqx.AbstractVar[tuple[Rule, ...]]

    @abc.abstractmethod
    def infer(self, values: Float[Array, " input"], *, softness: Softness = None) -> Inference:
        """Concludes from one value per input.

        Args:
            values: in the inputs' units; what lies outside a universe counts as its end.
            softness: how close degrees must be for a choice between them to be blurred, at most 1; None for the
                textbook's inference.
        """


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

    def infer(self, values: Float[Array, " input"], *, softness: Softness = None) -> Inference:
        strength = strengths(self.inputs, self.rules, values, self.conjunction, self.disjunction, softness)
        outputs, fired = [], []
        for number, variable in enumerate(self.outputs):
            concluded = self.conclusions(strength, number, softness)
            if not concluded:
                outputs.append(variable.middle)
                fired.append(jnp.zeros((), bool))
                continue
            clauses, weights = zip(*concluded, strict=True)
            outputs.append(self._defuzzified(variable, clauses, weights, softness))
            fired.append(jnp.stack([weight for _, weight in concluded]).max() > 0.0)
        return Inference(jnp.stack(outputs), jnp.stack(fired), jnp.stack(strength))

    def conclusions(
        self, strength: Sequence[Array], output: int, softness: Softness = None
    ) -> list[tuple[Clause, Array]]:
        """What the rules say about one output, and how strongly.

        Where sets are put together by their maximum, rules with the same conclusion count as the strongest of them:
        the clipped sets are nested.
        """
        found: list[tuple[Clause, Array]] = []
        for rule, weight in zip(self.rules, strength, strict=True):
            for clause in rule.consequent:
                if clause.variable != output:
                    continue
                same = [i for i, (known, _) in enumerate(found) if known == clause]
                if same and isinstance(self.aggregation, Maximum):
                    found[same[0]] = (clause, self.aggregation(found[same[0]][1], weight, softness))
                else:
                    found.append((clause, weight))
        return found

    def _defuzzified(
        self, variable: Variable, clauses: Sequence[Clause], weights: Sequence[Array], softness: Softness
    ) -> Array:
        """One value for sets with firing strengths."""
        if (
            isinstance(self.defuzzifier, Centroid)
            and isinstance(self.implication, Minimum | Product)
            and isinstance(self.aggregation, Maximum | Sum | ProbabilisticSum)
            and known(variable)
            # Outside a compiled program many small operations cost more than a few large ones.
            and not known(weights)
        ):
            shapes, grid = evaluate(_shapes, variable, clauses, self.points)
            found = columns(shapes, grid)
            if found is not None:
                area, moment = area_and_moment(found, weights, self.implication, self.aggregation)
                middle = float(0.5 * (grid[0] + grid[-1]))
                return self.defuzzifier.balance(middle, area, moment, self.points, softness)
        shapes, grid = _shapes(variable, clauses, self.points)
        parts = [self.implication(shape, weight) for shape, weight in zip(shapes, weights, strict=True)]
        return self.defuzzifier(grid, self.aggregation.all(parts), softness)


def _shapes(variable: Variable, clauses: Sequence[Clause], points: int) -> tuple[list[Array], Array]:
    """Degrees of some conclusions over the output's grid, and the grid."""
    grid = variable.grid(points)
    degrees = [variable.sets[clause.label].degree(grid) for clause in clauses]
    return [1.0 - d if clause.negated else d for d, clause in zip(degrees, clauses, strict=True)], grid
