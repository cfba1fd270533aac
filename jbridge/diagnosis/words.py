"""What the report says, in the words of a rig's owner."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..identify.result import Estimate
from ..model.effects.base import SITES, parameters_of, unit_at
from ..model.effects.catalogue import CATALOGUE
from .adequacy import LARGE
from .candidates import ABSENT_WHEN_LARGE, WRONG_VALUE, Candidate
from .holdout import OffMap
from .names import explanation_name, site_name, spaced
from .once import Once
from .result import Channel, Location, NamedEffect, Rival

_CHANNEL_WORDS = {
    "x": "cart position",
    "psi": "swing angle",
    "l": "rope length",
    "u_x": "cart drive's input",
    "u_l": "hoist drive's input",
    "x_rate": "cart's speed",
    "psi_rate": "rate of swing",
    "l_rate": "hoist's speed",
}


def quantity(e: Estimate) -> str:
    """A number with its 95 % half-width and unit; angles in degrees."""
    if isinstance(e.value, list):
        return ""
    value, std, unit = e.value, e.std, e.unit
    if unit.startswith("rad"):
        factor = 180 / math.pi
        value, unit = value * factor, "degrees" + unit[3:]
        std = None if not isinstance(std, float) else std * factor
    if unit == "1":
        unit = ""
    text = f"{value:.4g}"
    if isinstance(std, float) and std > 0:
        text += f" ± {1.96 * std:.2g}"
    return f"{text} {unit}".strip()


def amount(value: float, unit: str) -> str:
    """A number with two digits and its unit; angles in degrees."""
    if unit.startswith("rad"):
        value, unit = value * 180 / math.pi, "degrees" + unit[3:]
    if unit in ("m", "s") and abs(value) < 0.1:
        value, unit = 1e3 * value, f"m{unit}"
    text = f"{value:.2g}" if abs(value) < 99.5 else f"{float(f'{value:.2g}'):.0f}"
    return f"{text} {'' if unit == '1' else unit}".strip()


def limit_sentence(
    key: str, limit: float | None, unit: str, change: float | None, *, finite: bool = False, silent: bool = False
) -> str:
    """How large an effect that was not named may be.

    Args:
        key: the parameter that says how large it is.
        limit: its bound, None where there is none.
        unit: of both.
        change: by how much the hold-out's simulation would be off for it, over the noise; None where there is no limit.
        finite: whether the limit is the weakest of some sizes that were tried.
        silent: whether it does nothing in these recordings.
    """
    if limit is None:
        if finite:
            return "Could not have been seen in these recordings: at no size that was tried does it show in them."
        if silent:
            return "Could not have been seen in these recordings: nothing in them calls it up."
        return (
            "Could not have been seen in these recordings: the model's other numbers and the recordings' starts take "
            "up all that it does."
        )
    name, size = spaced(key), amount(limit, unit)
    assert change is not None
    matters = "may matter" if change > LARGE else "is practically nothing"
    off = f"a simulation of the hold-out without it is off by at most {_times(change)} times the noise"
    if finite:
        if key in ABSENT_WHEN_LARGE:
            text = f"A {name} of {size} or less would have shown"
        elif key == "position":
            text = f"It would have shown if it began at {size} or nearer"
        else:
            text = f"A {name} of {size} or more would have shown"
        return f"{text}. What may hide {matters}: {off}."
    text = f"At most {size}{' off' if key in ('scale', 'value') else ''}"
    return f"{text}. That {matters}: {off}."


def assumed(candidate: Candidate, key: str) -> str:
    """What else was taken for granted of an effect at a finite size."""
    cls = CATALOGUE[candidate.kind]
    infos = parameters_of(cls)
    numbers = [
        f"{spaced(k)} {amount(float(v), unit_at(infos[k].unit, candidate.site))}"
        for k, v in candidate.values.items()
        if k in infos and k != key
    ]
    words = [f"{spaced(k)} {v}" for k, v in candidate.values.items() if isinstance(v, str)]
    return f"(Tried with {', '.join(words + numbers)}.)" if words or numbers else ""


def effect_sentence(kind: str, site: str, parameters: Mapping[str, Estimate], rivals: Sequence[Rival]) -> str:
    """One sentence for a named effect, and one for what cannot be told from it."""
    if kind == WRONG_VALUE:
        text = (
            f"The value given for the {spaced(site)} is wrong: the recordings ask for {quantity(parameters['value'])}."
        )
    else:
        what = CATALOGUE[kind].sentence.format(axis=site_name(site))
        numbers = [f"{spaced(key)} {quantity(e)}" for key, e in parameters.items() if quantity(e)]
        detail = f" ({', '.join(numbers)})" if numbers else ""
        text = f"{what[0].upper()}{what[1:]}{detail}."
    if rivals:
        others = " or ".join(explanation_name(r.kind, r.site) for r in rivals)
        text += f" These recordings cannot tell it from {others}."
    return text


def _times(ratio: float) -> str:
    """A ratio with two digits."""
    if not math.isfinite(ratio):
        return "more than a million"  # a simulation that ran away
    return f"{ratio:.2g}" if ratio < 99.5 else f"{float(f'{ratio:.2g}'):.0f}"


class Proof(NamedTuple):
    """Error over noise on the hold-out, of the channel that is met worst."""

    before: float
    after: float
    measure: str
    """What was simulated: `free runs` or `windows of 2 s`."""


class Elsewhere(NamedTuple):
    """What a recording shows that others do not."""

    channel: str
    recording: str
    ratio: float
    """Error over noise there."""


def _gap(proof: Proof) -> str:
    way = "falls" if proof.after < proof.before else "goes"
    return (
        f"the error on the hold-out {way} from {_times(proof.before)} to {_times(proof.after)} times the noise "
        f"in {proof.measure}."
    )


def _once_sentence(once: Once, ratio: float, worst: str) -> str:
    """What is said of errors that sit in few recordings."""
    spans: dict[str, list[str]] = {name: [] for name in once.recordings}
    for interval in once.when:
        spans[interval.recording].append(f"{interval.start:.1f} to {interval.stop:.1f} s")
    where = ", ".join(name + (f" ({', '.join(times)})" if times else "") for name, times in spans.items())
    return (
        f"No physics is missing that these recordings could teach: errors reach {_times(ratio)} times the noise in the "
        f"{_CHANNEL_WORDS[worst]}, but all of it comes from {where}; the other recordings are met within "
        f"{_times(once.others)} times the noise. Something happened there that did not repeat (a push, a gust, a jump "
        "of a sensor): leave it out or trim it ([trim] in the sidecar), and the model's numbers become sharper."
    )


def aside_sentence(name: str, start: float, channel: str, ratio: float, beyond: str | None) -> str:
    """What is told of a recording that was set aside.

    Args:
        name: of the recording.
        start: until when the model meets it [s].
        channel: that which it meets worst from then on,
        ratio: and with how many times the noise.
        beyond: see `Event`.
    """
    told = (
        f"{name} was set aside: the model meets it as well as the others until {start:.2f} s, and then leaves "
        f"{_times(ratio)} times the noise in the {_CHANNEL_WORDS[channel]}. "
    )
    if beyond is None:
        return told + (
            "Something seems to have happened there once, such as a push or a reading that jumped. If it did not, "
            "record another run like it."
        )
    return told + (
        f"Just then its {_CHANNEL_WORDS[beyond]} is beyond that of any other recording: something happened there once, "
        "or something more is missing that begins there. Record another run that goes there, and add it with --with."
    )


def verdict_sentence(
    verdict: str,
    effects: Sequence[NamedEffect],
    location: Location,
    before: Mapping[str, Channel],
    after: Mapping[str, Channel],
    proof: Proof,
    *,
    large: bool,
    asked: bool,
    curve: bool,
    unproven: bool = False,
    abroad: OffMap | None = None,
    elsewhere: Elsewhere | None = None,
    odd_one: Elsewhere | None = None,
    once: Once | None = None,
) -> str:
    """The verdict in one or two sentences.

    Args:
        verdict: `adequate`, `missing_physics` or `unknown`.
        effects: what was named.
        location: where.
        before: errors of the model as given, refitted.
        after: errors of the final model.
        proof: errors on the hold-out.
        large: whether the errors before are more than noise.
        asked: whether it was asked if they repeat.
        curve: whether a force without a name was put into the model.
        unproven: whether what was named does not hold on the hold-out.
        abroad: where a hold-out went that therefore cannot judge what was named.
        elsewhere: what shows on the hold-out alone.
        odd_one: the same of a recording that was learned from for it.
        once: what happened in few recordings, and not in the others.
    """
    alarm = verdict == "missing_physics" or bool(effects)
    if odd_one is not None:
        return (
            f"What {odd_one.recording} shows in the {_CHANNEL_WORDS[odd_one.channel]} does not repeat in the other "
            "recordings, and one is not enough to learn it from. Record more runs like it, and add them with --with."
        )
    if elsewhere is not None and not alarm:
        return (
            f"The model explains these recordings, but not the hold-out: errors of {elsewhere.recording} reach "
            f"{_times(elsewhere.ratio)} times the noise in the {_CHANNEL_WORDS[elsewhere.channel]}, more than "
            "uncertain numbers would make. Something is missing that hardly shows in these recordings. Record more "
            "runs like that one, and add them with --with."
        )
    worst = max(before, key=lambda axis: before[axis].ratio)
    ratio = before[worst].ratio
    if verdict == "adequate":
        if not large:
            return (
                f"The model explains the recordings: what remains is noise, at most {_times(ratio)} times it "
                f"(in the {_CHANNEL_WORDS[worst]})."
            )
        if not asked:
            return (
                f"Errors reach {_times(ratio)} times the noise in the {_CHANNEL_WORDS[worst]}, but they hang together "
                "no longer than noise does: nothing can be learned from them."
            )
        if once is not None:
            return _once_sentence(once, ratio, worst)
        return (
            f"No physics is missing that these recordings could teach: errors reach {_times(ratio)} times the noise in "
            f"the {_CHANNEL_WORDS[worst]}, but they do not repeat from one recording to another. This is the rig's "
            "own scatter."
        )
    final = max(after[axis].ratio for axis in after)
    where = site_name(location.site) if location.site in SITES else "bridge"
    if verdict == "missing_physics":
        names = [
            f"the {spaced(e.site)}, which comes out as {quantity(e.parameters['value'])}"
            if e.kind == WRONG_VALUE
            else explanation_name(e.kind, e.site)
            for e in effects
        ]
        # Names that carry a clause of their own need a stronger mark between them.
        between = "; " if any("," in name for name in names) else ", "
        listed = names[0] if len(names) == 1 else f"{between.join(names[:-1])} and {names[-1]}"
        lead = "A known number is wrong" if all(e.kind == WRONG_VALUE for e in effects) else "The model lacks physics"
        gain = _gap(proof)
        if abroad is not None:
            (a, b), (c, d) = abroad.asked, abroad.learned
            gain = (
                f"what is left of the recordings is noise. On the hold-out errors go from {_times(proof.before)} to "
                f"{_times(proof.after)} times the noise in {proof.measure}, but it is no judge of a map of friction: "
                f"its {_CHANNEL_WORDS[abroad.axis]} goes from {a:.2f} to {b:.2f} m, the recordings' from {c:.2f} to "
                f"{d:.2f} m, and a map tells nothing of places where nobody has been. Record a run there."
            )
        rest = " What is left does not repeat from one recording to another." if final > LARGE else ""
        if elsewhere is not None and abroad is None:
            rest += (
                f" But {elsewhere.recording} is still met worse than uncertain numbers allow, with "
                f"{_times(elsewhere.ratio)} times the noise in the {_CHANNEL_WORDS[elsewhere.channel]}: something more "
                "is missing that hardly shows in these recordings."
            )
        return f"{lead}: {listed}. With {'it' if len(names) == 1 else 'them'} {gain}{rest}"
    like = f" {location.likeness.statement}" if location.likeness is not None and location.likeness.statement else ""
    if unproven:
        return (
            f"Something repeatable is missing at the {where}, but no explanation holds: what explains these recordings "
            f"leaves errors of {_times(proof.after)} times the noise on the hold-out, in {proof.measure}.{like}"
        )
    found = " What was found explains a part of it only." if effects else ""
    found += like
    if curve:
        found += f" The model file keeps the missing force as a curve. With {'both' if effects else 'it'} {_gap(proof)}"
    return (
        f"Something repeatable is missing at the {where}, and nothing in the catalogue explains it: errors reach "
        f"{_times(ratio if curve else final)} times the noise.{found}"
    )
