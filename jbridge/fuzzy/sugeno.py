"""Rules that conclude in numbers or linear functions of the inputs (Takagi and Sugeno 1985)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Scalar
from .defuzzify import EMPTY
from .inference import AbstractSystem, Inference, clipped_inputs, joined, strengths
from .membership import as_number
from .norms import AbstractNorm, Maximum, Product, Softness
from .rules import Rule, Variable, check_labels


class Linear(eqx.Module):
    """`offset + slopes . inputs`: a conclusion of first order, or of order zero where the slopes are 0."""

    slopes: Float[Array, " input"] = eqx.field(converter=as_number)
    offset: Scalar = eqx.field(converter=as_number)

    def value(self, inputs: Float[Array, " input"]) -> Scalar:
        return self.offset + jnp.sum(self.slopes * inputs)


class Conclusions(eqx.Module):
    """An output, with the functions that rules may conclude in."""

    name: str = eqx.field(static=True)
    low: Scalar = eqx.field(converter=as_number)
    high: Scalar = eqx.field(converter=as_number)
    labels: tuple[str, ...] = eqx.field(static=True)
    functions: tuple[Linear, ...]

    def __check_init__(self) -> None:
        check_labels(self.name, self.labels, self.functions)

    @property
    def middle(self) -> Scalar:
        """Middle of the range."""
        return 0.5 * (self.low + self.high)


class Sugeno(AbstractSystem):
    """Rules whose conclusions are averaged by their firing strengths."""

    inputs: tuple[Variable, ...]
    outputs: tuple[Conclusions, ...]
    rules: tuple[Rule, ...]
    conjunction: AbstractNorm = Product()
    disjunction: AbstractNorm = Maximum()
    summed: bool = eqx.field(static=True, default=False)
    """Whether conclusions are added up rather than averaged."""
    matlab: bool = eqx.field(static=True, default=False)
    """Whether an input beyond its universe has the degrees of its own place, as in MATLAB; see `Mamdani.matlab`."""

    def __check_init__(self) -> None:
        if any(clause.negated for rule in self.rules for clause in rule.consequent):
            raise ValueError("a Sugeno rule concludes in a function, which cannot be negated")

    def infer(self, values: Float[Array, " input"], *, softness: Softness = None) -> Inference:
        inside = clipped_inputs(self.inputs, values, self.matlab)
        strength = strengths(self.inputs, self.rules, inside, self.conjunction, self.disjunction, softness)
        outputs, fired = [], []
        for number, output in enumerate(self.outputs):
            total, weights = jnp.zeros_like(inside[0]), jnp.zeros_like(inside[0])
            for rule, weight in zip(self.rules, strength, strict=True):
                for clause in rule.consequent:
                    if clause.variable == number:
                        total = total + weight * output.functions[clause.label].value(inside)
                        weights = weights + weight
            any_fired = weights > 0.0
            if not self.summed:
                none = output.middle * EMPTY * (0.0 if softness is None else softness)
                total, weights = total + none, weights + EMPTY * (0.0 if softness is None else softness)
                total = total / jnp.where(weights > 0.0, weights, 1.0)
            outputs.append(jnp.where(any_fired, total, output.middle))
            fired.append(any_fired)
        return Inference(joined(outputs), jnp.stack(fired), jnp.stack(strength))
