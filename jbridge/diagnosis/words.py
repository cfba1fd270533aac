"""What the report says, in the words of a rig's owner."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..identification.result import Estimate
from ..model.effects.catalogue import CATALOGUE
from ..model.names import explanation_name, number_name, quantity_name, site_name, spaced
from .criteria import CRITERIA
from .result import NamedEffect, Rival
from .structures.candidates import WRONG_VALUE

_TRAINING, _HOLDOUT = "the training recordings'", "the hold-out's"
"""Whose error is told of."""


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


def limit_sentence(key: str, limit: float | None, unit: str, change: float | None, notable: bool) -> str:
    """How large an effect that was not named may be.

    Args:
        key: the parameter that says how large it is.
        limit: its bound, None where there is none.
        unit: of both.
        change: by how much a simulation would be off for it, over the noise; None where there is no limit.
        notable: whether that is more than noise.
    """
    if limit is None or change is None:
        return (
            "Could not have been seen: nothing in these recordings excites it, or the model's other parameters absorb "
            "all that it does."
        )
    matters = "may matter" if notable else "is practically nothing"
    off = f"a simulation without it is off by at most {_times(change)} times the noise"
    return f"At most {amount(limit, unit)}{' off' if key in ('scale', 'value') else ''}. That {matters}: {off}."


def effect_sentence(
    kind: str, site: str, parameters: Mapping[str, Estimate], rivals: Sequence[Rival], recording: str | None = None
) -> str:
    """One sentence for a named effect, with the one recording in which it happens, and one for what cannot be told from
    it."""
    if kind == WRONG_VALUE:
        text = (
            f"The value given for the {spaced(site)} is wrong: the recordings ask for {quantity(parameters['value'])}."
        )
    else:
        what = CATALOGUE[kind].sentence.format(axis=site_name(site))
        numbers = [f"{spaced(key)} {quantity(e)}" for key, e in parameters.items() if quantity(e)]
        detail = f" ({', '.join(numbers)})" if numbers else ""
        where = "" if recording is None else f", in {recording} alone"
        text = f"{what[0].upper()}{what[1:]}{detail}{where}."
    if rivals:
        others = " or ".join(explanation_name(r.kind, r.site) for r in rivals)
        text += f" These recordings cannot tell it from {others}."
    return text


def apart_sentence(
    recording: str, numbers: Sequence[tuple[str, str, float]], axis: str, closed: float, *, held_out: bool
) -> str:
    """A recording that differs from the others.

    Args:
        recording: its name.
        numbers: of the bridge, each of which would make it like the others: the parameter, its value there with the
            unit, and that over what the others ask for.
        axis: the channel in which the first matters.
        closed: share of the excess squared error there that it closes.
        held_out: whether the recording is of the hold-out, from which no model takes a number.
    """
    each = []
    for number, value, ratio in numbers:
        times = f" ({ratio:.3g} times that of the others)" if 0.01 < abs(ratio) < 100.0 else ""
        each.append(f"a {number_name(number)} of {value}{times}")
    mend = "measure it, and" if held_out else "if the rig was set up so,"
    return (
        f"{recording} differs from the other recordings: {' or '.join(each)} would close {share_of(closed)} of its "
        f"excess squared error in the {quantity_name(axis)}. Look for another supply, load or unit; {mend} give it"
        " under [override] in its sidecar, or leave the recording out."
    )


def _times(ratio: float) -> str:
    """A ratio with two digits."""
    if not math.isfinite(ratio):
        return "more than a million"  # a simulation that ran away
    return f"{ratio:.2g}" if ratio < 99.5 else f"{float(f'{ratio:.2g}'):.0f}"


def share_of(explained: float) -> str:
    """A share in percent; nothing that is not whole is called so."""
    return f"{min(100.0 * explained, 99.9 if explained < 1.0 else 100.0):.3g} %"


class Remains(NamedTuple):
    """What a model leaves: its largest error over what is foreseen."""

    ratio: float
    axis: str
    horizon: float
    """[s]"""
    over_scatter: bool
    """Whether the error is over the scatter of repeated runs, and not over what noise explains."""
    amount: str
    """The error with its unit, beside that of the hold-out where it is smaller."""


def verdict_sentence(
    verdict: str | None,
    effects: Sequence[NamedEffect],
    explained: tuple[Mapping[str, float], Mapping[str, float]],
    remains: Remains,
    *,
    complete: bool,
    stopped: str,
    tried: bool,
) -> str:
    """The verdict in one or two sentences.

    Args:
        verdict: `adequate`, `missing_physics`, `unknown`, or None where the search was interrupted.
        effects: what was named.
        explained: share of the hold-out's error that confirmed effects explain, by channel in which there is any; and
            share of the training recordings' error that all effects explain.
        remains: the final model's largest error.
        complete: whether what remains is noise or measured scatter.
        stopped: why the search ended.
        tried: whether any other model was fitted by then.
    """
    proven, learned = explained
    where = "in whole recordings" if math.isinf(remains.horizon) else f"in windows of {remains.horizon:g} s"
    times, channel = _times(remains.ratio), quantity_name(remains.axis)
    over = "the scatter of repeated runs" if remains.over_scatter else "what noise explains"
    left = f"{remains.amount} in the {channel} {where}, is {times} times {over}"
    late = " The budget ended before the search did: give it more with --budget." if stopped == "budget" else ""
    if verdict is None:
        named = listed([e for e in effects])
        return f"The search was interrupted{f' after it had found {named}' if named else ''}; the hold-out is unseen."
    if verdict == "adequate":
        events = [f"{listed([e])} in {e.recording}" for e in effects if e.recording is not None]
        once = f", but for {' and '.join(events)}" if events else ""
        return (
            f"The model explains the recordings{once}: what remains is noise or the rig's own measured scatter, at "
            f"most {times} times it ({channel}, {where})."
        )
    sure = [e for e in effects if e.status == "confirmed"]
    explain = "explains" if len(sure) == 1 else "explain"
    if verdict == "missing_physics":
        lead = "A known number is wrong" if all(e.kind == WRONG_VALUE for e in sure) else "The model lacks physics"
        rest = f"What remains, {left}, and is unexplained."
        if complete:
            rest = f"What remains is {'scatter between repeated runs' if remains.over_scatter else 'noise'}."
        if not proven:
            are, them = ("is", "it") if len(sure) == 1 else ("are", "them")
            small = f"but small: without {them} the error at 1 s is hardly more than noise"
            return f"{lead}: {listed(sure)} {are} confirmed by the hold-out, {small}. {rest}{late}"
        return f"{lead}: {listed(sure)} {explain} {_shares(proven)}. {rest}{late}"
    if sure:
        told = f"{explain} {_shares(proven)}"
        if proven and max(proven.values()) <= 0.0:
            # Confirmed by the typical error, with no share of the sum of squares.
            are, without = ("is", "it") if len(sure) == 1 else ("are", "them")
            told = (
                f"{are} confirmed, since most windows of the hold-out are met worse without {without}, but {told}: the "
                "windows with the largest errors, which make up most of the sum of squares, are met no better"
            )
        some = f"What was found, {listed(sure)}, {told}; what remains, {left}.{late}"
        return f"Not everything that is missing is identified. {some}"
    found = [e for e in effects if e.recording is None]
    if found and max(learned.values(), default=0.0) > CRITERIA.named:
        explain, them = ("explains", "it") if len(found) == 1 else ("explain", "them")
        return (
            f"Something is missing. What was found, {listed(found)}, {explain} {_shares(learned, _TRAINING)}, but the"
            f" hold-out does not confirm {them}: what remains, {left}.{late}"
        )
    if late:
        what = "nothing that was tried by then explains the hold-out" if tried else "nothing was tried by then"
        return f"{late.strip()} Something is missing, and {what}: what remains, {left}."
    return f"Something is missing, and nothing in the catalogue explains the hold-out: what remains, {left}."


def _shares(explained: Mapping[str, float], whose: str = _HOLDOUT) -> str:
    """Shares of the error of some recordings at 1 s, channel by channel where there are several."""
    each = [share_of(share) if share > 0.0 else "nothing" for share in explained.values()] or ["nothing"]
    if len(each) > 1:
        each = [f"{said} ({quantity_name(a)})" for said, a in zip(each, explained, strict=True)]
    return f"{' and '.join(filter(None, [', '.join(each[:-1]), each[-1]]))} of {whose} error at 1 s"


def listed(effects: Sequence[NamedEffect]) -> str:
    """Effects in a row, as a sentence names them."""
    names = [
        f"the {spaced(e.site)}, which comes out as {quantity(e.parameters['value'])}"
        if e.kind == WRONG_VALUE
        else explanation_name(e.kind, e.site)
        for e in effects
    ]
    if len(names) < 2:
        return "".join(names)
    between = "; " if any("," in name for name in names) else ", "
    return f"{between.join(names[:-1])} and {names[-1]}"
