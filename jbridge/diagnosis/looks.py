"""What the recordings say about every seed of every effect that a model lacks: estimate, covariance, and size.

With the model's weighted residual `r`, the Jacobian `A` of its free numbers and initial states and the Jacobian `G`
of an absent effect, what no refit of the model takes up is `G_p = (I - A A+) G`. The effect's least-squares estimate
is `c = -(G_p' G_p)^-1 G_p' r`, with covariance `(G_p' G_p)^-1` times the size and the correlation time of the
residuals (Seber and Wild, Nonlinear Regression, 1989, section 5.1). An effect without a tangent where it is absent
enters with its response at a finite seed, and `c` is how much of that response the recordings hold.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..identify.base import columns_for, measurements
from ..identify.evaluate import early
from ..identify.linearise import Gram
from ..identify.setting import lanes_for
from ..identify.solve import solve
from ..identify.uncertainty import correlation_time, inverse_normal
from ..model.effects.base import parameters_of
from ..model.effects.catalogue import KINDS
from .candidates import WRONG_VALUE, Candidate
from .normal import Tangents
from .responses import Cut, simulated, with_weaker
from .search import Search
from .trials import State

_TAKEN_UP = 1e-8
"""Share of a response's sum of squares below which the model's other numbers take up all of it."""

_PLACES = 4
"""Seeds of an effect (periods, places, times) that are looked at; a search, which must not miss one, has more."""
_VISITED = 1e-4
"""Response's sum of squares, over the largest, from which a level of a map counts as one that was visited."""


@dataclasses.dataclass(frozen=True)
class Look:
    """What the recordings say about one seed of an effect, its numbers together."""

    candidate: Candidate
    keys: tuple[str, ...]
    """Key of each number that does anything there; empty for a finite seed's amplitude."""
    estimate: NDArray[np.float64]
    """Distance from the null value, or a finite seed's amplitude."""
    covariance: NDArray[np.float64]
    taken_up: NDArray[np.bool_]
    """Numbers whose whole response the model's other numbers take up."""
    response: NDArray[np.float64]
    """What a unit of each number does to the training recordings, root mean square over the noise, nothing refitted."""
    change: NDArray[np.float64]
    """What the numbers do to the hold-out if the model was fitted to the training recordings without them: inner
    products of the responses to a unit of each, over the noise, mean of each channel, `(channel, number, number)`."""


def look(search: Search, state: State) -> list[Look]:
    """Every seed of every effect that a model lacks.

    Args:
        search: recordings.
        state: the model, fitted.
    """
    linear, numbers, hidden = _seeds(search, state)
    everything = [*linear, *numbers, *(c for seeds in hidden for c in seeds)]
    extra = np.array([state.engine.table.positions(c.site)[0] for c in numbers], np.int64)
    base = len(state.free)
    width = columns_for(base + len(extra))
    run = state.engine.gram(state.vector[None], state.free[None], state.initial[None], state.batch, columns=width)
    train = Cut(search.setting.recordings, state.batch, state.initial, run.predicted[0])
    cuts = [train, _hold_out(search, state, width)]

    with ThreadPoolExecutor(2) as pool:  # the compiler and the programs release the interpreter
        finite = [pool.submit(simulated, search, state, seeds, cuts) for seeds in hidden]
        told = [Tangents(state.engine, c.batch, state.vector, state.free, extra, c.initial) for c in cuts]
        columns, abroad = ([*t.effects(linear), *t.numbers()] for t in told)
    for future in finite:
        here, there = future.result()
        columns += here
        abroad += there
    # What may be is asked here.
    normal = told[0].normal(columns, free_starts=True)
    gram = told[0].gram
    whole = normal.over(np.ones(state.batch.count, bool))
    weight = np.asarray(state.batch.lanes.weight)
    residual = (gram.predicted[0] - np.asarray(state.batch.lanes.y)) * weight
    size = max(state.cost / max(measurements(state.batch), 1), 1.0) * correlation_time(residual, weight > 0)
    inverse = inverse_normal(whole.matrix[:base, :base]) if base else np.zeros((0, 0))
    looks, start = [], base
    for candidate, own, elsewhere in zip(everything, columns, abroad, strict=True):
        at = np.arange(start, start + own.shape[1])
        start += own.shape[1]
        taken = inverse @ whole.matrix[np.ix_(np.arange(base), at)]
        inside = whole.matrix[np.ix_(at, at)] - whole.matrix[np.ix_(at, np.arange(base))] @ taken
        slope = whole.gradient[at] - taken.T @ whole.gradient[:base]
        change = _change(told[1].gram, cuts[1], elsewhere, taken, width)
        looks.append(
            _look(candidate, inside, slope, (own**2).sum(axis=(0, 2)), change, measurements(state.batch), size)
        )
    return looks


def _seeds(search: Search, state: State) -> tuple[list[Candidate], list[Candidate], list[list[Candidate]]]:
    """Effects whose response is linear or has a column, known numbers, and effects that must be simulated."""
    named = {accepted.name for accepted in state.accepted}
    found = [c for c in search.candidates(state) if c.name not in named]
    with_null = {c.name for c in found if not c.finite}
    finite: dict[tuple[str, str], list[Candidate]] = {}
    for c in found:
        if c.name not in with_null:
            finite.setdefault(c.name, []).append(c)
    found = _thinned(found)
    grown = [with_weaker(seeds) for seeds in finite.values()]
    linear = [c for c in found if c.kind != WRONG_VALUE and not c.finite]
    linear += [c for seeds in grown for c in seeds if not c.unscreened]
    numbers = [c for c in found if c.kind == WRONG_VALUE]
    return linear, numbers, [seeds for seeds in grown if seeds[0].unscreened]


def _thinned(found: list[Candidate]) -> list[Candidate]:
    """A few of the seeds of every effect, its ends included."""
    families: dict[tuple, list[Candidate]] = {}
    for c in found:
        families.setdefault((*c.name, c.free, c.finite), []).append(c)
    kept: list[Candidate] = []
    for seeds in families.values():
        places = np.linspace(0, len(seeds) - 1, _PLACES)
        if seeds[0].harmonic:  # most that repeats along an axis does so a few times
            places = np.geomspace(1, len(seeds), _PLACES) - 1
        take = np.unique(places.round().astype(int))
        kept += [seeds[i] for i in take]
    return kept


def _hold_out(search: Search, state: State, width: int) -> Cut:
    """The hold-out with the model's starts on it; in the shape of the training lanes, so that programs serve both."""
    held = search.setting.holdout
    batch = lanes_for(state.engine.table, state.plant, search.setting, held, search.window, state.batch)
    none = [np.zeros(0, np.int64)]
    begin = dataclasses.replace(batch, lanes=early(batch))
    started = solve(state.engine, begin, state.vector[None], none, columns=width, iterations=4)
    return Cut(held, batch, started.initial[0], started.gram.predicted[0])


def _change(
    gram: Gram, cut: Cut, response: NDArray[np.float64], taken: NDArray[np.float64], width: int
) -> NDArray[np.float64]:
    """What is left on other recordings of an effect's response when the model's numbers have taken up what they can.

    Args:
        gram: the model's tangents on them.
        cut: those recordings.
        response: of a unit of each of the effect's numbers: lane, number, sample and channel.
        taken: what the model's numbers take up of each: `(free, number)`.
        width: columns of the tangents before those of the starts.
    """
    assert gram.tangents is not None
    own = gram.tangents[0]
    left = response - np.einsum("lbs,bn->lns", own[:, : len(taken)], taken)
    first = (np.asarray(early(cut.batch).weight) > 0).reshape(cut.batch.count, 1, -1)
    starts = own[:, width:]
    starts = np.where(np.isfinite(cut.batch.prior)[:, :, None], starts, 0.0)
    inner = np.einsum("las,lbs->lab", starts * first, starts) + np.eye(starts.shape[1]) * 1e-9
    shift = np.linalg.solve(inner, np.einsum("las,lns->lan", starts * first, left))
    left = left - np.einsum("las,lan->lns", starts, shift)
    counts = np.maximum((np.asarray(cut.batch.lanes.weight) > 0).sum(axis=(0, 1)), 1)
    by_channel = left.reshape(*left.shape[:2], -1, 3)
    return np.einsum("lnsc,lmsc->cnm", by_channel, by_channel) / counts[:, None, None]


def _look(
    candidate: Candidate,
    inside: NDArray[np.float64],
    slope: NDArray[np.float64],
    raw: NDArray[np.float64],
    change: NDArray[np.float64],
    count: int,
    size: float,
) -> Look:
    """A seed's numbers that do anything (a period without an amplitude does nothing), estimated together.

    Args:
        candidate: the seed.
        inside: its projected normal matrix, `(number, number)`.
        slope: its projected gradient.
        raw: sum of squares of its response, by number.
        change: see `Look`.
        count: number of measurements.
        size: by how much a sum of squares exceeds that of independent noise.
    """
    if candidate.finite:
        keys: tuple[str, ...] = ("",)
    elif candidate.kind == WRONG_VALUE:
        keys = ("value",)
    else:
        infos = parameters_of(KINDS[candidate.kind])
        keys = tuple(key for key in candidate.linear for _ in np.atleast_1d(candidate.values.get(key, infos[key].null)))
        if candidate.harmonic:
            keys = ("amplitude", "amplitude")
    taken_up = np.diag(inside) <= _TAKEN_UP * raw
    lists = np.array(
        [key != "" and key != "value" and parameters_of(KINDS[candidate.kind])[key].vector for key in keys]
    )
    least = np.where(lists, _VISITED, 1e-16) * max(float(raw.max(initial=0.0)), 1e-300)
    active = raw > least
    # What the model has already (a level beside a Coulomb friction) is asked of that, not here.
    kept = active & ~taken_up if (active & ~taken_up).any() else active
    places = np.flatnonzero(kept)
    covariance = inverse_normal(inside[np.ix_(places, places)]) * size if len(places) else np.zeros((0, 0))
    estimate = -covariance @ slope[places] / size
    return Look(
        candidate,
        tuple(keys[i] for i in places),
        estimate,
        covariance,
        taken_up[places],
        np.sqrt(raw[places] / max(count, 1)),
        change[:, places][:, :, places],
    )
