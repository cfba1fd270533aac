"""Refits of the most promising candidates, and the choice among them, one acceptance after the other."""

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._programs import forget_if_large
from ..identification.problem import Setting, free_places, scene_of
from ..identify.base import WINDOW, channel_errors, columns_for
from ..identify.lanes import Batch
from ..identify.left_out import cross_validated, folds, smoothness
from ..identify.linearise import Engine
from ..identify.setting import lanes_for
from ..identify.smooth import POOR, by_strength, smoothed
from ..identify.solve import Fits, solve
from ..model.effects.catalogue import make_effect
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from .candidates import WRONG_VALUE, Candidate, candidates, unnamed_forces
from .levels import anchored, settle_levels
from .normal import Tangents
from .screen import Screen, Screened, screen
from .shortlist import merged, shortlist, with_simpler
from .trials import State, Trial, least_gain, significance_of, transfer

_HARD_TO_PASS = 0.2
"""Least share of the cost that an effect must gain, above which the screen's expectation may rule a refit out."""
_URGED_GAIN = 0.005
"""Least share of the cost that an effect must gain where the hold-out asks for one and decides whether it stays."""

RESCREENING, SEEDS, BOOTSTRAP = "rescreening", "seeds", "bootstrap"
PARTS = (RESCREENING, SEEDS, BOOTSTRAP)
"""What a diagnosis can do without, to measure what it is worth: screening anew after each acceptance, more than one
seed of an effect, and significance from drawn signs in place of Ljung's and Box's limit."""


def state_of(
    engine: Engine, batch: Batch, fits: Fits, known: frozenset[str], accepted: tuple[Candidate, ...] = ()
) -> State:
    """A fit of one row as a state of the search."""
    free = fits.free[0]
    width = columns_for(len(free))
    smooth = smoothness(engine.table, fits.vectors[0], free)
    cv = cross_validated(fits.gram.products[0], len(free), width, fits.initial[0], batch, folds(batch), smooth)
    return State(
        plant=engine.table.unravel(fits.vectors[0]),
        known=known,
        engine=engine,
        batch=batch,
        vector=fits.vectors[0],
        free=free,
        initial=fits.initial[0],
        cost=float(fits.cost[0]),
        cross_validated=cv,
        ratios=channel_errors(batch, fits.gram.predicted[0], over_noise=True),
        accepted=accepted,
    )


class Search:
    """Rounds of screening, refitting and choosing."""

    def __init__(
        self,
        given: Plant,
        known: frozenset[str],
        setting: Setting,
        window: float | None,
        progress: Callable[[str], None] | None = None,
        insist: frozenset[tuple[str, str]] = frozenset(),
        leave_out: frozenset[str] = frozenset(),
    ):
        """Args:
        given: the model as given.
        known: parameters that are not estimated.
        setting: recordings and noise.
        window: length of the windows that are compared [s]; None compares whole recordings.
        progress: told what goes on.
        insist: kinds and sites of explanations that are refitted whatever is expected of them.
        leave_out: of `PARTS`, what the search does without.
        """
        self.given = given
        self.known = known
        self.setting = setting
        self.window = window
        self.progress = progress or (lambda text: None)
        self.insist = insist
        self.leave_out = leave_out
        self.urged = False
        """Whether the hold-out shows that more is missing than the recordings tell: then small gains count."""
        self.barred: frozenset[tuple[str, str]] = frozenset()
        """Kinds and sites of explanations that turned out to play something else."""
        self._first: Screen | None = None

    def least_gain(self, state: State) -> float:
        """Least share of the cost that an effect must gain beside a state's model."""
        return _URGED_GAIN if self.urged else least_gain(state)

    def candidates(self, state: State) -> list[Candidate]:
        """What may be missing beside a state's model, and where to start looking."""
        scene = scene_of(self.setting, state.plant)
        found = candidates(state.plant, state.known, self.setting, scene, one_seed=SEEDS in self.leave_out)
        return [candidate for candidate in found if candidate.name not in self.barred]

    def look(self, state: State) -> Screen:
        """Screens every candidate without a hidden state, on the state's own lanes."""
        found = self._screen(state)
        if RESCREENING not in self.leave_out:
            return found
        if self._first is None:
            self._first = found
        # What is expected of each stays as it was; where a refit of it starts does not.
        first: dict[tuple[str, str], Screened] = {}
        for item in self._first.ranked:
            first.setdefault(item.candidate.name, item)
        kept = [
            dataclasses.replace(item, cost=first[name].cost, gain=first[name].gain)
            for item in found.ranked
            if (name := item.candidate.name) in first
        ]
        return dataclasses.replace(found, ranked=sorted(kept, key=lambda item: item.cost))

    def look_closer(self, state: State, whole: Screen) -> Screen:
        """Screens again on windows, and merges the rankings.

        On whole recordings small effects add up and stand out, but a large mismatch is no longer linear; within
        windows it is.
        """
        if RESCREENING in self.leave_out and state.accepted:
            return whole
        outer, self.window = self.window, WINDOW
        try:
            guess = lanes_for(state.engine.table, state.plant, self.setting, self.setting.recordings, WINDOW).initial
            windows = self._screen(self.polish(state.plant, state.known, guess, state.accepted))
        finally:
            self.window = outer
        return Screen(merged(whole.ranked, windows.ranked), max(whole.learnable, windows.learnable))

    def _screen(self, state: State) -> Screen:
        forget_if_large()
        done = {a.name for a in state.accepted}
        found = [c for c in self.candidates(state) if not c.unscreened and c.name not in done]
        unnamed = unnamed_forces(self.setting, scene_of(self.setting, state.plant))
        extra = [state.engine.table.positions(c.site)[0] for c in found if c.kind == WRONG_VALUE]
        self.progress(f"screening {len({c.name for c in found})} explanations from {len(found)} starts")
        numbers = np.array(extra, np.int64)
        told = Tangents(state.engine, state.batch, state.vector, state.free, numbers, state.initial)
        return screen(told, found, unnamed)

    def refit(self, state: State, screened: Screen, done: Sequence[Trial] = ()) -> list[Trial]:
        """Full refits, by simulation, of the best candidates that are not `done` yet.

        Every effect has a program of its own: measured, the compiler's seconds for a handful of small programs are
        less than the time that one program with all effects takes to compile and to run. Seeds of one effect are rows
        of one batch.
        """
        tried = {trial.candidate.name for trial in done}
        untried = [item for item in screened.ranked if item.candidate.name not in tried]
        if self.least_gain(state) > _HARD_TO_PASS:
            # What is not even expected to gain half of what it must is not worth the time of a refit.
            untried = [item for item in untried if item.gain > 0.5 * self.least_gain(state)]
        chosen = with_simpler(shortlist(untried), untried)
        names = {item.candidate.name for item in chosen}
        for name in sorted(self.insist - names):
            chosen += [item for item in screened.ranked if item.candidate.name == name and name not in tried][:2]
        return self.refit_all(state, chosen)

    def refit_all(self, state: State, chosen: Sequence[Screened]) -> list[Trial]:
        """Full refits of some candidates, from where the screen expects them; seeds of one effect give one trial."""
        if not chosen:
            return []
        by_name: dict[tuple[str, str], list[Screened]] = {}
        for item in chosen:
            by_name.setdefault(item.candidate.name, []).append(item)
        self.progress(f"refitting {len(by_name)} explanations")

        def one(items: list[Screened]) -> Trial:
            engine, vector, free = self.extended(state, items[0].candidate)
            rows = [i.start(engine.table, vector) for i in items]
            seeds = [i.candidate for i in items]
            if self.window is not None:
                # What is missing has pulled the numbers so far away that a fit need not find back from there.
                rows.append(self._as_given(engine.table, rows[0], free))
                seeds.append(seeds[0])
            return self.refit_rows(state, seeds, engine, np.array(rows), free)

        return sorted(self.each(one, list(by_name.values())), key=lambda t: t.score)

    def _as_given(
        self, table: ParameterTable, vector: NDArray[np.float64], free: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """A start with the numbers of the model as given, as far as they are estimated."""
        start = vector.copy()
        given = ParameterTable(self.given)
        owner = transfer(given, np.array(given.ravel(self.given)), table, vector)
        start[free] = owner[free]
        return start

    def each(self, work: Callable[[Any], Any], items: list[Any]) -> list[Any]:
        """Two at a time: compiling and running release the interpreter."""
        forget_if_large()
        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(work, items))

    def extended(self, state: State, candidate: Candidate) -> tuple[Engine, NDArray[np.float64], NDArray[np.int64]]:
        """The state's model with a candidate's effect added, its parameters, and where the state's free ones stand."""
        plant = state.plant
        if candidate.kind != WRONG_VALUE:
            values = {k: v for k, v in candidate.values.items() if k != "coulomb"}
            plant = plant.adding(make_effect(candidate.kind, candidate.site, values))
        engine = Engine(plant)
        vector = transfer(state.engine.table, state.vector, engine.table, np.array(engine.table.ravel(plant)))
        names = [state.engine.table.entry(int(p)).name for p in state.free]
        return engine, vector, np.array([engine.table.positions(name)[0] for name in names], np.int64)

    def refit_rows(
        self,
        state: State,
        seeds: list[Candidate],
        engine: Engine,
        rows: NDArray[np.float64],
        free: NDArray[np.int64],
    ) -> Trial:
        plant = engine.table.unravel(rows[0])
        batch = lanes_for(engine.table, plant, self.setting, self.setting.recordings, self.window)
        initial = batch.initial.copy()
        initial[:, :6] = state.initial[:, :6]
        frees = [np.concatenate([free, seed.places(engine.table)]) for seed in seeds]
        width = columns_for(len(frees[0]))
        fits = solve(
            engine,
            batch,
            rows,
            frees,
            initial=np.repeat(initial[None], len(rows), axis=0),
            columns=width,
            iterations=10,
            tolerance=3e-3,
            drop=4.0,
        )
        best = int(np.nanargmin(np.where(np.isfinite(fits.cost), fits.cost, np.inf)))
        return self._trial(state, seeds[best], engine, batch, fits, best, width, len(free))

    def _trial(
        self,
        state: State,
        candidate: Candidate,
        engine: Engine,
        batch: Batch,
        fits: Fits,
        k: int,
        width: int,
        base: int,
    ) -> Trial:
        free = fits.free[k]
        products = fits.gram.products[k]
        ran = bool(np.isfinite(products).all())
        smooth = smoothness(engine.table, fits.vectors[k], free)
        weights = (products, len(free), width, fits.initial[k], batch, folds(batch), smooth)
        cv = cross_validated(*weights) if ran else np.inf
        known = state.known - ({candidate.site} if candidate.kind == WRONG_VALUE else set())
        plant = _with_candidate(state, candidate, engine.table, fits.vectors[k])
        cost = float(fits.cost[k]) if ran else np.inf
        given = transfer(state.engine.table, state.vector, engine.table, fits.vectors[k])
        mine = np.flatnonzero(np.isin(free, candidate.places(engine.table, candidate.sizes))).tolist()
        weighed = (products, free, width, fits.initial[k], batch, fits.vectors[k], mine, cost, engine.table, given)
        z = significance_of(*weighed) if ran else 0.0
        return Trial(
            plant=plant,
            known=known,
            engine=engine,
            batch=batch,
            vector=fits.vectors[k],
            free=free,
            initial=fits.initial[k],
            cost=cost,
            cross_validated=cv,
            ratios=channel_errors(batch, fits.gram.predicted[k], over_noise=True),
            candidate=candidate,
            z=z,
            extra=len(free) - base,
        )

    def polish(self, plant: Plant, known: frozenset[str], near: NDArray[np.float64], accepted: tuple) -> State:
        """The model as it stands fitted to convergence, in a program of its own structure.

        Args:
            plant: structure and start.
            known: parameters that are not estimated.
            near: initial states to start from.
            accepted: what was added to the model as given.
        """
        engine = Engine(plant)
        vector = np.array(engine.table.ravel(plant), dtype=float)
        free = free_places(engine.table, known, self.setting)
        free = np.setdiff1d(free, anchored(engine.table, vector))
        batch = lanes_for(engine.table, plant, self.setting, self.setting.recordings, self.window)
        initial = batch.initial.copy()
        initial[:, :6] = near[:, :6]
        width = columns_for(len(free))
        fits = solve(engine, batch, vector[None], [free], initial=initial[None], columns=width, iterations=20)
        return state_of(engine, batch, fits, known, accepted)

    def smooth(self, state: State) -> State:
        """The state with maps of friction that are as smooth as recordings left out say, if it leaves much."""
        if not state.accepted or state.chi < POOR:
            return state
        before = _fits_of(state)
        after = smoothed(state.engine, state.batch, before, columns_for(len(state.free)))
        return state if after is before else state_of(state.engine, state.batch, after, state.known, state.accepted)


def left_out_at_best(state: State) -> float:
    """Cost on recordings left out that a state's maps of friction reach when they are as smooth as is best for it."""
    return min(by_strength(state.engine, state.batch, _fits_of(state), columns_for(len(state.free))).values())


def _fits_of(state: State) -> Fits:
    """A state's fit with its normal equations, which a state does not keep."""
    vectors, initial = state.vector[None], state.initial[None]
    width = columns_for(len(state.free))
    gram = state.engine.gram(vectors, state.free[None], initial, state.batch, columns=width)
    return Fits(vectors, [state.free], initial, gram, 0)


def _with_candidate(state: State, candidate: Candidate, table: ParameterTable, vector: NDArray[np.float64]) -> Plant:
    """The state's plant with the candidate's effect, all at the refitted values."""
    fitted = table.unravel(vector)
    keep = {(effect.kind, effect.site) for effect in state.plant.effects}
    if candidate.kind != WRONG_VALUE:
        keep.add(candidate.name)
    effects = tuple(e for e in fitted.effects if (e.kind, e.site) in keep)
    return settled(Plant(fitted.bridge, effects))


def settled(plant: Plant) -> Plant:
    """The same plant with levels that two frictions have in common counted once."""
    own = ParameterTable(plant)
    return own.unravel(settle_levels(own, np.array(own.ravel(plant))))
