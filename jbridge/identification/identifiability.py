"""Which numbers of a model recordings can tell, before anything is fitted."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from .._display import Displayed
from ..compilation.threads import one_thread_each
from ..model.files import Model
from ..model.parameters import ParameterTable
from ..recordings import Recording, required
from .data.windows import HORIZONS, WHOLE, make_data
from .estimation import engine_for, make_problem, start_of
from .result import Estimate
from .setting import prepared, resolve
from .uncertainty import covariance, estimates, warnings


@dataclasses.dataclass(frozen=True, repr=False)
class Identifiability(Displayed):
    """How well recordings would determine a model's unknown numbers, were they those that it starts from."""

    parameters: Mapping[str, Estimate]
    """Every number of the model with the 95 % interval that a fit could give at best; none where it is known, or where
    nothing that was recorded depends on it."""
    estimated: tuple[str, ...]
    """Names of those that a fit would estimate."""
    warnings: tuple[str, ...]
    """What the recordings do not determine, in sentences."""
    notes: tuple[str, ...]
    noise: Mapping[str, float]
    """Standard deviation of each channel's noise [m, rad, m]."""


@one_thread_each
def identifiability(model: Model, recordings: Sequence[Recording]) -> Identifiability:
    """Returns the standard deviations that the Gauss-Newton matrix promises at the model's own numbers.

    The matrix `J' W J` is that of a fit to windows of up to 3 s, with initial states eliminated and weights `W` of the
    sensors' noise, taken as white. This is the Cramer-Rao bound of a model that is right (Ljung, System
    Identification, 1999, section 7.4): what a model leaves unexplained makes a fit less certain than that.

    Args:
        model: its numbers are where the matrix is taken.
        recordings: measured runs.

    Raises:
        InputError: model and recordings do not go together.
    """
    model, setting, told = prepared(model, required(recordings))
    setting = setting.thinned()
    plant = resolve(model.plant, setting.length)
    horizons = tuple(horizon for horizon in HORIZONS if horizon < WHOLE)
    # Recordings too short for any of them are windows themselves.
    data = make_data(setting.recordings, horizons)
    problem = make_problem(setting, data if data.tilings else make_data(setting.recordings, (WHOLE,)))
    engine = engine_for(setting, problem.data, plant)
    start = start_of(problem, engine, plant, model.known)
    key = np.random.default_rng(0)
    white = [key.standard_normal(left.shape) for left in problem.residuals(engine, start)]
    [point] = problem.evaluate(engine, [start])
    point = dataclasses.replace(point, square=np.ones_like(point.square))
    cov = covariance(problem.judged_by(white), engine, point)
    table = ParameterTable(plant, setting.units)
    found = estimates(table, point.vector, point.free, cov, setting.period)
    names = dict.fromkeys(table.entry(int(place)).group for place in point.free)
    loose = warnings(table, point.vector, point.free, np.asarray(cov), table.bounds())
    return Identifiability(found, tuple(names), tuple(loose), told, setting.noise)
