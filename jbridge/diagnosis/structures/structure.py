"""Fitted models that are compared: what was added, what it costs, and the criterion by block."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from ...identification.data.windows import Data
from ...identification.estimation import Problem
from ...identification.sensitivity.windowed_rollout import Steps
from ...identification.solver import Normal, Point, Start, bounded_step, mean_squares
from ...model.plant import Plant
from ..criteria import CRITERIA
from .candidates import WRONG_VALUE
from .space import Name, Space, happens_once, looks_like


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Structure:
    """One fitted model of a search."""

    space: Space
    """Whose program has a place for what was added."""
    names: tuple[Name, ...]
    """What was added, in the order in which it was."""
    keys: dict[Name, tuple[str, ...]]
    """Keys that are free of each."""
    choices: dict[Name, float]
    """Logarithm of the number of alternatives among which each was chosen."""
    point: Point
    blocks: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(0))
    """The criterion by block, each left out in turn."""
    price: float = math.inf
    """What its numbers and the choices behind it must gain."""
    restarted: bool = False
    """Whether its first fit ended worse than the model that it contains, so that it was fitted again from there."""
    left: tuple[NDArray[np.float32], ...] = ()
    """What each tiling leaves over the noise, `(sample, 3)`."""

    @property
    def value(self) -> float:
        """The criterion with its price."""
        return self.point.value + self.price

    @property
    def plant(self) -> Plant:
        return self.space.plant_of(self.point.vector, self.names)

    @property
    def known(self) -> frozenset[str]:
        return self.space.known

    @property
    def free(self) -> list[str]:
        """Names of the estimated numbers, entries of lists one by one."""
        return [self.space.table.entry(int(p)).name for p in self.point.free]

    def places(self, name: Name) -> list[int]:
        """Where the free parameters of an added effect stand."""
        groups = [name[1]] if name[0] == WRONG_VALUE else [f"{name[0]}@{name[1]}.{key}" for key in self.keys[name]]
        free = set(self.point.free.tolist())
        return [p for group in groups for p in self.space.table.positions(group) if p in free]


def base_structure(problem: Problem, space: Space, point: Point) -> Structure:
    """A structure with nothing added, from its fitted point."""
    return weighed(problem, Structure(space=space, names=(), keys={}, choices={}, point=point))


def weighed(problem: Problem, structure: Structure) -> Structure:
    """A structure with its price, and its criterion by block."""
    space, point = structure.space, structure.point
    [normal] = problem.normal(space.engine, [point])
    numbers = _numbers(problem, structure, normal)
    price = numbers * problem.likelihood.price + sum(structure.choices.values())
    left = tuple(each.astype(np.float32) for each in problem.residuals(space.engine, point))
    return dataclasses.replace(structure, price=price, blocks=left_out(problem, space, point, normal), left=left)


def _numbers(problem: Problem, structure: Structure, normal: Normal) -> float:
    """Added numbers; those of a map by its effective degrees of freedom: no place counts that is not visited."""
    free, n = structure.point.free, len(structure.point.free)
    added = [int(np.flatnonzero(free == p)[0]) for name in structure.names for p in structure.places(name)]
    total = problem.likelihood.weighted(structure.point.square, normal.products)[:n, :n]
    prior = problem.likelihood.prior
    tied, _ = prior.terms(structure.space.table, free, structure.point.vector, np.diag(total))
    levels = {int(i) for members in structure.space.table.vectors(free) for i in members}
    unit = np.sqrt(np.maximum(np.diag(total + tied), 1e-150))
    scaled = (total + tied) / np.outer(unit, unit) + 1e-12 * np.eye(n)
    share = np.diag(np.linalg.solve(scaled, total / np.outer(unit, unit)))
    return float(sum(np.clip(share[i], 0.0, 1.0) if i in levels else 1.0 for i in added))


_LEVELS = ("positive", "negative", "levels")
"""Keys of the levels of a friction law, to each of which a plain friction of the axis adds its own."""


def with_own_levels(structure: Structure) -> Structure:
    """The same laws with the smallest level of each added friction at zero and held there, where a plain friction
    beside it takes what is common to all: its level and theirs could not be told apart otherwise."""
    table, vector = structure.space.table, structure.point.vector.copy()
    free = [int(p) for p in structure.point.free]
    for kind, site in structure.names:
        plain = f"coulomb_friction@{site}.level"
        # All levels of the law, be they free or not: one that is held is their reference already.
        own = {f"{kind}@{site}.{key}" for key in _LEVELS}
        places = [p for group, found in table.of_site(site).items() if group in own for p in found]
        if kind == "coulomb_friction" or not places or plain not in table.names():
            continue
        [common] = table.positions(plain)
        smallest = min(places, key=lambda p: vector[p])
        if common in free and set(places) <= set(free):
            vector[common] += vector[smallest]
            vector[places] -= vector[smallest]
            free.remove(smallest)
    point = dataclasses.replace(structure.point, vector=vector, free=np.array(free, np.int64))
    return dataclasses.replace(structure, point=point)


def accepts(problem: Problem, now: Structure, then: Structure) -> bool:
    """Whether another model takes the place of one: the criterion is lower, and one with no fewer numbers gains on
    blocks that are left out, too, in all and steadily. Effects that imitate what has no name gain on those from which
    they are estimated."""
    if not then.value < now.value:
        return False
    added = set(then.names) - set(now.names)
    if len(then.point.free) < len(now.point.free) or any(happens_once(kind) for kind, _ in added):
        return True
    gain, blocks = now.blocks - then.blocks, blocks_of(problem)
    if not gain.sum() > 0.0:
        return False
    expected = problem.likelihood.expected(then.point.square, prediction_gap(problem.data, now.left, then.left))
    return steadiness(gain, np.array([expected[blocks == b].sum() for b in range(len(gain))])) > CRITERIA.sure


def in_equal_steps(problem: Problem, now: Structure, models: Sequence[Structure]) -> list[Structure]:
    """Larger models that must gain, beyond their price, what the model itself gains by their integration steps: what a
    mechanism integrates more closely is no merit of its law."""
    gains: dict[Steps, float] = {now.space.engine.steps.predictions: 0.0}
    out = []
    for model in models:
        steps = model.space.engine.steps.predictions
        if model.value < now.value:
            if steps not in gains:
                [closer] = problem.solve(now.space.engine.predicting_in(steps), [now.point.start])
                gains[steps] = max(now.point.value - closer.value, 0.0)
            model = dataclasses.replace(model, price=model.price + gains[steps])
        out.append(model)
    return out


def from_larger(problem: Problem, now: Structure, larger: Structure) -> Structure:
    """The model itself, from the numbers of a larger one where these are better for it, too: what a larger model gains
    must not be what another minimum of the smaller one gains, as that of another time of a push."""
    if not set(now.free) < set(larger.free):
        return now
    vector, table = now.point.vector.copy(), larger.space.table
    vector[now.point.free] = [larger.point.vector[table.positions(name)[0]] for name in now.free]
    [there] = problem.evaluate(now.space.engine, [Start(vector, now.point.free, larger.point.states)])
    if there.value >= now.point.value:
        return now
    [point] = problem.solve(now.space.engine, [there.start])
    return weighed(problem, dataclasses.replace(now, point=point))


def preferred(problem: Problem, models: Sequence[Structure]) -> Structure:
    """The best of several models: one with more numbers takes the place of one with fewer as it would in a search. Of
    two that differ by look-alikes, the plainer one is taken where it serves as well."""
    first, *others = sorted(models, key=lambda s: (len(s.point.free), s.value))
    for other in others:
        if accepts(problem, first, other):
            first = other
    for other in sorted(models, key=lambda s: s.value):
        if serves_as_well(problem, first, other):
            first = other
    return first


def serves_as_well(problem: Problem, now: Structure, then: Structure) -> bool:
    """Whether another model, which the criterion hardly tells from this one, has a plainer effect in the place of one
    that looks like it."""
    near = then.value < now.value + math.log(1.0 / CRITERIA.apart)
    return near and _is_plainer(then, now) and not accepts(problem, then, now)


def _is_plainer(one: Structure, other: Structure) -> bool:
    """Whether two models differ by one effect, and that of the other looks like this one's."""
    own, theirs = set(one.names) - set(other.names), set(other.names) - set(one.names)
    return len(own) == len(theirs) == 1 and looks_like(theirs.pop(), own.pop())


def prediction_gap(
    data: Data, one: Sequence[NDArray[np.floating[Any]]], other: Sequence[NDArray[np.floating[Any]]]
) -> NDArray[np.float64]:
    """Mean square difference of two models' predictions in each window over the noise's variance, by channel."""
    both = enumerate(zip(one, other, strict=True))
    return np.concatenate([mean_squares(data, k, (b - a).astype(np.float64)) for k, (a, b) in both])


_KNOWN = 2
"""Blocks that the variance of noise counts for."""


def steadiness(gain: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """How steadily a model gains over blocks: its slope over the standard error, as that of a normal distribution.

    The signed root of twice a block's gain grows with an effect, and noise gives it a variance of 1. It is held against
    the root of twice the gain that is expected if the effect is what the model says: where a block does not excite it,
    both models predict the same, and the block says nothing for or against it. The slope of the one over the other is
    tested twice, and the smaller counts: over the standard error of noise, which is known, and over the one that the
    blocks show, by Student's t, since they may be two, and with the variance of noise counted like one that some more
    have shown.

    Args:
        gain: by block.
        expected: by block, see `Likelihood.expected`; only their ratios count.
    """
    root = np.sign(gain) * np.sqrt(2.0 * np.abs(gain))
    share = expected / max(float(expected.sum()), 1e-300)
    # As many equal blocks would tell as much.
    count = 1.0 / max(float((share**2).sum()), 1e-300)
    slope = float(np.sqrt(share) @ root)
    scatter = float(share @ (root - slope * np.sqrt(share)) ** 2)
    freedom = _KNOWN + count - 1.0
    variance = (_KNOWN + count * scatter) / freedom
    known = abs(slope)
    shown = float(norm.isf(t.sf(known / math.sqrt(variance), freedom)))
    return math.copysign(min(known, shown), slope)


def leaves_nothing(problem: Problem, structure: Structure) -> bool:
    """Whether every channel is met at every horizon, as a verdict asks for it: then nothing is missing that shows."""
    windows, point = problem.windows, structure.point
    for horizon in problem.data.horizons:
        own = windows.horizon == horizon
        count = windows.count[own].sum(axis=0)
        mean = (point.square[own] * windows.count[own]).sum(axis=0) / np.maximum(count, 1.0)
        if mean.max() > CRITERIA.met**2:
            return False
    return True


def blocks_of(problem: Problem) -> NDArray[np.int64]:
    """The block of each window: its recording where there are six, else a stretch of it; -1 where it spans several."""
    windows, data = problem.windows, problem.data
    if len(data.grids) >= 6:
        return windows.recording.copy()
    length = max(CRITERIA.block, 2.0 * _swing_period(problem))
    out = np.full(len(windows.recording), -1)
    first = 0
    for r, grid in enumerate(data.grids):
        count = max(1, int(grid.times[-1] / length))
        own = windows.recording == r
        time = grid.times[np.minimum(windows.begin[own], grid.intervals)]
        whole = np.isinf(windows.horizon[own])
        out[own] = np.where(whole, -1, first + np.minimum((time / grid.times[-1] * count).astype(int), count - 1))
        first += count
    return out


def _swing_period(problem: Problem) -> float:
    if "psi" not in problem.setting.axes:
        return 0.0
    return 2.0 * math.pi * math.sqrt(problem.setting.length / 9.81)


def left_out(problem: Problem, space: Space, point: Point, normal: Normal) -> NDArray[np.float64]:
    """The criterion of each block at the parameters that the others ask for: one Gauss-Newton step, no refit.

    The step is what the block itself takes away: what all blocks together still ask for is part of no judgement.
    """
    blocks = blocks_of(problem)
    weight, scale = problem.likelihood.weights(point.square), problem.likelihood.scale(point.square)
    n = len(point.free)
    each = np.einsum("wc,wcij->wij", weight, normal.products)
    total = each.sum(axis=0)
    precision, gradient = problem.likelihood.prior.terms(space.table, point.free, point.vector, np.diag(total)[:n])
    low, high = problem.likelihood.prior.bounds(space.table)
    at = point.vector[point.free]
    least, most = low[point.free] - at, high[point.free] - at

    def asked(sums: NDArray[np.float64]) -> NDArray[np.float64]:
        return bounded_step(sums[:n, :n] + precision, sums[:n, n] + gradient, least, most, 1e-6)

    every = asked(total)
    out = []
    for block in range(int(blocks.max()) + 1):
        own = blocks == block
        step = np.clip(asked(total - each[own].sum(axis=0)) - every, least, most)
        square = squares(problem, normal.products, step)
        out.append(float(problem.likelihood.by_window(square, scale)[own].sum()))
    return np.array(out)


def squares(problem: Problem, products: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    along = np.append(step, 1.0)
    total = np.einsum("wcij,i,j->wc", products, along, along)
    return np.maximum(total, 0.0) / np.maximum(problem.likelihood.count, 1.0)
