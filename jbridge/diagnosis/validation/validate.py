"""What a hold-out says of a model whose structure is fixed; the only part of a diagnosis that has it.

Each effect that was added is left out in turn and the rest fitted again to the recordings. The loss on the hold-out, in
the unit of the criterion, is tested over blocks. What is not missed goes, the least first, and the others are judged
once more: of two effects of which either would do, neither is missed beside the other.
"""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...identification.data.windows import HORIZONS, WHOLE, make_data
from ...identification.estimation import Problem, make_problem
from ...identification.evaluation.errors import Evaluation
from ...identification.evaluation.judge import Judge, make_judge
from ...identification.evaluation.repeats import scatter
from ...identification.likelihood import Likelihood, likelihood
from ...identification.setting import Setting
from ...recordings import Recording
from ..criteria import CRITERIA
from ..structures.space import Name
from ..structures.structure import Structure, prediction_gap
from .confirmation import Checked, check_effect, explained_by_channel, one_second
from .deviating_recordings import Apart, own_numbers
from .holdout import HoldOut
from .refits import Fixed, of_its_own, recording_of, refitted


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
    events: tuple[Name, ...] = ()
    """Effects that act in one of the other recordings alone, of which the hold-out tells nothing,"""
    with_events: tuple[Evaluation, ...] = ()
    """and the model as given beside these, on the hold-out and on the others, where nothing else is confirmed."""

    @property
    def confirmed(self) -> tuple[Checked, ...]:
        return tuple(c for c in self.checked if c.status == "confirmed")

    def worst(self, evaluations: Sequence[Evaluation]) -> tuple[float, str, float, bool]:
        """Error over what the true model would leave, or over measured scatter where that is larger: the largest, its
        channel and horizon, and whether it is over scatter."""
        out = (0.0, "", 0.0, False)
        for run in evaluations:
            for horizon in run.horizons:
                spread = self.scatter.get(horizon) or {}
                foreseen, errors = run.foreseen(horizon), run.errors(horizon)
                for axis, error in errors.items():
                    ratio = error / max(foreseen[axis], spread.get(axis, 0.0))
                    if ratio > out[0]:
                        out = (ratio, axis, horizon, spread.get(axis, 0.0) > foreseen[axis])
        return out

    @property
    def verdict(self) -> tuple[str, bool]:
        """The verdict, and whether what remains is noise or measured scatter."""
        worst, *_ = self.worst((self.after, self.train_after))
        met = worst <= CRITERIA.met
        # Where no error exceeds the noise, there is no share: what the hold-out confirms is small, and all of it.
        if self.confirmed and max(self.explained.values(), default=1.0) > CRITERIA.named:
            return "missing_physics", met
        if not self.confirmed and self.worst(self.with_events or (self.before, self.train_before))[0] <= CRITERIA.met:
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
            explained=explained_by_channel(before, before),
            learned={},
            scatter=scatters,
            apart=_apart(problem, holdout, given, tell, deadline),
        )
    every, left_out, refuted = final, list[Name](), list[Name]()
    events = _of_one(setting, every)
    complete = judge.evaluate(final.plant, final.engine)
    beside, criterion = complete, likelihood(complete.data, complete.windows, complete.left)
    blocks = _blocks(setting, complete)
    judged: dict[Name, Checked] = {}
    judged_without: dict[Name, int] = {}
    # Of two effects of which either would do, neither is missed: the one that is missed least goes, and the others are
    # judged without it, those in doubt first.
    while time.monotonic() < deadline or not judged:
        due = [n for n in every.names if n not in events and n not in left_out]
        due = [n for n in due if judged_without.get(n) != len(left_out)]
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
            judged[name] = check_effect(name, loss, expected, before, beside, run)
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
    with_events = before, train_before
    if events and not any(c.status == "confirmed" for c in judged.values()):
        others = [name for name in every.names if name not in events]
        model = refitted(problem, every, base, others) if others else every
        with_events = judge.evaluate(model.plant, model.engine), own.evaluate(model.plant, model.engine)
    return Validation(
        checked=(
            *sorted(judged.values(), key=lambda c: -(c.explained or 0.0)),
            *(Checked(name, "event", None, 0.0) for name in events),
        ),
        given=given,
        final=final,
        before=before,
        after=complete,
        train_before=train_before,
        train_after=own.evaluate(final.plant, final.engine) if refuted else learned,
        explained=explained_by_channel(before, sure),
        learned=explained_by_channel(train_before, learned),
        scatter=_scatters(problem, holdout, before),
        apart=_apart(problem, holdout, final, tell, deadline),
        events=events,
        with_events=with_events,
    )


def _given(problem: Problem, base: Structure, judge: Judge) -> tuple[Fixed, Evaluation]:
    """The model as given with the numbers that leave the hold-out's squared error smaller: fitted as all models are, or
    by least squares, so that nothing is explained that another fit would have closed."""
    squares = dataclasses.replace(problem, likelihood=problem.likelihood.of_squares())
    [point] = squares.solve(base.space.engine, [base.point.start])
    found = []
    for each in (base, dataclasses.replace(base, point=problem.revalued(point))):
        run = judge.evaluate(each.plant, each.space.engine)
        ratios = run.ratios(one_second(run))
        found.append((sum(r * r for r in ratios.values()), of_its_own(problem, each), run))
    _, given, before = min(found, key=lambda f: f[0])
    return given, before


def unopened(problem: Problem, base: Structure, found: Structure) -> Validation:
    """What is known of an interrupted search: the recordings beside the model as given and what was found."""
    own = make_judge(problem.setting, problem.data.recordings, problem.setting.noise, samples=problem.data.samples)
    final = of_its_own(problem, found)
    before = own.evaluate(base.plant, base.space.engine)
    after = own.evaluate(final.plant, final.engine)
    events = _of_one(problem.setting, final)
    checked = tuple(Checked(n, "event" if n in events else "suggested", None, 0.0) for n in found.names)
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
        events=events,
    )


def _of_one(setting: Setting, model: Fixed) -> tuple[Name, ...]:
    """The effects that act in one recording alone."""
    return tuple(name for name in model.names if recording_of(setting, model, name) is not None)


def _blocks(setting: Setting, run: Evaluation) -> NDArray[np.int64]:
    """The block of each window of the compared horizons; -1 where it is of none."""
    period = 0.0
    if "psi" in setting.axes:
        period = 2.0 * math.pi * math.sqrt(setting.length / 9.81)
    out = np.full(len(run.windows.recording), -1)
    compared = np.isin(run.windows.horizon, HORIZONS)
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
    every = make_data([*problem.data.recordings, *holdout], HORIZONS, setting.noise, problem.data.samples)
    return tuple(own_numbers(make_problem(setting, every), model))


def whole_errors(problem: Problem, model: Fixed, sealed: HoldOut) -> dict[str, float]:
    """Root-mean-square error of a model on whole recordings of the hold-out, by channel."""
    judge = make_judge(problem.setting, sealed.open(), problem.setting.noise, (WHOLE,), samples=problem.data.samples)
    return judge.evaluate(model.plant, model.engine).errors(WHOLE)
