"""A hold-out taken from the recordings themselves where none was given, and what a hold-out cannot judge."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..model.effects.base import AXIS_OF_SITE, AbstractEffect, parameters_of
from ..model.plant import Plant
from ..recordings import Recording
from .adequacy import LARGE

_ABROAD = 0.25
"""Share of a hold-out's samples off a map from which on it cannot judge the map: a simulation keeps its errors."""

_BY_HEART = 3.0
"""Error of a hold-out over that of the recordings, from which a map that leaves much of them is no law of theirs."""


class OffMap(NamedTuple):
    """A hold-out that goes where a map of friction was not learned."""

    axis: str
    learned: tuple[float, float]
    """From where to where the recordings went [m]."""
    asked: tuple[float, float]
    """From where to where the hold-out goes [m]."""


def off_map(plant: Plant, named: Collection[tuple[str, str]], holdout: Sequence[Recording]) -> OffMap | None:
    """Whether a hold-out is largely where a named map over place knows nothing.

    A map's knots span what the recordings covered; beyond them its value is only carried on, which is no claim.

    Args:
        plant: the final model.
        named: kind and site of what was named.
        holdout: recordings that took no part.
    """
    for effect in _maps(plant, named):
        axis = AXIS_OF_SITE[effect.site]
        places = np.asarray(effect.knots)  # type: ignore[attr-defined]
        went = [getattr(r, axis) for r in holdout if (r.has_cart if axis == "x" else r.has_hoist)]
        if not went:
            continue
        values = np.concatenate(went)
        margin = 0.5 * float(places[1] - places[0])
        if np.mean((values < places[0] - margin) | (values > places[-1] + margin)) > _ABROAD:
            return OffMap(axis, (float(places[0]), float(places[-1])), (float(np.min(values)), float(np.max(values))))
    return None


def by_heart(
    plant: Plant, named: Collection[tuple[str, str]], left: Mapping[str, float], holdout: Mapping[str, float]
) -> bool:
    """Whether a named map over place took up of each recording what it could, and is no law.

    A map has a number for every place. One that is true leaves noise, and the rig's scatter, which a hold-out has as
    well; of a law that hangs on more than the place it takes up what the recordings happen to have in common.

    Args:
        plant: the final model.
        named: kind and site of what was named.
        left: error over noise of the recordings, by channel,
        holdout: and of the hold-out.
    """
    axes = {AXIS_OF_SITE[effect.site] for effect in _maps(plant, named)}
    return any(left[axis] > LARGE and not holdout[axis] <= _BY_HEART * left[axis] for axis in axes & {*left, *holdout})


def _maps(plant: Plant, named: Collection[tuple[str, str]]) -> Iterator[AbstractEffect]:
    for effect in plant.effects:
        knots = parameters_of(type(effect)).get("knots")
        if knots is not None and knots.unit == "{position}" and (effect.kind, effect.site) in named:
            yield effect


def split_off(recordings: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...], str]:
    """The last quarter of the recordings, or of the time of a single one, as hold-out."""
    if len(recordings) > 1:
        count = max(1, len(recordings) // 4)
        names = ", ".join(r.name for r in recordings[-count:])
        return (
            tuple(recordings[:-count]),
            tuple(recordings[-count:]),
            f"No hold-out was given: {names} took no part in the choice and serves as one.",
        )
    only = recordings[0]
    cut = int(0.75 * len(only.times))
    if min(cut, len(only.times) - cut) < 50:
        raise InputError(
            f"{only.name}: {len(only.times)} rows are too few to keep a quarter of them as hold-out; "
            "record longer, or give another recording with --holdout"
        )
    return (
        (only.rows(slice(None, cut)),),
        (only.rows(slice(cut, None)),),
        f"There is one recording: its last quarter, from {only.times[cut] - only.times[0]:.3g} s, took no part in the "
        "choice and serves as hold-out.",
    )
