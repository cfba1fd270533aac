"""What the report says, in the words of a rig's owner."""

import math
from collections.abc import Mapping, Sequence

from ..identify.result import Estimate
from ..model.effects.base import SITES
from ..model.effects.catalogue import CATALOGUE
from .adequacy import LARGE
from .candidates import WRONG_VALUE
from .result import Channel, Location, NamedEffect, Rival

_AXIS_WORDS = {
    "cart": "cart",
    "swing": "swing",
    "hoist": "hoist",
    "cart_drive": "cart's drive",
    "hoist_drive": "hoist's drive",
    "x_sensor": "cart position sensor",
    "psi_sensor": "angle sensor",
    "l_sensor": "rope length sensor",
}
_CHANNEL_WORDS = {"x": "cart position", "psi": "swing angle", "l": "rope length"}


def site_words(site: str) -> str:
    return _AXIS_WORDS.get(site, site.replace("_", " "))


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
        text = f"The value given for {site} is wrong: the recordings ask for {quantity(parameters['value'])}."
    else:
        what = CATALOGUE[kind].sentence.format(axis=site_words(site))
        numbers = [f"{key.replace('_', ' ')} {quantity(e)}" for key, e in parameters.items() if quantity(e)]
        detail = f" ({', '.join(numbers)})" if numbers else ""
        text = f"{what[0].upper()}{what[1:]}{detail}."
    if rivals:
        others = " or ".join(f"{r.kind.replace('_', ' ')} at the {site_words(r.site)}" for r in rivals)
        text += f" These recordings cannot tell it from {others}."
    return text


def _times(ratio: float) -> str:
    """A ratio with two digits."""
    return f"{ratio:.2g}" if ratio < 99.5 else f"{float(f'{ratio:.2g}'):.0f}"


def verdict_sentence(
    verdict: str,
    effects: Sequence[NamedEffect],
    location: Location,
    before: Mapping[str, Channel],
    after: Mapping[str, Channel],
    large: bool,
    *,
    curve: bool,
    unproven: float | None = None,
) -> str:
    """The verdict in one or two sentences.

    Args:
        verdict: `adequate`, `missing_physics` or `unknown`.
        effects: what was named.
        location: where.
        before: errors of the model as given, refitted.
        after: errors of the final model.
        large: whether the errors before are more than noise.
        curve: whether a force without a name was put into the model.
        unproven: error over noise on the hold-out, where what was named does not hold there.
    """
    worst = max(before, key=lambda axis: before[axis].ratio)
    ratio = before[worst].ratio
    if verdict == "adequate":
        if not large:
            return (
                f"The model explains the recordings: what remains is noise, at most {_times(ratio)} times it "
                f"(in the {_CHANNEL_WORDS[worst]})."
            )
        return (
            f"No physics is missing that these recordings could teach: errors reach {_times(ratio)} times the noise in "
            f"the {_CHANNEL_WORDS[worst]}, but they do not repeat from one recording to another. This is the rig's "
            "own scatter."
        )
    final = max(after[axis].ratio for axis in after)
    where = site_words(location.site) if location.site in SITES else "bridge"
    if verdict == "missing_physics":
        names = [
            f"the {e.site.replace('_', ' ')}, which comes out as {quantity(e.parameters['value'])}"
            if e.kind == WRONG_VALUE
            else f"{e.kind.replace('_', ' ')} at the {site_words(e.site)}"
            for e in effects
        ]
        # Names that carry a clause of their own need a stronger mark between them.
        between = "; " if any("," in name for name in names) else ", "
        listed = names[0] if len(names) == 1 else f"{between.join(names[:-1])} and {names[-1]}"
        lead = "A known number is wrong" if all(e.kind == WRONG_VALUE for e in effects) else "The model lacks physics"
        gain = f"the error falls from {_times(ratio)} to {_times(final)} times the noise in free runs."
        rest = " What is left does not repeat from one recording to another." if final > LARGE else ""
        return f"{lead}: {listed}. With {'it' if len(names) == 1 else 'them'} {gain}{rest}"
    if unproven is not None:
        return (
            f"Something repeatable is missing at the {where}, but no explanation holds: what explains these recordings "
            f"leaves errors of {_times(unproven)} times the noise on the hold-out."
        )
    found = " What was found explains a part of it only." if effects else ""
    if curve:
        found += " The model file keeps the missing force as a curve, so that its simulation is usable all the same."
    return (
        f"Something repeatable is missing at the {where}, and nothing in the catalogue explains it: errors reach "
        f"{_times(final)} times the noise.{found}"
    )
