"""`diagnose`: what a model lacks, from recordings, and the proof on recordings that took no part."""

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Collection, Sequence

from .._threads import one_thread_each
from ..errors import InputError
from ..identification.problem import Setting, make_setting, with_a_scale
from ..identify.base import WINDOW
from ..identify.evaluate import evaluate, traces
from ..identify.uncertainty import as_uncertainty
from ..model.files import Model
from ..recordings import Recording
from .adequacy import (
    FORESEEN,
    LARGE,
    LEARNABLE,
    NOTICEABLE,
    PROVEN,
    SIGNIFICANT,
    STILL_LEARNABLE,
    channels,
    is_large,
    worst_ratio,
)
from .aside import event, stands_out
from .attempt import Attempt, attempt
from .contend import contenders, continued, nearest
from .design import next_experiment
from .holdout import split_off
from .judge import Judgement, Settled, judge, settle
from .limits import not_seen
from .locate import equation_of
from .missing import missing_forces
from .once import happened_once, timed
from .result import Adequacy, Diagnosis, Former, NamedEffect
from .rounds import MOST_EFFECTS
from .search import PARTS
from .tell import location_of, named_of, parameters_of, trials_of
from .trials import EFFECTIVE
from .words import aside_sentence, verdict_sentence


@one_thread_each
def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording] = (),
    *,
    new: Sequence[Recording] = (),
    former: Former | None = None,
    leave_out: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Finds out whether a model lacks physics, where, and which.

    Args:
        model: structure, start values and what is known.
        recordings: measured runs from which everything is chosen.
        holdout: runs from which no number is learned; they say whether names that explain a small error are kept, and
            whether any, or further ones, are looked for where the recordings hardly show one. If several show what
            the recordings do not, the worst is learned from after all, in a second diagnosis. Without any, the last
            quarter of the recordings (of the time, if there is one recording) plays their part, and none of it is
            learned from. The report says so.
        new: further runs from which everything is chosen, made since an earlier diagnosis; never held out.
        former: that diagnosis. What it named or could not rule out is refitted whatever is expected of it.
        leave_out: of "rescreening", "seeds" and "bootstrap", what is done without, to measure what it is worth:
            screening anew after each acceptance, more than one seed of an effect, and a significance from drawn signs.
        progress: told what goes on, a short text at a time.

    Returns:
        Verdict, place, named effects with intervals, and the errors before and after on the hold-out.

    Raises:
        InputError: model and recordings do not go together.
        ValueError: `leave_out` names something else.
    """
    if unheard := set(leave_out) - set(PARTS):
        raise ValueError(f"a diagnosis can do without {', '.join(PARTS)}, and not without {', '.join(sorted(unheard))}")
    begun = time.perf_counter()
    notes = [f"{r.name}: {note}" for r in (*recordings, *new, *holdout) for note in r.notes]
    given = bool(holdout)
    if not given:
        recordings, holdout, note = split_off(recordings)
        notes.append(note)
    found: Diagnosis | _Plan = _Plan(
        model, (*recordings, *new), tuple(holdout), tuple(new), former, frozenset(leave_out), tuple(notes), given
    )
    while isinstance(found, _Plan):
        found = _diagnose(found, progress)
    return dataclasses.replace(found, seconds=time.perf_counter() - begun)


@dataclasses.dataclass(frozen=True)
class _Plan:
    """What is to be diagnosed."""

    model: Model
    recordings: tuple[Recording, ...]
    holdout: tuple[Recording, ...]
    new: tuple[Recording, ...]
    """Those of the recordings that an earlier diagnosis did not know, one that was set aside included."""
    former: Former | None
    leave_out: frozenset[str]
    notes: tuple[str, ...]
    spare: bool
    """Whether a recording of the hold-out may be learned from, if others show the same."""
    surprised: str | None = None
    """The channel for which one was."""
    aside: Recording | None = None
    """A recording that is left out, since it is met far worse than all others."""

    def setting_aside(self, index: int) -> "_Plan":
        """The same without one of the recordings."""
        odd = self.recordings[index]
        rest = tuple(recording for recording in self.recordings if recording is not odd)
        notes = tuple(note for note in self.notes if note != _taken(odd))
        surprised = None if _taken(odd) in self.notes else self.surprised
        return dataclasses.replace(self, recordings=rest, notes=notes, surprised=surprised, aside=odd, spare=False)

    def taking_in(self, index: int, channel: str) -> "_Plan":
        """The same with a recording of the hold-out to learn from."""
        taken = self.holdout[index]
        return dataclasses.replace(
            self,
            recordings=(*self.recordings, taken),
            holdout=self.holdout[:index] + self.holdout[index + 1 :],
            notes=(*self.notes, _taken(taken)),
            spare=False,
            surprised=channel,
        )


def _taken(recording: Recording) -> str:
    return f"{recording.name} was learned from, too: it shows what the other recordings hardly do."


def _diagnose(plan: _Plan, progress: Callable[[str], None] | None) -> "Diagnosis | _Plan":
    """The diagnosis, or a plan for another one that learns from a hold-out which the recordings did not prepare for."""
    tell = progress or (lambda text: None)
    model, holdout, former = plan.model, plan.holdout, plan.former
    setting = make_setting(model, plan.recordings, holdout)
    model, told = with_a_scale(model, setting.axes)
    if told is not None:
        plan = dataclasses.replace(plan, model=model, notes=(*plan.notes, told))
    made = attempt(
        model,
        setting,
        insist=former.names if former else frozenset(),
        leave_out=plan.leave_out,
        progress=progress,
    )
    settled = settle(made, setting, tell)
    if settled.unprepared is not None and plan.spare and len(settled.unprepared.recordings) > 1:
        tell("learning from a recording of the hold-out, too")
        return plan.taking_in(settled.unprepared.recordings[0], settled.unprepared.channel)
    judged = judge(made, settled, setting, plan.surprised)
    # Of rigs that drift, whole recordings are met by luck.
    if judged.verdict != "adequate" and plan.aside is None and made.search.window is None and is_large(judged.left):
        now = stands_out(settled.last.train.batch, settled.last.train.predicted)
        odd = made.explained.odd if now is None else now
        if odd is not None:
            tell("asking all recordings but one, which is met far worse")
            others = _without_what_happened_once(plan.setting_aside(odd), plan.recordings[odd], setting, progress)
            if others is not None and _rather(others, judged, settled):
                return others
    return _told(plan, made, settled, judged, setting, tell)


def _without_what_happened_once(
    plan: _Plan, odd: Recording, setting: Setting, progress: Callable[[str], None] | None
) -> Diagnosis | None:
    """What the other recordings say, if the hold-out bears it out and so does the odd one, until something happens."""
    try:
        found = _diagnose(plan, progress)
    except InputError:  # a motor that runs in the odd one alone, say
        return None
    assert isinstance(found, Diagnosis), "a plan with nothing to spare is carried out"
    if found.verdict != "missing_physics":
        return None
    happened = event(found.model.plant, setting, odd, plan.recordings)
    if happened is None:
        return None
    told = aside_sentence(odd.name, happened.when.start, happened.channel, happened.ratio, happened.beyond)
    before, after = (
        (model.plant, evaluate(model.plant, setting, [odd], windows=False)) for model in (found.before, found.model)
    )
    # Where the odd one may have met another law, what was named may be a part of what is missing.
    open_ = happened.beyond is not None
    return dataclasses.replace(
        found,
        verdict="unknown" if open_ else found.verdict,
        statement=f"{'More may be missing than has a name. ' if open_ else ''}{found.statement} {told}",
        location=dataclasses.replace(found.location, when=(*found.location.when, happened.when)),
        traces=(*found.traces, *traces(before, after, [odd], "aside")),
        aside=odd.name,
    )


def _rather(others: Diagnosis, judged: Judgement, settled: Settled) -> bool:
    """Whether a diagnosis without one of the recordings gives way for that with it."""
    if judged.verdict == "missing_physics" and others.verdict != judged.verdict:
        return False
    alone, together = others.holdout_after, settled.last.holdout.errors
    return worst_ratio(alone.free_run, others.noise) <= worst_ratio(together.free_run, others.noise)


def _told(
    plan: _Plan, made: Attempt, settled: Settled, judged: Judgement, setting: Setting, tell: Callable[[str], None]
) -> Diagnosis:
    """All that the report tells."""
    model, former = plan.model, plan.former
    first, last, state, values = settled.first, settled.last, settled.state, settled.values
    search, explained, steps, alarm = made.search, made.explained, made.explained.steps, made.alarm
    shown = traces((first.plant, first.train), (last.plant, last.train), setting.recordings, "train")
    shown += traces((first.plant, first.holdout), (last.plant, last.holdout), setting.holdout, "holdout")
    effects = named_of(steps, setting, values) if alarm else ()
    rivals = contenders(search, state, steps, effects)
    if judged.verdict == "unknown" and not rivals:
        rivals = nearest(state, explained.refused)
    experiment = next_experiment(rivals, setting, tell) if rivals else None
    train = [trace for trace in shown if trace.role == "train"]
    # Of small errors a force with no law assumed would be noise.
    latent = missing_forces(made.base, search.window is not None, train, tell) if alarm and made.large else None
    at = state.plant.effects[-1].site if settled.curved else None
    location = location_of(alarm, effects, steps, explained.screened, shown, at, latent)
    beyond = judged.odd_one or judged.elsewhere
    if not alarm and beyond is not None:
        location = dataclasses.replace(location, site=None, equation=equation_of(beyond.channel))
    once = None
    if judged.verdict == "adequate" and made.large and made.p_value <= SIGNIFICANT:
        once = happened_once(first.train, [r.name for r in setting.recordings])
    if once is not None:
        once = timed(once, missing_forces(made.base, search.window is not None, train, tell), train)
        location = dataclasses.replace(location, equation=equation_of(once.axis), when=once.when)
    given = Counter((e.kind, e.site) for e in search.given.effects)
    kept = given & Counter((e.kind, e.site) for e in last.plant.effects)
    own = tuple(
        NamedEffect(kind, site, None, parameters_of(kind, site, values, number), (), "")
        for (kind, site), count in kept.items()
        for number in range(1, count + 1)
    )
    before = channels(first.train.batch, first.train.predicted, setting.noise) if alarm else made.channels
    statement = verdict_sentence(
        judged.verdict,
        effects,
        location,
        before,
        judged.left,
        judged.proof,
        large=made.large,
        asked=made.p_value <= SIGNIFICANT,
        curve=settled.curved,
        unproven=judged.unproven and not judged.still,
        abroad=judged.abroad,
        elsewhere=judged.elsewhere,
        odd_one=judged.odd_one,
        once=once,
    )
    return Diagnosis(
        judged.verdict,
        statement,
        Adequacy(alarm, made.p_value, made.learnable, made.learnable_after, made.channels),
        location,
        effects,
        own,
        {name: e for name, e in values.items() if "@" not in name},
        dataclasses.replace(model, plant=first.plant),
        dataclasses.replace(model, plant=last.plant, known=state.known, uncertainty=as_uncertainty(values)),
        first.train.errors,
        last.train.errors,
        first.holdout.errors,
        last.holdout.errors,
        setting.noise,
        WINDOW,
        tuple(r.name for r in setting.holdout),
        shown,
        trials_of(steps, explained.refused),
        not_seen(search, state, {(rival.kind, rival.site) for effect in effects for rival in effect.equivalents}),
        experiment,
        None if former is None else continued(former, effects, [r.name for r in plan.new]),
        settled.hardly_told,
        tuple(dict.fromkeys(plan.notes)),
        {
            "large": LARGE,
            "noticeable": NOTICEABLE,
            "significant": SIGNIFICANT,
            "learnable": LEARNABLE,
            "foreseen": FORESEEN,
            "still_learnable": STILL_LEARNABLE,
            "proven": PROVEN,
            "compared_on": "free runs" if made.window is None else f"windows of {made.window:g} s",
            "most_effects": MOST_EFFECTS,
            "effective_samples": EFFECTIVE,
            "seed": 0,
            "left_out": sorted(plan.leave_out),
        },
        0.0,  # told by whoever asked
    )
