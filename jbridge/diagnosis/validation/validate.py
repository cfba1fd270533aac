"""What a hold-out says of a model whose structure is fixed; the only part of a diagnosis that has it.

Each effect that was added is left out in turn and the rest fitted again to the recordings. The loss on the hold-out, in
the unit of the criterion, is tested over blocks. What is not missed goes, the least first, and the others are judged
once more: of two effects of which either would do, neither is missed beside the other. An effect without which the
hold-out is met worse is confirmed if, in the channel whose error it changes most, it takes more off the square of the
typical error than is left without a name: that, too, is a force that hold-outs repeat, and whatever effect is most like
it imitates a part of it. The error is that of most windows, as the criterion counts it, since one that no model meets
says nothing of the others. Errors of channels are not added up: what one of them cannot explain says nothing of
another, and their noise, which a fine encoder makes as small as one likes, is no common unit.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..._types import AXES
from ...identification.data.windows import WHOLE, make_data
from ...identification.estimation import Problem, make_problem
from ...identification.evaluation.errors import Evaluation
from ...identification.evaluation.judge import Judge, make_judge
from ...identification.evaluation.repeats import scatter
from ...identification.likelihood import Likelihood, likelihood
from ...identification.setting import Setting
from ...recordings import Recording
from ..criteria import CRITERIA
from ..structures.space import Name, happens_once
from ..structures.structure import Structure, prediction_gap, steadiness
from .holdout import HoldOut
from .own_numbers import Apart, own_numbers
from .refits import Fixed, of_its_own, refitted

_COMPARED = (0.3, 1.0, 3.0, WHOLE)
"""Horizons on which models are compared, those of the criterion."""


@dataclasses.dataclass(frozen=True)
class Checked:
    """What the hold-out says of one effect."""

    name: Name
    status: str
    """`confirmed`, `suggested`, or `event` for what happened once, in the recordings alone."""
    explained: float | None
    """Share of the hold-out's excess squared error that comes back without it, as a mean over the channels in which
    any exceeds the noise; None where there is none."""
    steady: float
    """How steadily blocks of the hold-out are met worse without it, in standard errors, see `steadiness`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Validation:
    """The hold-out's answer."""

    checked: tuple[Checked, ...]
    given: Fixed
    """The model as given, refitted."""
    final: Fixed
    """The model with everything that was named but what the hold-out speaks against."""
    before: Evaluation
    """Of the model as given, refitted, on the hold-out,"""
    after: Evaluation
    """and of the final model."""
    train_before: Evaluation
    train_after: Evaluation
    explained: dict[str, float]
    """Share of the hold-out's excess squared error in windows of 1 s that confirmed effects close, by channel in which
    it is larger than the noise."""
    learned: dict[str, float]
    """The same of the recordings that the model was learned from, which all effects close."""
    scatter: dict[float, dict[str, float] | None]
    """Of repeated inputs, by horizon."""
    apart: tuple[Apart, ...] = ()
    """Recordings that ask for a number of their own."""

    @property
    def confirmed(self) -> tuple[Checked, ...]:
        return tuple(c for c in self.checked if c.status == "confirmed")

    def worst(self, evaluations: Sequence[Evaluation]) -> tuple[float, str, float]:
        """Error over what the true model would leave, or over measured scatter where that is larger: the largest, its
        channel and horizon."""
        out = (0.0, "", 0.0)
        for run in evaluations:
            for horizon in run.horizons:
                spread = self.scatter.get(horizon) or {}
                foreseen, errors = run.foreseen(horizon), run.errors(horizon)
                for axis, error in errors.items():
                    ratio = error / max(foreseen[axis], spread.get(axis, 0.0))
                    if ratio > out[0]:
                        out = (ratio, axis, horizon)
        return out

    @property
    def verdict(self) -> tuple[str, bool]:
        """The verdict, and whether what remains is noise or measured scatter."""
        worst, _, _ = self.worst((self.after, self.train_after))
        met = worst <= CRITERIA.met
        if self.confirmed and max(self.explained.values(), default=0.0) > CRITERIA.named:
            return "missing_physics", met
        if not self.confirmed and self.worst((self.before, self.train_before))[0] <= CRITERIA.met:
            return "adequate", True
        return "unknown", False


def validate(
    problem: Problem,
    base: Structure,
    found: Structure,
    sealed: HoldOut,
    tell: Callable[[str], None],
    deadline: float = math.inf,
) -> Validation:
    """Opens the hold-out.

    Args:
        problem: the recordings and the criterion.
        base: the model as given, refitted.
        found: the model that was chosen.
        sealed: recordings that took no part.
        tell: takes a line on what is being done.
        deadline: of `time.monotonic` [s], after which no effect is judged once more beside fewer others.
    """
    setting = problem.setting
    tell("validating on the hold-out")
    holdout = sealed.open()
    samples = problem.data.samples
    judge = make_judge(setting, holdout, setting.noise, samples=samples)
    own = make_judge(setting, problem.data.recordings, setting.noise, samples=samples)
    given, before = _given(problem, base, judge)
    final = of_its_own(problem, found) if found.names else given
    train_before = own.evaluate(given.plant, given.engine)
    if not found.names:
        scatters = _scatters(problem, holdout, before)
        return Validation(
            checked=(),
            given=given,
            final=given,
            before=before,
            after=before,
            train_before=train_before,
            train_after=train_before,
            explained=_explained(before, before),
            learned={},
            scatter=scatters,
            apart=_apart(problem, holdout, given, tell, deadline),
        )
    every, left_out, refuted = final, list[Name](), list[Name]()
    complete = judge.evaluate(final.plant, final.engine)
    beside, criterion = complete, likelihood(complete.data, complete.windows, complete.left)
    blocks = _blocks(setting, complete)
    judged: dict[Name, Checked] = {}
    judged_without: dict[Name, int] = {}
    # Of two effects of which either would do, neither is missed: the one that is missed least goes, and the others are
    # judged without it, those in doubt first.
    while time.monotonic() < deadline or not judged:
        due = [n for n in every.names if n not in left_out and judged_without.get(n) != len(left_out)]
        due = [n for n in due if n not in judged or judged[n].status != "confirmed"] or due
        if not due:
            break
        runs = {}
        for name in due:
            tell(f"leaving out {name[0]} ({name[1]})")
            reduced = refitted(problem, every, base, [*left_out, name])
            runs[name] = run = judge.evaluate(reduced.plant, reduced.engine)
            loss = _by_block(criterion, run, blocks) - _by_block(criterion, beside, blocks)
            excited = criterion.expected(beside.square, prediction_gap(beside.data, beside.left, run.left))
            expected = _summed(excited, blocks).sum(axis=1)
            judged[name] = _checked(name, loss, expected, before, beside, run)
            judged_without[name] = len(left_out)
        not_missed = [n for n in due if judged[n].status == "event" or judged[n].steady <= CRITERIA.sure]
        if not_missed:
            least = min(not_missed, key=lambda name: judged[name].steady)
            # Neither an event nor what the hold-out speaks against beside all others is a part of the model.
            against = judged[least].steady <= -CRITERIA.sure and len(refuted) == len(left_out)
            if against or judged[least].status == "event":
                refuted.append(least)
            left_out.append(least)
            beside = runs[least]
    if refuted:
        final = refitted(problem, every, base, refuted, own=True) if len(refuted) < len(every.names) else given
        complete = judge.evaluate(final.plant, final.engine) if final.names else before
    doubtful = [name for name, c in judged.items() if c.status != "confirmed"]
    sure = before if len(doubtful) == len(judged) else beside
    if sure is beside and len(doubtful) > len(left_out):
        reduced = refitted(problem, every, base, doubtful)
        sure = judge.evaluate(reduced.plant, reduced.engine)
    learned = own.evaluate(every.plant, every.engine)
    return Validation(
        checked=tuple(sorted(judged.values(), key=lambda c: -(c.explained or 0.0))),
        given=given,
        final=final,
        before=before,
        after=complete,
        train_before=train_before,
        train_after=own.evaluate(final.plant, final.engine) if refuted else learned,
        explained=_explained(before, sure),
        learned=_explained(train_before, learned),
        scatter=_scatters(problem, holdout, before),
        apart=_apart(problem, holdout, final, tell, deadline),
    )


def _given(problem: Problem, base: Structure, judge: Judge) -> tuple[Fixed, Evaluation]:
    """The model as given with the numbers that leave the hold-out's squared error smaller: fitted as all models are, or
    by least squares, so that nothing is explained that another fit would have closed."""
    squares = dataclasses.replace(problem, likelihood=problem.likelihood.of_squares())
    [point] = squares.solve(base.space.engine, [base.point.start])
    found = []
    for each in (base, dataclasses.replace(base, point=problem.revalued(point))):
        run = judge.evaluate(each.plant, each.space.engine)
        ratios = run.ratios(_one_second(run))
        found.append((sum(r * r for r in ratios.values()), of_its_own(problem, each), run))
    _, given, before = min(found, key=lambda f: f[0])
    return given, before


def unopened(problem: Problem, base: Structure, found: Structure) -> Validation:
    """What is known of an interrupted search: the recordings beside the model as given and what was found."""
    own = make_judge(problem.setting, problem.data.recordings, problem.setting.noise, samples=problem.data.samples)
    final = of_its_own(problem, found)
    before = own.evaluate(base.plant, base.space.engine)
    after = own.evaluate(final.plant, final.engine)
    checked = tuple(Checked(name, "suggested", None, 0.0) for name in found.names)
    return Validation(
        checked=checked,
        given=of_its_own(problem, base),
        final=final,
        before=before,
        after=after,
        train_before=before,
        train_after=after,
        explained={},
        learned={},
        scatter={},
    )


def _explained(before: Evaluation, after: Evaluation, beside: Evaluation | None = None) -> dict[str, float]:
    """Share of the excess squared error that a model closes, by channel in which it is larger than the noise.

    Args:
        before: the model as given.
        after: the model of which it is told.
        beside: one that is compared with it in place of the model as given.
    """
    horizon, axes = _shown(before)
    first, last, other = (run.excess(horizon) for run in (before, after, beside or before))
    # A noise that is estimated too large leaves less than nothing, and no more than all can be explained.
    return {axis: min((other[axis] - last[axis]) / max(first[axis], other[axis]), 1.0) for axis in axes}


def _one_second(run: Evaluation) -> float:
    """The horizon of 1 s, or the nearest that the recordings are long enough for."""
    return min(run.horizons, key=lambda h: abs(math.log(min(h, 1e3))))


def _shown(before: Evaluation) -> tuple[float, list[str]]:
    """The horizon of 1 s, and the channels whose excess is larger than the noise there; the next longer horizon where
    there is none."""
    nearest = _one_second(before)
    for horizon in (h for h in before.horizons if h >= nearest):
        axes = [axis for axis, ratio in before.ratios(horizon).items() if ratio**2 - 1.0 > 1.0]
        if axes:
            return horizon, axes
    return nearest, []


def _checked(
    name: Name,
    loss: NDArray[np.float64],
    expected: NDArray[np.float64],
    before: Evaluation,
    complete: Evaluation,
    run: Evaluation,
) -> Checked:
    """What the hold-out says of an effect.

    Args:
        name: of the effect.
        loss: of the criterion without it, by block and channel.
        expected: loss by block if the effect is what the model says.
        before: the model as given.
        complete: the model with it.
        run: the model without it.
    """
    steady = steadiness(loss.sum(axis=1), expected)
    own, (horizon, axes) = _explained(before, complete, run), _shown(before)
    # It is judged where it changes the error most, of the channels that lose. One that hardly exceeds the noise has
    # nothing that it might imitate.
    left, without = (each.typical_excess(horizon) for each in (complete, run))
    losing = [axis for axis, lost in zip(AXES, loss.sum(axis=0), strict=True) if lost > 0.0 and axis in left]
    most = max(losing, key=lambda axis: (1.0 + without[axis]) / (1.0 + left[axis]), default=None)
    nameless = most in axes and without[most] - left[most] <= left[most]
    explained = float(np.mean(list(own.values()))) if own else None
    if steady > CRITERIA.confirmed and not nameless:
        return Checked(name, "confirmed", explained, steady)
    once = happens_once(name[0]) and float(loss.sum()) <= 0.0
    return Checked(name, "event" if once else "suggested", explained, steady)


def _blocks(setting: Setting, run: Evaluation) -> NDArray[np.int64]:
    """The block of each window of the compared horizons; -1 where it is of none."""
    period = 0.0
    if "psi" in setting.axes:
        period = 2.0 * math.pi * math.sqrt(setting.length / 9.81)
    out = np.full(len(run.windows.recording), -1)
    compared = np.isin(run.windows.horizon, _COMPARED)
    if len(run.data.grids) >= 6:
        return np.where(compared, run.windows.recording, -1)
    first = 0
    for r, grid in enumerate(run.data.grids):
        end = float(grid.times[-1])
        count = max(1, int(end / max(CRITERIA.block, 2.0 * period)))
        own = compared & (run.windows.recording == r) & (~np.isinf(run.windows.horizon) | (count == 1))
        time = grid.times[np.minimum(run.windows.begin[own], grid.intervals)]
        out[own] = first + np.minimum((time / end * count).astype(int), count - 1)
        first += count
    return out


def _by_block(criterion: Likelihood, run: Evaluation, blocks: NDArray[np.int64]) -> NDArray[np.float64]:
    """The criterion by block and channel."""
    return _summed(criterion.by_window(run.square), blocks)


def _summed(value: NDArray[np.float64], blocks: NDArray[np.int64]) -> NDArray[np.float64]:
    """Windows' values summed by block."""
    return np.array([value[blocks == b].sum(axis=0) for b in range(int(blocks.max()) + 1)])


def _scatters(problem: Problem, holdout: Sequence[Recording], run: Evaluation) -> dict[float, dict[str, float] | None]:
    every = make_data([*problem.data.recordings, *holdout], (WHOLE,), problem.setting.noise)
    return {horizon: scatter(every, horizon) for horizon in run.horizons}


def _apart(
    problem: Problem, holdout: Sequence[Recording], model: Fixed, tell: Callable[[str], None], deadline: float
) -> tuple[Apart, ...]:
    if time.monotonic() > deadline:
        return ()
    tell("comparing the recordings")
    setting = problem.setting
    every = make_data([*problem.data.recordings, *holdout], _COMPARED, setting.noise, problem.data.samples)
    return tuple(own_numbers(make_problem(setting, every), model))


def whole_errors(problem: Problem, model: Fixed, sealed: HoldOut) -> dict[str, float]:
    """Root-mean-square error of a model on whole recordings of the hold-out, by channel."""
    judge = make_judge(problem.setting, sealed.open(), problem.setting.noise, (WHOLE,), samples=problem.data.samples)
    return judge.evaluate(model.plant, model.engine).errors(WHOLE)
