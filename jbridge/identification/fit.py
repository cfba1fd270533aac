"""`fit`: a model's unknown numbers from recordings, with intervals, and how well the result holds on others."""

import dataclasses
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from .._progress import silent, with_progress
from ..compilation.threads import one_thread_each
from ..errors import InputError
from ..model.files import Model
from ..model.parameters import ParameterTable
from ..recordings import Recording, as_recordings, covered_by, required
from .data.thinning import thinned
from .data.windows import make_data, make_windows
from .estimation import engine_for, fit_structure, make_problem
from .evaluation.errors import WINDOW
from .evaluation.judge import make_judge
from .result import Fit
from .setting import free_places, make_setting, prepared, resolve
from .solver import Start
from .traces import traces
from .uncertainty import as_uncertainty, covariance, estimates, warnings


@one_thread_each
@with_progress
def fit(
    model: Model,
    recordings: Recording | Sequence[Recording],
    holdout: Recording | Sequence[Recording] = (),
    *,
    window: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Estimates every parameter that is not known, from all recordings together.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs, or one of them.
        holdout: further runs, used only to state errors.
        window: fits windows of this length [s] alone, each from a state of its own, in place of windows of several
            lengths and whole recordings. Where a free run measures luck (a motor in current mode is a double
            integrator, a creeping one may stick or not), short windows tell the forces more truly.
        progress: told what goes on, a short text at a time; by default a bar on a terminal or in a notebook.

    Returns:
        The fitted model with 95 % intervals and free-run errors.

    Raises:
        InputError: there are no recordings, model and recordings do not go together, or the window does not suit one.
    """
    begun = time.perf_counter()
    tell = progress or silent
    notes = () if window is None else (f"Fitted to windows of {window:g} s, not to whole recordings.",)
    recordings, holdout = required(recordings), as_recordings(holdout)
    model, setting, told = prepared(model, recordings, holdout)
    notes = (*notes, *told)
    for recording in recordings:
        if window is not None and not window >= 10 * recording.period:
            raise InputError(
                f"{recording.name}: a window of {window:g} s is shorter than ten of its samples "
                f"({10 * recording.period:.3g} s); give a longer one"
            )
    setting = setting.thinned()
    recordings, holdout = setting.recordings, tuple(map(thinned, holdout))
    given = resolve(model.plant, setting.length)
    problem = make_problem(setting, make_data(recordings) if window is None else make_windows(recordings, window))
    tell("fitting")
    problem, fitted = fit_structure(problem, given, model.known)
    cov = covariance(problem, fitted.engine, fitted.point)
    named = ParameterTable(fitted.plant, setting.units)
    found = estimates(named, fitted.vector, fitted.free, cov, setting.period)
    tell("simulating")
    samples = problem.data.samples
    judges = [(make_judge(setting, recordings, setting.noise, samples=samples), "train")]
    if holdout:
        judges.append((make_judge(setting, holdout, setting.noise, samples=samples), "holdout"))
    runs = [
        (judge.evaluate(given, fitted.engine), judge.evaluate(fitted.plant, fitted.engine), role)
        for judge, role in judges
    ]
    shown = [trace for a, b, role in runs for trace in traces((given, a), (fitted.plant, b), role)]
    return Fit(
        model=dataclasses.replace(
            model,
            plant=fitted.plant,
            uncertainty=as_uncertainty(found),
            recorded=covered_by(recordings),
            units={**model.units, **setting.units},
        ),
        estimates=found,
        train=runs[0][1].as_errors(),
        holdout=runs[1][1].as_errors() if holdout else None,
        noise=setting.noise,
        over_foreseen=runs[-1][1].over_foreseen(),
        warnings=tuple(warnings(named, fitted.vector, fitted.free, cov, named.bounds())),
        notes=tuple(
            dict.fromkeys((*notes, *(f"{r.name}: {note}" for r in (*recordings, *holdout) for note in r.notes)))
        ),
        traces=tuple(shown),
        window=WINDOW,
        seconds=time.perf_counter() - begun,
    )


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
    window: float
    """Length of the windows that were fitted [s]."""

    def arrived(self) -> NDArray[np.bool_]:
        """Which starts came within 1 % of the best one's error."""
        return self.ratios <= 1.01 * np.nanmin(self.ratios)


@with_progress
def fit_from_many(
    model: Model,
    recordings: Recording | Sequence[Recording],
    *,
    starts: int = 64,
    spread: float = 0.5,
    iterations: int = 15,
    progress: Callable[[str], None] | None = None,
) -> Starts:
    """Estimates every number that is not known from many random starts, side by side.

    Args:
        model: structure, what is known, and the middle of the starts.
        recordings: measured runs, or one of them.
        starts: how many; the first is the model's own.
        spread: standard deviation of a start's logarithm.
        iterations: most steps of each.
        progress: told what goes on; by default a bar on a terminal or in a notebook.

    Raises:
        InputError: model and recordings do not go together, or one is too short.
    """
    (progress or silent)(f"fitting from {starts} starts")
    setting = make_setting(model, required(recordings), ()).thinned()
    plant = resolve(model.plant, setting.length)
    problem = make_problem(setting, make_windows(setting.recordings, WINDOW))
    engine = engine_for(setting, problem.data, plant)
    table = engine.table
    free = free_places(table, model.known, setting)
    low, high = table.bounds()
    rng = np.random.default_rng(0)
    rows = np.repeat(np.array(table.ravel(plant), dtype=float)[None], starts, axis=0)
    factors = np.exp(spread * rng.standard_normal((starts - 1, len(free))))
    rows[1:, free] = np.clip(rows[1:, free] * factors, low[free], high[free])
    points = problem.solve(engine, [Start(row, free, problem.guesses) for row in rows], iterations)
    count = problem.windows.count
    ratios = [float(np.sqrt(np.sum(p.square * count) / count.sum())) for p in points]
    names = tuple(table.entry(int(place)).name for place in free)
    found = np.stack([p.vector[free] for p in points])
    return Starts(names, rows[:, free], found, np.array(ratios), WINDOW)
