"""Refitted explanations: what one reaches, how it is weighed, and when it is accepted."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..identify.base import chi, measurements
from ..identify.lanes import Batch
from ..identify.linearise import Engine
from ..identify.solve import reduce
from ..identify.uncertainty import inverse_normal
from ..model.parameters import ParameterTable
from ..model.plant import Plant
from .candidates import WRONG_VALUE, Candidate

EFFECTIVE = 1000.0
"""Effective number of independent samples, for weighing costs against parameters: residuals hang together. Where fewer
were taken, it is as many as there are."""
_GAIN = 0.03
"""Least share of the cost that an acceptance must bring."""
_LATER_GAIN = 0.25
"""The same from the third effect on: what nobody catalogued is not to be pieced together from small gains."""
_BELIEVED = 4.0
"""Factor by which a number that its owner knows may be wrong. Beyond it stands for something else: a lag of the winch's
drive, say, for a winch that is ten times as heavy."""
NOT_HELD = "does not hold on recordings left out"
FAR_FROM_NULL = 4.0
"""Least distance of a parameter from its null value, in standard deviations."""


@dataclasses.dataclass(kw_only=True)
class Fitted:
    """A structure, fitted to the training recordings (or to windows of them)."""

    plant: Plant
    known: frozenset[str]
    engine: Engine
    batch: Batch
    vector: NDArray[np.float64]
    """All parameters of the engine's table, `(parameter,)`."""
    free: NDArray[np.int64]
    """Places of those that are estimated, `(free,)`."""
    initial: NDArray[np.float64]
    """Initial state of every lane, `(lane, state)`."""
    cost: float
    """Sum of squares of the residuals over their noise."""
    cross_validated: float
    """The same, each recording under the parameters that the others give; of one recording alone, the same."""
    ratios: Mapping[str, float]
    """Error over noise of each channel."""

    @property
    def chi(self) -> float:
        """Error over noise, root mean square over all channels."""
        return chi(self.cost, self.batch)

    def shared(self) -> dict[str, Any]:
        """These fields, for a `State` or `Trial` of the same fit."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(Fitted)}

    @property
    def worst(self) -> float:
        """Error over noise of the channel that is met worst."""
        return max(self.ratios.values())


@dataclasses.dataclass(kw_only=True)
class Trial(Fitted):
    """One refitted explanation."""

    candidate: Candidate
    z: float
    """Distance of the strongest number that says how large it is from its null value, in standard deviations."""
    extra: int
    """Number of its parameters."""
    stands_for: float = np.inf
    """Cost of the law with more parameters in whose place it is, since it holds as well on recordings left out."""

    @property
    def weighed(self) -> float:
        """Cost by which it is compared with others."""
        return min(self.cost, self.stands_for)

    @property
    def score(self) -> float:
        """Bayesian information criterion with an effective sample size; smaller is better."""
        count = min(EFFECTIVE, float(measurements(self.batch)))
        return count * float(np.log(max(self.weighed, 1e-9))) + self.extra * float(np.log(count))


@dataclasses.dataclass(kw_only=True)
class State(Fitted):
    """The model so far."""

    accepted: tuple[Candidate, ...] = ()
    without: Mapping[tuple[str, str], float] = dataclasses.field(default_factory=dict)
    """Cost when one of the accepted explanations is taken away and all else fitted again, where that was tried."""


def as_trial(state: State, candidate: Candidate, z: float) -> Trial:
    """A state as the trial of one of its explanations; `z` as in `Trial`."""
    group = f"{candidate.kind}@{candidate.site}."
    extra = sum(state.engine.table.entry(int(place)).group.startswith(group) for place in state.free)
    return Trial(**state.shared(), candidate=candidate, z=z, extra=extra)


def transfer(
    source: ParameterTable, vector: NDArray[np.float64], target: ParameterTable, into: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Values of one table's parameters put into another's vector, by name."""
    into = into.copy()
    names = set(target.names())
    for name in source.names():
        if name in names:
            into[target.positions(name)] = vector[source.positions(name)]
    for group, place in source.options().items():
        if group in target.options():
            into[target.option_place(group)] = vector[place]
    return into


def significance_of(
    products: NDArray[np.float64],
    free: NDArray[np.int64],
    width: int,
    initial: NDArray[np.float64],
    batch: Batch,
    vector: NDArray[np.float64],
    mine: Sequence[int],
    cost: float,
    table: ParameterTable,
    given: NDArray[np.float64],
) -> float:
    """How far the strongest of an explanation's numbers stands from its null value, in standard deviations.

    The entries of a vector count together: one by one they are hardly determined where they share a level with a plain
    friction, but their shape may be. `mine` are the numbers' places among the free ones.
    """
    reduced = reduce(products, len(free), width, initial, batch.initial, batch.prior)
    size = max(cost / max(measurements(batch), 1), 1.0)
    covariance = inverse_normal(reduced.matrix) * size
    groups: dict[str, list[int]] = {}
    best = 0.0
    for j in mine:
        entry = table.entry(int(free[j]))
        std = float(np.sqrt(max(covariance[j, j], 1e-300)))
        # A number of the bridge that counted as known may be wrong: its null value is what its owner wrote.
        null = given[free[j]] if entry.owner < 0 else entry.info.null
        best = max(best, abs(vector[free[j]] - null) / std)
        if entry.info.vector:
            groups.setdefault(entry.group, []).append(j)
    for members in groups.values():
        places = np.array(members)
        rest = np.setdiff1d(np.arange(len(free)), places)
        across = reduced.matrix[np.ix_(places, rest)]
        own = reduced.matrix[np.ix_(places, places)] - across @ (
            inverse_normal(reduced.matrix[np.ix_(rest, rest)]) @ across.T
        )
        away = vector[free[places]] - np.array([table.entry(int(p)).info.null for p in free[places]])
        best = max(best, float(np.sqrt(max(away @ own @ away, 0.0) / size / len(places))))
    return best


def held(state: State, trial: Trial, floor: float) -> float:
    """Share of the excess over a floor that a trial removes from recordings that took no part in its fit."""
    return 1.0 - max(trial.cross_validated - floor, 0.0) / max(state.cross_validated - floor, 1e-9)


def explained(state: State, trial: Trial, floor: float) -> float:
    """Share of the excess over a floor that a trial removes from the recordings that it is fitted to."""
    return 1.0 - (trial.cost - floor) / max(state.cost - floor, 1e-9)


def floor_of(trials: Sequence[Trial]) -> float:
    """Cost of noise alone: what is measured, or what the best of a round reaches, if noise was put too high."""
    if not trials:
        return 0.0
    best = min(trials, key=lambda trial: trial.score)
    return min(float(measurements(best.batch)), best.cost)


def least_gain(state: State) -> float:
    """Least share of the cost that a further effect must gain."""
    return _GAIN if len(state.accepted) < 2 else _LATER_GAIN


def accepts(state: State, trial: Trial, least: float, gain: float, floor: float) -> str:
    """Empty if the trial passes; otherwise why it does not.

    Args:
        state: the model so far.
        trial: what is tried.
        least: least share of the excess that must hold on recordings left out.
        gain: least share of the cost that it must gain.
        floor: cost of noise alone.
    """
    if not trial.cost < state.cost * (1 - gain):
        return "gains too little"
    if trial.z < FAR_FROM_NULL:
        return "its interval includes its absence"
    if unbelievable := beyond_belief(trial.candidate, state.plant, trial.plant):
        return unbelievable
    return NOT_HELD if held(state, trial, floor) < least else ""


def beyond_belief(candidate: Candidate, given: Plant, found: Plant) -> str:
    """Empty unless a known number of the bridge would have to be wrong by more than its owner may be."""
    if candidate.kind != WRONG_VALUE:
        return ""
    own, refitted = (float(getattr(plant.bridge, candidate.site)) for plant in (given, found))
    if own / _BELIEVED <= refitted <= own * _BELIEVED:
        return ""
    return f"the known number would have to be {refitted / own:.2g} times what it is"
