"""From a poor start to the best fit of one model structure.

Short windows first: there a wrong gain cannot carry the simulation away, so the fit is nearly a linear regression on
the motion. Then whole recordings, where small errors add up and parameters become sharp. Several starts guard against
the trade between a dead zone and a Coulomb friction of the same axis.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from .._types import AXES
from ..errors import InputError
from ..identification.problem import Setting, free_places
from ..model.plant import Plant
from ..recordings import Recording
from .lanes import Batch
from .linearise import Engine
from .setting import lanes_for
from .solve import Fits, solve

WINDOW = 2.0
"""Length of the windows [s]."""
_STARTS = 4
_MOST = 60
"""Iterations of a last fit. A dead zone, a gain and a friction of one axis make a curved valley, along which a fit
takes many; what it leaves there when it is cut short would be taken for an effect."""
_POOR = 4.0
"""Error over noise in windows above which further starts are tried."""
_SPREAD = 0.3
"""Relative spread of the further starts."""
_COLUMNS = (8, 16, 24, 32, 48, 64)
"""Numbers of parameter columns that programs are compiled for."""


def columns_for(count: int) -> int:
    """The smallest compiled width that holds `count` free parameters."""
    return next((c for c in _COLUMNS if c >= count), count)


@dataclasses.dataclass
class BaseFit:
    """One structure, fitted to windows and to whole recordings."""

    engine: Engine
    free: NDArray[np.int64]
    free_run: Batch
    windows: Batch
    window_vector: NDArray[np.float64]
    vector: NDArray[np.float64]
    fits: Fits
    """The fit to `fitted`, one row."""
    fitted: Batch
    """What was fitted in the end: whole recordings, or windows where those were asked for."""

    @property
    def chi(self) -> float:
        """Error over noise of `fits`."""
        return chi(self.fits.cost[0], self.fitted)


def begun_anew(base: BaseFit, vector: NDArray[np.float64]) -> BaseFit:
    """The same fit from another start, if that ends better.

    Args:
        base: a fit.
        vector: where to begin; what is not free stays as it was.
    """
    start = base.vector.copy()
    start[base.free] = vector[base.free]
    width = columns_for(len(base.free))
    fits = solve(base.engine, base.fitted, start[None], [base.free], columns=width, iterations=_MOST)
    if not _cost(fits) < _cost(base.fits):
        return base
    short = solve(base.engine, base.windows, fits.vectors, [base.free], columns=width, iterations=15)
    return dataclasses.replace(base, vector=fits.vectors[0], fits=fits, window_vector=short.vectors[0])


def chi(cost: float, batch: Batch) -> float:
    """Root mean square of weighted residuals."""
    return float(np.sqrt(cost / max(measurements(batch), 1)))


def channel_errors(batch: Batch, predicted: NDArray[np.float64], *, over_noise: bool = False) -> dict[str, float]:
    """Root mean square error of each measured channel [m, rad, m], or that over its noise.

    Args:
        batch: what was measured.
        predicted: the model's readings, `(lane, sample, channel)`.
        over_noise: whether to divide by the noise's standard deviation.
    """
    weight = np.asarray(batch.lanes.weight)
    error = predicted - np.asarray(batch.lanes.y)
    if over_noise:
        error = error * weight
    out = {}
    for k, axis in enumerate(AXES):
        measured = weight[:, :, k] > 0
        if measured.any():
            out[axis] = float(np.sqrt(np.mean(error[:, :, k][measured] ** 2)))
    return out


def measurements(batch: Batch) -> int:
    """Number of measured values."""
    return int((np.asarray(batch.lanes.weight) > 0).sum())


def check_runs(base: BaseFit, recordings: Sequence[Recording]) -> None:
    """Raises `InputError` if the fitted model's simulation runs away, which no result could be told from."""
    if not np.isfinite(base.fits.cost[0]):
        names = ", ".join(r.name for r in recordings)
        raise InputError(
            f"{names}: the model's simulation runs away from these recordings; check the signs and units of the inputs "
            "and the model's numbers"
        )


def _cost(fits: Fits) -> float:
    """Cost of the only row; a simulation that runs away is worst of all."""
    return float(np.nan_to_num(fits.cost[0], nan=np.inf))


def base_fit(
    plant: Plant,
    known: frozenset[str],
    setting: Setting,
    *,
    seed: int = 0,
    starts: int = _STARTS,
    thorough: bool = False,
    window: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> BaseFit:
    """Fits everything that is not known to the training recordings.

    Args:
        plant: structure and start.
        known: parameters that are not estimated.
        setting: recordings and noise.
        seed: of the further starts.
        starts: number of starts, the given one included.
        thorough: whether whole recordings are fitted from every start where windows alone do not lead to them.
        window: length of the windows that are fitted in place of whole recordings [s]; None fits whole recordings.
        progress: told what goes on.
    """
    engine = Engine(plant)
    table = engine.table
    free = free_places(table, known, setting)
    start = np.array(table.ravel(plant), dtype=float)
    windows = lanes_for(table, plant, setting, setting.recordings, window or WINDOW)
    whole = lanes_for(table, plant, setting, setting.recordings)
    columns = columns_for(len(free))
    low, high = table.bounds()
    if progress is not None:
        progress("fitting the model to short windows")
    short = solve(engine, windows, start[None], [free], columns=columns, iterations=15)
    others = [start]
    if starts > 1 and len(free) and not chi(short.cost[0], windows) <= _POOR:
        rng = np.random.default_rng(seed)
        # A first fit may have ended where friction holds everything and no slope leads out, so the given numbers
        # serve as well.
        rows = np.stack([(start, short.vectors[0])[i % 2] for i in range(starts - 1)])
        factors = np.exp(_SPREAD * rng.uniform(-1, 1, (starts - 1, len(free))))
        rows[:, free] = np.clip(rows[:, free] * factors, low[free], high[free])
        tries = [
            solve(engine, windows, row[None], [free], columns=columns, iterations=8, tolerance=1e-2) for row in rows
        ]
        others += [fits.vectors[0] for fits in (short, *tries)]
        short = min([short, *tries], key=_cost)
    if window is not None:
        fits = solve(engine, windows, short.vectors, [free], columns=columns, iterations=_MOST)
        return BaseFit(engine, free, whole, windows, fits.vectors[0], fits.vectors[0], fits, windows)
    if progress is not None:
        progress("fitting the model to whole recordings")
    fits = solve(engine, whole, short.vectors, [free], columns=columns, iterations=_MOST)
    astray = not np.isfinite(fits.cost[0])
    if astray or (thorough and not chi(fits.cost[0], whole) <= _POOR * max(chi(short.cost[0], windows), 1.0)):
        # Where friction holds what should move, a window tells little and a slope nothing. And what leaves least of
        # windows may wind in all of the rope in a whole recording.
        if progress is not None:
            progress("fitting whole recordings from other starts")
        tries = [solve(engine, whole, other[None], [free], columns=columns, iterations=_MOST) for other in others]
        fits = min([fits, *tries], key=_cost)
    span, longest = WINDOW, max(recording.duration for recording in setting.recordings)
    near = short.vectors
    while not np.isfinite(fits.cost[0]) and (span := 2.0 * span) < longest:
        # The longer a window, the more of what leads a simulation away it shows before that is lost.
        longer = lanes_for(table, plant, setting, setting.recordings, span)
        near = solve(engine, longer, near, [free], columns=columns, iterations=15).vectors
        fits = solve(engine, whole, near, [free], columns=columns, iterations=_MOST)
    return BaseFit(
        engine,
        free,
        whole,
        windows,
        short.vectors[0],
        fits.vectors[0],
        fits,
        whole,
    )
