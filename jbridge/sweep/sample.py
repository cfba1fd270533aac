"""Points of a sweep, any stretch of them without the ones before: so that a chunk can be computed anew, anywhere."""

import dataclasses
import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

KINDS = {"grid": 2**40, "random": 2**40, "latin": 10**7, "sobol": 2**30}
"""Most points of each kind: a Latin hypercube orders all of them at once, and Sobol's sequence has 30 bits."""


@dataclasses.dataclass(frozen=True)
class Axis:
    """One parameter that is varied."""

    name: str
    low: float
    high: float
    count: int = 0
    """Values on a grid."""
    values: tuple[float, ...] = ()
    """The grid's values where they are listed."""
    logarithmic: bool = False

    def at(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at shares of the range between 0 and 1."""
        if self.logarithmic:
            return self.low * (self.high / self.low) ** share
        return self.low + (self.high - self.low) * share

    @property
    def size(self) -> int:
        """Number of values on a grid."""
        return len(self.values) or self.count

    @property
    def ticks(self) -> NDArray[np.float64]:
        """Values on a grid."""
        return np.array(self.values) if self.values else self.at(np.linspace(0.0, 1.0, self.count))


@dataclasses.dataclass(frozen=True)
class Design:
    """Which points of the parameters' space a sweep visits."""

    kind: str
    """`grid`, `random`, `latin` or `sobol`."""
    axes: tuple[Axis, ...]
    count: int
    seed: int

    def points(self, start: int, stop: int) -> NDArray[np.float64]:
        """Parameter values of some points, `(point, axis)`; the same whichever stretch is asked for."""
        stop = min(stop, self.count)
        if self.kind == "grid":
            shape = [axis.size for axis in self.axes]
            index = np.unravel_index(np.arange(start, stop), shape)
            return np.stack([axis.ticks[i] for axis, i in zip(self.axes, index, strict=True)], axis=1)
        return np.stack([axis.at(u) for axis, u in zip(self.axes, self._shares(start, stop).T, strict=True)], axis=1)

    def _shares(self, start: int, stop: int) -> NDArray[np.float64]:
        if self.kind == "sobol":
            sequence = qmc.Sobol(len(self.axes), scramble=True, rng=np.random.default_rng(self.seed))
            if start:
                sequence.fast_forward(start)
            with warnings.catch_warnings():
                # A stretch need not be a power of two long; only the whole may want to be.
                warnings.filterwarnings("ignore", message="The balance properties of Sobol")
                return sequence.random(stop - start)
        columns = []
        for number in range(len(self.axes)):
            key = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, number]))
            if self.kind == "latin":
                # Every point has its stratum, and a place in it that depends on nothing but the seed.
                strata = key.permutation(self.count)[start:stop]
                inside = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 1, number]))
                columns.append((strata + _skip(inside, start, stop)) / self.count)
            else:
                columns.append(_skip(key, start, stop))
        return np.stack(columns, axis=1)


def _skip(key: np.random.Generator, start: int, stop: int) -> NDArray[np.float64]:
    """Uniform numbers `start` to `stop` of a stream: four to a step of the counter."""
    first = start // 4
    assert isinstance(key.bit_generator, np.random.Philox)
    key.bit_generator.advance(first)
    return key.random(stop - 4 * first)[start - 4 * first :]
