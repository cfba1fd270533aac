"""Errors of one fixed model on some recordings, by horizon, and what the true model would leave."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ..data.windows import WHOLE, Data
from ..likelihood import Index
from ..result import Errors

WINDOW = 2.0
"""Length of the windows whose errors stand beside those of free runs [s]."""


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Errors of one model on some recordings."""

    data: Data
    windows: Index
    square: NDArray[np.float64]
    """Mean square of each window's errors over the noise's variance, by window and channel."""
    predicted: tuple[NDArray[np.float64], ...]
    """Free run of each recording, `(sample, 3)`."""
    left: tuple[NDArray[np.float64], ...]
    """What each tiling leaves over the noise, `(sample, 3)`; 0 outside of its windows."""
    left_open: Callable[[], NDArray[np.float64]]
    """Computes `undetermined`, which takes as long as all else and is not needed to compare models."""

    @functools.cached_property
    def undetermined(self) -> NDArray[np.float64]:
        """Mean variance of a window's prediction, by window and channel, over the noise's: what the half second before
        it leaves open of its initial state, carried on. A wide swing's period depends on its amplitude, so a small part
        of the noise grows over a long recording, whatever the model."""
        return self.left_open()

    @property
    def horizons(self) -> tuple[float, ...]:
        return self.data.horizons

    def of(self, horizon: float) -> NDArray[np.bool_]:
        """Which windows are of a horizon."""
        return np.asarray(self.windows.horizon == horizon)

    def noise(self) -> NDArray[np.float64]:
        """Noise by window and channel [m, rad, m]; 1 where a channel is not measured."""
        own = self.data.noise[self.windows.recording]
        return np.where(np.isnan(own), 1.0, own)

    def errors(self, horizon: float) -> dict[str, float]:
        """Root mean square error by channel [m, rad, m], over all samples."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            count = self.windows.count[own, k]
            if count.any():
                squares = self.square[own, k] * self.noise()[own, k] ** 2
                out[axis] = float(np.sqrt(np.sum(squares * count) / np.sum(count)))
        return out

    def over_foreseen(self) -> float:
        """The largest error over what is foreseen, of all channels and horizons."""
        foreseen = {horizon: self.foreseen(horizon) for horizon in self.horizons}
        each = [e / own[axis] for horizon, own in foreseen.items() for axis, e in self.errors(horizon).items()]
        return max(each, default=0.0)

    def foreseen(self, horizon: float) -> dict[str, float]:
        """Root mean square error that the true model stays below in 19 of 20 such recordings, by channel [m, rad, m]:
        the noise, and what is not determined of initial states."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            count = self.windows.count[own, k]
            if count.any():
                noise = self.noise()[own, k] ** 2 * count
                # A window's error comes from two numbers mostly, an angle and its rate: its square has their two
                # degrees of freedom, a mean like its standard deviation.
                state = self.undetermined[own, k] * noise
                total = np.sum(noise) + np.sum(state) + 2.0 * np.sqrt(np.sum(state**2))
                out[axis] = float(np.sqrt(total / np.sum(count)))
        return out

    def typical(self, horizon: float) -> dict[str, float]:
        """Geometric mean over windows in motion of the error by channel [m, rad, m]."""
        return self._typical(np.log(np.maximum(self.square, 1e-12)) / 2 + np.log(self.noise()), horizon)

    def typical_excess(self, horizon: float) -> dict[str, float]:
        """Square of the typical error less noise, in units of the noise's variance, by channel; at least 0."""
        squares = self._typical(np.log(np.maximum(self.square, 1e-12)), horizon)
        return {axis: max(square - 1.0, 0.0) for axis, square in squares.items()}

    def _typical(self, logarithms: NDArray[np.float64], horizon: float) -> dict[str, float]:
        """Geometric mean over windows in motion, by channel."""
        own, motion = self.of(horizon), self.windows.motion
        moving = [(k, axis) for k, axis in enumerate(AXES) if motion[own, k].any()]
        return {a: float(np.exp(np.average(logarithms[own, k], weights=motion[own, k]))) for k, a in moving}

    def excess(self, horizon: float) -> dict[str, float]:
        """Sum over samples of squared error less noise, by channel [m^2, rad^2, m^2]."""
        own, out = self.of(horizon), {}
        for k, axis in enumerate(AXES):
            count = self.windows.count[own, k]
            if count.any():
                variance = self.noise()[own, k] ** 2
                out[axis] = float(np.sum((self.square[own, k] - 1.0) * variance * count))
        return out

    def as_errors(self) -> Errors:
        """Errors of free runs and of windows."""
        return Errors(self.errors(WHOLE), self.errors(WINDOW))

    def ratios(self, horizon: float) -> dict[str, float]:
        """Root mean square error over the noise by channel."""
        own = self.of(horizon)
        return {
            axis: float(np.sqrt(np.average(self.square[own, k], weights=self.windows.count[own, k])))
            for k, axis in enumerate(AXES)
            if self.windows.count[own, k].any()
        }
