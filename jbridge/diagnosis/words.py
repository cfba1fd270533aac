"""What the report says, in the words of a rig's owner."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..identify.result import Estimate
from ..model.effects.base import SITES
from ..model.effects.catalogue import CATALOGUE
from .adequacy import LARGE
from .candidates import WRONG_VALUE
from .names import kind_name, site_name, spaced
from .result import Channel, Location, NamedEffect, Rival

_CHANNEL_WORDS = {"x": "cart position", "psi": "swing angle", "l": "rope length"}


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
        others = " or ".join(_at(r) for r in rivals)
        text += f" These recordings cannot tell it from {others}."
    return text


def _at(explanation: NamedEffect | Rival) -> str:
    if explanation.kind == WRONG_VALUE:
        return f"a wrong value of the {spaced(explanation.site)}"
    return f"{kind_name(explanation.kind)} at the {site_name(explanation.site)}"


def _times(ratio: float) -> str:
    """A ratio with two digits."""
    return f"{ratio:.2g}" if ratio < 99.5 else f"{float(f'{ratio:.2g}'):.0f}"


class Proof(NamedTuple):
    """Error over noise on the hold-out, of the channel that is met worst."""

    before: float
    after: float
    measure: str
    """What was simulated: `free runs` or `windows of 2 s`."""


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
    """
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
            else _at(e)
            for e in effects
        ]
        # Names that carry a clause of their own need a stronger mark between them.
        between = "; " if any("," in name for name in names) else ", "
        listed = names[0] if len(names) == 1 else f"{between.join(names[:-1])} and {names[-1]}"
        lead = "A known number is wrong" if all(e.kind == WRONG_VALUE for e in effects) else "The model lacks physics"
        gain = (
            f"the error on the hold-out falls from {_times(proof.before)} to {_times(proof.after)} times the noise "
            f"in {proof.measure}."
        )
        rest = " What is left does not repeat from one recording to another." if final > LARGE else ""
        return f"{lead}: {listed}. With {'it' if len(names) == 1 else 'them'} {gain}{rest}"
    if unproven:
        return (
            f"Something repeatable is missing at the {where}, but no explanation holds: what explains these recordings "
            f"leaves errors of {_times(proof.after)} times the noise on the hold-out, in {proof.measure}."
        )
    found = " What was found explains a part of it only." if effects else ""
    if curve:
        found += " The model file keeps the missing force as a curve, so that its simulation is usable all the same."
    return (
        f"Something repeatable is missing at the {where}, and nothing in the catalogue explains it: errors reach "
        f"{_times(final)} times the noise.{found}"
    )
