"""What in a fuzzy system can never matter: rules that others always outdo, and parameters without any gradient.

Some of it follows from the rules' structure, whatever the sets: a rule that asks for more than another and concludes
the same never fires more strongly. The rest is found by asking for gradients at many random inputs.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .inference import AbstractSystem, Mamdani
from .norms import Maximum, Minimum, Product
from .rules import Labelled, Rule, in_words

_SAMPLES = 1000
"""Random inputs over the universes, and as many near the corners of the sets."""


@dataclasses.dataclass(frozen=True)
class Idle:
    """What never changes a system's output."""

    rules: tuple[tuple[int, int], ...]
    """Places of rules that can never matter, each with that of a rule that always outdoes it."""
    parameters: tuple[str, ...]
    """Names of parameters without a gradient anywhere, such as `input velocity.PB.left` or `rule 5.weight`."""
    sentences: tuple[str, ...]
    """The same in words."""


def idle_parts(system: AbstractSystem) -> Idle:
    """Finds what can never change the output of a system."""
    rules = outdone_rules(system)
    parameters = flat_parameters(system)
    sentences = []
    for idle, better in rules:
        text = in_words(system.rules[idle], system.inputs, system.outputs)
        sentences.append(
            f"Rule {idle + 1} ({text}) can never change the output: rule {better + 1} has fewer conditions "
            "and the same conclusion, so that it fires at least as strongly."
        )
    sentences += _inert_inputs(system, [idle for idle, _ in rules])
    sentences += _grouped(parameters)
    return Idle(rules, parameters, tuple(sentences))


def outdone_rules(system: AbstractSystem) -> tuple[tuple[int, int], ...]:
    """Rules that can never matter because another one always fires at least as strongly for the same conclusion.

    That holds where conclusions are put together by their maximum and a conjunction is never larger than its parts.
    """
    if not isinstance(system, Mamdani) or not isinstance(system.aggregation, Maximum):
        return ()
    shrinks = isinstance(system.conjunction, Minimum | Product)
    found: list[tuple[int, int]] = []
    gone: set[int] = set()
    for i, rule in enumerate(system.rules):
        for j, other in enumerate(system.rules):
            if i != j and j not in gone and _outdoes(other, rule, shrinks):
                found.append((i, j))
                gone.add(i)
                break
    return tuple(found)


def _outdoes(strong: Rule, weak: Rule, shrinks: bool) -> bool:
    if not set(weak.consequent) <= set(strong.consequent) or float(strong.weight) < float(weak.weight):
        return False
    less, more = set(strong.antecedent), set(weak.antecedent)
    if len(less) == 1 and len(more) == 1:
        return less == more
    if not weak.any_of and (not strong.any_of or len(less) == 1):
        return shrinks and less <= more
    # "or" of more parts is larger, whatever the norm.
    return (weak.any_of or len(more) == 1) and strong.any_of and more <= less


def flat_parameters(system: AbstractSystem) -> tuple[str, ...]:
    """Names of parameters on which no output depends at any of many random inputs."""
    rng = np.random.default_rng(0)
    lows, highs = (np.array([float(getattr(v, end)) for v in system.inputs]) for end in ("low", "high"))
    wide = rng.uniform(lows, highs, (_SAMPLES, len(lows)))
    # Sets are often condensed, so half of the inputs are drawn close to where something happens.
    near = np.stack(
        [
            rng.choice(_corners(system, i), _SAMPLES) + 0.02 * (highs[i] - lows[i]) * rng.standard_normal(_SAMPLES)
            for i in range(len(lows))
        ],
        axis=1,
    )
    values = jnp.asarray(np.clip(np.concatenate([wide, near]), lows, highs))
    largest = _largest_gradient(system, values)
    leaves, _ = jax.tree_util.tree_flatten_with_path(largest)
    names = []
    for path, leaf in leaves:
        name = _name(system, path)
        if name and not np.any(np.asarray(leaf) > 0.0):
            names.append(name)
    return tuple(names)


@jax.jit
def _largest_gradient(system: AbstractSystem, values: Array) -> AbstractSystem:
    gradient = jax.vmap(jax.jacrev(lambda s, v: s.infer(v).output), in_axes=(None, 0))(system, values)
    return jax.tree.map(lambda leaf: jnp.max(jnp.abs(leaf), axis=(0, 1)), gradient)


def _corners(system: AbstractSystem, place: int) -> np.ndarray:
    variable = system.inputs[place]
    numbers = [
        float(number)
        for member in variable.sets
        for number, unit in zip(member.parameters(), member.units(), strict=True)
        if unit.counted and np.isfinite(number)
    ]
    return np.array(numbers or [float(variable.low)])


def _name(system: AbstractSystem, path: Sequence) -> str:
    """A parameter's name from its place in the tree; empty for what is not a parameter (the ends of a universe)."""
    keys: list[Any] = [getattr(part, "name", getattr(part, "idx", None)) for part in path]
    if keys[0] in ("inputs", "outputs"):
        role, variables = keys[0][:-1], getattr(system, keys[0])
        variable: Labelled = variables[keys[1]]
        if len(keys) < 5:
            return ""
        return f"{role} {variable.name}.{variable.labels[keys[3]]}.{keys[4]}"
    if keys[0] == "rules":
        return f"rule {keys[1] + 1}.weight"
    return ""


def _inert_inputs(system: AbstractSystem, idle: Sequence[int]) -> list[str]:
    left = [rule for i, rule in enumerate(system.rules) if i not in idle]
    used = {clause.variable for rule in left for clause in rule.antecedent}
    named = {clause.variable for rule in system.rules for clause in rule.antecedent}
    sentences = []
    for place, variable in enumerate(system.inputs):
        if place in used:
            continue
        why = "only rules that can never matter ask for it" if place in named else "no rule asks for it"
        sentences.append(f"The input {variable.name} has no influence: {why}.")
    return sentences


def _grouped(parameters: Sequence[str]) -> list[str]:
    """One sentence for each set or rule."""
    groups: dict[str, list[str]] = {}
    for name in parameters:
        owner, _, key = name.rpartition(".")
        groups.setdefault(owner, []).append(key.replace("_", " "))
    return [f"No output has a slope towards {' or '.join(keys)} of {owner}." for owner, keys in groups.items()]
