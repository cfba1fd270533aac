"""What a run keeps: everything, every so many samples, or summaries in memory that does not grow with its length."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax


class AbstractCollector(eqx.Module):
    """Runs a loop over time and chooses what to keep of it."""

    @abc.abstractmethod
    def run(self, step: Callable[[Any, Any], tuple[Any, Any]], begin: Any, inputs: Any) -> Any:
        """As `jax.lax.scan`, whose last carry is not returned.

        Args:
            step: from a carry and one entry of the inputs to the next carry and a sample.
            begin: the first carry.
            inputs: with a leading axis of time.
        """


class Everything(AbstractCollector):
    """All samples, with a leading axis of time."""

    def run(self, step: Callable[[Any, Any], tuple[Any, Any]], begin: Any, inputs: Any) -> Any:
        return jax.lax.scan(step, begin, inputs)[1]


class Every(AbstractCollector):
    """The first of every `count` samples; a last block that is not full is left out."""

    count: int = eqx.field(static=True)

    def run(self, step: Callable[[Any, Any], tuple[Any, Any]], begin: Any, inputs: Any) -> Any:
        blocks = jax.tree.leaves(inputs)[0].shape[0] // self.count
        cut = jax.tree.map(
            lambda leaf: leaf[: blocks * self.count].reshape(blocks, self.count, *leaf.shape[1:]), inputs
        )

        def block(carry: Any, many: Any) -> tuple[Any, Any]:
            carry, first = step(carry, jax.tree.map(lambda leaf: leaf[0], many))
            rest = jax.tree.map(lambda leaf: leaf[1:], many)
            carry, _ = jax.lax.scan(lambda c, now: (step(c, now)[0], None), carry, rest)
            return carry, first

        return jax.lax.scan(block, begin, cut)[1]


class AbstractSummary(AbstractCollector):
    """Numbers that are kept up to date while time passes."""

    @abc.abstractmethod
    def start(self, sample: Any) -> Any:
        """The numbers before the first sample, which tells shapes and types only."""

    @abc.abstractmethod
    def update(self, numbers: Any, sample: Any) -> Any:
        """The numbers after one more sample."""

    @abc.abstractmethod
    def finish(self, numbers: Any) -> Any:
        """What is returned."""

    def run(self, step: Callable[[Any, Any], tuple[Any, Any]], begin: Any, inputs: Any) -> Any:
        shape = jax.eval_shape(lambda c, i: step(c, jax.tree.map(lambda leaf: leaf[0], i))[1], begin, inputs)

        def both(carry: tuple[Any, Any], now: Any) -> tuple[tuple[Any, Any], None]:
            inner, sample = step(carry[0], now)
            return (inner, self.update(carry[1], sample)), None

        (_, numbers), _ = jax.lax.scan(both, (begin, self.start(shape)), inputs)
        return self.finish(numbers)
