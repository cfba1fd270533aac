"""`diagnose`: what a model lacks, from recordings, and the proof on recordings that took no part."""

import dataclasses
import functools
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .._progress import Step, silent, with_progress
from .._types import AXIS_OF_EQUATION
from ..compilation import programs
from ..compilation.threads import one_thread_each
from ..identification.data.windows import WHOLE, make_data
from ..identification.estimation import fit_structure, make_problem
from ..identification.evaluation.errors import WINDOW
from ..identification.result import Errors
from ..identification.setting import prepared, resolve
from ..identification.traces import traces
from ..identification.uncertainty import as_uncertainty
from ..model.files import Model
from ..model.names import QUANTITIES
from ..model.plant import Plant
from ..recordings import Recording, as_recordings, covered_by, required
from .continuation import continued
from .criteria import CRITERIA
from .detection_limits import not_seen
from .equivalents import Naming, contenders, estimated, named_effect, parameters_of
from .experiment_design.next_experiment import next_experiment
from .localization.location import location, repeatable
from .result import Adequacy, Channel, Diagnosis, Former, Horizon, Location, NamedEffect
from .selection.moves import AT_ONCE
from .selection.search import Search, select
from .structures.candidates import WRONG_VALUE
from .structures.space import make_space
from .structures.structure import base_structure
from .validation.holdout import HoldOut, split_off
from .validation.refits import of_its_own, owner_of
from .validation.validate import Validation, unopened, validate, whole_errors
from .words import Remains, amount, apart_sentence, verdict_sentence

BUDGET = 300.0
"""Time that a diagnosis takes, about [s]."""
_KEPT, _MOST_KEPT = 0.25, 0.5
"""Share of it that is kept for the validation at least and at most."""
_BESIDE = 5
"""The refit of the model as given, the comparison of recordings and the report take about as long as this many fits;
each effect that is left out takes one more."""


@one_thread_each
@with_progress
def diagnose(
    model: Model,
    recordings: Recording | Sequence[Recording],
    holdout: Recording | Sequence[Recording] = (),
    *,
    new: Recording | Sequence[Recording] = (),
    former: Former | None = None,
    budget: float = BUDGET,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Finds out whether a model lacks physics, where, and which.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs from which everything is chosen, or one of them.
        holdout: runs from which no number is learned, and which are opened when the search has ended: the proof.
            Without any, the last quarter of the recordings (of the time, if there is one recording) plays their part,
            and the report says so.
        new: further runs from which everything is chosen, made since an earlier diagnosis; never held out.
        former: that diagnosis.
        budget: time for all of it [s]. A search that it cuts short reports what was found by then.
        progress: told what goes on, a short text at a time; by default a bar on a terminal or in a notebook.

    Returns:
        Verdict, place, named effects with intervals, and the errors before and after on the hold-out. After an
        interrupt (Ctrl-C) the model that was found by then, without a verdict: the hold-out stays closed.

    Raises:
        InputError: model and recordings do not go together, or there are none.
    """
    begun = time.monotonic()

    def tell(text: str) -> None:
        (progress or silent)(Step(text, most=budget))

    recordings, holdout, new = required(recordings), as_recordings(holdout), as_recordings(new)
    notes = [f"{r.name}: {note}" for r in (*recordings, *new, *holdout) for note in r.notes]
    if not holdout:
        recordings, holdout, note = split_off(recordings)
        notes.append(note)
    sealed = HoldOut(holdout)
    model, setting, told = prepared(model, (*recordings, *new), holdout)
    notes += told
    setting = setting.thinned()
    tell("fitting the model as given")
    problem = make_problem(setting, make_data(setting.recordings))
    problem = dataclasses.replace(problem, until=begun + (1.0 - _MOST_KEPT) * budget)
    fitting = time.monotonic() - programs.seconds()
    given = resolve(model.plant, setting.length)
    problem, fitted = fit_structure(problem, given, model.known)
    # Without the time that programs take to be made, which are there for the fits that follow.
    once = time.monotonic() - programs.seconds() - fitting

    def until(effects: int) -> float:
        kept = min(max((_BESIDE + effects) * once / budget, _KEPT), _MOST_KEPT)
        return begun + (1.0 - kept) * budget

    space = make_space(problem, fitted.plant, model.known, shared=False)
    base = base_structure(problem, space, fitted.point)
    search = select(problem, base, given, tell, until)
    base, found = search.held[0], search.held[-1]
    checked = None
    if search.stopped != "interrupted":
        try:
            checked = validate(search.problem, base, found, sealed, tell, begun + budget)
        except KeyboardInterrupt:
            search = dataclasses.replace(search, stopped="interrupted")
    if checked is None:
        checked = unopened(search.problem, base, found)
    result = _told(model, search, checked, sealed, tell, begun + budget)
    return dataclasses.replace(
        result,
        continued=None if former is None else continued(former, result.effects, [r.name for r in new]),
        notes=tuple(dict.fromkeys(notes)),
        seconds=time.monotonic() - begun,
    )


def _told(
    model: Model,
    search: Search,
    checked: Validation,
    sealed: HoldOut,
    tell: Callable[[str], None],
    deadline: float,
) -> Diagnosis:
    """All that the report tells of model and recordings."""
    problem, found = search.problem, search.held[-1]
    setting, base, final, opened = problem.setting, checked.given, checked.final, search.stopped != "interrupted"
    verdict, complete = checked.verdict if opened else (None, False)
    tell("drawing up the report")
    values, doubts = estimated(problem, final)
    searched = final if final.names == found.names else of_its_own(problem, found)
    told = values if searched is final else estimated(problem, searched)[0] | values
    on_holdout = functools.partial(whole_errors, problem, sealed=sealed) if opened else None
    naming = Naming(search, search.held[0], told, on_holdout, deadline)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        # Explanations that are not told apart have programs of their own.
        named = [
            pool.submit(
                named_effect,
                naming,
                c,
                final if inside else searched,
                in_model=inside and c.name not in checked.events,
            )
            for c in checked.checked
            for inside in [c.name in final.names]
        ]
        effects = tuple(each.result() for each in named)
    shown = traces((base.plant, checked.train_before), (final.plant, checked.train_after), "train")
    training = shown
    if opened:
        shown += traces((base.plant, checked.before), (final.plant, checked.after), "holdout")
    alarm = verdict != "adequate"
    place = location(search, effects, training) if alarm else Location(None, "none", {}, (), ())
    axis = AXIS_OF_EQUATION.get(place.equation)
    given = Counter((e.kind, e.site) for e in model.plant.effects)
    own = tuple(
        NamedEffect(
            kind=kind,
            site=site,
            probability=None,
            parameters=parameters_of(kind, site, values, number),
            equivalents=(),
            statement="",
            status="given",
        )
        for (kind, site), count in given.items()
        for number in range(1, count + 1)
    )
    worst = checked.worst((checked.after, checked.train_after))
    _, unit = QUANTITIES.get(worst[1], ("", ""))
    proof, others = (run.errors(worst[2]).get(worst[1], 0.0) for run in (checked.after, checked.train_after))
    remains = amount(max(proof, others), unit)
    if others > proof:
        remains += f" ({amount(proof, unit)} on the hold-out)"
    statement = verdict_sentence(
        verdict,
        effects,
        (checked.explained, checked.learned),
        Remains(*worst, remains),
        complete=complete,
        stopped=search.stopped,
        tried=any(search.tried),
    )
    rivals = contenders(search, effects) if opened else []
    apart = [
        apart_sentence(
            each.recording,
            [
                (n.number, amount(n.value, values[n.number].unit), n.value / n.others if n.others else math.inf)
                for n in own
            ],
            own[0].axis,
            own[0].closed,
            held_out=each.recording in sealed.names,
        )
        for each in checked.apart
        for own in [each.numbers]
    ]
    lasting = [e for e in final.plant.effects if (e.kind, e.site) not in checked.events]
    values = {name: e for name, e in values.items() if owner_of(name) not in checked.events}
    known = model.known - {site for kind, site in final.names if kind == WRONG_VALUE}
    empty = Errors({}, {})
    return Diagnosis(
        verdict=verdict,
        complete=complete,
        explained=_with_mean(checked.explained),
        stopped=search.stopped,
        statement=statement,
        adequacy=Adequacy(
            alarm,
            repeatable(training, axis, after=False),
            repeatable(training, axis, after=True),
            {a: Channel(e, setting.noise[a]) for a, e in checked.train_before.errors(WHOLE).items()},
        ),
        location=place,
        effects=effects,
        model_effects=own,
        bridge={name: e for name, e in values.items() if "@" not in name},
        before=dataclasses.replace(model, plant=base.plant, units={**model.units, **setting.units}),
        model=dataclasses.replace(
            model,
            plant=Plant(final.plant.bridge, tuple(lasting)),
            known=known,
            uncertainty=as_uncertainty(values),
            recorded=covered_by(setting.recordings),
            units={**model.units, **setting.units},
        ),
        train_before=checked.train_before.as_errors(),
        train_after=checked.train_after.as_errors(),
        holdout_before=checked.before.as_errors() if opened else empty,
        holdout_after=checked.after.as_errors() if opened else empty,
        noise=setting.noise,
        window=WINDOW,
        horizons=_horizons(checked) if opened else (),
        holdout=sealed.names,
        traces=shown,
        trials=_trials(search),
        # What was not looked for has no bound.
        not_seen=not_seen(problem, found, {(r.kind, r.site) for e in effects for r in e.equivalents})
        if search.stopped == "criterion"
        else (),
        next_experiment=next_experiment(rivals, problem, tell) if len(rivals) > 1 else None,
        warnings=(*apart, *doubts),
        settings=dataclasses.asdict(CRITERIA) | {"seed": 0},
    )


def _with_mean(explained: Mapping[str, float]) -> dict[str, float]:
    return {"all": float(np.mean(list(explained.values()))), **explained} if explained else {}


def _horizons(checked: Validation) -> tuple[Horizon, ...]:
    before, after = checked.before, checked.after
    return tuple(
        Horizon(h, before.errors(h), after.errors(h), before.typical(h), after.typical(h), checked.scatter.get(h))
        for h in before.horizons
        if not math.isinf(h)
    )


def _trials(search: Search) -> tuple[Mapping[str, object], ...]:
    """Every model that was fitted to all windows in each round."""
    rows = []
    for number, (before, tried) in enumerate(zip(search.held, search.tried, strict=False), 1):
        after = set(search.held[number].free) if number < len(search.held) else None
        for structure in tried:
            added = sorted(set(structure.names) - set(before.names))
            removed = sorted(set(before.names) - set(structure.names))
            both = sorted(set(before.names) & set(structure.names))
            refined = [n for n in both if len(structure.places(n)) > len(before.places(n))]
            taken = set(structure.free) == after
            changes = {"added": added, "left out": removed, "refined": refined}
            for name, change in [(n, change) for change, own in changes.items() for n in own]:
                rows.append(
                    {
                        "round": number,
                        "kind": name[0],
                        "site": name[1],
                        "change": change,
                        "gain": before.point.value - structure.point.value,
                        "price": structure.price - before.price if math.isfinite(structure.price) else None,
                        "restarted": structure.restarted,
                        "accepted": taken,
                    }
                )
    return tuple(rows)
