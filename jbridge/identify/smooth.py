"""Maps of friction as smooth as recordings left out say, where a model leaves much more than noise.

With errors of a hundred times the noise, every level of a map takes up what is nobody's friction at its place: the fit
zigzags, and where recordings pass but once the next one finds anything but what the map says. Firmer ties between
neighbours cost some of the fit and are worth it if what others learned then foretells more of each recording. What
leaves little more than noise knows its levels, and is left alone.
"""

from .base import chi
from .lanes import Batch
from .left_out import costs_left_out, several
from .linearise import Engine
from .neighbours import LOOSE
from .solve import Fits, solve

POOR = 3.0
"""Error over noise from which levels may take up what is not theirs."""
_STRENGTHS = (LOOSE, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0)
"""All maps of a model have one of these in common; at the last they are as good as even."""
_PAYS = 0.05
"""Share of the cost on recordings left out that firmer ties must gain."""
_ROUNDS = 3
"""Choices of a strength, each from the fit with the one before,"""
_MOST = 20
"""and the steps of each fit."""


def smoothed(engine: Engine, batch: Batch, fits: Fits, columns: int) -> Fits:
    """A fit of one row with firmer ties between neighbouring levels of its maps, as far as that is worth it.

    Args:
        engine: of the model.
        batch: the lanes that it was fitted to.
        fits: the fit.
        columns: columns of the engine's program.
    """
    free = fits.free[0]
    poor = chi(float(fits.cost[0]), batch) > POOR
    if not poor or not several(batch) or not engine.table.vectors(free):
        return fits
    now = LOOSE
    for _ in range(_ROUNDS):
        costs = by_strength(engine, batch, fits, columns)
        best = min((s for s in costs if s >= now), key=lambda strength: costs[strength])
        if not costs[best] < (1 - _PAYS) * costs[now]:
            break
        now = best
        fits = solve(
            engine,
            batch,
            fits.vectors,
            [free],
            initial=fits.initial,
            columns=columns,
            iterations=_MOST,
            strength=now,
        )
    return fits


def by_strength(engine: Engine, batch: Batch, fits: Fits, columns: int) -> dict[float, float]:
    """What recordings left out would cost with ties of each strength; arguments as of `smoothed`."""
    given = (fits.vectors[0], fits.free[0], fits.gram.products[0], columns, fits.initial[0], batch)
    return costs_left_out(engine.table, *given, _STRENGTHS)
