"""`fit`: a model's unknown numbers from recordings, with intervals, and how well the result holds on others."""

import dataclasses
import time
from collections.abc import Callable, Sequence

from .._threads import one_thread_each
from ..errors import InputError
from ..identification.problem import make_setting, resolve, with_a_scale
from ..model.files import Model
from ..recordings import Recording
from .base import WINDOW, base_fit, check_runs, columns_for
from .evaluate import evaluate, traces
from .finer import LastFit, fit_finely
from .result import Fit
from .smooth import smoothed
from .uncertainty import as_uncertainty, covariance, estimates, warnings


@one_thread_each
def fit(
    model: Model,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    window: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Estimates every parameter that is not known, from all recordings together.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs.
        holdout: further runs, used only to state errors.
        window: fits windows of this length [s], each from a state of its own, in place of whole recordings. Where a
            free run measures luck (a motor in current mode is a double integrator, a creeping one may stick or not),
            short windows tell the forces more truly.
        progress: told what goes on, a short text at a time.

    Returns:
        The fitted model with 95 % intervals and free-run errors.

    Raises:
        InputError: model and recordings do not go together, or the window is shorter than ten samples.
    """
    begun = time.perf_counter()
    notes = () if window is None else (f"Fitted to windows of {window:g} s, not to whole recordings.",)
    setting = make_setting(model, recordings, holdout)
    model, told = with_a_scale(model, setting.axes)
    notes = notes if told is None else (*notes, told)
    for recording in recordings:
        if window is not None and not window >= 10 * recording.period:
            raise InputError(
                f"{recording.name}: a window of {window:g} s is shorter than ten of its samples "
                f"({10 * recording.period:.3g} s); give a longer one"
            )
    plant = resolve(model.plant, setting.length)
    base = base_fit(plant, model.known, setting, thorough=True, window=window, progress=progress)
    check_runs(base, recordings)
    fits = smoothed(base.engine, base.fitted, base.fits, columns_for(len(base.free)))
    base = dataclasses.replace(base, fits=fits, vector=fits.vectors[0])
    if progress is not None:
        progress("fitting once more, with finer steps")
    last = fit_finely(LastFit.of(base))
    table = base.engine.table
    width = last.columns
    cov = covariance(last.gram.products[0], last.gram.predicted[0], len(last.free), width, last.initial, last.batch)
    fitted = table.unravel(last.vector)
    named = type(table)(fitted, setting.units)
    found = estimates(named, last.vector, last.free, cov, setting.period)
    if progress is not None:
        progress("simulating")
    like = (base.free_run, base.windows)
    runs = [
        (
            which,
            evaluate(which, setting, recordings, width, like, windows=final, finer=final and last.finer),
            evaluate(which, setting, holdout, width, like, windows=final, finer=final and last.finer)
            if holdout
            else None,
        )
        for which, final in ((plant, False), (fitted, True))
    ]
    (_, train_before, hold_before), (_, train_after, hold_after) = runs
    shown = traces((plant, train_before), (fitted, train_after), recordings, "train")
    if hold_before is not None and hold_after is not None:
        shown += traces((plant, hold_before), (fitted, hold_after), holdout, "holdout")
    return Fit(
        dataclasses.replace(model, plant=fitted, uncertainty=as_uncertainty(found)),
        found,
        train_after.errors,
        None if hold_after is None else hold_after.errors,
        setting.noise,
        tuple(warnings(named, last.vector, last.free, cov)),
        tuple(dict.fromkeys((*notes, *(f"{r.name}: {note}" for r in (*recordings, *holdout) for note in r.notes)))),
        shown,
        WINDOW,
        time.perf_counter() - begun,
    )
