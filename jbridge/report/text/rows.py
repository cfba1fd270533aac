"""The tables that the terminal and the page share, as rows of text."""

import dataclasses
import math
from collections.abc import Collection, Mapping

from ...diagnosis.criteria import CRITERIA
from ...diagnosis.result import Diagnosis
from ...identification.result import Estimate, Fit
from ...model.files import HOIST
from .quantities import UNKNOWN, digits, error_scale, join_unit, percent, shown, times_noise
from .words import is_choice, parameter_meaning


@dataclasses.dataclass(frozen=True)
class ErrorRow:
    """How far a channel's simulation is from its recording, before and after."""

    channel: str
    before: str
    before_ratio: str
    after: str
    after_ratio: str
    noise: str
    closed: str
    """Share of the gap to the noise that is closed."""


def is_met(fit: Fit) -> bool:
    """Whether what a fitted model leaves is noise, as a verdict asks for it."""
    return fit.over_foreseen <= CRITERIA.met


def error_rows(
    before: Mapping[str, float] | None, after: Mapping[str, float], noise: Mapping[str, float]
) -> list[ErrorRow]:
    """One row per channel; errors and noise in m and rad."""
    earlier = before or {}
    return [
        ErrorRow(
            channel,
            error_text(channel, earlier.get(channel)),
            times_noise(earlier.get(channel), noise.get(channel)),
            error_text(channel, after.get(channel)),
            times_noise(after.get(channel), noise.get(channel)),
            error_text(channel, noise.get(channel)),
            _closed(earlier.get(channel), after.get(channel), noise.get(channel)),
        )
        for channel in ("x", "psi", "l")
        if channel in after or channel in earlier
    ]


def error_text(channel: str, error: float | None) -> str:
    """An error of a channel with its unit, in mm or degrees.

    >>> error_text("x", 0.0123), error_text("psi", None)
    ('12.3 mm', '–')
    """
    if error is None or not math.isfinite(error):
        return UNKNOWN
    scale = error_scale(channel)
    size = scale.factor * error
    return join_unit(digits(size, 2 if size < 1 else 3), scale.unit)


def _closed(before: float | None, after: float | None, noise: float | None) -> str:
    """How much of the gap is closed; a gap of less than half the noise is none."""
    if before is None or after is None or noise is None or not before > 1.5 * noise:
        return UNKNOWN
    return percent(min((before - after) / (before - noise), 1.0))


@dataclasses.dataclass(frozen=True)
class ParameterRow:
    """A parameter as a table shows it."""

    name: str
    value: str
    interval: str
    """Its 95 % interval, or why there is none."""
    unit: str
    meaning: str


def parameter_rows(
    parameters: Mapping[str, Estimate], kind: str | None = None, site: str | None = None, known: Collection[str] = ()
) -> list[ParameterRow]:
    """The parameters of an effect, or of the bridge where there is no kind.

    Args:
        parameters: by key.
        kind, site: of the effect.
        known: names of the model's parameters that were not estimated.
    """
    rows = []
    for key, estimate in parameters.items():
        number = shown(estimate)
        interval = number.interval
        if interval == UNKNOWN:
            name = key if kind is None else f"{kind}@{site}.{key}"
            interval = "known" if name in known else "chosen" if is_choice(kind, key) else UNKNOWN
        rows.append(ParameterRow(key, number.value, interval, number.unit, parameter_meaning(kind, key)))
    return rows


@dataclasses.dataclass(frozen=True)
class Part:
    """The parameters of one effect of a fitted model, or of its bridge where `kind` and `site` are None."""

    kind: str | None
    site: str | None
    parameters: Mapping[str, Estimate]


def parts(fit: Fit) -> list[Part]:
    """A fit's estimates, sorted into the bridge (first) and its effects (in the model's order).

    A locked rope has no numbers of a hoist.

    A name is `cart_gain`, or `kind@site.key`; `kind@site#2.key` belongs to a second effect of that kind there.
    """
    bridge: dict[str, Estimate] = {}
    effects: dict[str, dict[str, Estimate]] = {}
    for name, estimate in fit.estimates.items():
        owner, _, key = name.partition(".")
        if "@" in owner:
            effects.setdefault(owner, {})[key] = estimate
        elif name not in HOIST or fit.model.has_hoist:
            bridge[name] = estimate
    found = [Part(None, None, bridge)]
    for owner, parameters in effects.items():
        kind, _, place = owner.partition("@")
        found.append(Part(kind, place.partition("#")[0], parameters))
    return found


def was_sought(diagnosis: Diagnosis) -> bool:
    """Whether the search came as far as to fit another model."""
    return diagnosis.stopped == "criterion" or bool(diagnosis.trials)


def is_changed(diagnosis: Diagnosis) -> bool:
    """Whether the final model is another one than the model as given, refitted."""
    return bool(diagnosis.effects) or diagnosis.holdout_before != diagnosis.holdout_after


def units_of(parameters: Mapping[str, Estimate]) -> dict[str, str]:
    return {name: estimate.unit for name, estimate in parameters.items()}
