"""`fit_from_many`: the same fit from many random starts, to see whether they arrive at one place."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..identification.problem import free_places, make_setting, resolve
from ..model.files import Model
from ..recordings import Recording
from .base import chi, columns_for
from .linearise import Engine
from .setting import lanes_for
from .solve import solve

_ABREAST = 8
"""Starts whose tangents are in memory together."""
_WINDOW = 2.0


@dataclasses.dataclass(frozen=True)
class Starts:
    """Where many starts ended."""

    names: tuple[str, ...]
    """Of the estimated numbers, entries of lists one by one."""
    starts: NDArray[np.float64]
    """`(start, number)`, SI."""
    found: NDArray[np.float64]
    """The same after the fit."""
    ratios: NDArray[np.float64]
    """Error over noise of each."""
    window: float | None
    """Length of the windows that were fitted [s]; None for whole recordings."""

    def arrived(self, within: float = 0.01) -> NDArray[np.bool_]:
        """Which starts came within a share of the best one's error."""
        return self.ratios <= (1.0 + within) * np.nanmin(self.ratios)


def fit_from_many(
    model: Model,
    recordings: Sequence[Recording],
    *,
    starts: int = 64,
    spread: float = 0.5,
    window: float | None = _WINDOW,
    iterations: int = 15,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Starts:
    """Estimates every number that is not known from many random starts in one batch.

    Args:
        model: structure, what is known, and the middle of the starts.
        recordings: measured runs.
        starts: how many; the first is the model's own.
        spread: standard deviation of a start's logarithm.
        window: length of the windows that are fitted [s]; None fits whole recordings, which has more local minima.
        iterations: most steps of each.
        seed: of the starts.
        progress: told what goes on.

    Raises:
        InputError: model and recordings do not go together.
    """
    setting = make_setting(model, recordings, ())
    plant = resolve(model.plant, setting.length)
    engine = Engine(plant)
    table = engine.table
    free = free_places(table, model.known, setting)
    low, high = table.bounds()
    rng = np.random.default_rng(seed)
    rows = np.repeat(np.array(table.ravel(plant), dtype=float)[None], starts, axis=0)
    factors = np.exp(spread * rng.standard_normal((starts - 1, len(free))))
    rows[1:, free] = np.clip(rows[1:, free] * factors, low[free], high[free])
    batch = lanes_for(table, plant, setting, recordings, window)
    width = columns_for(len(free))
    found, ratios = rows.copy(), np.full(starts, np.nan)
    for begin in range(0, starts, _ABREAST):
        if progress is not None:
            progress(f"fitting from starts {begin + 1} to {min(begin + _ABREAST, starts)} of {starts}")
        # All batches are of one size, so that one program serves them.
        chosen = np.minimum(np.arange(begin, begin + _ABREAST), starts - 1)
        fits = solve(engine, batch, rows[chosen], [free] * _ABREAST, columns=width, iterations=iterations)
        found[chosen] = fits.vectors
        ratios[chosen] = [chi(cost, batch) for cost in fits.cost]
    names = tuple(table.entry(int(place)).name for place in free)
    return Starts(names, rows[:, free], found[:, free], ratios, window)
