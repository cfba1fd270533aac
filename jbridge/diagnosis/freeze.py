"""Models whose numbers are settled: how they meet what they were, and what they were not, learned from."""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from ..identification.problem import Setting
from ..identify.base import BaseFit, columns_for
from ..identify.evaluate import Run, evaluate
from ..identify.finer import LastFit
from ..identify.result import Estimate
from ..identify.uncertainty import covariance, estimates, warnings
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from .trials import State


class Frozen(NamedTuple):
    """A model whose numbers are settled, and how it meets what it was and was not learned from."""

    fit: LastFit
    plant: Plant
    train: Run
    holdout: Run


def freeze(fitted: LastFit, setting: Setting, base: BaseFit) -> Frozen:
    """The runs of a fitted model; `base` has programs that are compiled anyway."""
    plant = fitted.engine.table.unravel(fitted.vector)
    like = (base.free_run, base.windows)
    with ThreadPoolExecutor(2) as pool:  # the compiler and the programs release the interpreter
        train, holdout = (
            pool.submit(evaluate, plant, setting, which, fitted.columns, like, finer=fitted.finer)
            for which in (setting.recordings, setting.holdout)
        )
    return Frozen(fitted, plant, train.result(), holdout.result())


def last_fit(state: State) -> LastFit:
    """A search's model as it was fitted last."""
    width = columns_for(len(state.free))
    gram = state.engine.gram(state.vector[None], state.free[None], state.initial[None], state.batch, columns=width)
    return LastFit(state.engine, state.vector, state.free, state.initial, gram, state.batch)


def numbers(fitted: LastFit, setting: Setting) -> tuple[dict[str, Estimate], tuple[str, ...]]:
    """A model's numbers with their intervals, and what the recordings hardly tell."""
    count = len(fitted.free)
    cov = covariance(
        fitted.gram.products[0], fitted.gram.predicted[0], count, fitted.columns, fitted.initial, fitted.batch
    )
    table = ParameterTable(fitted.engine.table.unravel(fitted.vector), setting.units)
    told = estimates(table, fitted.vector, fitted.free, cov, setting.period)
    return told, tuple(warnings(table, fitted.vector, fitted.free, cov))
