"""`fit`: a model's unknown numbers from recordings, with intervals, and how well the result holds on others."""

import dataclasses
import time
from collections.abc import Callable, Sequence

from ..model.files import Model
from ..recordings import Recording
from .base import WINDOW, base_fit, columns_for
from .evaluate import evaluate, traces
from .result import Fit
from .setting import make_setting, resolve
from .uncertainty import as_uncertainty, covariance, estimates, warnings


def fit(
    model: Model,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """Estimates every parameter that is not known, from all recordings together.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs.
        holdout: further runs, used only to state errors.
        progress: told what goes on, a short text at a time.

    Returns:
        The fitted model with 95 % intervals and free-run errors.

    Raises:
        InputError: model and recordings do not go together.
    """
    begun = time.perf_counter()
    setting = make_setting(model, recordings, holdout)
    plant = resolve(model.plant, setting.length)
    base = base_fit(plant, model.known, setting, thorough=True, progress=progress)
    table = base.engine.table
    width = columns_for(len(base.free))
    cov = covariance(
        base.fits.gram.products[0],
        base.fits.gram.predicted[0],
        len(base.free),
        width,
        base.fits.initial[0],
        base.free_run,
    )
    fitted = table.unravel(base.vector)
    named = type(table)(fitted, setting.units)
    found = estimates(named, base.vector, base.free, cov)
    if progress is not None:
        progress("simulating")
    like = (base.free_run, base.windows)
    runs = [
        (
            which,
            evaluate(which, setting, recordings, width, like),
            evaluate(which, setting, holdout, width, like) if holdout else None,
        )
        for which in (plant, fitted)
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
        tuple(warnings(named, base.vector, base.free, cov)),
        tuple(dict.fromkeys(f"{r.name}: {note}" for r in (*recordings, *holdout) for note in r.notes)),
        shown,
        WINDOW,
        time.perf_counter() - begun,
    )
