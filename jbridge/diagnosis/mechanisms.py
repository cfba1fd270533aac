"""Effects with a hidden state, which no linear screen can weigh: their seeds compete by simulation."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..identify.base import WINDOW, columns_for, measurements
from ..identify.linearise import Engine
from ..identify.setting import lanes_for
from ..identify.solve import solve
from ..model.parameters import ParameterTable
from ..recordings import Recording
from .candidates import Candidate
from .freeze import last_fit
from .search import Search
from .trials import State, Trial

_PROMISING = 0.8
"""Cost on windows, relative to the model without it, below which an effect with a hidden state is refitted whole."""
_RINGS = "belt_compliance"
"""What rings. In a window of seconds its phase must be right before a fit sees the way; in a short one it need not."""
_STIFFER = (2.5, 7.0, 20.0)
"""How much stiffer it is tried beyond the stiffest seed."""
_SHORT = 0.5
"""Length of these windows [s]."""
_NEAR = 4
"""Winners on them that compete with the seeds on longer ones."""
_SHARES = (0.8, 1.25)
"""Motor's inertia, relative to that of a belt which won, of others that are refitted beside it."""
_FEW_LEVELS = 16
"""Levels of maps that are fitted while seeds compete."""
_FEW = 2
"""Recordings on which seeds compete,"""
_LONG = 1.5
"""and how much longer than the second shortest they may be."""


@dataclasses.dataclass
class _Contest:
    """The winner among one effect's seeds."""

    cost: float
    candidate: Candidate
    engine: Engine
    vector: NDArray[np.float64]
    free: NDArray[np.int64]


def mechanisms(search: Search, state: State, only: tuple[str, str] | None = None) -> list[Trial]:
    """Refits of the effects (or of `only` one) that no linear screen can weigh, from several seeds."""
    found: dict[tuple[str, str], list[Candidate]] = {}
    for c in search.candidates(state):
        if c.unscreened and only in (None, c.name):
            found.setdefault(c.name, []).append(c)
    if not found:
        return []
    search.progress(f"refitting {len(found)} explanations with a hidden state")

    recordings = search.setting.recordings
    cost = last_fit(state).gram.cost[0]
    few = worst_met(recordings, [float(cost[state.batch.recording == i].sum()) for i in range(len(recordings))])
    lanes = lanes_for(state.engine.table, state.plant, search.setting, few, WINDOW)
    # Dozens of levels would take most of the time: those of fine maps stay as they are while seeds compete.
    level = np.array([state.engine.table.entry(int(place)).info.vector for place in state.free], bool)
    moving = ~level | (level.sum() <= _FEW_LEVELS)
    fewer = state.free[moving]
    width = columns_for(len(fewer))
    without = solve(state.engine, lanes, state.vector[None], [fewer], columns=width, iterations=5, tolerance=1e-2)

    def contest(seeds: list[Candidate]) -> _Contest:
        engine, vector, free = search.extended(state, seeds[0])
        rows = np.array([seed.set(engine.table, vector) for seed in seeds])
        places = np.concatenate([free[moving], seeds[0].places(engine.table)])
        plant = engine.table.unravel(rows[0])
        if seeds[0].kind == _RINGS:
            more = [*seeds, *stiffer(seeds)]
            begin = np.array([seed.set(engine.table, vector) for seed in more])
            plant = engine.table.unravel(begin[-1])  # the stiffest sets the step
            short = lanes_for(engine.table, plant, search.setting, few, _SHORT)
            wide = columns_for(len(places))
            quick = solve(engine, short, begin, [places] * len(more), columns=wide, iterations=8, tolerance=1e-2)
            near = np.argsort(np.nan_to_num(quick.cost, nan=np.inf))[:_NEAR]
            rows = np.concatenate([rows, quick.vectors[near]])
            seeds = [*seeds, *(more[k] for k in near)]
            stiffness = engine.table.positions(seeds[0].group("stiffness"))[0]
            plant = engine.table.unravel(rows[np.argmax(rows[:, stiffness])])
        frees = [places] * len(rows)
        batch = lanes_for(engine.table, plant, search.setting, few, WINDOW)
        tries = solve(engine, batch, rows, frees, columns=columns_for(len(frees[0])), iterations=7, tolerance=1e-2)
        best = int(np.nanargmin(np.where(np.isfinite(tries.cost), tries.cost, np.inf)))
        return _Contest(
            float(np.nan_to_num(tries.cost[best], nan=np.inf)), seeds[best], engine, tries.vectors[best], free
        )

    # Seeds compete on windows of a few recordings; only what wins there is taken through all of them.
    winners = sorted(search.each(contest, list(found.values())), key=lambda w: w.cost)
    # Where little is left, half of what exceeds the noise counts as much as a share of the whole.
    least = float(without.cost[0])
    enough = max(_PROMISING * least, least - 0.5 * max(least - measurements(lanes), 0.0))
    if only is None:  # what was asked for by its name is to be compared in any case
        winners = [w for w in winners if w.cost < enough]

    def refit(winner: _Contest) -> Trial:
        rows = [winner.vector]
        if winner.candidate.kind == _RINGS:
            rows += _ringing_alike(winner.engine.table, winner.vector, winner.candidate)
        return search.refit_rows(state, [winner.candidate] * len(rows), winner.engine, np.array(rows), winner.free)

    return search.each(refit, winners[:2])


def _ringing_alike(table: ParameterTable, vector: NDArray[np.float64], belt: Candidate) -> list[NDArray[np.float64]]:
    """Belts that ring as fast with other shares of the mass at the motor: there a fit may get stuck between."""
    stiffness, motor = (table.positions(belt.group(key))[0] for key in ("stiffness", "motor_mass"))
    mass = vector[table.positions("cart_mass")[0]]
    found = []
    for factor in _SHARES:
        other = vector.copy()
        other[motor] = min(factor * vector[motor], 0.9 * mass)
        # The masses swing against each other.
        both, before = (v[motor] * (mass - v[motor]) for v in (other, vector))
        other[stiffness] *= both / before
        found.append(other)
    return found


def worst_met(recordings: Sequence[Recording], cost: Sequence[float]) -> tuple[Recording, ...]:
    """The two recordings that a model meets worst, of those that are not long.

    A play shows where the drive turns round, an elastic rope where the load is jerked: not in every recording.

    Args:
        recordings: what it was fitted to.
        cost: sum of squares that it leaves of each.
    """
    longest = _LONG * sorted(recording.duration for recording in recordings)[:_FEW][-1]
    order = sorted(range(len(recordings)), key=lambda i: -cost[i] / recordings[i].duration)
    return tuple(recordings[i] for i in order if recordings[i].duration <= longest)[:_FEW]


def stiffer(seeds: Sequence[Candidate]) -> list[Candidate]:
    """A belt's seeds that ring fastest, ringing faster yet, the fastest last."""
    most = max(float(seed.values["stiffness"]) for seed in seeds)
    fastest = [seed for seed in seeds if float(seed.values["stiffness"]) == most]
    return [
        dataclasses.replace(seed, values={**seed.values, "stiffness": factor * most})
        for factor in _STIFFER
        for seed in fastest
    ]
